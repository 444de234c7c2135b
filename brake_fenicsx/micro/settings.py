"""How a rough surface is pressed to get its law, and the composite modulus of the lining."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from brake_fenicsx.arguments import number, one_of, positive
from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro.halfspace import Boundary

BulkCompliance = Literal["remove", "keep"]
Grids = Literal["cascade", "one"]
PLASTIC = 0.1  # a law under a hardness ends at this share of it, unless a pressure is given
MOST_STEPS = 10_000


def plane_strain_modulus(E: float, nu: float) -> float:
    """E* = E / (1 - nu^2) [Pa], exact for an isotropic half-space.

    The paper takes it for the lining too, with E_z and nu_xz: 1983.3 MPa, 0.4054: 2373.4 MPa.

    Args:
        E: Young's modulus [Pa], positive.
        nu: Poisson's ratio [-], between -1 and 0.5.

    Example:
        >>> round(plane_strain_modulus(1983.3e6, 0.4054) / 1e6, 1)
        2373.4
    """
    positive(E=E)
    if not -1.0 < number("nu", nu) <= 0.5:
        raise SceneError(f"nu = {nu}: Poisson's ratio lies between -1 and 0.5")
    return E / (1.0 - nu**2)


def transversely_isotropic_modulus(C11: float, C13: float, C33: float, C44: float) -> float:
    """Modulus E* [Pa] of a half-space whose axis of isotropy is the surface normal, exact.

    A point load F sinks the surface by F / (pi E* r), as on an isotropic half-space.

    Args:
        C11: stiffness in the plane [Pa].
        C13: coupling of plane and axis [Pa].
        C33: stiffness along the axis [Pa].
        C44: shear stiffness of planes through the axis [Pa].

    Reference: A. Delafargue, F.-J. Ulm, Int. J. Solids Struct. 41 (2004) 7351,
    doi:10.1016/j.ijsolstr.2004.06.019.

    Example:
        >>> round(transversely_isotropic_modulus(5.94e9, 0.98e9, 2.27e9, 1.18e9) / 1e6, 1)
        2569.4
    """
    if not (C11 > 0.0 and C33 > 0.0 and C44 > 0.0 and C11 * C33 > C13**2):
        raise SceneError(
            f"C11 = {C11}, C13 = {C13}, C33 = {C33}, C44 = {C44} Pa: not positive definite"
        )
    shear = 1.0 / C44 + 2.0 / (np.sqrt(C11 * C33) + C13)
    return float(2.0 * np.sqrt((C11 * C33 - C13**2) / C11 / shear))


@dataclass(frozen=True, slots=True)
class LawSettings:
    """Arguments of a law, checked when they are given.

    Attributes:
        E_star: composite modulus [Pa].
        max_pressure: mean pressure the law is computed to [Pa]; if not given 0.1 E*, and no more
            than 0.1 of the hardness.
        min_pressure: mean pressure of the first step [Pa]; 1e-6 E* if not given, less where the
            foot would be longer than 0.02 S_q.
        steps: number of steps, equal in the logarithm of the load; 40 per decade or more
            while fewer than three hundred pixels touch.
        boundary: ``"free"`` or ``"periodic"``.
        bulk_compliance: ``"remove"`` the sinking of the whole free patch, which the pad's finite
            elements already have, or ``"keep"`` it.
        tolerance: duality gap over the work of each step [-].
        hardness: pressure at which the surface yields [Pa]; None for an elastic surface.
        grids: ``"cascade"``: a periodic surface of 256 pixels or more along a side is pressed on
            coarser grids where many pixels touch; ``"one"``: on its own grid throughout.

    Raises:
        SceneError: a value without meaning, or a hardness that cannot carry the pressure.
    """

    E_star: float
    max_pressure: float | None = None
    min_pressure: float | None = None
    steps: int = 40
    boundary: Boundary = "free"
    bulk_compliance: BulkCompliance = "remove"
    tolerance: float = 1e-6
    hardness: float | None = None
    grids: Grids = "cascade"

    def __post_init__(self) -> None:
        one_of("boundary", self.boundary, Boundary)
        one_of("bulk_compliance", self.bulk_compliance, BulkCompliance)
        one_of("grids", self.grids, Grids)
        positive(E_star=self.E_star, steps=self.steps, tolerance=self.tolerance)
        for name in ("max_pressure", "min_pressure", "hardness"):
            if (value := getattr(self, name)) is not None:
                positive(**{name: value})
        if not (self.lowest < self.highest and 2 <= self.steps <= MOST_STEPS):
            raise SceneError(
                f"law from {self.lowest:.4g} to {self.highest:.4g} Pa in {self.steps} steps; give"
                f" rising pressures and 2 to {MOST_STEPS} steps"
            )
        if self.tolerance >= 1.0:
            raise SceneError(f"tolerance = {self.tolerance}; give less than 1, such as 1e-6")
        if self.hardness is not None and not self.highest < self.hardness:
            raise SceneError(
                f"hardness = {self.hardness:.4g} Pa: a law up to {self.highest:.4g} Pa needs more;"
                " lower 'max_pressure'"
            )

    @property
    def highest(self) -> float:
        """Mean pressure that the law is computed to [Pa]."""
        if self.max_pressure is not None:
            return self.max_pressure
        elastic = 0.1 * self.E_star
        return elastic if self.hardness is None else min(elastic, PLASTIC * self.hardness)

    @property
    def lowest(self) -> float:
        """Mean pressure of the first step [Pa], before the foot is looked at."""
        if self.min_pressure is not None:
            return self.min_pressure
        return min(1e-6 * self.E_star, 1e-2 * self.highest)
