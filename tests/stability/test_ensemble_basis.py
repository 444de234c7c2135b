"""Samples of other materials in the reduced model, against dense full order of their own bodies."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.condensation import compliance, petsc_matrix
from brake_fenicsx.stability.changing.bodies import split_bodies
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis
from dense_reference import agrees, all_lambda

BAND = (0.0, 60e3)

# Share by which C33 and the two shear moduli of the lining change at the corners of the box.
SPREAD = 0.2


def stiffness(n, seed):
    """Two decades about 3e11 Pa/m, a third of the elements open."""
    rng = np.random.default_rng(seed)
    k = 3e11 * 10 ** rng.uniform(-1, 1, n)
    k[rng.random(n) < 0.33] = 0.0
    return k


def coefficients(x):
    """Linear in the compliances, so that a uniform change is captured at once."""
    return np.array([2.27e9, 1.18e9]) * (1 / (1 + SPREAD * x) - 1)


def made(scene, degree):
    """The basis of a degree, made once."""
    if degree not in scene.bases:
        scene.bases[degree] = EnsembleBasis(
            scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], scene.unit_changes,
            coefficients, 2, BAND, degree, scene.comm,
        )  # fmt: skip
    return scene.bases[degree]


def changed(scene, parts, x):
    """The sample's own bodies."""
    return (scene.K + sum(c * A for c, A in zip(coefficients(x), parts, strict=True))).tocsr()


def exact(scene, K, k, mu):
    """All lambda, dense."""
    return all_lambda(K + scene.tangent(k, mu) - scene.K, scene.M)


def worst(modes, s):
    """Largest relative error."""
    return agrees(modes, s, BAND, rigid=0.0)[0]


def test_bodies_are_taken_apart(two_bodies):
    """Two bodies; their matrices and operators put together are those of the whole."""
    scene, parts = two_bodies
    bodies = split_bodies(scene.K, scene.M, scene.N, scene.T, scene.f[:, None], parts)
    assert len(bodies) == 2
    assert sorted(len(b.parts) for b in bodies) == [0, 2]
    places = np.concatenate([b.dofs for b in bodies])
    np.testing.assert_array_equal(np.sort(places), np.arange(scene.K.shape[0]))
    u = np.random.default_rng(0).standard_normal(places.size)
    gap, energy = np.zeros(scene.w.size), 0.0
    for b in bodies:
        gap[b.elements] += b.N @ u[b.dofs]
        energy += u[b.dofs] @ (b.K @ u[b.dofs])
    np.testing.assert_allclose(gap, scene.N @ u, rtol=1e-12, atol=1e-12)
    assert energy == pytest.approx(u @ (scene.K @ u), rel=1e-12)


@pytest.mark.parametrize("mu", [0.0, 0.5, 1.0])
def test_samples_of_other_moduli(two_bodies, mu):
    """Moduli within 20 %, contact over two decades and a third of it open: errors within 1e-6."""
    scene, parts = two_bodies
    basis = made(scene, 3)
    rng = np.random.default_rng(int(10 * mu))
    for seed in range(3):
        x, k = rng.uniform(-1, 1, 2), stiffness(scene.w.size, seed)
        modes = basis.modes(x, k, mu)
        s = exact(scene, changed(scene, parts, x), k, mu)
        assert worst(modes, s) < 1e-6
        nearest = s[np.abs(modes.s[:, None] - s).argmin(axis=1)]
        floor = 1e-15 * np.abs(s).max() ** 2 * modes.condition / np.abs(modes.s)
        assert np.all(np.abs(modes.s - nearest) <= modes.error + 20 * floor)
        for verdict, grows in zip(
            modes.verdict, nearest.real > 1e-6 * np.abs(nearest), strict=True
        ):
            assert verdict == "neutral" or (verdict == "unstable") == grows


def test_error_falls_with_the_degree(two_bodies):
    """Interpolation of degree 1, 2, 3 at a corner; at an anchor hardly anything is left."""
    scene, parts = two_bodies
    k, x = stiffness(scene.w.size, 1), np.array([-0.8, -0.9])
    s = exact(scene, changed(scene, parts, x), k, 0.5)
    errors = [worst(made(scene, d).modes(x, k, 0.5), s) for d in (1, 2, 3)]
    assert errors[1] < errors[0] / 5
    assert errors[2] < errors[1] / 3
    anchor = np.array([1.0, 0.0])
    s = exact(scene, changed(scene, parts, anchor), k, 0.5)
    assert worst(made(scene, 2).modes(anchor, k, 0.5), s) < 3e-7


def test_compliance_of_the_changed_bodies(two_bodies):
    """On springs k0, for braking equilibrium; the loads too."""
    scene, parts = two_bodies
    x = np.array([0.6, -0.7])
    found = made(scene, 3).compliance(x, scene.k0)
    K = petsc_matrix(changed(scene, parts, x))
    ref = compliance(K, scene.N, scene.T, scene.w, scene.f, scene.k0, scene.comm)
    for ours, theirs in zip(found, (ref.NN, ref.NT, ref.Nf[:, None]), strict=True):
        assert np.abs(ours - theirs).max() < 1e-5 * np.abs(theirs).max()


def test_displacements_of_the_coordinates(two_bodies):
    """M-orthonormal where they must be; open contact leaves no static answer out."""
    scene, parts = two_bodies
    basis, x = made(scene, 3), np.array([0.3, 0.4])
    np.testing.assert_allclose(
        basis.coordinates.projected(scene.M),
        np.eye(len(basis.coordinates.projected(scene.M))),
        atol=1e-8,
    )
    modes = basis.modes(x, np.where(np.arange(scene.w.size) == 3, 1e6, 0.0), 0.0)
    phi, K = basis.coordinates.displacements(modes.right), changed(scene, parts, x)
    elastic = -(modes.s**2).real > 1e6
    assert elastic.sum() >= 3
    quotient = np.einsum("im,im->m", phi.conj(), K @ phi).real
    quotient /= np.einsum("im,im->m", phi.conj(), scene.M @ phi).real
    # kappa = -lambda^2, by the Rayleigh quotient of the bodies alone.
    np.testing.assert_allclose(quotient[elastic], -(modes.s**2).real[elastic], rtol=1e-4)
    np.testing.assert_allclose(
        basis.coordinates.projected(scene.M, phi.real) @ modes.right,
        phi.real.T @ (scene.M @ phi),
        atol=1e-9,
    )


def test_images_share_the_work(twins):
    """Two brakes, the second an image of the first, each under contact of its own."""
    basis = EnsembleBasis(
        twins.K, twins.M, twins.N, twins.T, twins.w, twins.f[:, None], twins.parts, coefficients,
        2, BAND, 3, twins.comm,
    )  # fmt: skip
    assert [bool(body.arrays()) for body in basis.bodies] == [True, True, False, False]
    x, k = np.array([0.5, -0.6]), stiffness(twins.w.size, 4)
    K = changed(twins, twins.parts, x)
    modes = basis.modes(x, k, 0.4)
    scene = SimpleNamespace(
        K=twins.K, M=twins.M,
        tangent=lambda k, mu: (
            twins.K + (twins.N + mu * twins.T).T @ sp.diags(twins.w * k) @ twins.N
        ),
    )  # fmt: skip
    assert worst(modes, exact(scene, K, k, 0.4)) < 1e-6
    k0 = np.full(twins.w.size, 1e11)
    found = basis.compliance(x, k0)
    ref = compliance(petsc_matrix(K), twins.N, twins.T, twins.w, twins.f, k0, twins.comm)
    for ours, theirs in zip(found, (ref.NN, ref.NT, ref.Nf[:, None]), strict=True):
        assert np.abs(ours - theirs).max() < 1e-5 * np.abs(theirs).max()
    # Vectors too, by the Rayleigh quotient of full order; static answers are left out of them.
    k = np.where(np.arange(k.size) % 18 == 3, 1e6, 0.0)
    modes, whole = basis.modes(x, k, 0.0), scene.tangent(k, 0.0) + K - twins.K
    phi, elastic = basis.coordinates.displacements(modes.right), -(modes.s**2).real > 1e6
    assert elastic.sum() >= 6
    quotient = np.einsum("im,im->m", phi.conj(), whole @ phi).real
    quotient /= np.einsum("im,im->m", phi.conj(), twins.M @ phi).real
    np.testing.assert_allclose(quotient[elastic], -(modes.s**2).real[elastic], rtol=1e-4)
    np.testing.assert_allclose(
        basis.coordinates.projected(twins.M),
        np.eye(sum(b.directions for b in basis.bodies)),
        atol=1e-8,
    )


def test_what_was_made_earlier_gives_the_same_bytes(two_bodies):
    """Arrays of the bodies, taken again."""
    scene, parts = two_bodies
    first = made(scene, 3)
    again = EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], parts, coefficients, 2,
        BAND, 3, scene.comm, known=[body.arrays() for body in first.bodies],
    )  # fmt: skip
    x, k = np.array([0.1, -0.2]), stiffness(scene.w.size, 2)
    np.testing.assert_array_equal(first.modes(x, k, 0.5).s, again.modes(x, k, 0.5).s)
    for ours, theirs in zip(
        first.compliance(x, scene.k0), again.compliance(x, scene.k0), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)
