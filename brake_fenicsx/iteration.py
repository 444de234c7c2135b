"""When a fixed-point iteration or a refinement ends: the one rule of the package.

Each column of an iteration is judged by itself. It ends where what is left of its error is as small
as asked for, or where steps gain nothing any more: at the round-off of the arithmetic, or because
the iteration does not contract. What is left is an estimate, for the caller to judge.

Reference: C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations (1995), section 1.3,
doi:10.1137/1.9781611970944, for the estimate from two steps.
"""

import numpy as np
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import AnyArray, Array, Ints, Mask

# An iteration gains nothing where none of so many steps is below this share of one before them.
PATIENCE, GAIN = 4, 0.9

# Contraction that is believed: what is left is taken as no less than the last step, and steps that
# stand still leave some twenty times as much.
FASTEST, SLOWEST = 0.5, 0.95


def remaining(size: ArrayLike, rate: ArrayLike) -> Array:
    """What steps still to come would add, if each is ``rate`` times the one before: never nan.

    Args:
        size: of the last step.
        rate: of contraction; ``SLOWEST`` at most is believed.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        # The smaller of nan and a number is the number.
        believed = np.fmin(np.maximum(rate, 0.0), SLOWEST)
        left = np.asarray(size, float) * believed / (1 - believed)
    return np.where(np.isnan(left), np.inf, left)


def sizes(step: AnyArray, x: AnyArray) -> tuple[Array, Array]:
    """Norm of each column of a step, and of what it leads to, shape (columns,) each."""
    return np.linalg.norm(step, axis=0), np.linalg.norm(x + step, axis=0)


class Steps:
    """The steps of an iteration, each column judged by itself.

    Attributes:
        moving: columns that go on, shape (columns,).
        left: estimated relative error of each column; infinite before the first step.
        taken: number of steps.
    """

    def __init__(self, columns: int, tolerance: float, most: int):
        """Begin.

        Args:
            columns: number of columns.
            tolerance: value of ``left`` at which a column ends.
            most: steps allowed.
        """
        self.moving: Mask = np.ones(columns, bool)
        self.left: Array = np.full(columns, np.inf)
        self.taken = 0
        self._tolerance, self._most = tolerance, most
        # The last step, the last one that gained, and the largest since then.
        self._last: Array = np.full(columns, np.inf)
        self._least: Array = np.full(columns, np.inf)
        self._worst: Array = np.full(columns, np.inf)
        self._idle: Ints = np.zeros(columns, np.int64)

    def take(self, size: Array, whole: ArrayLike = 1.0) -> Mask:
        """Judge a step before it is added.

        Args:
            size: of the step of every column, shape (columns,).
            whole: size of what it leads to, likewise.

        Returns:
            The columns that the step is to be added to: those that move and stay finite.
        """
        good = self.moving & np.isfinite(size)
        self.taken += 1
        gains = size < GAIN * self._least
        self._idle = np.where(gains, 0, self._idle + 1)
        self._worst = np.where(gains, size, np.fmax(self._worst, size))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            rate = np.where(np.isfinite(self._last), size / self._last, SLOWEST)
            left = remaining(self._worst, np.fmax(rate, FASTEST)) / np.asarray(whole, float)
        left = np.where(self._worst == 0, 0.0, np.where(np.isnan(left), np.inf, left))
        self.left = np.where(good, left, np.where(self.moving, np.inf, self.left))
        self._least, self._last = np.where(gains, size, self._least), size
        self.moving = good & (self.left > self._tolerance) & (self._idle < PATIENCE)
        if self.taken >= self._most:
            self.moving = np.zeros_like(self.moving)
        return good
