"""Stiffness matrices: rotation, engineering constants, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.material import (
    Material,
    engineering_constants,
    isotropic,
    orthotropic,
    rotate_about_z,
)
from materials import LINING, ORTHOTROPIC, VOIGT, tensor


def voigt(c):
    return np.array([[c[i, j, k, l] for k, l in VOIGT] for i, j in VOIGT])


@given(angle=st.floats(-7.0, 7.0))
@settings(max_examples=40, deadline=None)
def test_rotation_is_that_of_the_tensor(angle):
    """Catches a transposed rotation (axis 1 turned the wrong way) and a factor 2 of the shears."""
    c, s = np.cos(angle), np.sin(angle)
    # Column j holds the material's axis j in x, y, z: axis 1 lies at +angle from x.
    Q = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    wanted = voigt(np.einsum("ia,jb,kc,ld,abcd->ijkl", Q, Q, Q, Q, tensor(ORTHOTROPIC)))
    np.testing.assert_allclose(rotate_about_z(ORTHOTROPIC, angle), wanted, atol=1e-12 * 9e9)


def test_lining_is_the_same_in_all_directions_of_its_plane():
    """Catches C66 other than (C11 - C12) / 2."""
    np.testing.assert_allclose(rotate_about_z(LINING, 0.7), LINING, atol=1e-12 * 5.94e9)
    assert LINING[5, 5] == pytest.approx(2.59e9)


def test_lining_has_the_two_published_constants():
    """E_z = 1983.3 MPa and nu_xz = 0.4054; catches Voigt shears in the place of normal strains."""
    found = engineering_constants(LINING)
    assert found["E_z"] == pytest.approx(1983.3e6, abs=0.05e6)
    assert found["nu_xz"] == pytest.approx(0.4054, abs=5e-5)
    # Reciprocity: nu_xz / E_x = nu_zx / E_z.
    assert found["nu_xz"] / found["E_x"] == pytest.approx(found["nu_zx"] / found["E_z"], rel=1e-12)


def test_orthotropic_constants_come_back():
    """Catches G_23 and G_12 exchanged."""
    found = engineering_constants(ORTHOTROPIC)
    for name, value in {
        "E_x": 9e9, "E_y": 5e9, "E_z": 2e9, "nu_xy": 0.2, "nu_xz": 0.35,
        "G_yz": 0.9e9, "G_xz": 1.3e9, "G_xy": 2.1e9,
    }.items():  # fmt: skip
        assert found[name] == pytest.approx(value, rel=1e-12), name


def test_isotropic_is_the_orthotropic_special_case():
    """Two ways to one matrix; catches a wrong Lame constant."""
    G = 210e9 / 2.6
    other = orthotropic(np.full(3, 210e9), np.full(3, 0.3), np.full(3, G))
    np.testing.assert_allclose(isotropic(210e9, 0.3), other, rtol=1e-12, atol=1e-3)


@pytest.mark.parametrize("E, nu", [(0.0, 0.3), (-1e9, 0.3), (1e9, 0.5), (1e9, -1.0), (1e9, np.nan)])
def test_isotropic_refusals(E, nu):
    """An incompressible or a negative material is the user's mistake, named."""
    with pytest.raises(SceneError, match="positive definite"):
        isotropic(E, nu)


@pytest.mark.parametrize("column, value", [((0, 1), 5.95e9), ((0, 2), 4e9), ((3, 3), -1.0)])
def test_indefinite_stiffness_is_refused(column, value):
    """One entry beyond its bound; catches a check of the diagonal alone."""
    C = LINING.copy()
    C[column] = C[column[::-1]] = value
    with pytest.raises(SceneError, match="not positive definite"):
        Material(C, 2510.0)


def test_stiffness_of_nan_or_without_symmetry_is_refused():
    """Catches eigenvalues taken from one triangle of a matrix that is no stiffness."""
    C = LINING.copy()
    C[0, 1] = 2e9
    with pytest.raises(SceneError, match="symmetric"):
        Material(C, 2510.0)
    C[0, 1] = np.nan
    with pytest.raises(SceneError):
        Material(C, 2510.0)


def test_an_infinite_modulus_is_named():
    """Its eigenvalues would end in an error of LAPACK."""
    with pytest.raises(SceneError, match="not finite"):
        Material(isotropic(np.inf, 0.3), 7200.0)


@pytest.mark.parametrize("rho", [0.0, -1.0, np.nan])
def test_density_must_be_positive(rho):
    with pytest.raises(SceneError, match="density"):
        Material(LINING, rho)


def test_orthotropic_refusals():
    """nu_12 above sqrt(E1/E2) has negative energy; so has a negative modulus."""
    E, G = np.array([1e9, 1e9, 1e9]), np.full(3, 4e8)
    with pytest.raises(SceneError, match="lower nu"):
        orthotropic(E, np.array([1.01, 0.0, 0.0]), G)
    with pytest.raises(SceneError, match="must be positive"):
        orthotropic(E, np.zeros(3), -G)


@pytest.mark.hard
def test_ratio_of_ten_thousand_and_nearly_incompressible():
    """The matrix is positive definite; constants are recovered as the condition allows."""
    C = orthotropic(np.array([1e13, 1e9, 1e9]), np.array([0.3, 0.3, 0.3]), np.full(3, 1e8))
    assert engineering_constants(C)["E_x"] == pytest.approx(1e13, rel=1e-10)
    C = isotropic(1e9, 0.5 - 1e-9)
    assert Material(C, 1.0).rho == 1.0
    assert engineering_constants(C)["E_x"] == pytest.approx(1e9, rel=1e-5)


@pytest.mark.parametrize("degrees", range(0, 180, 15))
def test_a_turned_isotropic_material_is_itself(degrees):
    """Catches round-off zeros that are not symmetric and made the turned material refused."""
    C = isotropic(207e9, 0.28)
    turned = Material(rotate_about_z(C, np.deg2rad(degrees)), 7820.0)
    np.testing.assert_allclose(turned.C, C, atol=1e-14 * 207e9 * 100)
