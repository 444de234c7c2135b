"""Linear elastic materials as 6 x 6 stiffness matrices.

Voigt order 11, 22, 33, 23, 13, 12, with engineering shear strains; axes 1, 2, 3 are the material's
own: for a pad 1 tangential at mid pad, 2 radial, 3 = z (the disc axis).
"""

from dataclasses import dataclass

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError


@dataclass(frozen=True, slots=True)
class Material:
    """A linear elastic material.

    Attributes:
        C: stiffness [Pa], shape (6, 6), symmetric positive definite.
        rho: density [kg/m^3].
        loss: loss factor eta [-].
    """

    C: Array
    rho: float
    loss: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a stiffness without positive energy and a density that is not positive."""
        if not (np.isfinite(self.C).all() and np.isfinite(self.rho)):
            raise SceneError("a stiffness or the density is not finite; give numbers")
        if not np.allclose(self.C, self.C.T, rtol=1e-9, atol=0.0):
            raise SceneError("the stiffness matrix is not symmetric, or not a number")
        lowest = np.linalg.eigvalsh(self.C)[0]
        if not lowest > 0:
            raise SceneError(f"""the stiffness matrix is not positive definite: eigenvalue
                {lowest:.4g} Pa; check moduli and Poisson ratios""")
        if not self.loss >= 0:
            raise SceneError(f"loss factor {self.loss} must be zero or more")
        if not self.rho > 0:
            raise SceneError(f"density {self.rho} kg/m^3 must be positive")


def isotropic(E: float, nu: float) -> Array:
    """Stiffness of an isotropic material.

    Args:
        E: Young's modulus [Pa].
        nu: Poisson's ratio [-].

    Returns:
        Stiffness [Pa], shape (6, 6).

    Raises:
        SceneError: nu outside (-1, 0.5) or E not positive.
    """
    if not (E > 0 and -1 < nu < 0.5):
        with np.errstate(divide="ignore"):
            lowest = np.divide(E, [1 + nu, 1 - 2 * nu]).min()
        raise SceneError(f"""E = {E:g} Pa, nu = {nu:g}: not positive definite, eigenvalue
            {lowest:.4g} Pa; E > 0 and -1 < nu < 0.5 are needed""")
    lame, G = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    C = np.zeros((6, 6))
    C[:3, :3] = lame
    C[np.arange(6), np.arange(6)] += np.array([2 * G, 2 * G, 2 * G, G, G, G])
    return C


def transversely_isotropic(C11: float, C12: float, C13: float, C33: float, C44: float) -> Array:
    """Stiffness of a material isotropic about its axis 3; C66 = (C11 - C12) / 2.

    Args:
        C11: in-plane stiffness [Pa].
        C12: in-plane coupling [Pa].
        C13: coupling of plane and axis [Pa].
        C33: axial stiffness [Pa].
        C44: shear stiffness of planes 13 and 23 [Pa].

    Returns:
        Stiffness [Pa], shape (6, 6).
    """
    return orthotropic_stiffness(C11, C11, C33, C12, C13, C13, C44, C44, 0.5 * (C11 - C12))


def orthotropic_stiffness(
    C11: float, C22: float, C33: float, C12: float, C13: float, C23: float,
    C44: float, C55: float, C66: float,
) -> Array:  # fmt: skip
    """Stiffness of an orthotropic material from its nine constants [Pa].

    Args:
        C11: along axis 1; C22 and C33 alike.
        C22: along axis 2.
        C33: along axis 3.
        C12: coupling of axes 1 and 2; C13 and C23 alike.
        C13: coupling of axes 1 and 3.
        C23: coupling of axes 2 and 3.
        C44: shear stiffness of plane 23.
        C55: shear stiffness of plane 13.
        C66: shear stiffness of plane 12.

    Returns:
        Stiffness [Pa], shape (6, 6).
    """
    C = np.diag([C11, C22, C33, C44, C55, C66]).astype(float)
    C[0, 1] = C[1, 0] = C12
    C[0, 2] = C[2, 0] = C13
    C[1, 2] = C[2, 1] = C23
    return C


def orthotropic(E: Array, nu: Array, G: Array) -> Array:
    """Stiffness of an orthotropic material from engineering constants.

    Args:
        E: E_1, E_2, E_3 [Pa].
        nu: nu_12, nu_13, nu_23 [-], strain j from stress i.
        G: G_23, G_13, G_12 [Pa].

    Returns:
        Stiffness [Pa], shape (6, 6).
    """
    E, nu, G = np.asarray(E, float), np.asarray(nu, float), np.asarray(G, float)
    if np.any(E <= 0) or np.any(G <= 0):
        raise SceneError(f"moduli E = {E}, G = {G} must be positive")
    S = orthotropic_stiffness(*1 / E, *-nu / E[[0, 0, 1]], *1 / G)
    lowest = np.linalg.eigvalsh(S[:3, :3])[0]
    if not lowest > 0:
        raise SceneError(f"""the compliance is not positive definite: eigenvalue {lowest:.4g} 1/Pa;
            lower nu""")
    return np.asarray(np.linalg.inv(S), float)


def engineering_constants(C: Array) -> dict[str, float]:
    """Young's moduli, Poisson's ratios and shear moduli of a stiffness.

    Args:
        C: stiffness [Pa], shape (6, 6).

    Returns:
        E_x, E_y, E_z, G_yz, G_xz, G_xy [Pa], nu_xy, nu_xz, nu_zx [-].
    """
    S = np.linalg.inv(C)
    E = 1 / np.diag(S)
    return {
        "E_x": E[0], "E_y": E[1], "E_z": E[2], "G_yz": E[3], "G_xz": E[4], "G_xy": E[5],
        "nu_xy": -S[0, 1] * E[0], "nu_xz": -S[0, 2] * E[0], "nu_zx": -S[2, 0] * E[2],
    }  # fmt: skip


def rotate_about_z(C: Array, angle: float) -> Array:
    """The stiffness in axes turned by ``-angle``: a material whose axis 1 lies at ``angle`` from x.

    Args:
        C: stiffness in the material's axes [Pa], shape (6, 6).
        angle: angle of axis 1 from x about z [rad].

    Returns:
        Stiffness in x, y, z [Pa], shape (6, 6).
    """
    c, s = np.cos(angle), np.sin(angle)
    a = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    T = np.empty((6, 6))
    for row, (i, j) in enumerate(pairs):
        for col, (k, l) in enumerate(pairs):
            T[row, col] = a[i, k] * a[j, l] + (a[i, l] * a[j, k] if k != l else 0.0)
    turned = T @ C @ T.T
    # Round-off of the zeros is not symmetric.
    return 0.5 * (turned + turned.T)
