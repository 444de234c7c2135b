"""The spectrum that artificial surfaces are made from, its direction, and the waviness it gives.

It is a bi-fractal fit, or that of the scan: the fit times its misfit, which is held beyond the
reliable band, so that both are continued alike: as power laws, or constant below the band.

Its radial mean is measured by ``psd.radial_psd``; the factor that makes a two-dimensional spectrum
of it says how the density of each wave number is spread over the angles, with mean 1. It is the
density of each wave vector over that of its ring, smoothed: over wave numbers by about a fifth,
over angles by half a step of the scan's grid of wave vectors, its resolution, and never by less
than a degree.

Waviness is the part that is longer than a patch, the mean heights of the patches of a face. The
laws hold the waves of a patch of side L, those of the wave vectors 2 pi (i, j) / L without (0, 0).
What they leave out is the height of the patch's mean plane: a Gaussian field whose spectrum is that
of the surface times the square of the transform of a patch, W = sinc(q_x L / 2) sinc(q_y L / 2),
that is heights averaged over every patch, correlated between neighbours as the spectrum says. The
sum of both variances is that of the surface, to one or two per cent where the spectrum rolls off at
waves shorter than a patch; for patches shorter than that the sum is too low, by 15 % at half of it.

Reference: E. Vanmarcke, Random Fields (1983), chapter 5 (local averages).
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import scipy.fft
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.optimize import brentq, least_squares

from brake_fenicsx.arguments import Array, one_of
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.psd import (
    RadialPsd,
    half_plane_weights,
    of_equal_length,
    psd_2d,
    seen_in_scans,
    wave_vectors,
)
from brake_fenicsx.surface.topography import Scans, Topography, first

LOW = ("extend", "flat")
SPECTRA = ("fit", "measured", "directional")
MODEL = 0.01  # variance of ln C that a ring has beyond its scatter
SMOOTH = 0.07  # standard deviation over ln q of the weights of rings: nearly one ring
WINDOW = 0.3  # and over q, in grid steps: half the width of the transform of a scan's area
ITERATIONS = 12
ANGLES = 360  # over half a turn
SPACING, BLUR = 0.2, 0.2  # of the rings over ln q, and standard deviation of their weights
ACROSS, LEAST = 0.5, np.radians(1.0)  # standard deviation over angles, in steps of q and in radians
MOST = 5.0  # change of ln C of the waves longer than the reliable band

PER_PATCH = 4  # grid points along a patch: the averaged field has no shorter waves than a patch
LONGEST = 4096  # grid points along a side of the field


@dataclass(frozen=True, slots=True, eq=False)
class Lay:
    """Density at a wave vector over the radial mean.

    Attributes:
        q: wave numbers of rings [rad/m], evenly spaced in ln q, shape (n,).
        share: factor at the middles of angles between 0 and pi; first the last of them once more,
            and at the end the first, shape (n, 362).
        turn: angle by which the surface is turned from the scan [rad].
    """

    q: Array
    share: Array
    turn: float = 0.0

    def __call__(self, qx: Array, qy: Array) -> Array:
        """Factor [-] at wave vectors [rad/m]; beyond the rings that of the first or the last."""
        q = np.maximum(np.hypot(qx, qy), 1e-300)
        angle = np.mod(np.arctan2(qy, qx + 0.0 * qy) - self.turn, np.pi)
        ring = np.log(q / self.q[0]) / SPACING
        at = [np.clip(ring, 0.0, len(self.q) - 1.0), angle * (ANGLES / np.pi) + 0.5]
        return np.asarray(map_coordinates(self.share, at, order=1, mode="nearest"))


def lay_of(scans: Scans, highest: float) -> Lay:
    """How the variance of levelled scans is spread over directions.

    Args:
        scans: levelled scan, or several.
        highest: wave number up to which they show the surface [rad/m].
    """
    C, topo = psd_2d(scans), first(scans)
    qx, qy = wave_vectors(topo.shape, topo.size)
    step = 2.0 * np.pi / float(topo.size.min())
    q, angle = np.hypot(qx, qy), np.mod(np.arctan2(qy, qx + 0.0 * qy), np.pi)
    weights = np.broadcast_to(half_plane_weights(topo.shape), q.shape)
    used = (q > 0.5 * step) & (q < 1.2 * highest)
    q, angle, C, weights = q[used], angle[used], C[used], weights[used]
    ring = np.rint(q / step).astype(int)
    mean = np.bincount(ring, weights * C) / np.maximum(np.bincount(ring, weights), 1e-300)
    relative = C / mean[ring]
    place = np.minimum((angle * (ANGLES / np.pi)).astype(int), ANGLES - 1)
    rings = step * np.exp(np.arange(0.0, max(np.log(highest / step), SPACING), SPACING))
    rows = []
    for middle in rings:
        near = np.hypot(BLUR, ACROSS * step / middle)
        w = weights * np.exp(-0.5 * (np.log(q / middle) / near) ** 2)
        sums = np.stack([np.bincount(place, x, ANGLES) for x in (w * relative, w)])
        width = max(ACROSS * step / middle, LEAST) * ANGLES / np.pi
        power, count = gaussian_filter1d(sums, width, axis=1, mode="wrap", truncate=6.0)
        share = power / np.maximum(count, 1e-12 * count.max())
        rows.append(share / share.mean())
    table = np.array(rows)
    return Lay(rings, np.pad(table, ((0, 0), (1, 1)), mode="wrap"))


@dataclass(frozen=True, slots=True)
class BiFractal:
    """Continuous broken power law, C0 (q/q_c)^c1 below q_c, C0 (q/q_c)^c2 above, times its misfit.

    Attributes:
        c1: slope below the corner, log C over log q [-].
        c2: slope above the corner [-].
        q_c: corner wave number [rad/m].
        C0: density at the corner [m^4].
        band: wave numbers the parameters were taken from (lo, hi) [rad/m].
        errors: standard errors of (c1, c2, ln q_c, ln C0); nan where the parameters are given.
        rms: root-mean-square deviation of ln C from the fit; nan where given.
        misfit: ln q [rad/m] of rings, and ln of the measured density there over the power law;
            none for the power law itself.
        form: spectrum of a longer, coarser scan, taken below the band; None where there is none.
        lay: how the density is spread over directions; None for an isotropic surface.
    """

    c1: float
    c2: float
    q_c: float
    C0: float
    band: tuple[float, float]
    # Undefined numbers equal nothing, and equal spectra share the fields made from them.
    errors: tuple[float, float, float, float] = field(default=(np.nan,) * 4, compare=False)
    rms: float = field(default=np.nan, compare=False)
    misfit: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    form: "BiFractal | None" = None
    lay: Lay | None = None

    def __call__(self, q: Array, low: str = "extend") -> Array:
        """Bi-fractal spectrum: density [m^4] at wave numbers q > 0 [rad/m], Eq. (17).

        Args:
            q: wave numbers [rad/m]; the density at q = 0 is zero (the mean plane).
            low: below the band's lower end, ``"extend"`` the power law or hold it ``"flat"``;
                with a ``form``, below the band of that.
        """
        one_of("low", low, LOW)
        q = np.asarray(q, dtype=float)
        x = np.where(q > 0.0, q, self.q_c)
        ln_q = np.log(np.maximum(x, self.band[0]) if low == "flat" else x)
        ln_C = _broken(ln_q, (np.log(self.C0), self.c1, self.c2, np.log(self.q_c)))
        if self.misfit is not None:
            ln_C += np.interp(ln_q, *self.misfit)
        C = np.exp(ln_C)
        if self.form is not None:
            C = np.where(q < self.band[0], self.form(q, low), C)
        return np.where(q > 0.0, C, 0.0)

    def on(self, qx: Array, qy: Array, low: str = "extend") -> Array:
        """Density [m^4] at wave vectors [rad/m], of which the call is the mean over directions."""
        C = self(np.hypot(qx, qy), low)
        return C if self.lay is None else C * self.lay(qx, qy)

    @property
    def convex(self) -> bool:
        """Whether the spectrum falls more slowly above the corner, beyond its standard errors."""
        doubt = np.nan_to_num(np.hypot(self.errors[0], self.errors[1]))
        return bool(self.c2 - self.c1 > 2.0 * doubt)

    def variance(self, lo: float, hi: float) -> float:
        """Variance [m^2] of the wave numbers between ``lo`` and ``hi`` [rad/m]."""
        total = 0.0
        pieces = ((lo, min(hi, self.q_c), self.c1), (max(lo, self.q_c), hi, self.c2))
        for start, end, slope in pieces:
            if end > start:
                a, b = start / self.q_c, end / self.q_c
                n = slope + 2.0
                total += np.log(b / a) if abs(n) < 1e-12 else (b**n - a**n) / n
        return 2.0 * np.pi * self.C0 * self.q_c**2 * total


def spectrum_of(scans: Scans, psd: RadialPsd, fit: BiFractal, kind: str) -> BiFractal:
    """The fit of a measured spectrum, or the spectrum of which scans show the measured one.

    The variance of rings, summed with the weights of a normal curve over ln q, is compared with
    that which scans would show of the spectrum, and their ratio corrects the spectrum
    (Richardson-Lucy iteration, stopped early, so that single rings are not copied). The waves
    longer than the reliable band get the level with which a periodic surface of the scan's side
    has its variance: levelling takes from them what no correction brings back.

    Args:
        scans: levelled scan, or several.
        psd: their radial mean.
        fit: of that.
        kind: ``"fit"``, ``"measured"``, or ``"directional"``: measured, with its direction.

    Reference: L. B. Lucy, Astron. J. 79 (1974) 745, doi:10.1086/111605.
    """
    one_of("spectrum", kind, SPECTRA)
    if kind == "fit":
        return fit
    if kind == "directional":
        fit = replace(fit, lay=lay_of(scans, psd.band[1]))
    use = psd.reliable
    x = np.log(psd.q[use])
    width = np.hypot(SMOOTH, WINDOW * psd.q[0] / psd.q[use])[:, None]
    kernel = np.exp(-0.5 * ((x[:, None] - x) / width) ** 2) * (psd.q * np.gradient(psd.q))[use]
    every = [scans] if isinstance(scans, Topography) else scans
    variance = float(np.mean([np.nanvar(scan.heights) for scan in every]))
    found, ln_ratio = fit, np.zeros(x.size)
    for _ in range(ITERATIONS):
        seen = seen_in_scans(partial(found, low="flat"), first(scans))[use]
        ln_ratio = ln_ratio + np.log((kernel @ psd.C[use]) / (kernel @ seen))
        found = replace(fit, misfit=(tuple(map(float, x)), tuple(map(float, ln_ratio))))
        if not first(scans).periodic:
            found = _closed(found, first(scans), variance)
    return found


def variance_on(spectrum: BiFractal, topo: Topography, below: float = np.inf) -> float:
    """Variance [m^2] of periodic surfaces with the sides and the pixels of a scan.

    Args:
        spectrum: of the surfaces.
        topo: the scan.
        below: wave number that the waves stay below [rad/m].
    """
    q, weights = _wave_numbers(topo.shape, (float(topo.size[0]), float(topo.size[1])), spectrum.lay)
    counted = q < below
    return float(weights[counted] @ spectrum(q[counted], "flat"))


@lru_cache(maxsize=4)
def _wave_numbers(
    shape: tuple[int, int], size: tuple[float, float], lay: Lay | None
) -> tuple[Array, Array]:
    """Wave numbers of periodic surfaces [rad/m], and the variance that unit density has there.

    Wave vectors of nearly the same length count as one.
    """
    qx, qy = wave_vectors(shape, np.array(size))
    weights = half_plane_weights(shape) * (4.0 * np.pi**2 / np.prod(size))
    weights = np.outer(np.ones(shape[0]), weights) if lay is None else weights * lay(qx, qy)
    ln_q, weights = np.log(np.hypot(qx, qy).ravel()[1:]), weights.ravel()[1:]
    place, middles = of_equal_length(ln_q)
    return np.exp(middles), np.bincount(place, weights).astype(float)


def _closed(found: BiFractal, topo: Topography, wanted: float) -> BiFractal:
    """A spectrum whose long waves bring the variance of periodic surfaces to a wanted one [m^2]."""
    x, ln_ratio = found.misfit or ((), ())
    longest = 2.0 * np.pi / float(topo.size.max())

    def with_level(change: float) -> BiFractal:
        misfit = ((float(np.log(longest)), *x), (ln_ratio[0] + change, *ln_ratio))
        return replace(found, band=(longest, found.band[1]), misfit=misfit)

    def missed(change: float) -> float:
        return variance_on(with_level(change), topo, shortest) - wanted + rest

    shortest = float(np.exp(x[0]))
    rest = variance_on(found, topo) - variance_on(found, topo, shortest)
    low, high = missed(-MOST), missed(MOST)
    if low * high > 0.0:
        return with_level(-MOST if low > 0.0 else MOST)
    return with_level(float(brentq(missed, -MOST, MOST, xtol=1e-6)))


def fit_bifractal(psd: RadialPsd) -> BiFractal:
    """Least-squares fit of the broken power law to ln C over ln q in the reliable band.

    ln C of a ring has the variance of its scatter and lies half of it low; what the model itself
    misses is estimated from the residual and added, so that a real surface weighs all rings alike
    and an ideal one weighs them by their wave vectors. The corner leaves two rings or more
    on either side and is sought from several starts;
    standard errors follow from the Jacobian and the residual.

    Raises:
        SurfaceError: fewer than six rings in the band.
    """
    use = psd.reliable
    if use.sum() < 6:
        raise SurfaceError(f"""bi-fractal fit: {use.sum()} rings between {psd.band[0]:.3g} and
            {psd.band[1]:.3g} rad/m, at least 6 are needed; scan a larger area or give
            'statistics'""")
    scatter = psd.scatter[use]
    x, y = np.log(psd.q[use]), np.log(psd.C[use]) + 0.5 * scatter
    missed = MODEL
    for _ in range(3):
        weights = 1.0 / np.sqrt(scatter + missed)
        v, jacobian, cost = _best_start(x, y, weights)
        residual = _broken(x, v) - y
        missed = max(float(np.mean(residual**2 - scatter)), 1e-6)
    spread = 2.0 * cost / max(x.size - 4, 1)
    e = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian) * spread))
    errors = (float(e[1]), float(e[2]), float(e[3]), float(e[0]))
    rms = float(np.sqrt(np.mean(residual**2)))
    q_c, C0 = float(np.exp(v[3])), float(np.exp(v[0]))
    return BiFractal(float(v[1]), float(v[2]), q_c, C0, psd.band, errors, rms)


def _best_start(x: Array, y: Array, weights: Array) -> tuple[Array, Array, float]:
    """Parameters, Jacobian and cost of the best of several fits with different corners."""
    fits = []
    for share in (0.2, 0.35, 0.5, 0.65, 0.8):
        corner = x[2] + share * (x[-3] - x[2])
        fits.append(
            least_squares(
                lambda v: weights * (_broken(x, v) - y),
                [*_linear_part(x, y, weights, corner), corner],
                bounds=([-np.inf] * 3 + [x[2] - 1e-9], [np.inf] * 3 + [x[-3] + 1e-9]),
                x_scale="jac",
            )
        )
    best = min(fits, key=lambda fit: fit.cost)
    return best.x, best.jac, float(best.cost)


def _broken(x: Array, v: Any) -> Array:
    """Model ln C(ln q) with v = (ln C0, c1, c2, ln q_c)."""
    t = x - v[3]
    return np.asarray(v[0] + np.where(t < 0.0, v[1], v[2]) * t)


def _linear_part(x: Array, y: Array, weights: Array, corner: float) -> list[float]:
    """Best (ln C0, c1, c2) for a fixed corner."""
    t = x - corner
    columns = np.stack([np.ones_like(t), np.minimum(t, 0.0), np.maximum(t, 0.0)], axis=1)
    return [
        float(c) for c in np.linalg.lstsq(columns * weights[:, None], y * weights, rcond=None)[0]
    ]


@dataclass(frozen=True, slots=True)
class Waviness:
    """Field of the mean heights of patches.

    Attributes:
        psd: spectrum of the surface.
        patch: side L of a patch [m].
        low: treatment of waves longer than the scan, ``"flat"`` or ``"extend"``.
    """

    psd: BiFractal
    patch: float
    low: str = "flat"

    def variance(self, length: float) -> float:
        """Variance [m^2] of the mean heights on a face of this length [m]."""
        shape, size = self._grid((length, length))
        return float((half_plane_weights(shape) * self._powers(shape, size)).sum())

    def sample(self, points: Array, rng: np.random.Generator) -> Array:
        """Mean heights of the patches about some points of one face.

        Args:
            points: coordinates in the plane of the face [m], shape (n, 2).
            rng: random numbers of the sample.

        Returns:
            Heights [m], shape (n,).

        Raises:
            SurfaceError: the face is too long for its patches.
        """
        low = points.min(axis=0)
        shape, size = self._grid(points.max(axis=0) - low)
        noise = scipy.fft.rfft2(rng.standard_normal(shape))
        amplitude = np.sqrt(self._powers(shape, size) * (shape[0] * shape[1]))
        field = scipy.fft.irfft2(noise * amplitude, s=shape)
        at = (points - low) / size * shape
        return np.asarray(map_coordinates(field, at.T, order=3, mode="grid-wrap"))

    def _grid(self, extent: tuple[float, float] | Array) -> tuple[tuple[int, int], Array]:
        """Points and lengths of a periodic field twice as long as the face."""
        step = self.patch / PER_PATCH
        least = [int(np.ceil(2.0 * e / step)) + PER_PATCH for e in extent]
        counts = [scipy.fft.next_fast_len(n, real=True) for n in least]
        if max(counts) > LONGEST:
            raise SurfaceError(f"""waviness: a face of {1e3 * float(max(extent)):.3g} mm has too
                many patches of {1e3 * self.patch:.3g} mm; make the patches larger""")
        return (counts[0], counts[1]), step * np.array(counts)

    def _powers(self, shape: tuple[int, int], size: Array) -> Array:
        """Variance of every wave vector of ``rfft2`` [m^2]."""
        qx, qy = wave_vectors(shape, size)
        # numpy's sinc(x) is sin(pi x) / (pi x).
        mean = np.sinc(qx * self.patch / (2.0 * np.pi)) * np.sinc(qy * self.patch / (2.0 * np.pi))
        C = self.psd.on(qx, qy, self.low)
        return np.asarray(C * mean**2 * 4.0 * np.pi**2 / np.prod(size))
