"""Closed forms of contact mechanics, shared by tests.

References: K. L. Johnson, Contact Mechanics (1985), chapters 4 and 13; H. M. Westergaard, J. Appl.
Mech. 6 (1939) A49; K. L. Johnson, J. A. Greenwood, J. G. Higginson, Int. J. Mech. Sci. 27 (1985)
383, doi:10.1016/0020-7403(85)90029-3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brake_fenicsx.arguments import Array

# Force of a rigid square flat punch, F / (E* L delta), in the limit of a fine grid.
SQUARE_PUNCH = 1.1523
# Contact area over mean pressure, A / A0 = kappa P / (E* h'_rms) at light load.
PERSSON_AREA = float(np.sqrt(8.0 / np.pi))
BUSH_GIBSON_THOMAS_AREA = float(np.sqrt(2.0 * np.pi))


@dataclass(frozen=True, slots=True)
class Hertz:
    """Sphere of radius R pressed on a half-space.

    Attributes:
        R: radius [m].
        E_star: composite modulus [Pa].
        load: resultant [N].
    """

    R: float
    E_star: float
    load: float

    @property
    def radius(self) -> float:
        """Contact radius [m]."""
        return float((0.75 * self.load * self.R / self.E_star) ** (1.0 / 3.0))

    @property
    def indentation(self) -> float:
        """Approach of distant points [m]."""
        return self.radius**2 / self.R

    @property
    def peak(self) -> float:
        """Largest pressure [Pa]."""
        return 1.5 * self.load / (np.pi * self.radius**2)

    @property
    def stiffness(self) -> float:
        """D load / d indentation [N/m]."""
        return 2.0 * self.E_star * self.radius

    def pressure(self, r: Array) -> Array:
        """Pressure [Pa] at the distance r [m] from the axis."""
        return self.peak * np.sqrt(np.maximum(1.0 - (r / self.radius) ** 2, 0.0))


@dataclass(frozen=True, slots=True)
class Westergaard:
    """Surface wave Delta cos(2 pi x / wave_length) under a rigid plane.

    Attributes:
        Delta: amplitude, crest over mean plane [m].
        wave_length: wave length [m].
        E_star: composite modulus [Pa].
    """

    Delta: float
    wave_length: float
    E_star: float

    @property
    def full(self) -> float:
        """Mean pressure p* at which the valley just closes [Pa]."""
        return float(np.pi * self.E_star * self.Delta / self.wave_length)

    def half_width(self, mean: float) -> float:
        """Half-width of the contact strip [m] at the mean pressure ``mean`` [Pa]."""
        return float(self.wave_length / np.pi * np.arcsin(np.sqrt(min(mean / self.full, 1.0))))

    def separation(self, mean: float) -> float:
        """Plane over the mean plane of the deformed surface [m]: Delta (1 - f + f ln f)."""
        f = mean / self.full
        return self.Delta * (1.0 - f + f * np.log(f)) if f < 1.0 else 0.0

    def pressure(self, x: Array, mean: float) -> Array:
        """Pressure [Pa] at the distance x [m] from a crest."""
        a = self.half_width(mean)
        k = np.pi / self.wave_length
        s = np.sin(k * x)
        root = np.sqrt(np.maximum(np.sin(k * a) ** 2 - s**2, 0.0))
        return np.asarray(2.0 * mean * np.abs(np.cos(k * x)) / np.sin(k * a) ** 2 * root)


def wave_2d_full(Delta: float, wave_length: float, E_star: float) -> float:
    """Mean pressure p* [Pa] that flattens Delta cos(2 pi x / l) cos(2 pi y / l) completely.

    Args:
        Delta: amplitude, crest over mean plane [m].
        wave_length: length l of the waves along x and y [m].
        E_star: composite modulus [Pa].
    """
    return float(np.sqrt(2.0) * np.pi * E_star * Delta / wave_length)
