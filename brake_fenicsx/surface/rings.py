"""Rings of the wave-vector plane, one grid step wide, on which spectra are compared."""

from __future__ import annotations

import numpy as np

from brake_fenicsx.surface.psd import half_plane_weights, wave_numbers
from brake_fenicsx.surface.topography import Array


class Rings:
    """Powers in the rings of the half plane of ``rfft2``.

    Args:
        shape: pixels (nx, ny).
        size: lengths [m], shape (2,).
        power: wanted power of every wave vector, in any unit, shape (nx, ny // 2 + 1).
    """

    def __init__(self, shape: tuple[int, int], size: Array, power: Array):
        q = wave_numbers(shape, size)
        self._shape = q.shape
        self._weights = np.broadcast_to(half_plane_weights(shape), q.shape).ravel()
        self._ring = np.rint(q / q[q > 0.0].min()).astype(np.intp).ravel()
        self._wanted = np.bincount(self._ring, self._weights * power.ravel())
        self._some = self._wanted > 0.0

    def ratio(self, power: Array) -> Array:
        """Power found over power wanted of each ring; 1 where none is wanted."""
        found = np.bincount(self._ring, self._weights * power.ravel())
        return np.divide(found, self._wanted, out=np.ones_like(found), where=self._some)

    def error(self, ratio: Array) -> float:
        """Root-mean-square over the rings of the ratio minus one."""
        return float(np.sqrt(np.mean((ratio[self._some] - 1.0) ** 2)))

    def spread(self, factor: Array) -> Array:
        """A factor per ring as a factor per wave vector."""
        return np.asarray(factor[self._ring].reshape(self._shape))
