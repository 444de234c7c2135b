"""How many eigenvalues a band holds, counted without an eigensolver.

The number of zeros of an analytic function inside a contour is the number of turns of its phase
along it. The function is det T(kappa) of a real matrix function, so that the upper half of a
contour symmetric about the real axis suffices. Values believed to be zeros are divided out first:
the phase of the quotient turns once for every zero that was missed, back once for every one that is
none, and hardly otherwise, so that a few points of the contour settle it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

# Largest turn of the phase from an end of a piece of the contour to its middle [rad].
TURN = 0.6


@dataclass(frozen=True, slots=True)
class Trapezium:
    """Region low <= Re kappa <= high, |Im kappa| <= slope Re kappa + rise.

    Attributes:
        low: smallest real part [1/s^2].
        high: largest real part [1/s^2].
        slope: growth of the half height [-].
        rise: half height at zero [1/s^2].
    """

    low: float
    high: float
    slope: float
    rise: float

    def holds(self, kappa: NDArray) -> NDArray[np.bool_]:
        """Which of some values lie inside."""
        x, y = kappa.real, np.abs(kappa.imag)
        return np.asarray(
            (x >= self.low) & (x <= self.high) & (y <= self.slope * np.maximum(x, 0) + self.rise)
        )

    def upper_half(self, points: int) -> NDArray[np.complex128]:
        """Points along the boundary from (high, 0) over the top to (low, 0)."""
        right = self.high + 1j * np.linspace(0, self.slope * self.high + self.rise, points)
        zero = max(self.low, 0.0)
        # Frequencies are about evenly spread.
        x = np.linspace(np.sqrt(self.high), np.sqrt(zero), 4 * points) ** 2
        top = x + 1j * (self.slope * x + self.rise)
        corner = np.linspace(zero, self.low, points) + 1j * (self.slope * zero + self.rise)
        left = self.low + 1j * np.linspace(self.slope * zero + self.rise, 0, points)
        # The edge bends at zero only where the region reaches below it.
        bend = corner[1:] if self.low < 0 else corner[:0]
        return np.concatenate([right, top[1:], bend, left[1:]])


def opening(zeta: float) -> float:
    """|Im kappa| / Re kappa of modes of a damping ratio: kappa = -lambda^2 turns twice as far."""
    return float(np.tan(2 * np.arcsin(zeta)))


def lowest_real(low: float, zeta: float) -> float:
    """Smallest Re kappa of modes with omega^2 >= low and damping ratios up to zeta [1/s^2]."""
    return low * (1 - zeta**2 / (1 - zeta**2))


def count_zeros(
    T: Callable[[complex], NDArray],
    region: Trapezium,
    believed: NDArray,
    points: int = 6,
    most: int = 2000,
) -> int:
    """Zeros of det T inside a region, with multiplicity.

    Args:
        T: matrix function, analytic in the region, real on the real axis.
        region: where to count; no zero may lie on its boundary.
        believed: values taken for zeros, inside the region and near it; any values are allowed,
            good ones save work.
        points: points of the first walk along the short sides.
        most: evaluations allowed.

    Returns:
        The number of zeros.

    Raises:
        InaccurateResult: the phase cannot be followed: a zero lies on the boundary.
    """
    return count_turns(lambda z: _phase(T, z, believed), region, believed, points, most)


def count_turns(
    phase: Callable[[complex], complex],
    region: Trapezium,
    believed: NDArray,
    points: int = 6,
    most: int = 2000,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> int:
    """Zeros inside a region of a function whose phase over prod (z - believed) is given.

    Args:
        phase: complex number of modulus one for a point of the upper half of the edge.
        region: where to count.
        believed: the values divided out.
        points: points of the first walk along the short sides.
        most: evaluations allowed.
        comm: processes that share the edge.

    Returns:
        The number of zeros.

    Raises:
        InaccurateResult: the phase cannot be followed: a zero lies on the boundary.
    """
    path = region.upper_half(points)
    own = np.array_split(np.arange(path.size - 1), comm.size)[comm.rank]
    phases = {i: phase(path[i]) for i in range(own[0], own[-1] + 2)} if own.size else {}
    walk = _Walk(phase, 1e-11 * abs(region.high), most - path.size)
    try:
        part = sum(walk.turn(path[i], path[i + 1], phases[i], phases[i + 1]) for i in own)
        failed = None
    except InaccurateResult as error:
        part, failed = 0.0, error
    parts, failures = comm.allgather(part), comm.allgather(failed)
    for failure in failures:
        if failure is not None:
            raise failure
    turned = sum(parts)
    return int(region.holds(believed).sum()) + int(np.rint(turned / np.pi))


class _Walk:
    """Turn of a phase along a path, each piece of it settled by a point between its ends.

    The point between is evaluated in any case: two ends alone cannot tell a small turn from one
    that is a whole turn larger, as a missed zero close to the path makes it.
    """

    def __init__(self, phase: Callable[[complex], complex], least: float, most: int):
        self.phase, self.least, self.left = phase, least, most

    def turn(self, a: complex, b: complex, at_a: complex, at_b: complex) -> float:
        """Turn from a to b [rad].

        Raises:
            InaccurateResult: it cannot be followed.
        """
        if self.left <= 0 or not abs(b - a) > self.least:
            raise InaccurateResult(
                "count of modes: an eigenvalue lies on the edge of the band; move the band a little"
            )
        self.left -= 1
        middle = 0.5 * (a + b)
        at_middle = self.phase(middle)
        first, second = np.angle(at_middle / at_a), np.angle(at_b / at_middle)
        if max(abs(first), abs(second)) <= TURN:
            return float(first + second)
        return self.turn(a, middle, at_a, at_middle) + self.turn(middle, b, at_middle, at_b)


def _phase(T: Callable[[complex], NDArray], z: complex, believed: NDArray) -> complex:
    """Phase of det T / prod (z - believed), from a factorisation."""
    lu, pivots = la.lu_factor(T(z), check_finite=False)
    diagonal = np.diag(lu).astype(complex)
    swaps = int(np.sum(pivots != np.arange(pivots.size)))
    away = np.conj(z - believed)
    factors = np.concatenate([diagonal / np.abs(diagonal), away / np.abs(away)])
    phase: complex = np.prod(factors) * (-1) ** swaps
    return phase
