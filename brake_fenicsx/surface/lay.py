"""Direction of a surface: how the density of each wave number is spread over the angles.

The radial mean of the spectrum is measured by ``psd.radial_psd``; here is the factor that makes a
two-dimensional spectrum of it, of mean 1 over the angles. It is the density of each wave vector
over that of its ring, smoothed: over wave numbers by about a fifth, over angles by half a step of
the scan's grid of wave vectors, its resolution, and never by less than a degree.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, map_coordinates

from brake_fenicsx.arguments import Array
from brake_fenicsx.surface.psd import half_plane_weights, psd_2d, wave_vectors
from brake_fenicsx.surface.topography import Scans, first

ANGLES = 360  # over half a turn
SPACING, SMOOTH = 0.2, 0.2  # of the rings over ln q, and standard deviation of their weights
ACROSS, LEAST = 0.5, np.radians(1.0)  # standard deviation over angles, in steps of q and in radians


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
        near = np.hypot(SMOOTH, ACROSS * step / middle)
        w = weights * np.exp(-0.5 * (np.log(q / middle) / near) ** 2)
        sums = np.stack([np.bincount(place, x, ANGLES) for x in (w * relative, w)])
        width = max(ACROSS * step / middle, LEAST) * ANGLES / np.pi
        power, count = gaussian_filter1d(sums, width, axis=1, mode="wrap", truncate=6.0)
        share = power / np.maximum(count, 1e-12 * count.max())
        rows.append(share / share.mean())
    table = np.array(rows)
    return Lay(rings, np.pad(table, ((0, 0), (1, 1)), mode="wrap"))
