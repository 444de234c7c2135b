"""Laws that a formula gives: a linear penalty and an exponential."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import Array, positive


@dataclass(frozen=True, slots=True)
class LinearLaw:
    """Penalty p = k <-d>.

    Attributes:
        k: stiffness [Pa/m].
    """

    k: float
    first_touch: float = 0.0

    def pressure(self, d: ArrayLike) -> Array:
        """Pressure p [Pa] at the separation d [m]."""
        return self.k * np.maximum(-np.asarray(d, dtype=float), 0.0)

    def stiffness(self, d: ArrayLike) -> Array:
        """Stiffness -dp/dd [Pa/m]."""
        return np.where(np.asarray(d, dtype=float) < 0.0, self.k, 0.0)

    vibration = stiffness


@dataclass(frozen=True, slots=True)
class ExponentialLaw:
    """p = p0 exp(-d / u0): many contacts of a random surface.

    Attributes:
        p0: pressure at d = 0 [Pa].
        u0: length over which the pressure falls by e [m].
    """

    p0: float
    u0: float

    @property
    def first_touch(self) -> float:
        """Separation [m] where p has fallen to p0 / 1e6, since it never becomes zero."""
        return float(self.u0 * np.log(1e6))

    def pressure(self, d: ArrayLike) -> Array:
        """Pressure p [Pa] at the separation d [m]."""
        return np.asarray(self.p0 * np.exp(-np.asarray(d, dtype=float) / self.u0), float)

    def stiffness(self, d: ArrayLike) -> Array:
        """Stiffness -dp/dd [Pa/m]."""
        return np.asarray(self.pressure(d) / self.u0, float)

    vibration = stiffness


def linear_law(k: float) -> LinearLaw:
    """Linear penalty p = k <-d> with k [Pa/m].

    Example:
        >>> float(linear_law(1e12).pressure(-2e-6))  # 2 um of overlap
        2000000.0
    """
    positive(k=k)
    return LinearLaw(float(k))


def exponential_law(p0: float, u0: float) -> ExponentialLaw:
    """Exponential law p = p0 exp(-d / u0) with p0 [Pa] and u0 [m].

    Example:
        >>> law = exponential_law(1e6, 1e-6)
        >>> round(float(law.pressure(1e-6)))  # p0 / e
        367879
    """
    positive(p0=p0, u0=u0)
    return ExponentialLaw(float(p0), float(u0))
