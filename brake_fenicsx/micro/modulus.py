"""Composite modulus of the lining under the rigid disc: what one pressure does to the surface."""

from __future__ import annotations

import numpy as np

from brake_fenicsx.arguments import number, positive
from brake_fenicsx.errors import SceneError


def plane_strain_modulus(E: float, nu: float) -> float:
    """E* = E / (1 - nu^2) [Pa], exact for an isotropic half-space.

    The paper takes it for the lining too, with E_z and nu_xz: 1983.3 MPa, 0.4054: 2373.4 MPa.

    Args:
        E: Young's modulus [Pa], positive.
        nu: Poisson's ratio [-], between -1 and 0.5.
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
    """
    if not (C11 > 0.0 and C33 > 0.0 and C44 > 0.0 and C11 * C33 > C13**2):
        raise SceneError(
            f"C11 = {C11}, C13 = {C13}, C33 = {C33}, C44 = {C44} Pa: not positive definite"
        )
    shear = 1.0 / C44 + 2.0 / (np.sqrt(C11 * C33) + C13)
    return float(2.0 * np.sqrt((C11 * C33 - C13**2) / C11 / shear))
