"""How many eigenvalues a region holds, counted without an eigensolver: the argument principle.

The number of zeros of an analytic function inside a contour is the number of turns of its phase
along it. The function is det T(z) of a real matrix function, so that the upper half of a contour
symmetric about the real axis suffices. Candidates for zeros are divided out first: the phase of
the quotient turns once for every zero that was missed, back once for every candidate that is none,
and hardly otherwise, so that a few points of the contour settle it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from .regions import Trapezium

# Largest turn of the phase from an end of a piece of the contour to its middle [rad]: far from pi,
# at which a turn could be taken for one of the other direction.
TURN = 0.6


def count_zeros(
    T: Callable[[complex], NDArray],
    region: Trapezium,
    candidates: NDArray,
    points: int = 6,
    most: int = 2000,
) -> int:
    """Zeros of det T inside a region, with multiplicity.

    Args:
        T: matrix function, analytic in the region, real on the real axis.
        region: where to count; no zero may lie on its boundary.
        candidates: values taken for zeros, inside the region and near it; any values are allowed,
            good ones save work.
        points: first points along the short sides.
        most: evaluations allowed.

    Returns:
        The number of zeros.

    Raises:
        InaccurateResult: the phase cannot be followed: a zero lies on the boundary.
    """

    def phase(z: complex) -> complex:
        return determinant_phase(la.lu_factor(T(z), check_finite=False), candidates - z)

    return count_turns(phase, region, candidates, points, most)


def count_turns(
    phase: Callable[[complex], complex],
    region: Trapezium,
    candidates: NDArray,
    points: int = 6,
    most: int = 2000,
) -> int:
    """Zeros inside a region of a function whose phase over prod (z - candidates) is given.

    Args:
        phase: complex number of modulus one for a point of the upper half of the contour.
        region: where to count.
        candidates: the values divided out.
        points: first points along the short sides.
        most: evaluations allowed.

    Returns:
        The number of zeros.

    Raises:
        InaccurateResult: the phase cannot be followed: a zero lies on the boundary.
    """
    path = region.upper_half(points)
    phases = [phase(z) for z in path]
    follower = _PhaseFollower(phase, 1e-11 * abs(region.high), most - path.size)
    turned = sum(
        follower.turn(path[i], path[i + 1], phases[i], phases[i + 1]) for i in range(path.size - 1)
    )
    return int(region.holds(candidates).sum()) + int(np.rint(turned / np.pi))


def determinant_phase(
    lu: tuple[NDArray, NDArray], candidates: NDArray, poles: NDArray | None = None
) -> complex:
    """Phase of det T prod poles / prod candidates, from a factorisation of T, but for the sign.

    Args:
        lu: factors of T(z) and pivots.
        candidates: candidates for zeros, minus z.
        poles: poles of T, minus z.
    """
    factors = np.concatenate(
        [np.diag(lu[0]).astype(complex), np.conj(candidates), [] if poles is None else poles]
    )
    swaps = int(np.sum(lu[1] != np.arange(lu[1].size)))
    phase: complex = np.prod(factors / np.abs(factors)) * (-1) ** swaps
    return phase


class _PhaseFollower:
    """Turn of a phase along a path, each piece of it settled by a point between its ends.

    The point between is evaluated in any case: two ends alone cannot tell a small turn from one
    that is a whole turn larger, as a missed zero close to the path makes it.
    """

    def __init__(self, phase: Callable[[complex], complex], shortest: float, most: int):
        self.phase, self.shortest, self.remaining = phase, shortest, most

    def turn(self, a: complex, b: complex, at_a: complex, at_b: complex) -> float:
        """Turn from a to b [rad].

        Raises:
            InaccurateResult: it cannot be followed.
        """
        if self.remaining <= 0 or not abs(b - a) > self.shortest:
            raise InaccurateResult(
                "count of modes: an eigenvalue lies on the edge of the band; move the band a little"
            )
        self.remaining -= 1
        middle = 0.5 * (a + b)
        at_middle = self.phase(middle)
        first, second = np.angle(at_middle / at_a), np.angle(at_b / at_middle)
        if max(abs(first), abs(second)) <= TURN:
            return float(first + second)
        return self.turn(a, middle, at_a, at_middle) + self.turn(middle, b, at_middle, at_b)
