"""Artificial rough surfaces with a given spectrum and height distribution, and scans of them.

The spectrum is that of the scan; the variance of the surface follows from it, since a surface
longer than the scan has longer waves too. The height distribution gives the shape: skewness,
kurtosis and tails. Surfaces are translation fields: both are those of the
family, and single surfaces scatter about them as cuts of one long surface do, the highest points
included.

A translation field is a Gaussian field of which every height is mapped to another distribution.
With x a Gaussian field of unit variance, z = T(x) has the distribution whose quantile function is
T(x) = P^-1(Phi(x)). Expanded in Hermite polynomials, T = sum_k t_k He_k / sqrt(k!), the
correlation r of x becomes g(r) = sum_k t_k^2 r^k, a monotone function. The field x therefore gets
the correlation g^-1(R), where R belongs to the wanted spectrum. Neighbouring heights depend on
each other as the spectrum says, so that the highest summit converges with the number of pixels.

Reference: M. Grigoriu, J. Eng. Mech. 124 (1998) 121,
doi:10.1061/(ASCE)0733-9399(1998)124:2(121); M. D. Shields, G. Deodatis, P. Bocchini, Prob. Eng.
Mech. 26 (2011) 511, doi:10.1016/j.probengmech.2011.04.003 (iteration on the spectrum).

Statistics as another scan of the surface would give them are those of a cut of an artificial
surface of the same statistics, twice as long as the scan: it has the scatter of long waves and of
few summits, and is levelled and described like the scan (parametric bootstrap). Tiles of the scan
drawn with replacement, the block bootstrap, scatter half as much as scans do: a scan holds few of
its own longest waves.

Reference: B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap (1993), section 6.5,
doi:10.1201/9780429246593.
"""

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.fft
from scipy.special import ndtr

from brake_fenicsx.arguments import Array, one_of
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import HeightDistribution, moments, pooled
from brake_fenicsx.surface.psd import Density, half_plane_weights, wave_numbers, wave_vectors
from brake_fenicsx.surface.record import SurfaceStatistics
from brake_fenicsx.surface.spectrum import LOW, BiFractal
from brake_fenicsx.surface.statistics import described
from brake_fenicsx.surface.topography import SynthesisRecord, Topography, form

_polynomial: Any = np.polynomial.polynomial
TERMS = 40  # Hermite polynomials; a Johnson distribution of kurtosis 10 needs about 20
REACH = 7.0  # standard deviations of x that are tabulated: 3e-12 of the points lie beyond
ENOUGH = 1e-3  # error of the spectrum at which the iteration stops
VARIANCES = ("spectrum", "scan")
UNSEEN = 0.5  # share of the variance in waves that the scan never saw that is worth a warning
POOR = 0.05  # error of the radial PSD that is worth a warning
WRONG = 0.25  # error of the rms slope that no law survives


@dataclass(frozen=True, slots=True)
class TranslationField:
    """A family of surfaces, prepared once.

    Attributes:
        amplitude: amplitudes of the Gaussian field on the half plane of ``rfft2``, for white noise.
        x: Gaussian heights of the table [-], ascending.
        z: heights they are mapped to, of zero mean and unit variance [-].
        shape: pixels (nx, ny).
        psd_error: rms over the rings of the family's mean spectrum over the wanted one, minus one;
            rings weigh as in the mean square slope.
        slope_ratio: rms slope of the family over that of the wanted spectrum [-].
    """

    amplitude: Array
    x: Array
    z: Array
    shape: tuple[int, int]
    psd_error: float
    slope_ratio: float

    def sample(self, rng: np.random.Generator) -> Array:
        """One surface of unit variance in the mean of the family [-], shape (nx, ny)."""
        noise = scipy.fft.rfft2(rng.standard_normal(self.shape))
        return _on_even(scipy.fft.irfft2(noise * self.amplitude, s=self.shape), self.x, self.z)


def translation_field(
    shares: Array,
    hdf: HeightDistribution,
    shape: tuple[int, int],
    size: Array,
    iterations: int = 20,
) -> TranslationField:
    """Prepare the field of a spectrum and a distribution.

    Args:
        shares: share of every wave vector of ``rfft2`` in the variance, zero at the mean plane;
            their sum over the full plane is one, shape (nx, ny // 2 + 1).
        hdf: distribution of the heights; its shape counts, not its spread.
        shape: pixels (nx, ny).
        size: lengths [m], shape (2,).
        iterations: corrections of the spectrum at most; they act where g^-1(R) is not the
            correlation of any field and its negative part has been cut off.
    """
    weights = half_plane_weights(shape)
    x: Array = np.linspace(-REACH, REACH, 8001, dtype=float)
    z, powers = expansion(hdf, x)
    r = np.linspace(-1.0, 1.0, 4001)
    g = _polynomial.polyval(r, powers)
    wanted: Array = np.asarray(shares / float((weights * shares).sum()), float)
    gaussian = _spectrum(np.interp(_correlation(wanted, shape), g, r), shape)
    q = wave_numbers(shape, size)
    ring, slopes = np.rint(q / q[q > 0.0].min()).astype(np.intp).ravel(), weights * q**2
    best, lowest, slope = gaussian, np.inf, np.inf
    for _ in range(iterations):
        gaussian = np.maximum(gaussian, 0.0)
        gaussian[0, 0] = 0.0
        gaussian /= float((weights * gaussian).sum())
        translated = _spectrum(_on_even(_correlation(gaussian, shape), r, g), shape)
        asked, got = (np.bincount(ring, (slopes * a).ravel()) for a in (wanted, translated))
        missed = np.divide(got - asked, asked, out=np.zeros_like(got), where=asked > 0.0)
        error = float(np.sqrt(asked @ missed**2 / asked.sum()))
        if error < lowest:
            best, lowest, slope = gaussian, error, float(np.sqrt(got.sum() / asked.sum()))
        if lowest <= ENOUGH or error > 2.0 * lowest:
            break
        ratio = np.divide(wanted, translated, out=np.ones_like(translated), where=translated > 0.0)
        gaussian = gaussian * np.clip(ratio, 0.5, 2.0)
    amplitude = np.asarray(np.sqrt(best * (shape[0] * shape[1])), float)
    return TranslationField(amplitude, x, z, shape, lowest, slope)


def _on_even(at: Array, x: Any, y: Array) -> Array:
    """Values between those of a table with an even step, whose ends hold beyond it."""
    place = np.clip((at - x[0]) / (x[1] - x[0]), 0.0, x.size - 1.0)
    left = np.minimum(place.astype(np.intp), x.size - 2)
    return np.asarray(y[left] + (place - left) * np.diff(y)[left])


def expansion(hdf: HeightDistribution, x: Array) -> tuple[Array, Array]:
    """Heights T(x) of zero mean and unit variance, and the squares t_k^2, whose sum is one.

    Args:
        hdf: distribution of the heights.
        x: normal heights [-], evenly spaced from -7 to 7.
    """
    weight = np.exp(-0.5 * x**2)
    weight = weight / weight.sum()
    z = hdf.ppf(ndtr(x))
    z = z - weight @ z
    z = z / np.sqrt(weight @ z**2)
    before, now = np.ones_like(x), x
    terms = [0.0, float(weight @ (z * now))]
    for k in range(2, TERMS):
        before, now = now, (x * now - np.sqrt(k - 1.0) * before) / np.sqrt(k)
        terms.append(float(weight @ (z * now)))
    powers = np.array(terms) ** 2
    return z, powers / powers.sum()


def _correlation(shares: Array, shape: tuple[int, int]) -> Array:
    """Correlation of a spectrum given as shares of the variance [-], shape (nx, ny)."""
    return np.asarray(scipy.fft.irfft2(shares * (shape[0] * shape[1]), s=shape))


def _spectrum(correlation: Array, shape: tuple[int, int]) -> Array:
    """Shares of the variance, the inverse of ``_correlation``."""
    return np.asarray(scipy.fft.rfft2(correlation).real / (shape[0] * shape[1]))


def synthesise(
    psd: BiFractal | Density,
    hdf: HeightDistribution,
    shape: tuple[int, int],
    size: tuple[float, float],
    rng: np.random.Generator,
    low: str = "flat",
    variance: str = "spectrum",
) -> Topography:
    """Make one periodic artificial surface.

    Args:
        psd: density C(q) [m^4] of the wave number [rad/m]; a ``BiFractal`` may have a direction.
        hdf: distribution of the heights.
        shape: pixels (nx, ny).
        size: lengths [m], shape (2,).
        rng: source of the random field.
        low: where the surface is longer than the scan, ``"extend"`` the power law or hold it
            ``"flat"``; for a plain function of q it has no effect.
        variance: ``"spectrum"``: that of ``psd`` on this grid, and ``hdf`` is scaled to it;
            ``"scan"``: that of ``hdf``, and ``psd`` is scaled to it (the source's reading, which
            puts a surface longer than the scan below its spectrum).

    Returns:
        Surface with zero mean; its ``record`` tells the errors reached, its ``warnings`` what is
        doubtful about it.

    Raises:
        SurfaceError: an argument without meaning, a PSD without power on this grid, or one that
            such heights cannot have.
    """
    if min(shape) < 2 or min(size) <= 0.0:
        raise SurfaceError(f"surface of {shape} pixels and {size} m; at least 2 x 2 and positive")
    one_of("variance", variance, VARIANCES)
    one_of("low", low, LOW)
    grid = (shape[0], shape[1]), (float(size[0]), float(size[1]))
    asked, low_share, field = _family(psd, hdf, *grid, low)
    S_q = hdf.S_q if variance == "scan" else float(np.sqrt(asked))
    heights = S_q * field.sample(rng)
    record = SynthesisRecord(
        field.psd_error, field.slope_ratio, S_q**2 / asked, S_q, low, low_share
    )
    lengths = np.array(size, dtype=float)
    surface = heights - heights.mean()
    return Topography(surface, lengths, True, "artificial surface", _doubts(record), record)


@functools.lru_cache(maxsize=4)
def _family(
    psd: BiFractal | Density, hdf: HeightDistribution, shape: tuple[int, int],
    size: tuple[float, float], low: str,
) -> tuple[float, float, TranslationField]:  # fmt: skip
    """Of all surfaces of a grid, once: variance [m^2], its share below the band, the field."""
    powers, variance, low_share = _powers(psd, shape, np.array(size), low)
    field = translation_field(powers * (1.0 / variance), hdf, shape, np.array(size))
    if not abs(field.slope_ratio - 1.0) < WRONG:
        raise SurfaceError(f"""artificial surfaces of {shape[0]} x {shape[1]} pixels have
            {field.slope_ratio:.3g} times the rms slope of the spectrum: no surface has these
            heights and this spectrum; check the scan for steps and noise, or choose another
            'distribution'""")
    return variance, low_share, field


def _powers(
    psd: BiFractal | Density, shape: tuple[int, int], size: Array, low: str
) -> tuple[Array, float, float]:
    """Variance of every wave vector [m^2], of all, and the share of those below the band [-]."""
    q = wave_numbers(shape, size)
    if isinstance(psd, BiFractal):
        C, lo = psd.on(*wave_vectors(shape, size), low), (psd.form or psd).band[0]
    else:
        C, lo = np.where(q > 0.0, psd(np.where(q > 0.0, q, q[q > 0.0].min())), 0.0), 0.0
    powers = C * (4.0 * np.pi**2 / float(np.prod(size)))
    weighted = half_plane_weights(shape) * powers
    variance = float(weighted.sum())
    if not 0.0 < variance < np.inf:
        raise SurfaceError(f"""the variance of the PSD on this grid is {variance:.3g} m^2; a rough
            surface needs some roughness, and a finite one""")
    below = float(weighted[q < lo * (1.0 - 1e-12)].sum()) / variance
    return powers, variance, below


def _doubts(record: SynthesisRecord) -> tuple[str, ...]:
    """What a user should know of this surface, one line each."""
    found = []
    if record.psd_error > POOR:
        found.append(
            f"PSD missed by {record.psd_error:.1%} rms: heights and spectrum contradict each other;"
            " choose another 'distribution'"
        )
    if record.low_share > UNSEEN:
        flat = " or hold the PSD 'flat'" if record.low == "extend" else ""
        found.append(
            f"{record.low_share:.0%} of the variance lies in waves longer than those that the scan"
            f" measures reliably (low = {record.low!r}); scan a larger area, make smaller"
            f" patches{flat}"
        )
    return tuple(f"artificial surface: {text}" for text in found)


def resampled(stats: SurfaceStatistics, rng: np.random.Generator) -> SurfaceStatistics:
    """Statistics of as many other scans as they were taken from, without errors and doubts.

    Args:
        stats: statistics of scans.
        rng: random numbers of the draw.

    Raises:
        SurfaceError: the statistics were given by numbers alone.
    """
    if stats.psd is None or not stats.topographies:
        raise SurfaceError("statistics given by numbers have no scan that could be drawn anew")
    kind = "fit" if stats.spectrum.misfit is None else "measured"
    kind = kind if stats.spectrum.lay is None else "directional"
    scans = []
    for one in stats.each:
        scan = _other(stats, one, rng)
        heights = scan.heights - form(scan, stats.level)
        scans.append(replace(scan, heights=heights - np.nanmean(heights)))
    heights = pooled([scan.heights for scan in scans])
    cutoff, no_errors = 2.0 * np.pi / stats.psd.band[1], (np.nan,) * 4
    found = described(scans, stats.level, cutoff, stats.hdf.name, kind)
    found["spectrum"] = replace(found["spectrum"], form=stats.spectrum.form)
    mean, S_q, S_sk, S_ku = moments(heights)
    return SurfaceStatistics(
        mean, float(np.median(heights)), S_q, S_sk, S_ku, no_errors, **found, level=stats.level
    )


def _other(
    stats: SurfaceStatistics, one: SurfaceStatistics, rng: np.random.Generator
) -> Topography:
    """A scan of the size, the pixels and the missing points of another.

    Where the deepest points were missing the surface has flat valleys, and none is missing.
    """
    scan = one.topographies[0]
    (nx, ny), times = scan.shape, 1 if scan.periodic else 2
    size = times * scan.size
    whole = synthesise(
        stats.spectrum, stats.hdf, (times * nx, times * ny), (size[0], size[1]), rng, "extend"
    )
    shown = scan.valid | (one.lost == "deepest")
    heights = np.where(shown, whole.heights[:nx, :ny], np.nan)
    return replace(scan, heights=heights, source=f"{scan.source}, drawn anew")
