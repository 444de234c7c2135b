"""Artificial rough surfaces with a given spectrum and a given height distribution.

The spectrum is that of the scan; the variance of the surface follows from it, since a surface
longer than the scan has longer waves too. The height distribution gives the shape: skewness,
kurtosis and tails. Two methods:

- ``"projection"``: alternating projections. Impose the amplitudes of the spectrum, then put
  heights, drawn independently, in the places of equal rank, and again. Every surface has the
  imposed spectrum and the heights drawn. The highest of n independent heights rises with n where
  the distribution has no bound, so that first touch depends on the number of pixels.
- ``"translation"``: a Gaussian field, every height mapped to the distribution. Spectrum and
  distribution are those of the family; single surfaces scatter about them as cuts of a large
  surface do. Works for any number of pixels.

Reference: F. Perez-Rafols, A. Almqvist, Tribology International 131 (2019) 591,
doi:10.1016/j.triboint.2018.11.020; ``translation.py`` for the second.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.fft

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import HeightDistribution, Measured, moments
from brake_fenicsx.surface.psd import BiFractal, half_plane_weights, wave_numbers
from brake_fenicsx.surface.rings import Rings
from brake_fenicsx.surface.topography import Array, Topography
from brake_fenicsx.surface.translation import TranslationField, translation_field

METHODS = ("projection", "translation")
VARIANCES = ("spectrum", "scan")
GAIN = 0.4  # exponent of the ring-wise correction of the imposed amplitudes
UNSEEN = 0.5  # share of the variance in waves that the scan never saw that is worth a warning
POOR = 0.05  # rms error of the radial PSD that is worth a warning
Density = Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class SynthesisRecord:
    """What the synthesis reached.

    Attributes:
        method: ``"projection"`` or ``"translation"``.
        psd_errors: rms over the rings of C / C_target - 1 after each iteration, heights imposed;
            for a translation field that of the family's mean.
        height_error: largest deviation of the moments of the surface's heights from those
            imposed: mean over S_q, S_q relative, S_sk, S_ku [-]; nan for translation fields, which
            scatter about the distribution.
        C0_scale: factor between the given PSD and the one imposed: 1, unless the variance is that
            of the scan [-].
        S_q: root-mean-square height of the imposed PSD [m].
        low: treatment of the wave numbers below the scan's band.
        low_share: share of the variance in those wave numbers [-].
    """

    method: str
    psd_errors: tuple[float, ...]
    height_error: float
    C0_scale: float
    S_q: float
    low: str
    low_share: float

    @property
    def psd_error(self) -> float:
        """Error of the finished surface [-]."""
        return self.psd_errors[-1]

    @property
    def iterations(self) -> int:
        """Number of projections on the heights."""
        return len(self.psd_errors)


def synthesise(
    psd: BiFractal | Density,
    hdf: HeightDistribution,
    shape: tuple[int, int],
    size: tuple[float, float],
    rng: np.random.Generator,
    low: str = "flat",
    method: str | None = None,
    variance: str = "spectrum",
    tolerance: float = 1e-2,
    max_iterations: int = 40,
) -> Topography:
    """Make one periodic artificial surface.

    Args:
        psd: density C(q) [m^4] of the wave number [rad/m].
        hdf: distribution of the heights.
        shape: pixels (nx, ny).
        size: lengths [m], shape (2,).
        rng: source of phases and heights.
        low: where the surface is longer than the scan, ``"extend"`` the power law or hold it
            ``"flat"``; for a plain function of q it has no effect.
        method: ``"projection"`` or ``"translation"``; if not given, projection for measured
            heights, which have a highest one, and translation for others.
        variance: ``"spectrum"``: that of ``psd`` on this grid, and ``hdf`` is scaled to it;
            ``"scan"``: that of ``hdf``, and ``psd`` is scaled to it (the source's reading, which
            puts a surface longer than the scan below its spectrum).
        tolerance: rms error of the radial PSD at which the projections stop [-].
        max_iterations: projections at most.

    Returns:
        Surface with zero mean; its ``record`` tells the errors reached, its ``warnings`` what is
        doubtful about it.

    Raises:
        SurfaceError: an argument without meaning, or a PSD without power on this grid.
    """
    if min(shape) < 2 or min(size) <= 0.0:
        raise SurfaceError(f"surface of {shape} pixels and {size} m; at least 2 x 2 and positive")
    if variance not in VARIANCES:
        raise SurfaceError(f"variance = {variance!r}; choose one of {', '.join(VARIANCES)}")
    if method is None:
        method = "projection" if isinstance(hdf, Measured) else "translation"
    if method not in METHODS:
        raise SurfaceError(f"method = {method!r}; choose one of {', '.join(METHODS)}")
    target = _target(psd, tuple(shape), (float(size[0]), float(size[1])), low)
    S_q = hdf.S_q if variance == "scan" else float(np.sqrt(target.variance))
    if method == "translation":
        field = _field(psd, hdf, target.shape, target.size, low)
        heights = S_q * field.sample(rng)
        errors: tuple[float, ...] = (field.psd_error,)
        missed = float("nan")
    else:
        z = hdf.ordered_sample(shape[0] * shape[1], rng)
        z -= z.mean()
        if variance == "spectrum":
            z *= S_q / z.std()
        S_q = float(z.std())
        heights, errors = _project(target, z, rng, tolerance, max_iterations)
        missed = _moments_missed(heights, z)
    heights = heights - heights.mean()
    scale = S_q**2 / target.variance
    record = SynthesisRecord(method, errors, missed, scale, S_q, low, target.low_share)
    lengths = np.array(size, dtype=float)
    return Topography(heights, lengths, True, "artificial surface", _doubts(record), record)


@dataclass(frozen=True, slots=True)
class _Target:
    """Spectrum on a grid: shares of the variance [-], the variance [m^2], the share below band."""

    shape: tuple[int, int]
    size: tuple[float, float]
    shares: Array
    variance: float
    low_share: float


@functools.lru_cache(maxsize=4)
def _target(
    psd: BiFractal | Density, shape: tuple[int, int], size: tuple[float, float], low: str
) -> _Target:
    """The spectrum that surfaces of this grid are to have."""
    lengths = np.array(size)
    q = wave_numbers(shape, lengths)
    if isinstance(psd, BiFractal):
        C = psd(q, low)
    elif low not in ("extend", "flat"):
        raise SurfaceError(f"low = {low!r}; choose 'extend' or 'flat'")
    else:
        C = np.where(q > 0.0, psd(np.where(q > 0.0, q, q[q > 0.0].min())), 0.0)
    powers = C * 4.0 * np.pi**2 / np.prod(lengths)
    weighted = half_plane_weights(shape) * powers
    variance = float(weighted.sum())
    if not variance > 0.0:
        raise SurfaceError("the PSD vanishes on this grid; a rough surface needs some roughness")
    lo = (psd.form or psd).band[0] if isinstance(psd, BiFractal) else 0.0
    below = float(weighted[q < lo * (1.0 - 1e-12)].sum()) / variance
    return _Target(shape, size, powers / variance, variance, below)


@functools.lru_cache(maxsize=4)
def _field(
    psd: BiFractal | Density, hdf: HeightDistribution, shape: tuple[int, int],
    size: tuple[float, float], low: str,
) -> TranslationField:  # fmt: skip
    """The translation field of a library, prepared once."""
    target = _target(psd, shape, size, low)
    return translation_field(target.shares, hdf, shape, np.array(size))


def _doubts(record: SynthesisRecord) -> tuple[str, ...]:
    """What a user should know of this surface, one line each."""
    found = []
    if record.psd_error > POOR:
        after = f" after {record.iterations} iterations" if record.method == "projection" else ""
        found.append(
            f"PSD missed by {record.psd_error:.1%} rms{after}: heights and spectrum contradict"
            " each other; smooth the height distribution or choose the other 'synthesis'"
        )
    if record.low_share > UNSEEN:
        flat = " or hold the PSD 'flat'" if record.low == "extend" else ""
        found.append(
            f"{record.low_share:.0%} of the variance lies in waves longer than those that the scan"
            f" measures reliably (low = {record.low!r}); scan a larger area, make smaller"
            f" patches{flat}"
        )
    return tuple(f"artificial surface: {text}" for text in found)


def _project(
    target: _Target, z: Array, rng: np.random.Generator, tolerance: float, max_iterations: int
) -> tuple[Array, tuple[float, ...]]:
    """Alternate between amplitudes and heights; the best heights and the errors on the way."""
    rings = Rings(target.shape, np.array(target.size), target.shares * (z.size**2 * z.var()))
    amplitude = z.size * np.sqrt(target.shares * z.var())
    f = scipy.fft.rfft2(rng.standard_normal(target.shape))
    errors: list[float] = []
    best: Array = np.empty(0)
    lowest = np.inf
    for _ in range(max_iterations):
        size = np.abs(f)
        f *= np.divide(amplitude, size, out=np.zeros_like(size), where=size > 0.0)
        heights = _place(scipy.fft.irfft2(f, s=target.shape), z)
        f = scipy.fft.rfft2(heights)
        ratio = rings.ratio(f.real**2 + f.imag**2)
        errors.append(rings.error(ratio))
        if errors[-1] < lowest:
            best, lowest = heights, errors[-1]
        if lowest <= tolerance or _stalled(errors):
            break
        # Ring by ring, ask for more of what the heights took away.
        amplitude = amplitude * rings.spread(np.clip(ratio, 0.25, 4.0) ** -GAIN)
    return best, (*errors[:-1], lowest)


def _place(h: Array, z: Array) -> Array:
    """Heights z (ascending) in the places of rank of h; ranks of 16 bits, ties in grid order.

    A level of 1 / 65535 of the range is 1e-4 S_q: less than any height is known to.
    """
    low, high = h.min(), h.max()
    levels = ((h - low) * (65535.0 / max(high - low, 1e-300))).astype(np.uint16)
    placed = np.empty(z.size)
    placed[np.argsort(levels, axis=None, kind="stable")] = z
    return placed.reshape(h.shape)


def _moments_missed(heights: Array, z: Array) -> float:
    """Largest deviation of the four moments of ``heights`` from those of ``z``."""
    mean, S_q, S_sk, S_ku = moments(heights.ravel())
    mean_z, S_q_z, S_sk_z, S_ku_z = moments(z)
    misses = ((mean - mean_z) / S_q_z, S_q / S_q_z - 1.0, S_sk - S_sk_z, S_ku - S_ku_z)
    return max(abs(miss) for miss in misses)


def _stalled(errors: list[float]) -> bool:
    """Whether the last ten of many iterations found nothing better."""
    return len(errors) > 20 and min(errors[-10:]) > 0.99 * min(errors[:-10])
