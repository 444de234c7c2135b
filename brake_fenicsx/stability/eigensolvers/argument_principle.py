"""How many eigenvalues a region holds, counted without an eigensolver: the argument principle.

The number of zeros of an analytic function inside a contour is the number of turns of its phase
along it. The function is det T(z) of a real matrix function, so that the upper half of a contour
symmetric about the real axis suffices. Candidates for zeros are divided out first: the phase of
the quotient turns once for every zero that was missed, back once for every candidate that is none,
and hardly otherwise, so that a few points of the contour settle it.

Regions of the complex plane that hold a band, their edges in gaps of the spectrum.

In kappa = -lambda^2 (undamped) a trapezium, in lambda (damped) a rectangle, both symmetric about
the real axis. Modes are counted in them; an edge that ran through a cluster would split it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import AnyArray, Array, Complex, Mask
from brake_fenicsx.errors import InaccurateResult

# The region of kappa may reach beyond the band to a gap of the spectrum, by this share: 5 % in
# frequency, a few modes of any brake.
MARGIN = 0.1
# Eigensolvers search a little further than the region that is counted: its rim may cut a cluster.
RIM = 1.05
# Largest turn of the phase from an end of a piece of the contour to its middle [rad]: far from pi,
# at which a turn could be taken for one of the other direction.
TURN = 0.6


@dataclass(frozen=True, slots=True)
class Trapezium:
    """Region low <= Re z <= high, |Im z| <= slope Re z + rise, of kappa [1/s^2] or lambda [1/s].

    Attributes:
        low: smallest real part.
        high: largest real part.
        slope: growth of the half height [-].
        rise: half height at zero.
    """

    low: float
    high: float
    slope: float
    rise: float

    def holds(self, values: AnyArray) -> Mask:
        """Which of some values lie inside."""
        x, y = values.real, np.abs(values.imag)
        return np.asarray(
            (x >= self.low) & (x <= self.high) & (y <= self.slope * np.maximum(x, 0) + self.rise)
        )

    def upper_half(self, points: int) -> Complex:
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


def widest_gap(values: Array, low: float, high: float) -> float:
    """Middle of the widest gap that some values leave between two bounds, bounds included."""
    inner = np.sort(values[(values > low) & (values < high)])
    marks = np.r_[low, inner, high]
    widest = int(np.argmax(np.diff(marks)))
    return float(0.5 * (marks[widest] + marks[widest + 1]))


def undamped_region(kappa: AnyArray, low: float, high: float, zeta_max: float) -> Trapezium:
    """Region of the plane of kappa that holds every mode of a band up to a damping ratio.

    Args:
        kappa: eigenvalues in the band and beyond [1/s^2].
        low: lower end of the band [1/s^2].
        high: upper end.
        zeta_max: largest damping ratio looked for.
    """
    rise = 1e-3 * high
    # Smallest Re kappa of modes with omega^2 >= low.
    wide, least = opening(zeta_max), low * (1 - zeta_max**2 / (1 - zeta_max**2))
    near = kappa[np.abs(kappa.imag) <= 2 * wide * np.abs(kappa.real) + rise]
    top = widest_gap(near.real, high, high * (1 + MARGIN))
    bottom = widest_gap(near.real, least * (1 - MARGIN), least) if low > 0 else -0.02 * high
    inner = kappa[(kappa.real > bottom) & (kappa.real < top) & (kappa.real > 0)]
    slopes = (np.abs(inner.imag) - rise) / np.maximum(inner.real, 1e-6 * high)
    slope = widest_gap(slopes, wide, wide * (1 + MARGIN))
    return Trapezium(bottom, top, slope, rise)


def undamped_reach(high: float, zeta_max: float, sigma: float) -> float:
    """Largest |kappa - sigma| of that region, zero included, and a little more [1/s^2]."""
    top = (1 + MARGIN) * high
    corner = complex(top, opening(zeta_max) * (1 + MARGIN) * top + 1e-3 * high)
    return float(max(abs(corner - sigma), abs(sigma + 0.02 * high)) + 2e-3 * high)


def damped_region(s: Complex, high: float, wide: float, margin: float = RIM) -> Trapezium:
    """Region of the plane of lambda that holds the band.

    Args:
        s: eigenvalues in the band and beyond [1/s].
        high: upper end of the band [rad/s].
        wide: largest |Re lambda| over that.
        margin: the edges may be moved outwards by this factor.
    """
    wide *= high
    inner = s[np.abs(s.real) < margin * wide]
    left, right = ((-margin * wide, -wide), (wide, margin * wide))
    top = widest_gap(np.abs(inner.imag), high, margin * high)
    return Trapezium(widest_gap(s.real, *left), widest_gap(s.real, *right), 0.0, top)


def count_zeros(
    T: Callable[[complex], AnyArray],
    region: Trapezium,
    candidates: AnyArray,
    points: int = 6,
    most: int = 2000,
) -> int:
    """Zeros of det T inside a region, with multiplicity.

    Args:
        T: matrix function, analytic in the region, real on the real axis.
        region: where to count; no zero may lie on its boundary.
        candidates: values taken for zeros; any values are allowed, good ones save work. Those far
            beyond the region belong to them: many zeros there turn the phase by whole turns
            between two points.
        points: first points along the short sides.
        most: evaluations allowed.

    Returns:
        The number of zeros.

    Raises:
        InaccurateResult: the phase cannot be followed: a zero lies on the boundary.
    """

    def phase(z: complex) -> complex:
        return determinant_phase(la.lu_factor(T(z), check_finite=False), candidates - z)

    turned = turn_along(phase, region.upper_half(points), most)
    return int(region.holds(candidates).sum()) + int(np.rint(turned / np.pi))


def turn_along(phase: Callable[[complex], complex], path: Complex, most: int = 2000) -> float:
    """Turn of a phase along a path [rad], each piece of it settled by a point between its ends.

    The point between is evaluated in any case: two ends alone cannot tell a small turn from one
    that is a whole turn larger, as a missed zero close to the path makes it.

    Args:
        phase: complex number of modulus one for a point of the path.
        path: points of it.
        most: evaluations allowed.

    Raises:
        InaccurateResult: the phase cannot be followed: a zero lies on the path.
    """
    shortest, evaluated = 1e-11 * float(np.abs(path).max()), path.size

    def turn(a: complex, b: complex, at_a: complex, at_b: complex) -> float:
        nonlocal evaluated
        if evaluated >= most or not abs(b - a) > shortest:
            raise InaccurateResult("""count of modes: an eigenvalue lies on the edge of the band;
                move the band a little""")
        evaluated += 1
        middle = 0.5 * (a + b)
        at_middle = phase(middle)
        first, second = np.angle(at_middle / at_a), np.angle(at_b / at_middle)
        if max(abs(first), abs(second)) <= TURN:
            return float(first + second)
        return turn(a, middle, at_a, at_middle) + turn(middle, b, at_middle, at_b)

    phases = [phase(z) for z in path]
    return sum(turn(*ends) for ends in zip(path, path[1:], phases, phases[1:], strict=False))


def determinant_phase(
    lu: tuple[AnyArray, AnyArray], candidates: AnyArray, poles: AnyArray | None = None
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
