"""Power spectral density of a surface, as a scan shows it.

Convention: C(q) [m^4] is the two-dimensional density over the wave vector q [rad/m], so that the
integral of C over both components of q is the variance of the heights; for an isotropic surface
2 pi int C(q) q dq = S_q^2. On a periodic grid of area A the discrete coefficients
h_q = mean(h exp(-i q x)) give C = |h_q|^2 A / (4 pi^2).
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft

from brake_fenicsx.arguments import Array, Index, Mask, number
from brake_fenicsx.surface.topography import Scans, Topography, fill, first

Density = Callable[[Array], Array]
RINGS = 12  # per factor e of the wave number
GROUP = 1.0 / 48.0  # width in ln q of the groups of waves that are looked at together
NEAR = 1e-3  # difference in ln q below which waves count as equally long


@dataclass(frozen=True, slots=True)
class RadialPsd:
    """Radial mean of a two-dimensional PSD.

    Attributes:
        q: mean wave number of each ring [rad/m], shape (n,).
        C: mean density of each ring [m^4], shape (n,).
        scatter: relative variance of each ring's mean [-], shape (n,).
        band: reliable wave numbers (lo, hi) [rad/m].
    """

    q: Array
    C: Array
    scatter: Array
    band: tuple[float, float]

    @property
    def reliable(self) -> Mask:
        """Rings inside the reliable band, shape (n,)."""
        return (self.q >= self.band[0]) & (self.q <= self.band[1]) & (self.C > 0.0)


def wave_vectors(shape: tuple[int, int], size: Array) -> tuple[Array, Array]:
    """Components of the wave vectors of ``rfft2`` [rad/m], shape (nx, 1) and (1, ny // 2 + 1)."""
    qx = 2.0 * np.pi * np.fft.fftfreq(shape[0], size[0] / shape[0])
    qy = 2.0 * np.pi * np.fft.rfftfreq(shape[1], size[1] / shape[1])
    return qx[:, None], qy[None, :]


def wave_numbers(shape: tuple[int, int], size: Array) -> Array:
    """Wave numbers |q| [rad/m] of ``rfft2``, shape (nx, ny // 2 + 1)."""
    return np.hypot(*wave_vectors(shape, size))


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
    the variance is kept on average: it shows directions, and the centre of the scan more than its
    rim. Missing points are filled first. The density of several scans is their mean at every wave
    vector (Bartlett's method).
    """
    if not isinstance(topo, Topography):
        return np.asarray(np.mean([psd_2d(scan) for scan in topo], axis=0))
    h = fill(topo.heights)
    if not topo.periodic:
        window = np.outer(*(np.hanning(n + 2)[1:-1] for n in topo.shape))
        h = h - np.sum(window * h) / window.sum()
        h = h * window / np.sqrt(np.mean(window**2))
    h_q = scipy.fft.rfft2(h) / h.size
    h_q[0, 0] = 0.0
    return np.asarray(np.abs(h_q) ** 2 * np.prod(topo.size) / (4.0 * np.pi**2))


def cosine_psd(topo: Topography) -> Array:
    """Two-dimensional PSD [m^4] of a scan that is not periodic, of wave vectors pi (i, j) / L.

    Cosine waves, the Fourier series of the scan beside its mirror image, have no step at the rim.
    No window is needed: every point has the same weight, wherever it lies, and the sum is the
    variance of the scan. Missing points are filled first. Shape (nx, ny).

    Reference: B. Denis, J. Cote, R. Laprise, Mon. Weather Rev. 130 (2002) 1812,
    doi:10.1175/1520-0493(2002)130<1812:SDOTDA>2.0.CO;2.
    """
    waves = waves_of(fill(topo.heights), topo)
    return np.asarray(waves**2 * np.prod(topo.size) / (4.0 * np.pi**2 * waves.size))


def waves_of(heights: Array, topo: Topography) -> Array:
    """Coefficients [m] of the waves that a scan is measured by, without the mean plane.

    Args:
        heights: heights without missing points [m], shape (nx, ny).
        topo: the scan, which is periodic or not.
    """
    h = heights - heights.mean()
    return np.asarray(scipy.fft.rfft2(h) if topo.periodic else scipy.fft.dctn(h, norm="ortho"))


def ring_sums(values: Array, topo: Topography) -> Array:
    """Sums over the rings of ``radial_psd`` of what belongs to each wave, shape (n,).

    Args:
        values: of the waves of ``waves_of``.
        topo: scan whose grid it has.
    """
    ring, inside, _, weights = _rings(topo)
    return np.asarray(np.bincount(ring, weights * values.ravel()[inside]), dtype=float)


def radial_psd(scans: Scans, cutoff: float | None = None) -> RadialPsd:
    """Radial mean of the PSD with its reliable band.

    Args:
        scans: levelled scan, or several.
        cutoff: shortest wave length the instrument resolves [m]; two pixels if not given.

    Returns:
        The PSD. Its reliable band runs from the scan length (from twice its wave number for a scan
        that is not periodic, since levelling takes from the lowest waves) to the cutoff, or to
        where the density sinks to ten times that of the instrument's white noise.
    """
    topo = first(scans)
    C = _density(scans)
    mean_q, mean_C, scatter = radial_mean(C, topo)
    step, nyquist = 2.0 * np.pi / topo.size.min(), np.pi / topo.pixel.max()
    lo = (0.99 if topo.periodic else 1.9) * step
    if cutoff is None:
        cutoff = float(2.0 * topo.pixel.max())
    hi = min(nyquist, 2.0 * np.pi / number("cutoff", cutoff, least=0.0))
    floor = 0.0 if topo.periodic else 10.0 * _noise(C, _wave_numbers(topo)[0], nyquist)
    below = (mean_C < floor) & (mean_q > 2.0 * lo)
    hi = min(hi, float(mean_q[below][0])) if below.any() else hi
    return RadialPsd(mean_q, mean_C, scatter, (lo, hi))


def radial_mean(C: Array, topo: Topography) -> tuple[Array, Array, Array]:
    """Wave number [rad/m], mean density [m^4] and its relative variance [-] of each ring.

    The variance between wave vectors is the same share of the square in all rings: 1 for a random
    surface, 0 for one with imposed amplitudes.

    Args:
        C: density [m^4] of the waves that a scan is measured by: those of ``psd_2d`` of a periodic
            one, else those of ``cosine_psd``.
        topo: scan whose grid it has.
    """
    ring, inside, ln_q, w = _rings(topo)
    middle, mean, moved = _ring_means(ring, w, ln_q, C.ravel()[inside])
    count, share = np.bincount(ring, w), 1.0
    if moved is not C and (full := count > 2.0).any():
        relative = np.bincount(ring, w * (moved / mean[ring] - 1.0) ** 2)
        share = float(relative[full].sum() / np.maximum(count[full] - 1.0, 1.0).sum())
    return np.exp(middle), mean, share / count


def _rings(topo: Topography) -> tuple[Index, Mask, Array, Array]:
    """Ring of every wave inside one, empty rings left out; which waves; their ln q and weights.

    Rings are ``RINGS`` per factor e of the wave number, and at least one grid step wide.
    """
    q, weights = _wave_numbers(topo)
    step, nyquist = 2.0 * np.pi / topo.size.min(), np.pi / topo.pixel.max()
    edges = [0.5 * step]
    while edges[-1] < nyquist:
        edges.append(max(edges[-1] + step, edges[-1] * np.exp(1.0 / RINGS)))
    ring = np.digitize(q.ravel() * (1.0 + 1e-9), edges) - 1  # on an edge, whatever the rounding
    inside = (ring >= 0) & (ring < len(edges) - 1)
    ring = _without_empty(ring[inside])
    weights = np.broadcast_to(weights, q.shape).ravel()[inside]
    return ring, inside, np.log(q.ravel()[inside]), weights


def seen_in_scans(C: Density, topo: Topography) -> Array:
    """Radial mean that ``radial_psd`` finds on average in scans of a spectrum [m^4], shape (n,).

    Args:
        C: density [m^4] of the wave number [rad/m].
        topo: a scan of the size and the grid; nothing is done to a periodic one.
    """
    answers, q, waves, rings = _groups(topo.shape, topo.periodic, *map(float, topo.size))
    seen = C(q)
    if not topo.periodic:
        seen = np.maximum(answers[0] @ seen @ answers[1].T, 0.0)
    group, ring, weights, ln_q = waves
    middle, mean, _ = _ring_means(ring, weights, ln_q, seen.ravel()[group])
    return np.asarray(np.exp(np.interp(rings, middle, np.log(mean))))


@functools.lru_cache(maxsize=4)
def _groups(shape: tuple[int, int], periodic: bool, *size: float) -> tuple[Any, Array, Any, Array]:
    """What scans of a grid do to a spectrum, for groups of neighbouring waves.

    Along each axis the first waves stand alone, later ones in groups of a width of ``GROUP`` in
    ln q, over which a spectrum hardly changes: rings come out to 2e-3 at worst, 3e-4 rms
    (tests/surface/test_psd.py), of a scan of 2000 x 2000 points from 50,000 groups. Of a periodic
    scan waves of nearly the same length are a group.

    Returns:
        Along each axis the mean squares of the cosine waves of every group for unit density of one;
        wave numbers of the groups [rad/m]; which of them lie in rings, in which, with which weight
        and ln q; ln of the wave numbers of the rings of ``radial_psd``.
    """
    ring, inside, ln_q, weights = _rings(Topography(np.empty(shape), np.array(size), periodic))
    rings = np.bincount(ring, weights * ln_q) / np.bincount(ring, weights)
    answers: list[Array] = []
    if periodic:
        group, means = of_equal_length(ln_q)
        q: Array = np.exp(means)
    else:
        middles, places = [], []
        for n, side in zip(shape, size, strict=True):
            singles, log_steps = np.arange(2.0 / GROUP), np.arange(0.0, np.log(n + 1.0), GROUP)
            starts = np.append(singles, np.exp(log_steps)).astype(int)
            starts = np.unique(starts[starts < n])
            ends = np.append(starts[1:], n)
            j = np.arange(n + 1)[:, None]
            members = (j >= np.append(starts, n)) & (j < np.append(ends, n + 1))
            correlation = scipy.fft.dct(members.astype(float), type=1, axis=0) / (2.0 * n)
            squares = np.add.reduceat(_mean_squares(correlation), starts, axis=0)
            answers.append(np.pad(squares / (ends - starts)[:, None], ((0, 1), (0, 0))))
            middles.append(np.append(starts + ends - 1.0, 2.0 * n) * (0.5 * np.pi / side))
            places.append(np.repeat(np.arange(starts.size), ends - starts))
        q = np.hypot(middles[0][:, None], middles[1])
        group = (places[0][:, None] * middles[1].size + places[1]).ravel()[inside]
    # Waves of one group may lie in two rings.
    count = np.bincount(ring * q.size + group, weights)
    ring, group = np.divmod(np.flatnonzero(count), q.size)
    return answers, q, (group, ring, count[count > 0.0], np.log(q.ravel()[group])), rings


def of_equal_length(ln_q: Array) -> tuple[Index, Array]:
    """Number of the group of every wave, whose lengths differ by ``NEAR``, and ln q of the groups.

    Args:
        ln_q: ln of wave numbers, shape (n,).
    """
    place = _without_empty(np.rint((ln_q - ln_q.min()) / NEAR).astype(np.intp))
    return place, np.bincount(place, ln_q) / np.bincount(place)


def _without_empty(numbers: Index) -> Index:
    """Numbers of groups, those of groups without a member left out."""
    return np.asarray((np.cumsum(np.bincount(numbers) > 0) - 1)[numbers])


def _mean_squares(R: Array) -> Array:
    """Mean squares of cosine waves along the first axis, of correlations at lags 0 to n.

    Of the wave k along n points it is the sum over lags l of R(l) ((n - |l|) cos(a l) -
    sin(a |l|) / sin a) / n, where a = pi k / n; without the second term for k = 0.
    """
    n = len(R) - 1
    lag = np.arange(n + 1.0)[:, None]
    squares = scipy.fft.dct(R * (1.0 - lag / n), type=1, axis=0)[:n]
    sine = scipy.fft.dst(R[1:n], type=1, axis=0)
    squares[1:] -= sine / (n * np.sin(np.pi * lag[1:n] / n))
    return np.asarray(squares)


def _density(scans: Scans) -> Array:
    """Density of the waves that scans are measured by [m^4], the mean of several."""
    if not isinstance(scans, Topography):
        return np.asarray(np.mean([_density(scan) for scan in scans], axis=0))
    return psd_2d(scans) if scans.periodic else cosine_psd(scans)


def _wave_numbers(topo: Topography) -> tuple[Array, Array]:
    """Wave numbers [rad/m] of the waves that a scan is measured by, and how much each counts."""
    if topo.periodic:
        weights = np.asarray(half_plane_weights(topo.shape) / 2.0, float)
        return wave_numbers(topo.shape, topo.size), weights
    kx, ky = (np.pi * np.arange(n) / L for n, L in zip(topo.shape, topo.size, strict=True))
    return np.hypot(kx[:, None], ky), np.ones(1)


def _noise(C: Array, q: Array, nyquist: float) -> float:
    """Density of the instrument's white noise [m^4]; zero where the surface still rules.

    Noise shows as a density that no longer falls: between 0.7 of the Nyquist wave number and the
    corners of the wave-vector square its slope is above -1.
    """
    inner, outer = (q > 0.6 * nyquist) & (q < 0.8 * nyquist), q > 1.2 * nyquist
    if inner.sum() < 8 or outer.sum() < 8:
        return 0.0
    levels = [float(np.mean(C[part])) for part in (inner, outer)]
    ratio = float(q[outer].mean() / q[inner].mean())
    return levels[1] if levels[1] > levels[0] / ratio else 0.0


def _ring_means(ring: Index, w: Array, ln_q: Array, C: Array) -> tuple[Array, Array, Array]:
    """Ln of the mean wave number of each ring, mean density there, density of waves moved there.

    Within a ring the density follows the local slope; that is taken out before the mean, or a
    wide ring would lie high.
    """
    count = np.bincount(ring, w)
    middle = np.bincount(ring, w * ln_q) / count
    mean, moved = np.bincount(ring, w * C) / count, C
    if mean.size < 3 or not (mean > 0.0).all():
        return middle, mean, moved
    off = ln_q - middle[ring]
    for _ in range(2):
        slope = np.gradient(np.log(mean), middle)
        # A noisy slope must not bend a ring more than the surface does: smooth over three.
        slope = np.convolve(np.pad(slope, 1, mode="edge"), np.ones(3) / 3.0, mode="valid")
        moved = C * np.exp(-slope[ring] * off)
        mean = np.bincount(ring, w * moved) / count
    return middle, mean, moved


def anisotropy(topo: Scans, band: tuple[float, float]) -> tuple[float, float]:
    """How far the variance depends on the direction, and the direction of the strongest waves.

    Args:
        topo: levelled scan, or several.
        band: wave numbers looked at (lo, hi) [rad/m].

    Returns:
        Second angular harmonic of the variance over the variance (0 isotropic, 1 a grooved
        surface) [-], and the angle of the wave vectors with most of it from the x axis [rad].
    """
    C, topo = psd_2d(topo), first(topo)
    qx, qy = wave_vectors(topo.shape, topo.size)
    q = np.hypot(qx, qy)
    inside = (q >= band[0]) & (q <= band[1])
    variance = (C * half_plane_weights(topo.shape))[inside]
    if inside.sum() < 8 or not variance.any():
        return 0.0, 0.0
    harmonic = np.sum(variance * ((qx + 1j * qy) ** 2)[inside] / q[inside] ** 2)
    return float(abs(harmonic) / variance.sum()), float(np.angle(harmonic) / 2.0)
