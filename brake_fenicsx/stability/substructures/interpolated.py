"""Moments of a body over its own parameters: each D_n interpolated with a degree of its own.

The error is estimated by the step from one degree lower, times what one degree more gains, and by
the errors that were measured at two points between the anchors.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from .parameters import Interpolation

Array = NDArray[np.float64]

# Estimates of errors need few digits.
Estimate = NDArray[np.float32]

# Values that are taken at a time, so that the second product with them finds them in the cache: it
# is memory that limits the interpolation.
STRIP = 8192


class InterpolatedMoments:
    """Moments at the anchors of the own parameters of a body, and between them.

    Attributes:
        points: where they are computed: the anchors, the first at the centre, then the points
            where the interpolation is checked; each of shape (own parameters,).
        counts: how many moments each of these points needs.
    """

    def __init__(
        self, dimension: int, degrees: Sequence[int], known: dict[str, NDArray] | None = None
    ):
        """Place the points.

        Args:
            dimension: number of own parameters.
            degrees: total degree of the interpolation of each moment, not increasing.
            known: ``arrays`` of an earlier run; None where ``add`` will bring the values.
        """
        self._degrees = degrees if dimension else [0] * len(degrees)
        self._box = Interpolation(dimension, max(self._degrees))
        self._ends = [comb(degree + dimension, dimension) for degree in self._degrees]
        checks = self._box.checks if dimension else ()
        self.points: list[Array] = [*self._box.points, *checks]
        self.counts = [sum(i < end for end in self._ends) for i in range(self._ends[0])]
        self.counts += [len(self._degrees)] * len(checks)
        self._gain: Array = np.zeros(len(degrees))
        self._checks: list[Estimate] = []
        self._D: list[Array] = []
        # Of a body without parameters: all moments in one array, which may be mapped from a file.
        self._constant: Array = np.zeros((0, 0, 0))
        if known is not None and not dimension:
            self._constant = known["D"]
        elif known is not None:
            self._D = [known[f"D{n}"] for n in range(len(degrees))]
            self._checks, self._gain = [*known["checks"]], known["gain"]

    def add(self, i: int, found: Array) -> None:
        """Moments at point i, shape (counts[i], rows, columns); points come in their order."""
        if not self.points[i].size:
            self._constant = found
            return
        if i == 0:
            self._D = [np.empty((end, *found.shape[1:])) for end in self._ends]
        if i < self._ends[0]:
            for n in range(len(found)):
                self._D[n][i] = found[n]
            return
        D, step = self._interpolated(self.points[i])
        error = found - D
        size = [[la.norm(A) for A in every] for every in (error, step)]
        self._gain = np.maximum(self._gain, np.divide(size[0], size[1]))
        self._checks.append(error.astype(np.float32))

    def arrays(self) -> dict[str, NDArray]:
        """What was computed, to be kept in a file."""
        if not self._D:
            return {"D": self._constant}
        shape = len(self._checks), len(self._D), *self._D[0].shape[1:]
        checks = np.array(self._checks, np.float32).reshape(shape)
        made = {f"D{n}": D for n, D in enumerate(self._D)}
        return {"checks": checks, "gain": self._gain, **made}

    def at(self, own: Array) -> tuple[Array, list[Estimate], float]:
        """Moments at a point of the own parameters, shape (own parameters,).

        Returns:
            D, shape (count, rows, columns); estimates of its errors, each of that shape: what one
            degree more would change, and the errors at the points that were checked; how much
            larger these may be at this point.
        """
        if not own.size:
            return self._constant, [], 1.0
        D, step = self._interpolated(own)
        # One degree more gains about what it gains at the points that were checked.
        gain = self._gain[:, None, None]
        more = np.multiply(step, gain, dtype=np.float32, casting="same_kind")
        return D, [more, *self._checks], self._box.growth(own)

    def _interpolated(self, own: Array) -> tuple[Array, Array]:
        """Moments, and the step from one degree lower."""
        D = np.empty((len(self._D), *self._D[0].shape[1:]))
        step = np.empty_like(D)
        for n, (values, degree) in enumerate(zip(self._D, self._degrees, strict=True)):
            weights = self._box.weights(own, degree)
            lower = weights - self._box.weights(own, degree - 1)
            count = len(values)
            every, pairs = values.reshape(count, -1), ((weights, D[n]), (lower, step[n]))
            for first in range(0, every.shape[1], STRIP):
                strip = slice(first, first + STRIP)
                for factors, out in pairs:
                    np.matmul(factors[:count], every[:, strip], out=out.reshape(-1)[strip])
        return D, step
