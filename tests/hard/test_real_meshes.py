"""Hard cases on real meshes, with and without damping, against independent solvers."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.macro.elasticity import affine_parts, layer_masses
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.modes import energy_shares
from coarse_block import SCENES
from dense_reference import all_kappa, undamped
from tables import turns

pytestmark = pytest.mark.hard

TWO_PI = 2 * np.pi


def solved(scene, k, mu, C, band, M=None, **more):
    """Full order of a sample, its friction as an interface; with another mass if it is given."""
    face = contact_interface(scene.N, scene.T, scene.w * k, mu) if mu else None
    M = scene.M if M is None else M
    return complex_modes(M, C, scene.tangent(k, mu), band, friction=face, **more)


def rayleigh_of(kappa, alpha, beta):
    """lambda^2 + lambda (alpha + beta kappa) + kappa = 0: exact for C = alpha M + beta K."""
    c = alpha + beta * kappa
    return -c / 2 + np.array([1, -1])[:, None] * np.sqrt(c**2 / 4 - kappa + 0j)


def agree(m, exact, tolerance=1e-7):
    """As many as there are, each one of them."""
    assert len(m) == exact.size > 5
    far = np.abs(m.s[:, None] - exact[None, :])
    assert np.unique(far.argmin(axis=1)).size == len(m)
    assert np.all(far.min(axis=1) <= tolerance * np.abs(m.s) + m.error)


@pytest.mark.parametrize("mu, beta", turns([(0.0,), (0.5,), (1.0,)], [(None,), (1e-8,)]))
def test_contact_face_without_mass(two_blocks, mu, beta):
    """A third of the dofs has no mass: compared with the condensed stiffness.

    Catches infinite eigenvalues that come back as finite ones, and modes lost with them.
    """
    scene, band = two_blocks("guided"), (0.0, 90e3)
    k = np.full(scene.w.size, 3e11)
    face = np.unique(np.r_[scene.N.indices, scene.T.indices])
    rest = np.setdiff1d(np.arange(scene.M.shape[0]), face)
    heavy = np.ones(scene.M.shape[0])
    heavy[face] = 0.0
    M = (sp.diags(heavy) @ scene.M @ sp.diags(heavy)).tocsr()
    K = scene.tangent(k, mu)
    D = K.toarray()
    condensed = D[np.ix_(rest, rest)] - D[np.ix_(rest, face)] @ la.solve(
        D[np.ix_(face, face)], D[np.ix_(face, rest)]
    )
    kappa = all_kappa(condensed, M[rest][:, rest])
    C = None if beta is None else (200.0 * M + beta * K).tocsr()
    s = undamped(kappa) if beta is None else rayleigh_of(kappa, 200.0, beta).ravel()
    s = s[(s.imag > 0) & (s.imag <= TWO_PI * band[1])]
    agree(solved(scene, k, mu, C, band, M=M, zeta_max=0.3), s)


@pytest.mark.parametrize("mu", [pytest.param(0.3, marks=pytest.mark.slow), 1.0])
@pytest.mark.parametrize("damped", ["no", "rayleigh", "loss"])
def test_rigid_modes_with_friction(two_blocks, mu, damped):
    """Two free blocks, one sliding on the other: six rigid modes and three of sliding.

    None lost, none a growing mode; with loss factors alone nothing damps them, and each is a double
    zero of the quadratic problem.
    """
    scene, band = two_blocks("free"), (0.0, 60e3)
    k = np.full(scene.w.size, 1e11)
    C = {
        "no": None,
        "rayleigh": 5.0 * scene.M + 1e-9 * scene.K,
        "loss": 1e-3 / (TWO_PI * 20e3) * scene.K,
    }[damped]
    m = solved(scene, k, mu, C, band)
    rigid = np.abs(m.s) < 10.0
    assert rigid.sum() == 9
    assert set(np.array(m.verdict)[rigid]) == {"neutral"}
    kappa = all_kappa(scene.tangent(k, mu), scene.M)
    elastic = undamped(kappa[np.abs(kappa) > 1e5])
    elastic = elastic[elastic.imag <= TWO_PI * band[1]]
    found = m.s[~rigid]
    assert found.size == elastic.size > 5
    order = np.lexsort((elastic.real, np.round(elastic.imag)))
    # Little damping moves frequencies in second order only.
    np.testing.assert_allclose(found.imag, elastic[order].imag, rtol=1e-5)


@pytest.mark.parametrize("pairs", [1, 3])
def test_more_modes_at_zero_than_a_block_has_vectors(two_blocks, pairs):
    """Pairs of free blocks apart from one another: every mode as often as there are pairs.

    27 modes at zero with three pairs; the Krylov spaces start from blocks of 8 and 16 vectors.
    """
    scene, mu = two_blocks("free"), 1.0
    D = scene.w * np.full(scene.w.size, 1e11)
    K, smooth, M, N, T = (
        sp.block_diag([A] * pairs, "csr")
        for A in (scene.tangent(1e11, mu), scene.tangent(1e11, 0.0), scene.M, scene.N, scene.T)
    )
    face = contact_interface(N, T, np.tile(D, pairs), mu)
    m = complex_modes(M, None, K, (0.0, 60e3), frictionless=smooth, friction=face)
    one = all_kappa(scene.tangent(1e11, mu), scene.M)
    elastic = undamped(one[np.abs(one) > 1e5])
    elastic = np.sort(elastic.imag[elastic.imag <= TWO_PI * 60e3])
    rigid = np.abs(m.s) < 10.0
    assert rigid.sum() == 9 * pairs and m.count.kind == "proven"
    np.testing.assert_allclose(np.sort(m.s[~rigid].imag), np.repeat(elastic, pairs), rtol=1e-7)


def linearised(M, C, K, scale, centre, number):
    """Eigenvalues nearest to a point by ARPACK and SuperLU on the doubled pencil."""
    one = sp.identity(M.shape[0])
    A = sp.bmat([[None, one], [-K / scale**2, -C / scale]]).tocsc().astype(complex)
    B = sp.block_diag([one, M]).tocsc().astype(complex)
    v0 = np.random.default_rng(0).standard_normal(2 * M.shape[0]) + 0j
    s, _ = spla.eigs(A, number, B, sigma=centre / scale, v0=v0, ncv=3 * number)
    return s * scale


@pytest.mark.long
@pytest.mark.parametrize("mu", [0.0, 0.7])
def test_damping_contrast_of_a_thousand_between_parts(two_blocks, mu):
    """Lining with eta = 0.1 on a plate with 1e-4, all in one band."""
    scene, band = two_blocks("guided"), (0.0, 90e3)
    k = np.full(scene.w.size, 3e11)
    layers = [{name: scene.materials[name].C} for name in ("pad.body", "plate.body")]
    pad, plate = affine_parts(scene.mesh, scene.free, layers)
    assert abs(pad + plate - scene.K).max() < 1e-12 * abs(scene.K).max()
    C = ((0.1 * pad + 1e-4 * plate) / (TWO_PI * 60e3)).tocsr()
    m = solved(scene, k, mu, C, band, zeta_max=0.3)
    K, high = scene.tangent(k, mu), TWO_PI * band[1]
    exact = linearised(scene.M, C, K, high, 0.5j * high, 40)
    # Complete up to the farthest that was found.
    reach = np.abs(exact - 0.5j * high).max()
    assert reach > 0.7 * high
    inside = (exact.imag > 0) & (exact.imag <= high)
    inside &= exact.real >= -0.3 * np.abs(exact)
    agree(m, exact[inside])
    zeta = -m.s.real / np.abs(m.s)
    assert zeta.max() > 0.02 and "stable" in m.verdict


SOFT = [
    "stages=['equilibrium','stability']", "contact.pad_disc.gap=none", "samples.n=1",
    "contact.pad_disc.law={ linear='1e10 Pa/m' }", "parts.disc.size='24 mm'",
    "parts.pad.size='18 mm'", "parts.pad.plate_size='18 mm'", "mesh.quality=0.01",
    "parts.pad.shim=['1 mm','1 mm']", "parts.pad.side=top",
    "materials.soft={ model='isotropic', E='20.7 MPa', nu=0.28, rho='7820 kg/m^3' }",
    "parts.pad.material={ lining='lining', plate='steel', shim1='soft', shim2='steel' }",
]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("mu", [pytest.param(0.0, marks=pytest.mark.slow), 0.5])
def test_solid_shim_ten_thousand_times_softer_than_steel(mu):
    """A steel sheet on a soft layer of 1 mm: all modes of the band as from ARPACK."""
    b = assemble_brake(read_scene(SCENES / "disc_brake_demo.toml", SOFT), MPI.COMM_SELF)
    K, M = b.K, b.M
    k = np.full(b.w.size, 1e10)
    tangent = (K + (b.N + mu * b.T).T @ sp.diags(b.w * k) @ b.N).tocsr()
    face = contact_interface(b.N, b.T, b.w * k, mu) if mu else None
    m = complex_modes(M, None, tangent, (0.0, 6e3), friction=face)
    centre = (TWO_PI * 4e3) ** 2
    v0 = np.random.default_rng(0).standard_normal(M.shape[0])
    kappa = spla.eigs(tangent.tocsc(), 45, M.tocsc(), sigma=centre, v0=v0, ncv=130)[0]
    assert np.abs(kappa - centre).max() > centre, "ARPACK sees the whole of the band"
    exact = undamped(kappa)
    agree(m, exact[(exact.imag > 0) & (exact.imag <= TWO_PI * 6e3)])
    density = dict.fromkeys(b.mesh.layers, 7820.0) | {"disc.body": 7200.0, "pad.lining": 2510.0}
    share = energy_shares(layer_masses(b.mesh, b.elastic.free, density), m.right)
    # The sheet moves by itself, as it never does on steel.
    assert np.any(share["pad.shim2"] > 0.5)
