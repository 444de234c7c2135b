"""Power spectral density of a surface, and its bi-fractal model.

Convention: C(q) [m^4] is the two-dimensional density over the wave vector q [rad/m], so that the
integral of C over both components of q is the variance of the heights; for an isotropic surface
2 pi int C(q) q dq = S_q^2. On a periodic grid of area A the discrete coefficients
h_q = mean(h exp(-i q x)) give C = |h_q|^2 A / (4 pi^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.optimize import least_squares

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.topography import Array, Scans, Topography, fill, first, form


@dataclass(frozen=True, slots=True)
class RadialPsd:
    """Radial mean of a two-dimensional PSD.

    Attributes:
        q: mean wave number of each ring [rad/m], shape (n,).
        C: mean density of each ring [m^4], shape (n,).
        scatter: relative variance of each ring's mean [-], shape (n,).
        band: reliable wave numbers (lo, hi) [rad/m].
        label: what it was taken from.
    """

    q: Array
    C: Array
    scatter: Array
    band: tuple[float, float]
    label: str = "scan"

    @property
    def reliable(self) -> NDArray[np.bool_]:
        """Rings inside the reliable band, shape (n,)."""
        return (self.q >= self.band[0]) & (self.q <= self.band[1]) & (self.C > 0.0)


@dataclass(frozen=True, slots=True)
class BiFractal:
    """Continuous broken power law: C0 (q/q_c)^c1 below q_c, C0 (q/q_c)^c2 above.

    Attributes:
        c1: slope below the corner, log C over log q [-].
        c2: slope above the corner [-].
        q_c: corner wave number [rad/m].
        C0: density at the corner [m^4].
        band: wave numbers the parameters were taken from (lo, hi) [rad/m].
        errors: standard errors of (c1, c2, ln q_c, ln C0); nan where the parameters are given.
        rms: root-mean-square deviation of ln C from the fit; nan where given.
        form: spectrum of a longer, coarser scan, taken below the band; None where there is none.
    """

    c1: float
    c2: float
    q_c: float
    C0: float
    band: tuple[float, float]
    errors: tuple[float, float, float, float] = (np.nan, np.nan, np.nan, np.nan)
    rms: float = np.nan
    form: BiFractal | None = None

    def __call__(self, q: Array, low: str = "extend") -> Array:
        """Bi-fractal spectrum: density [m^4] at wave numbers q > 0 [rad/m], Eq. (17).

        Args:
            q: wave numbers [rad/m]; the density at q = 0 is zero (the mean plane).
            low: below the band's lower end, ``"extend"`` the power law or hold it ``"flat"``;
                with a ``form``, below the band of that.
        """
        if low not in ("extend", "flat"):
            raise SurfaceError(f"low = {low!r}; choose 'extend' or 'flat'")
        q = np.asarray(q, dtype=float)
        x = np.where(q > 0.0, q, self.q_c)
        if low == "flat":
            x = np.maximum(x, self.band[0])
        x = x / self.q_c
        C = self.C0 * np.where(x < 1.0, x**self.c1, x**self.c2)
        if self.form is not None:
            C = np.where(q < self.band[0], self.form(q, low), C)
        return np.where(q > 0.0, C, 0.0)

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


def wave_numbers(shape: tuple[int, int], size: Array) -> Array:
    """Wave numbers |q| [rad/m] of ``rfft2``, shape (nx, ny // 2 + 1)."""
    qx = 2.0 * np.pi * np.fft.fftfreq(shape[0], size[0] / shape[0])
    qy = 2.0 * np.pi * np.fft.rfftfreq(shape[1], size[1] / shape[1])
    return np.hypot(qx[:, None], qy[None, :])


def half_plane_weights(shape: tuple[int, int]) -> Array:
    """How often each column of ``rfft2`` stands in the full transform, shape (ny // 2 + 1,)."""
    weights = np.full(shape[1] // 2 + 1, 2.0)
    weights[0] = 1.0
    if shape[1] % 2 == 0:
        weights[-1] = 1.0
    return weights


def psd_2d(topo: Scans) -> Array:
    """Two-dimensional PSD [m^4] on the half plane of ``rfft2``, shape (nx, ny // 2 + 1).

    A scan that is not periodic is multiplied by a Hann window in both directions, scaled so that
    the variance is kept on average. Missing points are filled first. The density of several scans
    is their mean at every wave vector (Bartlett's method).
    """
    if not isinstance(topo, Topography):
        return np.asarray(np.mean([psd_2d(scan) for scan in topo], axis=0))
    h = fill(topo.heights)
    if not topo.periodic:
        window = np.outer(*(np.hanning(n + 2)[1:-1] for n in h.shape))
        h = h - np.sum(window * h) / window.sum()
        h = h * window / np.sqrt(np.mean(window**2))
    h_q = scipy.fft.rfft2(h) / h.size
    h_q[0, 0] = 0.0
    return np.asarray(np.abs(h_q) ** 2 * np.prod(topo.size) / (4.0 * np.pi**2))


def radial_psd(
    topo: Scans, cutoff: float | None = None, rings: int = 12, label: str = "scan"
) -> RadialPsd:
    """Radial mean of the PSD with its reliable band.

    Args:
        topo: levelled scan, or several.
        cutoff: shortest wave length the instrument resolves [m]; two pixels if not given.
        rings: rings per factor e of the wave number where the grid is fine enough; ring edges
            stand at least one grid step apart.
        label: name for figures.

    Returns:
        The PSD. Its reliable band runs from the scan length (from twice its wave number for a
        windowed scan, since window and levelling take from the lowest waves) to the cutoff, or to
        where the density sinks to ten times that of the instrument's white noise.
    """
    C, topo = psd_2d(topo), first(topo)
    q = wave_numbers(topo.shape, topo.size)
    weights = np.broadcast_to(half_plane_weights(topo.shape) / 2.0, C.shape)
    step = 2.0 * np.pi / topo.size.min()
    nyquist = np.pi / topo.pixel.max()
    edges = _ring_edges(step, nyquist, rings)
    ring = np.digitize(q.ravel(), edges) - 1
    inside = (ring >= 0) & (ring < edges.size - 1)
    mean_q, mean_C, scatter = _ring_means(
        ring[inside], weights.ravel()[inside], q.ravel()[inside], C.ravel()[inside]
    )
    if not topo.periodic:
        scatter = scatter * 2.25  # the window ties neighbouring wave vectors to each other
    lo = (0.99 if topo.periodic else 2.0) * step
    hi = nyquist if cutoff is None else min(nyquist, 2.0 * np.pi / cutoff)
    floor = 0.0 if topo.periodic else 10.0 * _noise(C, q, weights, nyquist)
    below = (mean_C < floor) & (mean_q > 2.0 * lo)
    hi = min(hi, float(mean_q[below][0])) if below.any() else hi
    return RadialPsd(mean_q, mean_C, scatter, (lo, hi), label)


def noise_bound(topo: Scans) -> float:
    """Standard deviation of the white noise that the spectrum of a scan allows at most [m].

    It alone would be the density in the corners of the wave-vector square, beyond 1.2 of the
    Nyquist wave number: the instrument's noise where the surface no longer rules there, else more.

    Args:
        topo: levelled scan, or several.
    """
    C, topo = psd_2d(topo), first(topo)
    q = wave_numbers(topo.shape, topo.size)
    corners = q > 1.2 * np.pi / topo.pixel.max()
    weights = np.broadcast_to(half_plane_weights(topo.shape), q.shape)[corners]
    density = float(np.average(C[corners], weights=weights))
    return float(np.sqrt(density * 4.0 * np.pi**2 / np.prod(topo.pixel)))


def _noise(C: Array, q: Array, weights: Array, nyquist: float) -> float:
    """Density of the instrument's white noise [m^4]; zero where the surface still rules.

    Noise shows as a density that no longer falls: between 0.7 of the Nyquist wave number and the
    corners of the wave-vector square its slope is above -1.
    """
    inner, outer = (q > 0.6 * nyquist) & (q < 0.8 * nyquist), q > 1.2 * nyquist
    if inner.sum() < 8 or outer.sum() < 8:
        return 0.0
    levels = [float(np.average(C[part], weights=weights[part])) for part in (inner, outer)]
    ratio = float(q[outer].mean() / q[inner].mean())
    return levels[1] if levels[1] > levels[0] / ratio else 0.0


def _ring_means(ring: NDArray[np.intp], w: Array, q: Array, C: Array) -> tuple[Array, Array, Array]:
    """Mean wave number [rad/m], mean density there [m^4] and its relative variance [-] per ring.

    Within a ring the density follows the local slope; that is taken out before the mean, or a
    wide ring would lie high. The variance between wave vectors is the same share of the square in
    all rings: 1 for a random surface, 0 for one with imposed amplitudes.
    """
    _, ring = np.unique(ring, return_inverse=True)
    count = np.bincount(ring, w)
    middle = np.exp(np.bincount(ring, w * np.log(q)) / count)
    mean = np.bincount(ring, w * C) / count
    if mean.size < 3 or not (mean > 0.0).all():
        return middle, mean, 1.0 / count
    for _ in range(2):
        slope = np.gradient(np.log(mean), np.log(middle))
        # A noisy slope must not bend a ring more than the surface does: smooth over three.
        slope = np.convolve(np.pad(slope, 1, mode="edge"), np.ones(3) / 3.0, mode="valid")
        detrended = C * (q / middle[ring]) ** -slope[ring]
        mean = np.bincount(ring, w * detrended) / count
    relative = np.bincount(ring, w * (detrended / mean[ring] - 1.0) ** 2)
    full = count > 2.0
    share = (
        float(relative[full].sum() / np.maximum(count[full] - 1.0, 1.0).sum())
        if full.any()
        else 1.0
    )
    return middle, mean, share / count


def _ring_edges(step: float, nyquist: float, rings: int) -> Array:
    """Edges of the rings [rad/m]: one grid step apart at first, then equal in log q."""
    edges = [0.5 * step]
    while edges[-1] < nyquist:
        edges.append(max(edges[-1] + step, edges[-1] * np.exp(1.0 / rings)))
    return np.array(edges)


def anisotropy(topo: Scans, band: tuple[float, float]) -> tuple[float, float]:
    """How far the PSD depends on the direction, and the direction of the strongest waves.

    Args:
        topo: levelled scan, or several.
        band: wave numbers looked at (lo, hi) [rad/m].

    Returns:
        Second angular harmonic of C over its radial mean (0 isotropic, about 1 a grooved
        surface) [-], and the angle of the wave vectors with the largest C from the x axis [rad].
    """
    C, topo = psd_2d(topo), first(topo)
    qx = 2.0 * np.pi * np.fft.fftfreq(topo.shape[0], topo.pixel[0])[:, None]
    qy = 2.0 * np.pi * np.fft.rfftfreq(topo.shape[1], topo.pixel[1])[None, :]
    q = np.hypot(qx, qy)
    inside = (q >= band[0]) & (q <= band[1])
    if inside.sum() < 8:
        return 0.0, 0.0
    weights = np.broadcast_to(half_plane_weights(topo.shape), C.shape)[inside]
    ring = np.floor(np.log(q[inside] / band[0]) * 4.0).astype(int)
    total = np.bincount(ring, weights * C[inside])
    count = np.bincount(ring, weights)
    mean = total[ring] / count[ring]
    relative = np.divide(C[inside], mean, out=np.ones_like(mean), where=mean > 0.0)
    angle = np.arctan2(np.broadcast_to(qy, C.shape), np.broadcast_to(qx, C.shape))[inside]
    harmonic = np.average(relative * np.exp(2j * angle), weights=weights)
    return float(abs(harmonic)), float(np.angle(harmonic) / 2.0)


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
        raise SurfaceError(
            f"bi-fractal fit: {use.sum()} rings between {psd.band[0]:.3g} and {psd.band[1]:.3g} "
            "rad/m, at least 6 are needed; scan a larger area or give 'statistics'"
        )
    scatter = psd.scatter[use]
    x, y = np.log(psd.q[use]), np.log(psd.C[use]) + 0.5 * scatter
    missed = 0.01
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


def _broken(x: Array, v: Array) -> Array:
    """Model ln C(ln q) with v = (ln C0, c1, c2, ln q_c)."""
    t = x - v[3]
    return v[0] + np.where(t < 0.0, v[1], v[2]) * t


def _linear_part(x: Array, y: Array, weights: Array, corner: float) -> list[float]:
    """Best (ln C0, c1, c2) for a fixed corner."""
    t = x - corner
    columns = np.stack([np.ones_like(t), np.minimum(t, 0.0), np.maximum(t, 0.0)], axis=1)
    return [
        float(c) for c in np.linalg.lstsq(columns * weights[:, None], y * weights, rcond=None)[0]
    ]


def sub_psds(topo: Topography, cutoff: float | None = None) -> tuple[RadialPsd, ...]:
    """Radial PSDs of five half-length windows and of the scan decimated by 2 and by 4.

    They show what of the PSD belongs to the surface and what to the scan (the paper's Fig. 5b).
    """
    found = []
    nx, ny = topo.shape
    half = (nx // 2, ny // 2)
    if min(half) >= 16:
        corners = ((0, 0), (0, ny - half[1]), (nx - half[0], 0), (nx - half[0], ny - half[1]))
        for k, (i, j) in enumerate((*corners, (nx // 4, ny // 4))):
            heights = topo.heights[i : i + half[0], j : j + half[1]]
            if np.isfinite(heights).mean() < 0.5:
                continue
            part = Topography(heights, topo.pixel * half)
            part = Topography(heights - form(part, "plane"), part.size)
            found.append(radial_psd(part, cutoff, label=f"window {k + 1}"))
    filled = fill(topo.heights)
    for step in (2, 4):
        if min(nx, ny) // step >= 16:
            heights = filled[::step, ::step]
            size = topo.pixel * step * heights.shape
            found.append(radial_psd(Topography(heights, size), cutoff, label=f"every {step}th"))
    return tuple(found)


def psd_spread(psd: RadialPsd, others: tuple[RadialPsd, ...]) -> float:
    """Root-mean-square of ln(C_other / C) over the wave numbers reliable in both [-]."""
    use = psd.reliable
    if use.sum() < 2:
        return float("nan")
    defects = []
    for other in others:
        inside = other.reliable & (other.q >= psd.q[use][0]) & (other.q <= psd.q[use][-1])
        own = np.interp(np.log(other.q[inside]), np.log(psd.q[use]), np.log(psd.C[use]))
        defects.append(np.log(other.C[inside]) - own)
    joined = np.concatenate(defects) if defects else np.zeros(0)
    return float(np.sqrt(np.mean(joined**2))) if joined.size else float("nan")
