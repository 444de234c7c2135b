"""Polynomial interpolation over a box of parameters, of a degree of its own in each of them.

A polynomial T_i(x_1) T_j(x_2) ... is one of them where i / n_1 + j / n_2 + ... is 1 at most: with
the same degree n in all parameters, all polynomials of total degree n. The anchors are discrete
Leja points: as many as there are polynomials, chosen among Chebyshev points by Gaussian elimination
with pivoting, so that the first of them are good anchors of the lower degrees (Bos, De Marchi,
Sommariva and Vianello, SIAM J. Numer. Anal. 48, 2010, doi:10.1137/090777372).

Each coefficient D_n of a body is interpolated with a degree of its own. Where an anchor serves the
first n coefficients alone, an undamped body of several parameters is factored at n frequencies: its
other coefficients are interpolated from earlier anchors. Those beyond the first are held in single
precision: they are a hundredth of it and less. The error is estimated by the step from one degree
lower, times what one degree more gains, and by the errors that were measured at two points between
the anchors.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import ceil
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy import special

from brake_fenicsx.arguments import AnyArray, Array, Index

# A coefficient moves with a parameter if that changes it by more than this share of what another
# parameter does.
MOVES = 1e-12

# Of sums of shares of degrees.
ROUND_OFF = 1e-9

# Pivots that differ by less than this share are ties, which the order of the points decides,
# whatever round-off a processor makes.
TIE = 1e-9

# Coordinates of the points where an interpolation is checked: away from those of the anchors, where
# two blocks in rough and in perfect contact showed the errors that were hardest to foresee.
BETWEEN = (0.7, 0.3)


# The first in double, those beyond in single precision.
Powers = Sequence[AnyArray]

# Estimates of errors need few digits.
Estimate = NDArray[np.float32]

# Up to this degree the changes from the centre are held in single precision, since memory limits
# the interpolation: its own error is larger. The errors at the checked points contain both.
SINGLE = 5

# Values that are taken at a time, so that those of all anchors stay in the cache.
STRIP = 8192


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters that all bodies of a brake depend on, scaled to the box [-1, 1]^d.

    Attributes:
        dimension: number of parameters d; 0 for materials that do not change.
        coefficients: of the changes of stiffness, damping and mass at a point of the box, shape
            (3, changes), in this order.
        softening: least r with K(p) >= r K(0) as quadratic forms, wherever in the box the
            parameters of ``shapes`` are the same.
        shapes: numbers of the parameters that change the shape or the mass of a body.
        sliding: numbers of those that move contact elements along their faces.
        contact: with such ones the rows "N", "T", "R" of all contact elements, shape (elements,
            dofs), and their areas [m^2] at a point of the box; None where these stay.
        names: what a user knows them by, shape (d,); none if nobody has to.
    """

    dimension: int
    coefficients: Callable[[Array], Array]
    softening: float = 1.0
    shapes: tuple[int, ...] = ()
    sliding: tuple[int, ...] = ()
    contact: Callable[[Array], tuple[dict[str, sp.csr_matrix], Array]] | None = None
    names: tuple[str, ...] = ()

    @property
    def centre(self) -> Array:
        """Coefficients at the centre of the box."""
        return self.coefficients(np.zeros(self.dimension))

    def corners(self, names: tuple[int, ...]) -> list[Array]:
        """The corners of the box of some parameters, all else at the centre; none of none."""
        points: list[Array] = []
        for ends in product((-1.0, 1.0), repeat=len(names)) if names else ():
            points.append(np.zeros(self.dimension))
            points[-1][list(names)] = ends
        return points

    def acting_on(self, changes: list[int], elements: int = 0) -> Index:
        """Numbers of the parameters that move a coefficient of some of the changes, or elements.

        Args:
            changes: of a body.
            elements: number of its contact elements that may slide.
        """
        base = self.centre
        steps = np.zeros((self.dimension, *base.shape))
        for step, axis in zip(steps, np.eye(self.dimension), strict=True):
            ends = [np.abs(self.coefficients(side * axis) - base) for side in (1.0, -1.0)]
            step[:] = np.max(ends, axis=0)
        moved = steps > MOVES * steps.max(axis=0, initial=0.0)
        acts = moved[:, :, changes].any(axis=(1, 2))
        acts[list(self.sliding)] |= elements > 0
        return np.flatnonzero(acts)


CONSTANT = Parameters(0, lambda x: np.zeros((3, 0)))


def polynomial_levels(degrees: Sequence[int]) -> dict[tuple[int, ...], int]:
    """Polynomials of an interpolation, rising: index -> degree that it counts with.

    Of one parameter of the largest degree it is the polynomial's own.

    Args:
        degrees: degree in each of the parameters.
    """
    highest, out = max(degrees, default=0), {}
    for index in product(*(range(n + 1) for n in degrees)):
        share = sum(i / n for i, n in zip(index, degrees, strict=True))
        if share <= 1 + ROUND_OFF:
            out[index] = ceil(highest * share - ROUND_OFF)
    return dict(sorted(out.items(), key=lambda item: (item[1], item[0])))


def coefficient_counts(
    orders: Sequence[int], degrees: Sequence[int], coarse: bool = False
) -> list[int]:
    """How many coefficients are wanted at each anchor and check, see ``InterpolatedCoefficients``.

    Args:
        orders: degree of the interpolation of the first coefficient in each parameter.
        degrees: level of the interpolation of each coefficient.
        coarse: see ``InterpolatedCoefficients``.
    """
    own, levels = _own_degrees(orders, degrees, coarse), polynomial_levels(orders).values()
    checks = [len(own)] * (2 * bool(orders))
    return [sum(level <= degree for degree in own) for level in levels] + checks


def _own_degrees(orders: Sequence[int], degrees: Sequence[int], coarse: bool) -> list[int]:
    """A body that has none of the parameters of the highest degree needs fewer levels."""
    less = max(degrees) - max(orders, default=0)
    own = [max(0, n - less) for n in degrees]
    if coarse:
        own = [max(min(n, 1), n - 1) for n in own]
    return own


class Interpolation:
    """Polynomials through discrete Leja points of [-1, 1]^d.

    Attributes:
        points: the anchors, shape (anchors, d); the first is the centre.
        degree: the largest of the degrees.
    """

    def __init__(self, degrees: Sequence[int]):
        """Place the anchors.

        Args:
            degrees: degree in each of the d parameters.
        """
        self._degrees = tuple(degrees)
        self.degree = max(self._degrees, default=0)
        self._level = polynomial_levels(self._degrees)
        self._indices, self._levels = np.array([*self._level], int), [*self._level.values()]
        candidates = self._candidates()
        self.points: Array = candidates[_discrete_leja(self._polynomials(candidates))]

    def count(self, degree: int) -> int:
        """Number of anchors up to a level; they come first."""
        return int(np.searchsorted(self._levels, degree, side="right"))

    def weights(self, x: Array, degree: int) -> Array:
        """Weights of the values at all anchors for the interpolant of a level, shape (anchors,).

        Args:
            x: a point, shape (d,).
            degree: the level, at most the largest degree.
        """
        n = self.count(degree)
        out = np.zeros(len(self.points))
        matrix = self._polynomials(self.points[:n])[:, :n]
        out[:n] = np.linalg.solve(matrix.T, self._polynomials(x[None])[0, :n])
        return out

    @property
    def checks(self) -> Array:
        """Two opposite points between the anchors, shape (2, d)."""
        return np.outer([1.0, -1.0], np.resize(BETWEEN, self.points.shape[1]))

    def growth(self, x: Array) -> float:
        """How much larger than in the box an error may be at a point: 1 inside.

        The polynomials of one degree more, which the interpolation lacks, grow no faster outside
        than Chebyshev's.
        """
        each = zip(self._degrees, np.maximum(1.0, np.abs(x)), strict=True)
        return float(max((special.eval_chebyt(n + 1, size) for n, size in each), default=1.0))

    def _polynomials(self, x: Array) -> Array:
        """Products of Chebyshev polynomials, shape (points, anchors)."""
        each = special.eval_chebyt(np.arange(self.degree + 1), x[..., None])
        out = np.ones((len(x), len(self._indices)))
        for j in range(x.shape[1]):
            out *= each[:, j, self._indices[:, j]]
        return out

    def _candidates(self) -> Array:
        """Chebyshev points with as many coordinates off the centre as a polynomial couples."""
        off = []
        for n in self._degrees:
            line = np.sin(np.pi / 2 * np.linspace(-1, 1, 2 * (n // 2) + 5))
            off.append([x for x in line if x])
        dimension = len(self._degrees)
        points = [np.zeros(dimension)]
        for many in range(1, dimension + 1):
            for axes in combinations(range(dimension), many):
                if tuple(int(j in axes) for j in range(dimension)) not in self._level:
                    continue
                for values in product(*(off[j] for j in axes)):
                    point = np.zeros(dimension)
                    point[list(axes)] = values
                    points.append(point)
        return np.array(points)


def _discrete_leja(V: Array) -> Index:
    """Rows that Gaussian elimination with row pivoting takes, the first row first."""
    rows = np.arange(len(V))
    A = V.copy()
    for k in range(V.shape[1]):
        size = np.abs(A[k:, k])
        p = k + int(np.flatnonzero(size >= (1 - TIE) * size.max())[0]) if k else 0
        A[[k, p]], rows[[k, p]] = A[[p, k]], rows[[p, k]]
        A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
    return rows[: V.shape[1]]


class InterpolatedCoefficients:
    """Coefficients at the anchors of the own parameters of a body, and between them.

    Attributes:
        anchors: number of the anchors.
        points: where they are computed: the anchors, the first at the centre, then the points
            where the interpolation is checked; each of shape (own parameters,).
        counts: how many coefficients each of these points needs.
        order: numbers of those that need any, the centre first, those of many before others.
    """

    def __init__(
        self,
        orders: Sequence[int],
        degrees: Sequence[int],
        known: dict[str, AnyArray] | None = None,
        coarse: bool = False,
        kind: type[np.floating[Any]] = np.float32,
    ):
        """Place the points.

        Args:
            orders: degree of the interpolation of the first coefficient in each own parameter.
            degrees: level of the interpolation of each coefficient, not increasing; see
                ``Interpolation``. The first is the largest of ``orders``, if there are any.
            known: ``arrays`` of an earlier run; None where ``add`` will bring the values.
            coarse: one level less, through the first of these anchors, as long as one is left.
            kind: precision of the coefficients beyond the first.
        """
        dimension = len(orders)
        self._degrees = _own_degrees(orders, degrees, coarse)
        self._box = Interpolation(orders)
        self._ends = [self._box.count(degree) for degree in self._degrees]
        checks = self._box.checks if dimension else ()
        self.anchors: int = len(self._box.points)
        self.points: list[Array] = [*self._box.points, *checks]
        self.counts = coefficient_counts(orders, degrees, coarse)
        needed = (i for i, count in enumerate(self.counts) if count)
        self.order: list[int] = sorted(needed, key=lambda i: -self.counts[i])
        self._gain: Array = np.zeros(0)
        self._checks: list[Estimate] = []
        self._checked: dict[int, Array] = {}
        # The coefficients at the centre, and what they change from there to the other anchors.
        self._centre: Powers = []
        self._changes: list[AnyArray] = []
        self._kind = kind
        self._precision = kind if self._box.degree <= SINGLE else np.float64
        if known is not None:
            self._centre = [known["D"], *known["higher"]]
        if known is not None and dimension:
            self._changes = [known[f"D{n}"] for n in range(len(degrees))]
            self._checks, self._gain = [*known["checks"]], known["gain"]

    def add(self, i: int, found: Array) -> None:
        """Coefficients at point i, shape (counts[i], rows, columns); the centre comes first."""
        if i == 0:
            self._centre = [found[0], *found[1:].astype(self._kind)]
            if self.points[0].size:
                shapes = [(end - 1, *found.shape[1:]) for end in self._ends]
                self._changes = [np.empty(shape, self._precision) for shape in shapes]
        elif i < self._ends[0]:
            for n, coefficient in enumerate(found):
                self._changes[n][i - 1] = coefficient - self._centre[n]
        else:
            self._checked[i] = found

    def beyond(self, i: int) -> list[Array]:
        """Coefficients at point i beyond the first counts[i], of anchors that come before it."""
        out, x = [], self.points[i]
        for n in range(self.counts[i], len(self._degrees)):
            weights = self._box.weights(x, self._degrees[n])[1 : self._ends[n]]
            changed = np.tensordot(weights, self._changes[n], 1)
            out.append(np.asarray(self._centre[n] + changed, float))
        return out

    def arrays(self) -> dict[str, AnyArray]:
        """What was computed, to be kept in a file; once all points are there."""
        centre = {"D": self._centre[0], "higher": np.array(self._centre[1:])}
        if not self._changes:
            return centre
        gain, checks = np.zeros(len(self._degrees)), []
        for i, found in sorted(self._checked.items()):
            D, step = self.interpolated(self.points[i])
            error = [A - B for A, B in zip(found, D, strict=True)]
            size, last, whole = (
                np.array([la.norm(A.astype(float)) for A in every])
                for every in (error, step, found)
            )
            # Of a step that is round-off no ratio is known: the errors at the points remain.
            held = [max(np.finfo(kind).eps for kind in (A.dtype, self._precision)) for A in D]
            known = last > held * whole
            gain = np.maximum(gain, np.where(known, size / np.where(known, last, 1.0), 1.0))
            checks.append(np.array(error, np.float32))
        made = {f"D{n}": changes for n, changes in enumerate(self._changes)}
        return {**centre, "checks": np.array(checks), "gain": gain, **made}

    def at(self, own: Array) -> tuple[Powers, list[Estimate], float]:
        """Coefficients at a point of the own parameters, shape (own parameters,).

        Returns:
            D, one array of shape (rows, columns) for each coefficient; estimates of its errors,
            each of shape (count, rows, columns): what one degree more would change, and the errors
            at the points that were checked; how much larger these may be at this point.
        """
        if not own.size:
            return self._centre, [], 1.0
        # One degree more gains about what it gains at the points that were checked.
        D, step = self.interpolated(own, self._gain)
        return D, [step.astype(np.float32, copy=False), *self._checks], self._box.growth(own)

    def interpolated(self, own: Array, gain: Array | None = None) -> tuple[Powers, AnyArray]:
        """Coefficients at a point of the own parameters, and the step from one degree lower.

        Args:
            own: the point, shape (own parameters,).
            gain: what the step of each coefficient is multiplied by.
        """
        gain = np.ones(len(self._degrees)) if gain is None else gain
        D = [np.empty_like(coefficient) for coefficient in self._centre]
        step = np.empty((len(D), *D[0].shape), self._precision)
        for n, (changes, degree) in enumerate(zip(self._changes, self._degrees, strict=True)):
            weights = self._box.weights(own, degree)
            pair = np.array([weights, gain[n] * (weights - self._box.weights(own, degree - 1))])
            # Weights add up to 1: those of the changes are all but that of the centre.
            factors = pair[:, 1 : len(changes) + 1].astype(self._precision)
            every, centre = changes.reshape(len(changes), -1), self._centre[n].ravel()
            for first in range(0, centre.size, STRIP):
                strip = slice(first, first + STRIP)
                change, difference = factors @ every[:, strip]
                np.add(centre[strip], change, out=D[n].reshape(-1)[strip])
                step[n].reshape(-1)[strip] = difference
        return D, step
