"""Regions of the complex plane that hold a band, their edges in gaps of the spectrum.

In kappa = -lambda^2 (undamped) a trapezium, in lambda (damped) a rectangle, both symmetric about
the real axis. Modes are counted in them; an edge that ran through a cluster would split it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# The region of kappa may reach beyond the band to a gap of the spectrum, by this share: 5 % in
# frequency, a few modes of any brake.
MARGIN = 0.1

# Eigensolvers search a little further than the region that is counted: its rim may cut a cluster.
RIM = 1.05


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

    def holds(self, values: NDArray) -> NDArray[np.bool_]:
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


def undamped_region(kappa: NDArray, low: float, high: float, zeta_max: float) -> Trapezium:
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


def undamped_reach(high: float, zeta_max: float) -> float:
    """Largest |kappa| of that region and a little more [1/s^2]."""
    slope = opening(zeta_max) * (1 + MARGIN)
    return float((1 + MARGIN) * high * np.hypot(1, slope) + 2e-3 * high)


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
    return Trapezium(
        widest_gap(s.real, -margin * wide, -wide), widest_gap(s.real, wide, margin * wide), 0.0,
        widest_gap(np.abs(inner.imag), high, margin * high),
    )  # fmt: skip
