"""Samples of other materials refined on their own full problem, and what is doubted of their k."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.condensation import compliance, petsc_matrix
from brake_fenicsx.stability.changing.own_bodies import Whole
from brake_fenicsx.stability.changing.shifts import Changes
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis
from dense_reference import agrees, all_lambda

BAND, SPREAD = (0.0, 60e3), 0.2


def coefficients(x):
    """Linear in the compliances."""
    return np.array([2.27e9, 1.18e9]) * (1 / (1 + SPREAD * x) - 1)


def stiffness(n, seed):
    """Two decades about 3e11 Pa/m, a third of the elements open."""
    rng = np.random.default_rng(seed)
    k = 3e11 * 10 ** rng.uniform(-1, 1, n)
    k[rng.random(n) < 0.33] = 0.0
    return k


def made(scene, parts, degree):
    """The basis of a degree, made once."""
    if degree not in scene.bases:
        scene.bases[degree] = EnsembleBasis(
            scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], parts, coefficients, 2,
            BAND, degree, scene.comm,
        )  # fmt: skip
    return scene.bases[degree]


def at(scene, parts, x):
    """The bodies of a sample at full order."""
    K = (scene.K + sum(c * A for c, A in zip(coefficients(x), parts, strict=True))).tocsr()
    return Whole(K, scene.M, scene.N, scene.T, scene.N[:0])


def exact(whole, w, k, mu):
    """All lambda, dense."""
    N, T = whole.N.toarray(), whole.T.toarray()
    return all_lambda(whole.K.toarray() + (N + mu * T).T @ ((w * k)[:, None] * N), whole.M)


@pytest.mark.parametrize("mu", [0.0, 0.5, 1.0])
def test_modes_beyond_the_tolerance_are_refined(two_bodies, mu):
    """A basis of degree one, wrong by 1e-5: estimates within 1e-6 and 1e-9 where that is asked.

    Catches a step with the bodies of the scene in place of the sample's, and modes of the space
    taken for modes of the body.
    """
    scene, parts = two_bodies
    basis, rng = made(scene, parts, 1), np.random.default_rng(int(10 * mu))
    for seed in range(3):
        x, k = rng.uniform(-1, 1, 2), stiffness(scene.w.size, seed)
        whole = at(scene, parts, x)
        reference = exact(whole, scene.w, k, mu)
        off, estimate = agrees(basis.modes(x, k, mu), reference, BAND)
        assert off > 3e-6
        for tolerance in (1e-6, 1e-9):
            modes = basis.modes(x, k, mu, tolerance, lambda whole=whole: whole)
            off, estimate = agrees(modes, reference, BAND)
            assert off < tolerance and estimate <= tolerance
            assert modes.iterations == len(modes)


def test_none_is_refined_without_need(two_bodies):
    """A tolerance that all estimates meet: the sample at full order is not asked for."""
    scene, parts = two_bodies
    x, k = np.array([0.2, -0.4]), stiffness(scene.w.size, 0)

    def whole():
        raise AssertionError

    modes = made(scene, parts, 3).modes(x, k, 0.5, 1e-3, whole)
    assert modes.iterations == 0


def test_images_are_solved_by_the_factor_of_the_first(twins):
    """Two brakes, the second an image: both refined, each under contact of its own."""
    basis = EnsembleBasis(
        twins.K, twins.M, twins.N, twins.T, twins.w, twins.f[:, None], twins.parts, coefficients,
        2, BAND, 1, twins.comm,
    )  # fmt: skip
    x, k = np.array([0.5, -0.6]), stiffness(twins.w.size, 4)
    whole = at(twins, twins.parts, x)
    reference = exact(whole, twins.w, k, 0.4)
    assert agrees(basis.modes(x, k, 0.4), reference, BAND)[0] > 1e-6
    modes = basis.modes(x, k, 0.4, 1e-8, lambda: whole)
    assert agrees(modes, reference, BAND)[1] <= 1e-8


def test_refined_modes_near_their_merging(two_bodies):
    """The friction at which two modes are most alike: refined together, covered, none lost."""
    scene, parts = two_bodies
    basis, x = made(scene, parts, 2), np.array([-0.5, 0.7])
    k = np.full(scene.w.size, 9e11)
    whole = at(scene, parts, x)
    mus = np.linspace(0.5, 2.5, 41)
    worst_mu = max(mus, key=lambda mu: basis.modes(x, k, mu).condition.max())
    modes = basis.modes(x, k, worst_mu, 1e-8, lambda: whole)
    assert modes.condition.max() > 5
    off, estimate = agrees(modes, exact(whole, scene.w, k, worst_mu), BAND)
    assert off < 1e-7 and estimate < 1e-6


def test_doubt_of_the_compliance_covers_its_error(two_bodies):
    """Gaps of the bodies under forces and loads, on springs: summed doubts against full order."""
    scene, parts = two_bodies
    rng, n = np.random.default_rng(3), scene.w.size
    for degree in (1, 3):
        basis = made(scene, parts, degree)
        for x in rng.uniform(-1, 1, (4, 2)):
            F, loads = rng.uniform(0, 1, n), np.ones(1)
            doubt = basis.compliance_doubt(F, 0.4 * F, loads)
            NN, NT, Nf = basis.compliance(x, scene.k0)
            K = petsc_matrix(at(scene, parts, x).K)
            ref = compliance(K, scene.N, scene.T, scene.w, scene.f, scene.k0, scene.comm)
            free = np.eye(n) - ref.NN * (scene.w * scene.k0)
            error = (NN - ref.NN) @ F + (NT - ref.NT) @ (0.4 * F) + Nf[:, 0] - ref.Nf
            # The springs feel the change too: it is that of the bodies under what they carry.
            carried = F - scene.w * scene.k0 * (ref.NN @ F + ref.NT @ (0.4 * F) + ref.Nf)
            doubt = basis.compliance_doubt(carried, 0.4 * F, loads) @ free.T
            assert np.linalg.norm(error) <= np.linalg.norm(np.abs(doubt).sum(axis=0))


@pytest.mark.parametrize("mu", [0.0, 0.6])
def test_errors_of_k_shift_modes_as_they_are_told(two_bodies, mu):
    """A change of k by 1e-5, scattered: what is added to the errors is what the modes move by.

    To a tenth, since of what the kept modes leave only the static answer is looked at.
    """
    scene, parts = two_bodies
    basis, x, k = made(scene, parts, 3), np.array([0.3, -0.6]), stiffness(scene.w.size, 2)
    change = 1e-5 * k * np.random.default_rng(1).standard_normal(k.size)
    before, after = basis.modes(x, k, mu), basis.modes(x, k + change, mu)
    doubted = basis.modes(x, k, mu, doubt=Changes(np.array([change, 0 * change])))
    added = doubted.error - before.error
    moved = np.abs(after.s - before.s)
    elastic = np.abs(before.s) > 10.0
    np.testing.assert_allclose(added[elastic], moved[elastic], rtol=0.1, atol=1e-3 * moved.max())


@pytest.mark.parametrize("what", ["k", "along", "across", "all"])
def test_errors_of_rates_shift_damped_modes_too(two_blocks, what):
    """The same of k and of the rates at contact, alone and together, with damped bodies."""
    from brake_fenicsx.stability.changing.proportion import Damping

    scene = two_blocks("coarse")
    C = (1e-7 * scene.K).tocsr()
    given = Damping(C, 0.0, np.array([1e-7]), scene.R, True, True)
    part = sp.csr_matrix(0.01 * scene.K)
    basis = EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], [part], lambda x: x, 1,
        BAND, 1, scene.comm, damping=given,
    )  # fmt: skip
    k, x, rng = stiffness(scene.w.size, 3), np.array([0.4]), np.random.default_rng(2)
    acts = {"k": k, "along": -2e4 * (k > 0), "across": 1e5 * (k > 0)}
    change = {
        name: 1e-5 * (what in (name, "all")) * value * rng.standard_normal(k.size)
        for name, value in acts.items()
    }

    def modes(k, along, across, **more):
        return basis.damped_modes(x, k, 0.5, along, across, 0.3, **more)

    before, after = modes(**acts), modes(**{name: acts[name] + change[name] for name in acts})
    doubted = modes(**acts, doubt=Changes(**{name: c[None] for name, c in change.items()}))
    added, moved = doubted.error - before.error, np.abs(after.s - before.s)
    elastic = np.abs(before.s) > 10.0
    np.testing.assert_allclose(added[elastic], moved[elastic], rtol=0.1, atol=1e-3 * moved.max())
