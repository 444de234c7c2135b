"""Moduli of the half-space against the isotropic limit and against its own elasticity problem."""

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.micro import plane_strain_modulus, transversely_isotropic_modulus

LINING = {"C11": 5.94e9, "C13": 0.98e9, "C33": 2.27e9, "C44": 1.18e9}


def surface_wave_modulus(C11, C13, C33, C44):
    """E* from plane-strain elasticity: pressure cos(kx) on z < 0 sinks it by 2 p / (E* k).

    Displacements (U, i W) exp(ikx + k a z) decay downwards; two of them clear the shear traction.
    """
    # (C44 a^2 - C11) U - (C13 + C44) a W = 0 and (C13 + C44) a U + (C33 a^2 - C44) W = 0
    cross = (C13 + C44) ** 2 - C11 * C33 - C44**2
    roots = np.roots([C33 * C44, cross, C11 * C44]).astype(complex)
    a = np.sqrt(roots)
    a = np.where(a.real > 0, a, -a)
    W = (C44 * a**2 - C11) / ((C13 + C44) * a)
    shear = C44 * (a - W)  # of U = 1, over k
    normal = C13 + C33 * a * W
    share = np.linalg.solve(np.array([shear, normal]), np.array([0.0, 1.0]))
    return float(abs(2.0 / (share @ W)))


def test_paper_value():
    assert plane_strain_modulus(1983.3e6, 0.4054) == pytest.approx(2373.4e6, rel=2e-5)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_isotropic_limit(nu):
    E = 3e9
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    found = transversely_isotropic_modulus(lam + 2 * mu, lam, lam + 2 * mu, mu)
    assert found == pytest.approx(plane_strain_modulus(E, nu), rel=1e-12)


@pytest.mark.parametrize("C44", [0.3e9, 1.18e9, 3e9])
def test_modulus_solves_the_half_space(C44):
    """Also where the decay exponents are complex."""
    stiffness = {**LINING, "C44": C44}
    expected = surface_wave_modulus(**stiffness)
    assert transversely_isotropic_modulus(**stiffness) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize(
    "make",
    [
        lambda: plane_strain_modulus(-1.0, 0.3),
        lambda: plane_strain_modulus(1.0, 0.6),
        lambda: transversely_isotropic_modulus(1.0, 2.0, 1.0, 1.0),
    ],
)
def test_impossible_materials(make):
    with pytest.raises(SceneError):
        make()
