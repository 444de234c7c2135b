"""Heights of a surface: their distribution, and parameters by the names of ISO 25178-2.

The distribution has moments with their errors, and the law that new heights are drawn from:
z = xi + lam f((x - gamma) / delta) with x normal, Johnson's system, f = sinh (SU, unbounded) or the
logistic function (SB, bounded), matched to four moments; or the measured heights themselves, of
which the highest follow a smooth tail.

Of the parameters, gradients are differences of neighbouring pixels that were both measured. There
is no S-filter beyond the pixel and no L-filter beyond the form that was removed from the scan. S_k
and its relatives are those of ISO 13565-2, from the secant of the bearing curve. Surfalize 0.19.2
agrees in S_al and S_tr to 0.1 % at the same cost, and refuses a surface with missing points.

Reference: N. L. Johnson, Biometrika 36 (1949) 149, doi:10.1093/biomet/36.1-2.149; M. B. Wilk,
R. Gnanadesikan, Biometrika 55 (1968) 1, doi:10.1093/biomet/55.1.1 (lines over normal quantiles).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy.fft
from scipy.ndimage import label, map_coordinates
from scipy.optimize import least_squares
from scipy.special import expit, ndtr, ndtri
from scipy.stats import gaussian_kde, johnsonsb, johnsonsu, norm

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.topography import Topography

TAIL = 0.1  # share of the heights that follow the smooth tail at most
ENOUGH = 100  # independent heights in the tail, beyond which it begins higher
EQUAL = 0.01  # share of the tail at its highest height that no rough surface has
NEAR = 5e-3  # distance kept from the kurtosis of the lognormal distribution

DECAY = 0.2  # of the autocorrelation, for S_al and S_tr
DIRECTIONS = 180
CORE = 0.4  # share of the bearing curve below the secant that defines the core


@dataclass(frozen=True, slots=True)
class Johnson:
    """Normal or Johnson distribution of given moments, zero mean.

    Attributes:
        family: ``"normal"``, ``"johnson-su"`` or ``"johnson-sb"``.
        S_q: root-mean-square height [m].
        S_sk: skewness [-].
        S_ku: kurtosis, 3 for a normal distribution [-].
        gamma: shape [-].
        delta: shape [-], positive.
        xi: place [m].
        lam: scale [m].
    """

    family: str
    S_q: float
    S_sk: float
    S_ku: float
    gamma: float
    delta: float
    xi: float
    lam: float

    @property
    def name(self) -> str:
        """``"johnson"`` or ``"normal"``."""
        return self.family.partition("-")[0]

    @property
    def _law(self) -> Any:
        """The distribution as SciPy has it."""
        shapes = () if self.family == "normal" else (self.gamma, self.delta)
        return _FAMILIES[self.family](*shapes, loc=self.xi, scale=self.lam)

    def ppf(self, u: Array) -> Array:
        """Height [m] below which a share ``u`` of the surface lies."""
        return np.asarray(self._law.ppf(u))

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Draw ``n`` independent heights [m]."""
        return self.ppf(ndtr(rng.standard_normal(n)))

    def pdf(self, z: Array) -> Array:
        """Probability density [1/m] at heights ``z`` [m] above the mean plane."""
        return np.asarray(self._law.pdf(z))


_FAMILIES = {"normal": norm, "johnson-su": johnsonsu, "johnson-sb": johnsonsb}


@dataclass(frozen=True, slots=True)
class Tail:
    """Upper tail of a normal distribution, which the highest heights follow.

    Attributes:
        share: share of the surface that is higher than ``threshold`` [-].
        threshold: height where the tail begins [m].
        spread: height over a standard deviation of the normal distribution [m].
    """

    share: float
    threshold: float
    spread: float

    def height(self, above: Array) -> Array:
        """Height [m] of which a share ``above`` of the surface is higher, up to ``share``."""
        x = ndtri(self.share) - ndtri(np.maximum(above, 1e-300))
        return np.asarray(self.threshold + self.spread * x)


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The measured heights, between them straight lines of the quantile function, and their tail.

    Attributes:
        sorted_heights: ascending heights about their mean [m], shape (n,).
        tail: of the highest of them; None where the top is flat.
    """

    sorted_heights: Array
    tail: Tail | None = None
    name: str = "measured"

    @property
    def S_q(self) -> float:
        """Root-mean-square height [m]."""
        return float(self.sorted_heights.std())

    def ppf(self, u: Array) -> Array:
        """Height [m] below which a share ``u`` of the surface lies."""
        u = np.asarray(u, dtype=float)
        z = self.sorted_heights
        below = np.interp(u * z.size - 0.5, np.arange(z.size), z)
        if self.tail is None:
            return below
        above = np.minimum(1.0 - u, self.tail.share)
        body = np.minimum(below, self.tail.threshold)
        return np.where(1.0 - u < self.tail.share, self.tail.height(above), body)

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Draw ``n`` independent heights [m]."""
        return self.ppf(rng.random(n))

    def pdf(self, z: Array) -> Array:
        """Probability density [1/m] at heights ``z`` [m], by a kernel density estimate."""
        return kernel_density(self.sorted_heights, np.asarray(z, dtype=float))


HeightDistribution = Johnson | Measured  # P(z) of the heights about their mean plane


def measured(scans: Sequence[Array]) -> Measured:
    """Distribution of the heights of scans, with its tail.

    Args:
        scans: heights of each [m], shape (nx, ny); nan where missing.
    """
    heights = pooled(scans)
    return Measured(heights, fit_tail(heights, summits(scans)))


def summits(scans: Sequence[Array]) -> int:
    """Connected regions of the highest tenth of each scan: independent heights of the tail."""
    return sum(label(z > np.nanquantile(z, 1.0 - TAIL), np.ones((3, 3)))[1] for z in scans)


def fit_tail(heights: Array, independent: int) -> Tail | None:
    """Tail of the highest heights: the line that fits them best over normal quantiles.

    Neighbouring pixels belong to one summit, and a scan has few summits: more than the slope of a
    line cannot be told from them. Of scans of known distributions the heights that 0.1 to 0.001 %
    of the surface exceed come out nearer to the truth than by a generalised Pareto distribution or
    by a parabola (docs/laws.md).

    Args:
        heights: ascending heights [m].
        independent: independent heights in the highest tenth, see ``summits``.

    Returns:
        The tail above the highest tenth, or above the highest 100 independent heights; None where
        the highest are equal: a plateau ends there, or the instrument's range.
    """
    n = heights.size
    count = max(int(TAIL * min(1.0, ENOUGH / max(independent, 1)) * n), 1)
    threshold = float(heights[-count - 1])
    over = heights[-count:] - threshold
    if np.mean(over >= over[-1]) > EQUAL + 1.0 / count:
        return None
    x = ndtri(count / n) - ndtri((np.arange(count)[::-1] + 0.5) / n)
    return Tail(count / n, threshold, float(x @ over / (x @ x)))


def pooled(scans: Sequence[Array]) -> Array:
    """Heights of all scans about the mean of each [m], ascending, shape (n,).

    Their variance is the mean of the variances of the scans, however many points each has.

    Args:
        scans: heights of each [m], any shape; nan where missing.
    """
    centred = [z[np.isfinite(z)] for z in scans]
    centred = [z - z.mean() for z in centred]
    heights = np.sort(np.concatenate(centred))
    if len(centred) == 1:
        return heights
    return heights * np.sqrt(np.mean([z.var() for z in centred]) / heights.var())


def kernel_density(heights: Array, z: Array, most: int = 5000) -> Array:
    """Gaussian kernel density [1/m] of ``heights`` [m] at ``z`` [m].

    At most ``most`` evenly spaced quantiles of the heights carry kernels.
    """
    heights = np.sort(np.asarray(heights, dtype=float).ravel())
    if heights[0] == heights[-1]:
        raise SurfaceError("kernel density: all heights are equal; the surface is flat")
    if heights.size > most:
        heights = heights[np.linspace(0, heights.size - 1, most).round().astype(int)]
    return np.asarray(gaussian_kde(heights)(np.ravel(z))).reshape(np.shape(z))


def moments(heights: Array) -> tuple[float, float, float, float]:
    """Mean [m], S_q [m], S_sk [-] and S_ku [-] of heights [m]; (0, 3) for a flat surface."""
    mean = float(heights.mean())
    z = heights - mean
    S_q = float(np.sqrt(np.mean(z**2)))
    if S_q <= 1e-14 * max(abs(mean), float(np.abs(heights).max())):
        return mean, 0.0, 0.0, 3.0
    z /= S_q
    square = z * z
    return mean, S_q, float(np.mean(square * z)), float(np.mean(square * square))


def match_moments(S_q: float, S_sk: float = 0.0, S_ku: float = 3.0) -> Johnson:
    """Zero-mean distribution with the given moments.

    Args:
        S_q: root-mean-square height [m], positive.
        S_sk: skewness [-].
        S_ku: kurtosis [-], more than 1 + S_sk^2. Within 0.005 of the lognormal distribution's,
            where both families degenerate, it is moved off by so much.

    Raises:
        SurfaceError: no distribution, or none of Johnson's, has these moments.
    """
    if not (np.isfinite([S_q, S_sk, S_ku]).all() and S_q > 0.0):
        raise SurfaceError(f"S_q = {S_q} m, S_sk = {S_sk}, S_ku = {S_ku}: S_q must be positive")
    if S_ku <= 1.0 + S_sk**2:
        raise SurfaceError(f"""S_ku = {S_ku}, S_sk = {S_sk}: every distribution has S_ku > 1 +
            S_sk^2; check both""")
    if abs(S_sk) < 1e-3 and abs(S_ku - 3.0) < 2e-3:  # less than any scan can tell from normal
        return Johnson("normal", S_q, 0.0, 3.0, 0.0, 1.0, 0.0, S_q)
    border = _lognormal_kurtosis(S_sk)
    family = "johnson-su" if S_ku > border else "johnson-sb"
    if abs(S_ku - border) < NEAR:
        S_ku = border + (NEAR if family == "johnson-su" else -NEAR)
    gamma, delta = _solve_shape(family, S_sk, S_ku)
    mean, spread, _, _ = _family_moments(family, gamma, delta)
    lam = S_q / spread
    return Johnson(family, S_q, S_sk, S_ku, gamma, delta, -lam * mean, lam)


def matched(S_q: float, S_sk: float, S_ku: float, distribution: str) -> Johnson:
    """Johnson's distribution of the four moments, or the normal one of the first two.

    Args:
        S_q: root-mean-square height [m].
        S_sk: skewness [-].
        S_ku: kurtosis [-].
        distribution: ``"johnson"`` or ``"normal"``.
    """
    return match_moments(S_q) if distribution == "normal" else match_moments(S_q, S_sk, S_ku)


def _lognormal_kurtosis(S_sk: float) -> float:
    """Kurtosis of the lognormal distribution of this skewness: the border of SU and SB."""
    b = S_sk**2
    w = np.cbrt(1.0 + b / 2.0 + np.sqrt(b + b**2 / 4.0))
    w = w + 1.0 / w - 1.0
    return float(w**4 + 2.0 * w**3 + 3.0 * w**2 - 3.0)


_X = np.linspace(-12.0, 12.0, 1601)
_WEIGHT = np.exp(-0.5 * _X**2)
_WEIGHT = _WEIGHT / _WEIGHT.sum()


def _family_moments(family: str, gamma: float, delta: float) -> tuple[float, float, float, float]:
    """Mean, spread, skewness and kurtosis of f((x - gamma) / delta), x normal.

    The trapezoidal rule over the normal density converges faster than any power.
    """
    y = (np.sinh if family == "johnson-su" else expit)((_X - gamma) / delta)
    mean = float(_WEIGHT @ y)
    spread = float(np.sqrt(_WEIGHT @ (y - mean) ** 2))
    z = (y - mean) / spread
    return mean, spread, float(_WEIGHT @ z**3), float(_WEIGHT @ z**4)


@cache
def _solve_shape(family: str, S_sk: float, S_ku: float) -> tuple[float, float]:
    """Shapes (gamma, delta) that give the skewness and the kurtosis."""

    def defect(v: Array) -> list[float]:
        with np.errstate(all="ignore"):
            _, _, s, k = _family_moments(family, v[0], float(np.exp(v[1])))
        miss = [s - S_sk, k - S_ku]
        return miss if np.isfinite(miss).all() else [1e3, 1e3]

    for delta in (1.0, 2.0, 4.0, 0.5, 10.0, 30.0, 100.0):
        for gamma in (0.0, np.sign(S_sk) * delta, -np.sign(S_sk) * delta, -5 * S_sk * delta**2):
            start = [gamma, np.log(delta)]
            fit = least_squares(defect, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
            if np.abs(fit.fun).max() < 1e-9:
                return float(fit.x[0]), float(np.exp(fit.x[1]))
    raise SurfaceError(f"""S_sk = {S_sk}, S_ku = {S_ku}: no Johnson distribution found; use the
        measured heights""")


def iso_parameters(topo: Topography) -> dict[str, float]:
    """Height, hybrid, spatial and functional parameters of a levelled surface.

    Args:
        topo: heights about their mean plane [m].

    Returns:
        S_a, S_p, S_v, S_z, S_al [m], S_dq, S_dr, S_tr [-], and those of ``core_parameters``; S_al
        and S_tr of a flat surface are nan. ``S_tr_open`` is the share of the directions in which
        the autocorrelation does not fall to 0.2 within half of the scan, as along grooves: where it
        is above zero S_tr is the largest value possible, with the length of the scan's half there,
        and S_al is the shortest of the lengths that are known.
    """
    z = topo.heights - np.nanmean(topo.heights)
    h = z[np.isfinite(z)]
    S_al, S_tr, S_tr_open = _decay(np.where(np.isfinite(z), z, 0.0), np.isfinite(z), topo.pixel)
    S_dq, S_dr = gradients(z, topo.pixel)
    return {
        "S_a": float(np.mean(np.abs(h))),
        "S_p": float(h.max()),
        "S_v": float(-h.min()),
        "S_z": float(h.max() - h.min()),
        "S_dq": S_dq,
        "S_dr": S_dr,
        "S_al": S_al,
        "S_tr": S_tr,
        "S_tr_open": S_tr_open,
        **core_parameters(h),
    }


def core_parameters(heights: Array) -> dict[str, float]:
    """Core, peaks and valleys of the bearing curve, by ISO 13565-2 and ISO 25178-2.

    The core is where the secant over 40 % of the curve is least steep, the uppermost such place
    where there are several. The line that fits the curve there in the mean square has the heights
    of the core's ends at the ratios 0 and 1. Peaks above and valleys below are replaced by
    triangles of their area.

    Args:
        heights: heights [m], any shape; nan where missing.

    Returns:
        S_k, S_pk, S_vk [m] and the material ratios S_mr1, S_mr2 [-] at the upper and the lower end
        of the core.
    """
    z = np.sort(heights[np.isfinite(heights)])[::-1]
    n = z.size
    span = min(max(round(CORE * n), 1), n - 1)
    drop = z[: n - span] - z[span:]
    # Sums of rounded heights differ in their last digits where the curve is straight.
    least = float(drop.min()) + 1e-12 * float(z[0] - z[-1])
    start = int(np.argmax(drop <= least))
    core = z[start : start + span + 1]
    ratio = (np.arange(start, start + span + 1) + 0.5) / n
    centred = ratio - ratio.mean()
    slope = float(centred @ core / (centred @ centred))
    upper = float(core.mean() - slope * ratio.mean())
    lower = upper + slope
    # Within rounding of the line a height is of the core.
    room = 1e-9 * float(z[0] - z[-1])
    peaks, valleys = z[z > upper + room] - upper, lower - z[z < lower - room]
    return {
        "S_k": upper - lower,
        "S_pk": 2.0 * float(peaks.mean()) if peaks.size else 0.0,
        "S_vk": 2.0 * float(valleys.mean()) if valleys.size else 0.0,
        "S_mr1": peaks.size / n,
        "S_mr2": 1.0 - valleys.size / n,
    }


def bearing_curve(heights: Array, points: int = 201) -> tuple[Array, Array]:
    """Material ratio curve (Abbott curve) of a surface.

    Args:
        heights: heights [m], any shape; nan where missing.
        points: of the curve.

    Returns:
        Material ratios from 0 to 1 and the heights [m] above which such a share of the surface
        lies, shape (points,) each.
    """
    share: Array = np.asarray(np.linspace(0.0, 1.0, points), dtype=float)
    return share, np.asarray(np.nanquantile(heights, 1.0 - share))


def gradients(z: Array, pixel: Array) -> tuple[float, float]:
    """Root mean square gradient, and how much larger the surface is than its projection."""
    corner = z[:-1, :-1]
    along, across = (z[1:, :-1] - corner) / pixel[0], (z[:-1, 1:] - corner) / pixel[1]
    square = along**2 + across**2
    square = square[np.isfinite(square)]
    return float(np.sqrt(np.mean(square))), float(np.mean(np.sqrt(1 + square)) - 1)


def _decay(z: Array, valid: Mask, pixel: Array) -> tuple[float, float, float]:
    """Shortest lag at which the autocorrelation falls to 0.2, its ratio to the longest, open rays.

    Args:
        z: heights [m], 0 where missing, shape (nx, ny).
        valid: where they were measured.
        pixel: lengths of a pixel [m], shape (2,).
    """
    half = [n // 2 for n in z.shape]
    shape = [scipy.fft.next_fast_len(n + m, real=True) for n, m in zip(z.shape, half, strict=True)]
    both = [scipy.fft.rfft2(a, shape) for a in (z, valid.astype(float))]
    product, pairs = (scipy.fft.irfft2(np.abs(a) ** 2, shape) for a in both)
    rows, columns = np.arange(-half[0], half[0] + 1), np.arange(half[1] + 1)
    lags = np.ix_(rows, columns)
    with np.errstate(divide="ignore", invalid="ignore"):
        acf = np.where(pairs[lags] > 0.5, product[lags] / pairs[lags], 0.0)
    if acf[half[0], 0] <= 0:
        return float("nan"), float("nan"), 0.0
    acf = acf / acf[half[0], 0]
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    direction = np.array([np.cos(angle), np.sin(angle)])
    # Lengths along each ray in steps of the finer pixel, up to the end of the scan's half.
    step = float(pixel.min())
    with np.errstate(divide="ignore"):
        ends = np.min((np.array(half) * pixel)[:, None] / np.abs(direction), axis=0)
    s = step * np.arange(int(ends.max() / step * (1 + 1e-12)) + 1)
    x, y = direction[:, :, None] * s / pixel[:, None, None]
    along = map_coordinates(acf, [half[0] + x, y], order=1, mode="nearest")
    along[s > ends[:, None] * (1 + 1e-12)] = np.inf
    j = np.argmax(along <= DECAY, axis=1)
    ray = np.arange(DIRECTIONS)
    with np.errstate(divide="ignore", invalid="ignore"):  # rays without a fall: not used below
        part = (DECAY - along[ray, j]) / (along[ray, np.maximum(j - 1, 0)] - along[ray, j])
    lag = np.where(j > 0, s[j] - step * part, ends)
    # Heights without their mean fall in some direction; the other case is a safeguard.
    shortest = lag[j > 0].min() if j.any() else ends.max()
    return float(shortest), float(shortest / lag.max()), float(np.mean(j == 0))
