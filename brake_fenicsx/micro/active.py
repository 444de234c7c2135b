"""Active-set solver of the contact program: exact, right for a few hundred touching pixels.

Block pivoting on the set of touching pixels: all pixels under tension leave, all that penetrate
enter, those above the hardness are held there, held ones that open are let go; the elastic ones
are solved with a dense Cholesky factor. Where the blocks do not settle, single pivots follow, and
after a given number of sets the solver gives up, so that it always ends.

References: A. Bemporad, M. Paggi, Int. J. Solids Struct. 69-70 (2015) 421,
doi:10.1016/j.ijsolstr.2015.06.005 (active sets for rough contact); J. J. Judice, F. M. Pires,
Comput. Oper. Res. 21 (1994) 587, doi:10.1016/0305-0548(94)90106-6 (block pivoting).
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky, solve_triangular

from brake_fenicsx.arguments import Array, Index, Mask
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.micro.halfspace import HalfSpace

ROUND_OFF = 1e-13  # penetrations below this share of the overlap are rounding errors


class Pixels(Protocol):
    """The pixels that can touch."""

    height: Array  # over the mean plane [m], shape (n,)
    most: int  # how many can touch at once; a periodic surface in full contact has no separation

    def influence(self, points: Index, others: Index) -> Array:
        """Dense influence of ``others`` on ``points`` [m], a fresh array."""

    def sinking(self, points: Index, pressure: Array) -> Array:
        """Displacement [m] of every pixel by pressures over E* on ``points``, shape (n,)."""


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

    def influence(self, points: Index, others: Index) -> Array:
        """See ``Pixels``."""
        return self.space.block(points, others)

    def sinking(self, points: Index, pressure: Array) -> Array:
        """See ``Pixels``."""
        p = np.zeros(self.height.size)
        p[points] = pressure
        return self.space.apply(p.reshape(self.space.shape)).ravel()


class HighPixels:
    """The highest pixels alone, gaps by their dense influence.

    A row of the influence is computed when its pixel touches for the first time, and kept: few do.

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
        self._space, self._known = space, 0
        self._row = np.full(address.size, -1)
        self._rows: Array = np.empty((0, address.size))

    def influence(self, points: Index, others: Index) -> Array:
        """See ``Pixels``."""
        row = self._placed(points)
        return np.asarray(self._rows[row[:, None], others])

    def sinking(self, points: Index, pressure: Array) -> Array:
        """See ``Pixels``."""
        row = self._placed(points)
        if 4 * row.size < self._known:
            return np.asarray(pressure @ self._rows[row])
        p = np.zeros(self._known)
        p[row] = pressure
        return np.asarray(p @ self._rows[: self._known])

    def _placed(self, points: Index) -> Index:
        """Places of the points among the rows; missing rows are computed."""
        missing = points[self._row[points] < 0]
        if missing.size:
            first, self._known = self._known, self._known + missing.size
            if self._known > len(self._rows):
                rows = np.empty((2 * self._known, self.address.size))
                rows[:first] = self._rows[:first]
                self._rows = rows
            self._row[missing] = np.arange(first, self._known)
            self._rows[first : self._known] = self._space.block(self.address[missing], self.address)
        return np.asarray(self._row[points])


@dataclass(frozen=True, slots=True)
class Touching:
    """Solution on the touching pixels.

    Attributes:
        points: the touching pixels, among ``Pixels``; those at the hardness come last.
        pressure: pressures over E* [-], shape of ``points``.
        unit: their answer to a unit approach, -dp/dd [1/m]; zero at the hardness.
        gap: gap of all ``Pixels`` [m].
        d: separation [m].
        plastic: how many of the points are held at the hardness.
        iterations: sets tried.
    """

    points: Index
    pressure: Array
    unit: Array
    gap: Array
    d: float
    plastic: int
    iterations: int


def active_set(
    pixels: Pixels,
    d: float | None,
    total: float | None,
    start: Index,
    most: int | None = None,
    max_iterations: int = 60,
    cap: float = np.inf,
    held: Index | None = None,
) -> Touching | None:
    """Solve the contact at a given separation or a given load.

    Args:
        pixels: the pixels that can touch.
        d: separation [m], or None for a given load.
        total: sum of the pressures over E* [-], or None for a given separation.
        start: pixels to start from, at least one.
        most: give up when more pixels than these touch elastically; None for no limit.
        max_iterations: sets tried at most.
        cap: hardness over E* [-]; infinite for an elastic surface.
        held: those of ``start`` that start at the hardness; None for none.

    Returns:
        The solution, exact to round-off; None if the pivoting does not settle or gives up.
    """
    height = pixels.height
    touching, plastic = np.zeros(height.size, dtype=bool), np.zeros(height.size, dtype=bool)
    touching[start] = True
    if held is not None:
        touching[held], plastic[held] = False, True
    most = pixels.most if most is None else min(most, pixels.most)
    if total is not None and total >= cap * height.size:
        return None
    least = ROUND_OFF * cap if np.isfinite(cap) else 0.0
    fewest, patience = height.size + 1, 3
    pushed, under = np.zeros_like(plastic), np.zeros(height.size)  # what yields, and its sinking
    for iteration in range(1, max_iterations + 1):
        if total is not None and not touching.any():
            too_much = bool(total > cap * np.count_nonzero(plastic))
            _some_elastic(height, touching, plastic, too_much)
        points, top = np.flatnonzero(touching), np.flatnonzero(plastic)
        if points.size > most:
            return None
        if (changed := np.flatnonzero(plastic != pushed)).size:
            under += pixels.sinking(changed, np.where(plastic[changed], cap, -cap))
            pushed = plastic.copy()
        x = _dense_solve(pixels, points, (height - under)[points])
        if x is None:
            return None
        if total is not None:
            plastic_sum = float(np.full(top.size, cap).sum())
            at = (float(x[0].sum()) + plastic_sum - total) / float(x[1].sum())
        else:
            assert d is not None
            at = d
        pressure = x[0] - at * x[1]
        gap = under + pixels.sinking(points, pressure) - height + at
        tiny = ROUND_OFF * max(float(height.max()) - at, 0.0)
        # A load of so many pixels at the hardness leaves one at a bound, but for rounding errors.
        opening, yielding = points[pressure < -least], points[pressure > cap + least]
        entering = np.flatnonzero((gap < -tiny) & ~touching & ~plastic)
        released = top[gap[top] > tiny]
        moved = [opening, yielding, entering, released]
        wrong = sum(m.size for m in moved)
        if wrong == 0:
            every, unit = np.concatenate([points, top]), np.concatenate([x[1], np.zeros(top.size)])
            pressure = np.concatenate([np.clip(pressure, 0.0, cap), np.full(top.size, cap)])
            return Touching(every, pressure, unit, gap, at, top.size, iteration)
        if wrong < fewest:
            fewest, patience = wrong, 3
        elif patience > 0:
            patience -= 1
        else:
            last = max(m.max(initial=-1) for m in moved)
            opening, yielding, entering, released = (m[m == last] for m in moved)
        touching[opening] = touching[yielding] = plastic[released] = False
        touching[entering] = touching[released] = plastic[yielding] = True
        if not (touching.any() or plastic.any()):
            return None
    return None


class ElasticAnswer:
    """Sum of the pressures over E* [1/m] that displace touching pixels by one, all elastic.

    It is the square of z = L^-1 1 with the Cholesky factor L of their influence, which grows by the
    pixels that have come into contact; it is made anew where one has opened.
    """

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._points: Index = np.empty(0, dtype=np.intp)
        self._factor: Array = np.empty((0, 0))
        self._z: Array = np.empty(0)

    def __call__(self, pixels: Pixels, points: Index) -> float:
        """Answer of these touching pixels.

        Args:
            pixels: the pixels that can touch, which have the numbers of those of the last call.
            points: the touching ones.
        """
        touching = np.zeros(pixels.height.size, dtype=bool)
        touching[points] = True
        if not touching[self._points].all():
            self._forget()
        old = self._points
        touching[old] = False
        new = np.flatnonzero(touching)
        n, m = old.size, new.size
        if m:
            left = pixels.influence(new, old).T
            if n:
                left = solve_triangular(self._factor, left, lower=True, check_finite=False)
            corner = pixels.influence(new, new) - left.T @ left
            try:
                corner = cholesky(corner, lower=True, overwrite_a=True, check_finite=False)
            except LinAlgError:
                raise NotConverged("""stiffness of the touching pixels: their influence is
                    singular""") from None
            factor = np.zeros((n + m, n + m), order="F")
            factor[:n, :n], factor[n:, :n], factor[n:, n:] = self._factor, left.T, corner
            rest = 1.0 - left.T @ self._z
            z = solve_triangular(corner, rest, lower=True, check_finite=False)
            self._points, self._factor = np.concatenate([old, new]), factor
            self._z = np.concatenate([self._z, z])
        return float(self._z @ self._z)


def _some_elastic(height: Array, touching: Mask, plastic: Mask, more: bool) -> None:
    """A given load needs pixels that give way: the next to touch, or the first to be let go."""
    among = ~plastic if more else plastic
    chosen = among & (height == (height[among].max() if more else height[among].min()))
    touching |= chosen
    plastic &= ~chosen


def _dense_solve(pixels: Pixels, points: Index, overlap: Array) -> Array | None:
    """Pressures that displace the points by their overlaps [m], and by one; shape (2, n)."""
    if points.size == 0:
        return np.empty((2, 0))
    rhs = np.empty((points.size, 2), order="F")
    rhs[:, 0], rhs[:, 1] = overlap, 1.0
    try:
        factor = cho_factor(
            pixels.influence(points, points).T, overwrite_a=True, check_finite=False
        )
    except LinAlgError:
        return None
    return np.asarray(cho_solve(factor, rhs, overwrite_b=True, check_finite=False).T)
