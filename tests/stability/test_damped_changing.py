"""Damped samples of other materials in the reduced model, against dense full order of their own."""

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import gathered
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.stability.changing.proportion import Damping
from brake_fenicsx.stability.damping import sliding_damping, velocity_slope
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis
from brake_fenicsx.stability.gyroscopic import gyroscopic
from tables import turns

BAND, K0, SPEED, ZETA = (0.0, 60e3), 3e11, 2.0, 0.3
HIGH = 2 * np.pi * BAND[1]
OMEGA_REF = 2 * np.pi * 30e3

# C33 and C44 = C55 of the lining [Pa], whose inverses change by this share at the box's ends.
MODULI, SPREAD = np.array([2.27e9, 1.18e9]), 0.2

# Loss factors at 30 kHz of lining and plate, and of what C44 = C55 alone adds to the lining's;
# alpha, beta; speed of the turning plate; rates at contact.
CASES = {
    "sliding": dict(across=True),
    "falling": dict(along=True),
    "rayleigh": dict(alpha=500.0, beta=2e-8),
    "loss": dict(loss=(0.1, 0.002, 0.0)),
    "layers": dict(loss=(0.04, 0.002, 0.08)),
    "turning": dict(turn=800.0),
    "all": dict(
        loss=(0.04, 0.002, 0.05), alpha=500.0, beta=1e-8, turn=800.0, across=True, along=True
    ),
}


def coefficients(x):
    """Linear in the compliances."""
    return MODULI * (1 / (1 + SPREAD * x) - 1)


@cache
def unit_changes(scene):
    """Of C33, and of C44 = C55."""
    changes = [{"pad.body": np.diag(np.isin(np.arange(6), p) + 0.0)} for p in (2, [3, 4])]
    parts = affine_parts(scene.mesh, scene.free, changes)
    return [local_rows(gathered(A)) for A in parts]


@cache
def damping(scene, case):
    """Damping of the scene and of its changes."""
    terms = CASES[case]
    alpha, beta = terms.get("alpha", 0.0), terms.get("beta", 0.0)
    pad, plate, shear = (eta / OMEGA_REF for eta in terms.get("loss", (0.0, 0.0, 0.0)))
    layers = [
        local_rows(gathered(affine_parts(scene.mesh, scene.free, [{n: scene.materials[n].C}])[0]))
        for n in ("pad.body", "plate.body")
    ]
    C = alpha * scene.M + beta * scene.K + pad * layers[0] + plate * layers[1]
    C = C + shear * MODULI[1] * unit_changes(scene)[1]
    if terms.get("turn"):
        G = gyroscopic(scene.mesh, scene.free, {"plate.body": 7200.0}, terms["turn"])
        C = C + local_rows(gathered(G))
    C = C.tocsr()
    C.eliminate_zeros()
    along, across = (bool(terms.get(name)) for name in ("along", "across"))
    follows = np.array([pad + beta, pad + shear + beta])
    return Damping(C if C.nnz else None, alpha, follows, scene.R, along, across)


@cache
def offline(scene, case):
    return EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], unit_changes(scene),
        coefficients, 2, BAND, 3, scene.comm, damping=damping(scene, case),
    )  # fmt: skip


class Sample:
    """Scattered stiffness and pressure, some elements open, at a place in the box."""

    def __init__(self, scene, case, x, mu, seed):
        rng, n, d = np.random.default_rng(seed), scene.w.size, damping(scene, case)
        self.x, self.mu, self.k = np.array(x), mu, K0 * 10 ** rng.uniform(-1, 1, n)
        self.k[rng.random(n) < 0.3] = 0.0
        p = np.where(self.k > 0, 5e5 * rng.uniform(0, 2, n), 0.0)
        self.along, self.across = -0.1 * p * d.along, mu * p / SPEED * d.across
        c, parts = coefficients(self.x), unit_changes(scene)
        self.K = scene.tangent(self.k, mu) + sum(a * A for a, A in zip(c, parts, strict=True))
        C = sp.csr_matrix(scene.K.shape) if d.C is None else d.C
        C = C + sum(f * a * A for f, a, A in zip(d.follows, c, parts, strict=True))
        C = C + sliding_damping(scene.R, scene.w, self.across * SPEED, SPEED + 0 * p, 1.0)
        self.C, self.M = C + velocity_slope(scene.T, scene.w, self.along, 1.0), scene.M

    def modes(self, basis):
        return basis.damped_modes(self.x, self.k, self.mu, self.along, self.across, ZETA)


PLACES = (0.0, (0.3, -0.5)), (0.5, (-1.0, -1.0)), (1.0, (0.7, 0.9))


@pytest.mark.parametrize("case, mu, x", turns(zip(CASES), PLACES), ids=str)
def test_every_damped_mode_of_changed_bodies(two_blocks, dense, case, mu, x):
    """None missed, errors covered and within 1e-6, verdicts of full order.

    Two places inside, and the corner without an anchor. Catches a term with a
    wrong sign or at the wrong place, damping that does not follow a sample's stiffness, one in
    proportion where it is not ("layers"), a left vector of the wrong problem ("turning").
    """
    scene = two_blocks("coarse")
    sample = Sample(scene, case, x, mu, seed=int(10 * mu))
    found = sample.modes(offline(scene, case))
    assert dense(sample.M, sample.C, sample.K, HIGH, ZETA).agrees(found) < 1e-6
    assert len(found) == found.count.expected and "winding number" in found.count.how
    assert np.median(found.error / np.abs(found.s)) < 2e-5
    assert np.all(found.residual < 0.02)


def test_what_is_in_proportion_needs_no_anchors_of_its_own(two_blocks):
    """One loss factor a body, Rayleigh: the undamped bodies tell; layers are a coordinate more."""
    scene = two_blocks("coarse")
    sizes = {case: offline(scene, case).bodies[0].anchors.points.shape for case in CASES}
    assert sizes == {case: (20, 3) if case in ("layers", "all") else (10, 2) for case in CASES}


def test_without_damping_it_is_the_undamped_model(two_blocks):
    """Equal rows, within the errors of both; equilibria take the same bodies."""
    scene = two_blocks("coarse")
    sample = Sample(scene, "falling", (0.4, -0.9), 0.6, seed=3)
    none, basis = np.zeros(scene.w.size), offline(scene, "falling")
    found = basis.damped_modes(sample.x, sample.k, 0.6, none, none, ZETA)
    plain = EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], unit_changes(scene),
        coefficients, 2, BAND, 3, scene.comm,
    )  # fmt: skip
    for other in (plain, basis):
        modes = other.modes(sample.x, sample.k, 0.6)
        assert len(modes) == len(found)
        distance = np.abs(modes.s[:, None] - found.s)
        nearest = distance.argmin(axis=1)
        assert np.all(distance.min(axis=1) <= modes.error + found.error[nearest])
    pairs = (model.compliance(sample.x, scene.k0) for model in (plain, basis))
    for ours, theirs in zip(*pairs, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10 * np.abs(theirs).max())


@pytest.mark.parametrize("case", ["sliding", "all"])
def test_what_was_made_earlier_gives_the_same_bytes(two_blocks, case):
    """Arrays of the bodies, taken again."""
    scene = two_blocks("coarse")
    sample, first = Sample(scene, case, (0.1, -0.2), 0.5, seed=2), offline(scene, case)
    again = EnsembleBasis(
        scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], unit_changes(scene),
        coefficients, 2, BAND, 3, scene.comm, known=[body.arrays() for body in first.bodies],
        damping=damping(scene, case),
    )  # fmt: skip
    np.testing.assert_array_equal(sample.modes(first).s, sample.modes(again).s)


def test_images_share_the_work(two_blocks):
    """Two damped brakes, the second in another order and upside down: the lambda of both."""
    scene, rng = two_blocks("guided"), np.random.default_rng(5)
    m, n = scene.N.shape
    order, rows = rng.permutation(n), rng.permutation(m)
    turn = np.where(rng.random(n) < 0.4, -1.0, 1.0)
    P = sp.csr_matrix((turn, (order, np.arange(n))), shape=(n, n))
    S = sp.csr_matrix((np.ones(m), (rows, np.arange(m))), shape=(m, m))
    d = damping(scene, "all")
    K, M, C, *parts = (
        sp.block_diag([A, P @ A @ P.T]).tocsr()
        for A in (scene.K, scene.M, d.C, *unit_changes(scene))
    )
    N, T, R = (sp.block_diag([A, S @ A @ P.T]).tocsr() for A in (scene.N, scene.T, scene.R))
    twice = Damping(C, d.alpha, d.follows, R, d.along, d.across)
    w, f = np.r_[scene.w, S @ scene.w], np.r_[scene.f, P @ scene.f]
    basis = EnsembleBasis(
        K, M, N, T, w, f[:, None], parts, coefficients, 2, BAND, 3, scene.comm, damping=twice
    )
    assert [bool(body.arrays()) for body in basis.bodies] == [True, True, False, False]
    # Contact of its own under each: equal eigenvalues would be a hard case of another kind.
    one, two = (Sample(scene, "all", (0.5, -0.6), 0.4, seed) for seed in (4, 5))
    pairs = ((one.k, two.k), (one.along, two.along), (one.across, two.across))
    k, along, across = (np.r_[a, S @ b] for a, b in pairs)
    found = basis.damped_modes(one.x, k, 0.4, along, across, ZETA)
    alone = [sample.modes(offline(scene, "all")) for sample in (one, two)]
    s, error = (np.concatenate([getattr(m, name) for m in alone]) for name in ("s", "error"))
    assert len(found) == s.size
    distance = np.abs(found.s[:, None] - s)
    nearest = distance.argmin(axis=1)
    assert np.unique(nearest).size == s.size
    assert np.all(distance.min(axis=1) <= found.error + error[nearest])
    assert np.median(distance.min(axis=1) / np.abs(found.s)) < 1e-6


def test_displacements_of_the_coordinates(two_blocks):
    """Right vectors of open contact: lambda solves their quadratic equation."""
    scene = two_blocks("coarse")
    sample = Sample(scene, "layers", (0.5, 0.2), 0.0, seed=1)
    none, basis = np.zeros(scene.w.size), offline(scene, "layers")
    found = basis.damped_modes(sample.x, none, 0.0, none, none, ZETA)
    open_contact = sample.K - (scene.tangent(sample.k, 0.0) - scene.K)
    phi, elastic = basis.coordinates.displacements(found.right), np.abs(found.s) > 1e-4 * HIGH
    # All matrices are symmetric: left vectors are right ones, and the quotient is stationary.
    a, b, c = (np.einsum("im,im->m", phi, A @ phi) for A in (sample.M, sample.C, open_contact))
    off = found.s**2 * a + found.s * b + c
    assert elastic.sum() >= 3
    # The static answer to the forces of damping is left out.
    assert np.all(np.abs(off[elastic]) < 5e-4 * np.abs(c[elastic]))


def test_refused_by_name(two_blocks):
    """A part that turns and changes; a lining that is all but a dashpot."""
    scene, parts = two_blocks("coarse"), unit_changes(two_blocks("coarse"))

    def make(C, loss):
        given = Damping(C, 0.0, np.full(2, loss), scene.R, False, False)
        return EnsembleBasis(
            scene.K, scene.M, scene.N, scene.T, scene.w, scene.f[:, None], parts, coefficients, 2,
            BAND, 1, scene.comm, damping=given,
        )  # fmt: skip

    G = gyroscopic(scene.mesh, scene.free, {"pad.body": 2510.0}, 800.0)
    with pytest.raises(InaccurateResult, match="must be clamped and of constant stiffness"):
        make(local_rows(gathered(G)), 0.0)
    loss = 1.5 / HIGH
    with pytest.raises(InaccurateResult, match="damping too strong for the reduced model"):
        make((loss * scene.K).tocsr(), loss)
