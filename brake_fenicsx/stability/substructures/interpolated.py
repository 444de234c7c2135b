"""Coefficients of a body over its own parameters: each D_n interpolated with a degree of its own.

The coefficients beyond the first are held in single precision: they are a hundredth of it and less.
The error is estimated by the step from one degree lower, times what one degree more gains, and by
the errors that were measured at two points between the anchors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from .parameters import Interpolation

Array = NDArray[np.float64]

# The first in double, those beyond in single precision.
Powers = Sequence[NDArray[Any]]

# Estimates of errors need few digits.
Estimate = NDArray[np.float32]

# Up to this degree the changes from the centre are held in single precision, since memory limits
# the interpolation: its own error is larger. The errors at the checked points contain both.
SINGLE = 5

# Values that are taken at a time, so that those of all anchors stay in the cache.
STRIP = 8192


class InterpolatedCoefficients:
    """Coefficients at the anchors of the own parameters of a body, and between them.

    Attributes:
        points: where they are computed: the anchors, the first at the centre, then the points
            where the interpolation is checked; each of shape (own parameters,).
        counts: how many coefficients each of these points needs.
        order: numbers of the points, the centre first, those of many coefficients before others.
    """

    def __init__(
        self, orders: Sequence[int], degrees: Sequence[int], known: dict[str, NDArray] | None = None
    ):
        """Place the points.

        Args:
            orders: degree of the interpolation of the first coefficient in each own parameter.
            degrees: level of the interpolation of each coefficient, not increasing; see
                ``Interpolation``. The first is the largest of ``orders``, if there are any.
            known: ``arrays`` of an earlier run; None where ``add`` will bring the values.
        """
        dimension, highest = len(orders), max(orders, default=0)
        # A body that has none of the parameters of the highest degree needs fewer levels.
        self._degrees = [max(0, n - max(degrees) + highest) for n in degrees]
        self._box = Interpolation(orders)
        self._ends = [self._box.count(degree) for degree in self._degrees]
        checks = self._box.checks if dimension else ()
        self.points: list[Array] = [*self._box.points, *checks]
        self.counts = [sum(i < end for end in self._ends) for i in range(self._ends[0])]
        self.counts += [len(self._degrees)] * len(checks)
        self.order: list[int] = sorted(range(len(self.points)), key=lambda i: -self.counts[i])
        self._gain: Array = np.zeros(0)
        self._checks: list[Estimate] = []
        self._checked: dict[int, Array] = {}
        # The coefficients at the centre, and what they change from there to the other anchors.
        self._centre: Powers = []
        self._changes: list[NDArray[Any]] = []
        self._precision = np.float32 if self._box.degree <= SINGLE else np.float64
        if known is not None:
            self._centre = [known["D"], *known["higher"]]
        if known is not None and dimension:
            self._changes = [known[f"D{n}"] for n in range(len(degrees))]
            self._checks, self._gain = [*known["checks"]], known["gain"]

    def add(self, i: int, found: Array) -> None:
        """Coefficients at point i, shape (counts[i], rows, columns); the centre comes first."""
        if i == 0:
            self._centre = [found[0], *found[1:].astype(np.float32)]
            if self.points[0].size:
                shapes = [(end - 1, *found.shape[1:]) for end in self._ends]
                self._changes = [np.empty(shape, self._precision) for shape in shapes]
        elif i < self._ends[0]:
            for n, coefficient in enumerate(found):
                self._changes[n][i - 1] = coefficient - self._centre[n]
        else:
            self._checked[i] = found

    def arrays(self) -> dict[str, NDArray]:
        """What was computed, to be kept in a file; once all points are there."""
        centre = {"D": self._centre[0], "higher": np.array(self._centre[1:])}
        if not self._changes:
            return centre
        gain, checks = np.zeros(len(self._degrees)), []
        for i, found in sorted(self._checked.items()):
            D, step = self._interpolated(self.points[i])
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
        D, step = self._interpolated(own)
        # One degree more gains about what it gains at the points that were checked.
        step *= self._gain[:, None, None].astype(step.dtype)
        return D, [step.astype(np.float32, copy=False), *self._checks], self._box.growth(own)

    def _interpolated(self, own: Array) -> tuple[Powers, NDArray[Any]]:
        """Coefficients, and the step from one degree lower."""
        D = [np.empty_like(coefficient) for coefficient in self._centre]
        step = np.empty((len(D), *D[0].shape), self._precision)
        for n, (changes, degree) in enumerate(zip(self._changes, self._degrees, strict=True)):
            weights = self._box.weights(own, degree)
            pair = np.array([weights, weights - self._box.weights(own, degree - 1)])
            # Weights add up to 1: those of the changes are all but that of the centre.
            factors = pair[:, 1 : len(changes) + 1].astype(self._precision)
            every, centre = changes.reshape(len(changes), -1), self._centre[n].ravel()
            for first in range(0, centre.size, STRIP):
                strip = slice(first, first + STRIP)
                change, difference = factors @ every[:, strip]
                D[n].reshape(-1)[strip] = centre[strip] + change
                step[n].reshape(-1)[strip] = difference
        return D, step
