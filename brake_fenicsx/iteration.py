"""When a fixed-point iteration or a refinement ends: the one rule of the package.

Each column of an iteration is judged by itself. It ends where what is left of its error is as small
as asked for, or where steps gain nothing any more: at the round-off of the arithmetic, or because
the iteration does not contract. What is left is an estimate, for the caller to judge.

Reference: C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations (1995), section 1.3,
doi:10.1137/1.9781611970944, for the estimate from two steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# A step gains nothing where none of so many is smaller than this share of the smallest before.
PATIENCE, GAIN = 3, 0.9

# Largest contraction that the estimate believes: steps that stand still would leave all.
SLOWEST = 0.95


def remaining(size: ArrayLike, rate: ArrayLike) -> Array:
    """What steps still to come would add, if each is ``rate`` times the one before: never nan.

    Args:
        size: of the last step.
        rate: of contraction; ``SLOWEST`` at most is believed.
    """
    rate = np.clip(np.nan_to_num(np.asarray(rate, float), nan=SLOWEST), 0.0, SLOWEST)
    left = np.asarray(size, float) * rate / (1 - rate)
    return np.asarray(np.nan_to_num(left, nan=np.inf, posinf=np.inf))


def relative_size(step: NDArray, x: NDArray) -> Array:
    """Norm of each column of a step over that of what it changes, shape (columns,)."""
    size = np.linalg.norm(step, axis=0)
    return np.asarray(size / np.maximum(np.linalg.norm(x, axis=0), np.finfo(float).tiny))


class Steps:
    """The steps of an iteration, each column judged by itself.

    Attributes:
        moving: columns that go on, shape (columns,).
        left: estimated size of what is left of the error of each column, in the measure of the
            steps; infinite before the first one.
        taken: number of steps.
    """

    def __init__(self, columns: int, tolerance: ArrayLike, most: int):
        """Begin.

        Args:
            columns: number of columns.
            tolerance: size of ``left`` at which a column ends, one or one per column.
            most: steps allowed.
        """
        self.moving: NDArray[np.bool_] = np.ones(columns, bool)
        self.left: Array = np.full(columns, np.inf)
        self.taken = 0
        self._tolerance, self._most = np.asarray(tolerance, float), most
        self._last, self._least = np.full(columns, np.inf), np.full(columns, np.inf)
        self._idle = np.zeros(columns, int)

    def take(self, size: Array) -> NDArray[np.bool_]:
        """Judge a step before it is added.

        Args:
            size: of the step of every column, relative to what it changes, shape (columns,).

        Returns:
            The columns that the step is to be added to: those that move and stay finite.
        """
        good = self.moving & np.isfinite(size)
        self.taken += 1
        with np.errstate(invalid="ignore", divide="ignore"):
            rate = np.where(np.isfinite(self._last), size / self._last, SLOWEST)
        left = remaining(size, np.where(size == 0, 0.0, rate))
        self.left = np.where(good, left, np.where(self.moving, np.inf, self.left))
        self._idle = np.where(size < GAIN * self._least, 0, self._idle + 1)
        self._least, self._last = np.minimum(self._least, size), size
        self.moving = good & (self.left > self._tolerance) & (self._idle < PATIENCE)
        if self.taken >= self._most:
            self.moving = np.zeros_like(self.moving)
        return good
