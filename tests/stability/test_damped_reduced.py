"""Reduced model with damping against dense eigenvalues of the whole problem, and its parts."""

from functools import cache, partial

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import gathered
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.stability import DampedReduced, Reduced
from brake_fenicsx.stability.damping import sliding_damping, velocity_slope
from brake_fenicsx.stability.gyroscopic import gyroscopic
from brake_fenicsx.stability.modes import THRESHOLD
from brake_fenicsx.stability.reduced.deflation import Deflated
from brake_fenicsx.stability.reduced.division import quadratic_divisor, quadratic_pairs
from tables import turns

BAND, K0, SPEED, ZETA = (0.0, 90e3), 3e11, 2.0, 0.2
OMEGA = 2 * np.pi * BAND[1]

# Loss factor of the lining at 30 kHz, alpha, beta, speed of the turning plate; contact's rates.
CASES = {
    "loss": dict(loss=0.1),
    "rayleigh": dict(alpha=500.0, beta=2e-8),
    "turning": dict(turn=800.0),
    "sliding": dict(across=True),
    "falling": dict(along=True),
    "all": dict(loss=0.1, alpha=500.0, beta=1e-8, turn=800.0, across=True, along=True),
}


@cache
def real_modes(scene, order=0):
    return Reduced(
        scene.elastic.K, scene.elastic.M, scene.N, scene.T, scene.w, K0, BAND, order=order
    )


@cache
def bulk(scene, loss=0.0, alpha=0.0, beta=0.0, turn=0.0, **contact):
    """Damping of the bodies; None where there is none."""
    if not (loss or alpha or beta or turn):
        return None
    (lining,) = affine_parts(scene.mesh, scene.free, [{"pad.body": scene.materials["pad.body"].C}])
    C = loss / (2 * np.pi * 30e3) * local_rows(gathered(lining)) + alpha * scene.M + beta * scene.K
    if turn:
        G = gyroscopic(scene.mesh, scene.free, {"plate.body": 7200.0}, turn)
        C = C + local_rows(gathered(G))
    return C.tocsr()


@cache
def offline(scene, case, alone=True):
    terms = CASES[case]
    comm = MPI.COMM_SELF if alone else scene.comm
    along, across = (bool(terms.get(name)) for name in ("along", "across"))
    return DampedReduced(real_modes(scene), bulk(scene, **terms), scene.R, along, across, comm)


class Sample:
    """Scattered stiffness and pressure, some elements open, and the dense problem."""

    def __init__(self, dense, scene, case, seed, mu, is_open=0.3):
        rng, n = np.random.default_rng(seed), scene.w.size
        self.k = K0 * 10 ** rng.uniform(-1, 1, n)
        self.k[rng.random(n) < is_open] = 0.0
        p = np.where(self.k > 0, 5e5 * rng.uniform(0, 2, n), 0.0)
        terms, self.mu = CASES[case], mu
        self.along = -0.1 * p * bool(terms.get("along"))
        self.across = mu * p / SPEED * bool(terms.get("across"))
        M, K = scene.M, scene.tangent(self.k, mu)
        C = bulk(scene, **terms)
        C = sp.csr_matrix(scene.M.shape) if C is None else C
        w, V = scene.w, np.full(n, SPEED)
        C = C + sliding_damping(scene.R, w, self.across * V, V, 1.0)
        C = C + velocity_slope(scene.T, w, self.along, 1.0)
        self.exact = dense(M, C, K, OMEGA, ZETA, 1e-6)

    def modes(self, model, tolerance=1e-6, zeta=ZETA):
        return model.modes(self.k, self.mu, self.along, self.across, zeta, tolerance)


@pytest.fixture
def sample_of(dense):
    """``sample_of(scene, case, seed, mu)``: see ``Sample``."""
    return partial(Sample, dense)


@pytest.mark.parametrize("case, mu, seed", turns(zip(CASES), [(0.0, 1), (0.4, 2), (1.0, 3)]))
def test_every_damped_mode_of_a_random_interface(two_blocks, sample_of, case, mu, seed):
    """None missed, none invented, errors covered and within the tolerance, verdicts of full order.

    Catches a term with a wrong sign or at the wrong place, one lost in the series, and a left
    vector of the wrong problem (turning: C is not symmetric).
    """
    scene = two_blocks("coarse")
    sample = sample_of(scene, case, seed, mu)
    found = sample.modes(offline(scene, case))
    exact = np.array([sample.exact.sharp(s) for s in found.s])
    assert len(found) == sample.exact.eigenvalues.size == found.count.expected > 10
    assert np.unique(np.round(exact, 3)).size == len(found)
    assert "winding number" in found.count.how
    distance = np.abs(found.s - exact)
    assert np.all(distance <= found.error + 1e-12 * np.abs(exact))
    assert np.all(distance <= 1e-6 * np.abs(exact))
    assert np.all(found.residual < 0.02)
    grows = exact.real > THRESHOLD * np.abs(exact)
    for verdict, unstable in zip(found.verdict, grows, strict=True):
        assert verdict == "neutral" or (verdict == "unstable") == unstable
    if case in ("loss", "rayleigh") and mu == 0:
        assert set(found.verdict) == {"stable"}


def test_falling_friction_feeds_energy_in(two_blocks, sample_of):
    """The cases above have unstable modes in them, by flutter and by falling friction alone."""
    scene = two_blocks("coarse")
    sample = sample_of(scene, "falling", 5, 0.0, is_open=0.0)
    found = sample.modes(offline(scene, "falling"))
    assert "unstable" in found.verdict


def test_errors_before_and_after_refinement(two_blocks, sample_of):
    """Estimates cover what nothing was done about; refined to 1e-10 the full problem agrees."""
    scene, before, after = two_blocks("coarse"), [], []
    for seed, mu in ((11, 0.3), (12, 0.9)):
        sample = sample_of(scene, "all", seed, mu)
        rough, fine = (sample.modes(offline(scene, "all"), tol) for tol in (np.inf, 1e-10))
        assert rough.iterations == 0 < fine.iterations
        for modes, errors in ((rough, before), (fine, after)):
            exact = np.array([sample.exact.sharp(s) for s in modes.s])
            assert np.all(np.abs(modes.s - exact) <= modes.error + 1e-12 * np.abs(exact))
            errors.extend(np.abs(modes.s - exact) / np.abs(exact))
    assert np.max(before) < 1e-4 and np.median(before) < 1e-6
    assert np.max(after) < 1e-10


def test_without_damping_it_is_the_undamped_model(two_blocks, sample_of):
    """A scene whose only term does not act in a sample; flutter pairs come as +-alpha.

    One pair is near merging, condition 14: a correction of first order leaves 5e-5 there.
    """
    scene = two_blocks("coarse")
    sample = sample_of(scene, "loss", 4, 0.8)
    none = DampedReduced(real_modes(scene), None, scene.R, along=False, across=True)
    found = none.modes(sample.k, 0.8, 0 * sample.k, 0 * sample.k, ZETA, 1e-9)
    undamped = real_modes(scene, 5).modes(sample.k, 0.8)
    assert len(found) == len(undamped)
    distance = np.abs(found.s[:, None] - undamped.s)
    assert np.all(distance.min(axis=1) <= undamped.error[distance.argmin(axis=1)] + found.error)
    assert undamped.condition.max() > 10 and np.all(distance.min(axis=1) < 1e-6 * np.abs(found.s))
    for s in found.s[found.s.real > 1.0]:
        assert np.abs(found.s + s.conjugate()).min() < 1e-8 * abs(s)


def test_series_of_the_rest(two_blocks):
    """Sum of lambda^n G_n against a dense solve at a complex lambda, and how fast it converges.

    Catches a term of the recursion that is lost, and rows or columns out of place.
    """
    scene = two_blocks("coarse")
    model = offline(scene, "all")
    Phi, C, n = model.reduced.Phi, model.C.toarray(), scene.K.shape[0]
    K_0 = scene.K + scene.N.T @ sp.diags(scene.w * K0) @ scene.N
    s = (-0.1 + 0.7j) * OMEGA
    rest = Deflated(model.reduced.factor, Phi, model.reduced.basis.Lambda)
    R_0 = rest.solve(np.eye(n))
    S = la.solve(np.eye(n) + s * R_0 @ C + s**2 * R_0 @ scene.M.toarray(), R_0)
    np.testing.assert_allclose(K_0 @ (Phi / model.basis.Lambda), scene.M @ Phi, atol=1e-9)
    rows = np.vstack([model.O.toarray(), Phi.T @ C])
    columns = np.hstack([model.I.toarray().T, C @ Phi])
    exact, total, errors = rows @ S @ columns, 0.0, []
    own = np.s_[: model.O.shape[0], : model.I.shape[0]]
    for j, G in enumerate(model.basis.G):
        total = total + s**j * G
        errors.append(la.norm((total - exact)[own]) / la.norm(exact[own]))
    assert errors[-1] < 3e-3 * errors[1]
    # Two terms more are worth |lambda|^2 / radius^2.
    rate = (errors[-1] / errors[-5]) ** 0.25
    assert rate < 1.1 * abs(s) / model.basis.radius
    whole = la.norm(total - exact, axis=0) / la.norm(exact, axis=0)
    assert np.all(whole < 0.05)


def test_processes_share_the_columns(two_blocks):
    """The same model from one process and from all."""
    scene = two_blocks("coarse")
    own, shared = (offline(scene, "all", alone) for alone in (True, False))
    for A, B in zip(own.basis.G, shared.basis.G, strict=True):
        np.testing.assert_allclose(A, B, rtol=0, atol=1e-10 * np.abs(A).max())


def test_displacements(two_blocks, sample_of):
    """Expanded vectors solve the full problem to what the series of the rest leaves."""
    scene = two_blocks("coarse")
    sample, model = sample_of(scene, "all", 7, 0.5), offline(scene, "all")
    m = sample.modes(model)
    u = model.expand(m.s, m.right, sample.k, 0.5, sample.along, sample.across)
    K, C, M = sample.exact.K, sample.exact.C, sample.exact.M
    r = K @ u + C @ (u * m.s) + M @ (u * m.s**2)
    forces = np.abs(K @ u).max(axis=0)
    assert np.all(np.abs(r).max(axis=0) < 1e-2 * forces)
    # Two terms of the series, each worth |lambda / cutoff|^2, and more.
    assert np.all(np.abs(r).max(axis=0)[:3] < 2e-3 * forces[:3])


def test_damping_too_strong_is_refused(two_blocks):
    """A lining that is all but a dashpot: its rest decays within the band."""
    scene = two_blocks("coarse")
    with pytest.raises(InaccurateResult, match="damping too strong for the reduced model"):
        DampedReduced(real_modes(scene), bulk(scene, loss=3.0), scene.R, False, False)


def polynomial(seed, high):
    """Five coefficients of which the last two are corrections of a size."""
    rng = np.random.default_rng(seed)
    full = [rng.standard_normal((20, 20)) / 20 for _ in range(5)]
    T = [c * A for c, A in zip((0.1, 0.1, 0.1, high, high), full, strict=True)]
    T[0] += np.diag(rng.uniform(0.1, 2.0, 20))
    T[2] += np.eye(20)
    return T


def test_division_of_a_matrix_polynomial():
    """All small zeros of T, right and left vectors, against its full linearisation."""
    T = polynomial(0, 0.05)
    z, a, b = quadratic_pairs(*quadratic_divisor(T), 1.0)
    zero, one = np.zeros((20, 20)), np.eye(20)
    B = la.block_diag(one, one, one, T[4])
    A = np.block(
        [[zero, one, zero, zero], [zero, zero, one, zero], [zero, zero, zero, one],
         [-T[0], -T[1], -T[2], -T[3]]]
    )  # fmt: skip
    every = la.eigvals(A, B)
    small = np.sort(np.abs(every))[:40]
    assert np.sort(np.abs(z)) == pytest.approx(small, rel=1e-9)
    assert np.abs(z[:, None] - every).min(axis=1) == pytest.approx(0, abs=1e-9)
    right = sum(z**j * (A @ a) for j, A in enumerate(T))
    left = sum(z.conj() ** j * (A.T @ b) for j, A in enumerate(T))
    assert np.abs(right).max() < 1e-12
    assert np.abs(left).max() < 1e-5


def test_division_needs_small_high_coefficients():
    """Catches an iteration that wanders off and returns what it has."""
    with pytest.raises(InaccurateResult, match="no small correction"):
        quadratic_divisor(polynomial(0, 20.0))
