"""Active-set solver of the contact program: exact, right for a few hundred touching pixels.

Block pivoting on the set of touching pixels: all pixels under tension leave, all that penetrate
enter, the touching ones are solved with a dense Cholesky factor. Where the blocks do not settle,
single pivots follow, which cannot cycle.

References: A. Bemporad, M. Paggi, Int. J. Solids Struct. 69-70 (2015) 421,
doi:10.1016/j.ijsolstr.2015.06.005 (active sets for rough contact); J. J. Judice, F. M. Pires,
Comput. Oper. Res. 21 (1994) 587, doi:10.1016/0305-0548(94)90106-6 (block pivoting).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from brake_fenicsx.micro.halfspace import Array, HalfSpace, Index

ROUND_OFF = 1e-13  # penetrations below this share of the overlap are rounding errors


class Pixels(Protocol):
    """The pixels that can touch."""

    height: Array  # over the mean plane [m], shape (n,)
    most: int  # how many can touch at once; a periodic surface in full contact has no separation

    def influence(self, points: Index) -> Array:
        """Dense influence of ``points`` on themselves [m], a fresh array."""

    def gap(self, points: Index, pressure: Array, d: float) -> Array:
        """Gap [m] of every pixel under the pressures over E* on ``points``, shape (n,)."""


class AllPixels:
    """Every pixel of the grid; gaps by FFT.

    Args:
        space: the half-space.
        h: heights over their mean [m], shape (nx, ny).
    """

    def __init__(self, space: HalfSpace, h: Array):
        self.space = space
        self.height: Array = h.ravel()
        self.most = h.size - (1 if space.boundary == "periodic" else 0)

    def influence(self, points: Index) -> Array:
        """See ``Pixels``."""
        return self.space.block(points, points)

    def gap(self, points: Index, pressure: Array, d: float) -> Array:
        """See ``Pixels``."""
        p = np.zeros(self.height.size)
        p[points] = pressure
        return np.asarray(self.space.apply(p.reshape(self.space.shape)).ravel() - self.height + d)


class HighPixels:
    """The highest pixels alone, gaps by a dense matrix.

    Pressures push a free half-space down everywhere: a pixel below the undeformed plane never
    touches. Under a periodic boundary that does not hold.

    Args:
        space: half-space with a free boundary.
        h: heights over their mean [m], shape (nx, ny).
        address: flat indices of the highest pixels, in any order.
    """

    def __init__(self, space: HalfSpace, h: Array, address: Index):
        self.address, self.height = address, h.ravel()[address]
        self.most = address.size
        self._matrix = space.block(address, address)

    def influence(self, points: Index) -> Array:
        """See ``Pixels``."""
        return np.asarray(self._matrix[points[:, None], points])

    def gap(self, points: Index, pressure: Array, d: float) -> Array:
        """See ``Pixels``."""
        return np.asarray(pressure @ self._matrix[points] - self.height + d)


@dataclass(frozen=True, slots=True)
class Touching:
    """Solution on the touching pixels.

    Attributes:
        points: the touching pixels, among ``Pixels``.
        pressure: pressures over E* [-], shape of ``points``.
        unit: their answer to a unit approach, -dp/dd [1/m].
        gap: gap of all ``Pixels`` [m].
        d: separation [m].
        iterations: sets tried.
    """

    points: Index
    pressure: Array
    unit: Array
    gap: Array
    d: float
    iterations: int


def active_set(
    pixels: Pixels,
    d: float | None,
    total: float | None,
    start: Index,
    most: int | None = None,
    max_iterations: int = 60,
) -> Touching | None:
    """Solve the contact at a given separation or a given load.

    Args:
        pixels: the pixels that can touch.
        d: separation [m], or None for a given load.
        total: sum of the pressures over E* [-], or None for a given separation.
        start: pixels to start from, at least one.
        most: give up when more pixels than these touch; None for no limit.
        max_iterations: sets tried at most.

    Returns:
        The solution, exact to round-off; None if the pivoting does not settle or gives up.
    """
    height = pixels.height
    touching = np.zeros(height.size, dtype=bool)
    touching[start] = True
    fewest, patience = height.size + 1, 3
    for iteration in range(1, max_iterations + 1):
        points = np.flatnonzero(touching)
        if points.size > (pixels.most if most is None else min(most, pixels.most)):
            return None
        x = _dense_solve(pixels, points)
        if x is None:
            return None
        at = (float(x[0].sum()) - total) / float(x[1].sum()) if total is not None else d
        assert at is not None
        pressure = x[0] - at * x[1]
        gap = pixels.gap(points, pressure, at)
        overlap = max(float(height.max()) - at, 0.0)
        leaving = points[pressure < 0.0]
        entering = np.flatnonzero((gap < -ROUND_OFF * overlap) & ~touching)
        wrong = leaving.size + entering.size
        if wrong == 0:
            return Touching(points, pressure, x[1], gap, at, iteration)
        if wrong < fewest:
            fewest, patience = wrong, 3
        elif patience > 0:
            patience -= 1
        else:
            last = max(leaving.max(initial=-1), entering.max(initial=-1))
            leaving, entering = leaving[leaving == last], entering[entering == last]
        touching[leaving] = False
        touching[entering] = True
        if not touching.any():
            return None
    return None


def _dense_solve(pixels: Pixels, points: Index) -> Array | None:
    """Pressures that displace the points by their heights, and by one; shape (2, n)."""
    rhs = np.empty((points.size, 2), order="F")
    rhs[:, 0], rhs[:, 1] = pixels.height[points], 1.0
    try:
        factor = cho_factor(pixels.influence(points).T, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    return np.asarray(cho_solve(factor, rhs, overwrite_b=True, check_finite=False).T)
