"""What a body of variable stiffness is known by at any point: W'A W exactly, R_j interpolated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .anchors import Anchors
from .expansion import Moment

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# R_0 is interpolated with the degree of the anchors, R_1 and R_2 with these at most.
LATER_DEGREES = 3, 2


@dataclass(frozen=True, slots=True)
class Stiffness:
    """W'A W.

    Attributes:
        projected: W'K W and the same of the unit changes, shape (1 + changes, directions,
            directions).
        numbers: of these changes among all.
        coefficients: of all unit changes at a point.
        sigma: shift [1/s^2].
    """

    projected: Array
    numbers: Index
    coefficients: Callable[[Array], Array]
    sigma: float

    def at(self, x: Array) -> Array:
        """The matrix at a point [1/s^2], shape (directions, directions)."""
        A = self._sum(np.r_[1.0, self.coefficients(x)[self.numbers]], self.projected)
        A[np.diag_indices(len(A))] += self.sigma
        return A

    def difference(self, x: Array) -> Array:
        """W' DeltaC W, what the last coordinate t multiplies."""
        end = np.r_[x[:-1], 1.0]
        c = (self.coefficients(end) - self.coefficients(x))[self.numbers]
        return self._sum(c, self.projected[1:])

    @staticmethod
    def _sum(c: Array, matrices: Array) -> Array:
        return np.asarray((c @ matrices.reshape(c.size, -1)).reshape(matrices.shape[1:]))


@dataclass(frozen=True, slots=True)
class Rests:
    """The first R_j.

    Attributes:
        anchors: where they were computed.
        values: of each j at its anchors, shape (anchors, rows, columns).
    """

    anchors: Anchors
    values: tuple[Array, ...]

    def at(self, x: Array, j: int, rows: int) -> Array:
        """The first rows of R_j at a point."""
        R = self.values[j]
        # They stand side by side: a part of each matrix, without a copy.
        flat = R.reshape(len(R), -1)[:, : rows * R.shape[2]]
        weights = self.anchors.weights(x, degrees(self.anchors)[j])
        return np.asarray((weights @ flat).reshape(rows, -1))

    def moment(self, x: Array, j: int, series: bool) -> Moment:
        """R_j at a point; as a series in the last coordinate if that is wanted."""
        degree = degrees(self.anchors)[j]
        if series:
            return Moment(j, self.anchors.series(x[:-1], degree), self.values[j])
        return Moment(j, self.anchors.weights(x, degree)[None], self.values[j])


def degrees(anchors: Anchors) -> list[int]:
    """Degree of each R_j that is interpolated."""
    return [anchors.degree, *(d for d in LATER_DEGREES if d <= anchors.degree)]
