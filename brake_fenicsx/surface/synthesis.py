"""Artificial rough surfaces with a given spectrum and a given height distribution.

Alternating projections: impose the amplitudes |F| of the spectrum, then put drawn heights in the
places of equal rank, and again. The heights have the last word, so their moments are exactly those
drawn; what remains of the spectrum's error is reported.

Reference: F. Perez-Rafols, A. Almqvist, Tribology International 131 (2019) 591,
doi:10.1016/j.triboint.2018.11.020.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import HeightDistribution, moments
from brake_fenicsx.surface.psd import BiFractal, half_plane_weights, wave_numbers
from brake_fenicsx.surface.topography import Array, Topography

GAIN = 0.4  # exponent of the ring-wise correction of the imposed amplitudes
UNSEEN = 0.5  # share of the variance in waves that the scan never saw that is worth a warning
POOR = 0.05  # rms error of the radial PSD that is worth a warning
Density = Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class SynthesisRecord:
    """What the synthesis reached.

    Attributes:
        psd_errors: rms over the rings of C / C_target - 1 after each iteration, heights imposed.
        height_error: largest deviation of the moments of the surface's heights from those of the
            drawn heights: mean over S_q, S_q relative, S_sk, S_ku [-].
        C0_scale: factor between the given PSD and the one imposed, whose variance is that of the
            drawn heights [-].
        low: treatment of the wave numbers below the scan's band.
        low_share: share of the variance in those wave numbers [-].
    """

    psd_errors: tuple[float, ...]
    height_error: float
    C0_scale: float
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
    low: str = "extend",
    tolerance: float = 4e-3,
    max_iterations: int = 40,
) -> Topography:
    """Make one periodic artificial surface.

    Args:
        psd: density C(q) [m^4] of the wave number [rad/m].
        hdf: distribution of the heights; each surface draws its own from it, so that the highest
            summit differs from surface to surface.
        shape: pixels (nx, ny).
        size: lengths [m], shape (2,).
        rng: source of phases and heights.
        low: where the surface is longer than the scan, ``"extend"`` the power law or hold it
            ``"flat"``; for a plain function of q it has no effect.
        tolerance: rms error of the radial PSD at which to stop [-].
        max_iterations: projections at most.

    Returns:
        Surface with zero mean; its ``record`` tells the errors reached, its ``warnings`` what is
        doubtful about it.
    """
    if min(shape) < 2 or min(size) <= 0.0:
        raise SurfaceError(f"surface of {shape} pixels and {size} m; at least 2 x 2 and positive")
    lengths = np.array(size, dtype=float)
    q = wave_numbers(shape, lengths)
    z = np.sort(hdf.sample(q.shape[0] * shape[1], rng))
    z -= z.mean()
    C = _density(psd, q, low)
    amplitude, scale, below = _amplitude(C, q, lengths, z, psd)
    phases = scipy.fft.rfft2(rng.standard_normal(shape))
    heights, errors = _project(
        amplitude, z, phases, _Rings(q, shape, amplitude), tolerance, max_iterations
    )
    record = SynthesisRecord(errors, _moments_missed(heights, z), scale, low, below)
    return Topography(heights, lengths, True, "artificial surface", _doubts(record), record)


def _doubts(record: SynthesisRecord) -> tuple[str, ...]:
    """What a user should know of this surface, one line each."""
    found = []
    if record.psd_error > POOR:
        found.append(
            f"PSD missed by {record.psd_error:.1%} rms after {record.iterations} iterations: "
            "heights and spectrum contradict each other, or 'max_iterations' is too low"
        )
    if record.low_share > UNSEEN:
        found.append(
            f"{record.low_share:.0%} of the variance lies in waves longer than the scan (low = "
            f"{record.low!r}); scan a larger area, make smaller patches or hold the PSD 'flat'"
        )
    return tuple(f"artificial surface: {text}" for text in found)


def _project(
    amplitude: Array, z: Array, f: Array, rings: _Rings, tolerance: float, max_iterations: int
) -> tuple[Array, tuple[float, ...]]:
    """Alternate between amplitudes and heights; the best heights and the errors on the way.

    Ranks of 16 bits are enough on the way. The heights that are returned carry exact ranks, and
    the last error is theirs.
    """
    errors: list[float] = []
    best, lowest, imposed = np.empty(0), np.inf, amplitude
    for _ in range(max_iterations):
        h = scipy.fft.irfft2(_with_amplitude(f, imposed), s=rings.grid)
        f = scipy.fft.rfft2(_place(h, z))
        ratio = rings.ratio(f)
        errors.append(rings.error(ratio))
        if errors[-1] < lowest:
            best, lowest = h, errors[-1]
            if lowest <= 0.8 * tolerance:
                heights, error = _finished(h, z, rings)
                if error <= tolerance:
                    return heights, (*errors[:-1], error)
        if _stalled(errors):
            break
        # Ring by ring, ask for more of what the heights took away.
        imposed = imposed * rings.spread(np.clip(ratio, 0.25, 4.0) ** -GAIN)
    heights, error = _finished(best, z, rings)
    return heights, (*errors[:-1], error)


def _finished(h: Array, z: Array, rings: _Rings) -> tuple[Array, float]:
    """Heights z in the places of rank of h, and their error."""
    heights = _put(np.argsort(h, axis=None, kind="stable"), z, h)
    return heights, rings.error(rings.ratio(scipy.fft.rfft2(heights)))


def _density(psd: BiFractal | Density, q: Array, low: str) -> Array:
    """C(q) [m^4] on the grid, zero for the mean plane."""
    if isinstance(psd, BiFractal):
        return psd(q, low)
    if low not in ("extend", "flat"):
        raise SurfaceError(f"low = {low!r}; choose 'extend' or 'flat'")
    safe = np.where(q > 0.0, q, q[q > 0.0].min())
    return np.where(q > 0.0, psd(safe), 0.0)


def _amplitude(
    C: Array, q: Array, size: Array, z: Array, psd: BiFractal | Density
) -> tuple[Array, float, float]:
    """Amplitudes |F| of ``rfft2`` with the variance of the heights z; scale; share below band."""
    weights = half_plane_weights((q.shape[0], z.size // q.shape[0]))
    dq2 = 4.0 * np.pi**2 / np.prod(size)
    shares = weights * C * dq2
    variance = float(shares.sum())
    if not variance > 0.0:
        raise SurfaceError("the PSD vanishes on this grid; a rough surface needs some roughness")
    scale = float(z.var()) / variance
    lo = psd.band[0] if isinstance(psd, BiFractal) else 0.0
    below = float(shares[q < lo * (1.0 - 1e-12)].sum()) / variance
    return z.size * np.sqrt(C * dq2 * scale), scale, below


def _with_amplitude(f: Array, amplitude: Array) -> Array:
    """Same phases, given amplitudes."""
    size = np.abs(f)
    return np.asarray(f * np.divide(amplitude, size, out=np.zeros_like(size), where=size > 0.0))


def _place(h: Array, z: Array) -> Array:
    """Heights z (ascending) in the places of rank of h, by 16-bit ranks: ties in grid order."""
    low, high = h.min(), h.max()
    levels = ((h - low) * (65535.0 / max(high - low, 1e-300))).astype(np.uint16)
    return _put(np.argsort(levels, axis=None, kind="stable"), z, h)


def _put(order: NDArray[np.intp], z: Array, like: Array) -> Array:
    """Place z[k] at the flat position order[k]."""
    placed = np.empty(z.size)
    placed[order] = z
    return placed.reshape(like.shape)


def _moments_missed(heights: Array, z: Array) -> float:
    """Largest deviation of the four moments of ``heights`` from those of ``z``."""
    mean, S_q, S_sk, S_ku = moments(heights.ravel())
    mean_z, S_q_z, S_sk_z, S_ku_z = moments(z)
    misses = ((mean - mean_z) / S_q_z, S_q / S_q_z - 1.0, S_sk - S_sk_z, S_ku - S_ku_z)
    return max(abs(miss) for miss in misses)


def _stalled(errors: list[float]) -> bool:
    """Whether the last ten of many iterations found nothing better."""
    return len(errors) > 20 and min(errors[-10:]) > 0.99 * min(errors[:-10])


class _Rings:
    """Rings of the half plane, one grid step wide, on which the PSD error is taken."""

    def __init__(self, q: Array, shape: tuple[int, int], amplitude: Array):
        self.shape, self.grid = q.shape, shape
        weights = np.broadcast_to(half_plane_weights(shape), q.shape)
        self.ring = np.rint(q / q[q > 0.0].min()).astype(np.intp).ravel()
        self.weights = weights.ravel()
        self.target = np.bincount(self.ring, self.weights * amplitude.ravel() ** 2)
        self.some = self.target > 0.0

    def ratio(self, f: Array) -> Array:
        """C / C_target of each ring; 1 where the target is zero."""
        power = (f.real**2 + f.imag**2).ravel()
        found = np.bincount(self.ring, self.weights * power)
        return np.divide(found, self.target, out=np.ones_like(found), where=self.some)

    def error(self, ratio: Array) -> float:
        """Root-mean-square over the rings of C / C_target - 1."""
        return float(np.sqrt(np.mean((ratio[self.some] - 1.0) ** 2)))

    def spread(self, factor: Array) -> Array:
        """A factor per ring as a factor per wave vector."""
        return np.asarray(factor[self.ring].reshape(self.shape))
