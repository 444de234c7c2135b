"""Reduced model against dense eigenvalues of the whole problem, and its parts."""

from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.macro.condensation import petsc_matrix
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.stability import Reduced, complex_modes, reduction
from brake_fenicsx.stability.full.lanczos import lowest_modes
from brake_fenicsx.stability.modes import THRESHOLD
from dense_reference import all_kappa, standard, undamped

BAND = (0.0, 90e3)
K0 = 3e11


@cache
def offline(scene, k0=K0, cutoff=None):
    return Reduced(
        scene.elastic.K, scene.elastic.M, scene.N, scene.T, scene.w, k0, BAND, cutoff, scene.comm
    )


def stiffness(n, seed, centre=K0, decades=2.0, is_open=0.3):
    """Scattered over decades about a centre, some elements open."""
    rng = np.random.default_rng(seed)
    k = centre * 10 ** rng.uniform(-decades / 2, decades / 2, n)
    k[rng.random(n) < is_open] = 0.0
    return k


def dense_vectors(scene, k, mu):
    """kappa with left and right vectors of the whole problem, M-orthogonal coordinates undone."""
    A, L = standard(scene.tangent(k, mu), scene.M)
    kappa, left, right = la.eig(A, left=True, right=True)
    return kappa, *(la.solve_triangular(L, V, lower=True, trans=1) for V in (left, right))


def dense(scene, k, mu):
    """All lambda with omega >= 0 [1/s], and the round-off they carry before their condition."""
    kappa = all_kappa(scene.tangent(k, mu), scene.M, symmetric=mu == 0)
    return undamped(kappa), 1e-15 * np.abs(kappa).max()


def within(lam, highest):
    """Those of the modes with frequencies up to a highest one [Hz]."""
    return lam[(lam.imag > 0) & (lam.imag <= 2 * np.pi * highest)]


def verdicts_agree(modes, nearest):
    grows = nearest.real > THRESHOLD * np.abs(nearest)
    for verdict, unstable in zip(modes.verdict, grows, strict=True):
        assert verdict == "neutral" or (verdict == "unstable") == unstable


CASES = [(mu, seed) for mu in (0.0, 0.3, 0.5, 1.0) for seed in range(2)]


@pytest.mark.parametrize("mu, seed", CASES)
def test_every_mode_of_a_random_interface(two_blocks, mu, seed):
    """Two decades of stiffness, 30 % open: none missed, none invented, errors covered, verdicts.

    Catches a residual flexibility of the wrong order or sign, and a friction column lost.
    """
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, seed)
    found = offline(scene).modes(k, mu)
    exact, floor = dense(scene, k, mu)
    inside = exact[(exact.imag > 0) & (exact.imag <= 2 * np.pi * BAND[1])]
    assert len(found) == inside.size == found.count.expected > 15
    distance = np.abs(found.s[:, None] - exact)
    nearest = exact[distance.argmin(axis=1)]
    assert np.unique(np.round(nearest, 6)).size == len(found)
    round_off = floor * found.condition / (2 * np.abs(found.s))
    assert np.all(distance.min(axis=1) <= found.error + round_off)
    assert np.max(distance.min(axis=1) / np.abs(found.s)) < 1e-3
    verdicts_agree(found, nearest)
    if mu == 0:
        np.testing.assert_array_equal(found.s.real, 0.0)
        assert set(found.verdict) == {"stable"}


def test_some_of_these_flutter(two_blocks):
    """The verdicts above have something to say: unstable pairs exist, and come as +-alpha."""
    scene = two_blocks("guided")
    pairs = 0
    for seed in range(8):
        k = stiffness(scene.w.size, seed)
        m = offline(scene).modes(k, 1.0)
        for i in np.flatnonzero(np.array(m.verdict) == "unstable"):
            pairs += 1
            mirror = -m.s[i].conjugate()
            assert np.abs(m.s - mirror).min() < 1e-9 * abs(mirror)
    assert pairs >= 3


def test_a_pair_that_the_correction_moves_over_the_edge_is_counted(two_blocks):
    """The linear pencil has it beyond 90 kHz, the corrected one below: the phase turns unseen.

    Catches a count that divides by the uncorrected values. On another mesh (gmsh 4.13) no pair lies
    there, and what is left is that no mode well inside is missing.
    """
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 122, 10 * K0, 2)
    found = offline(scene).modes(k, 0.3)
    exact, _ = dense(scene, k, 0.3)
    there = within(exact, BAND[1]).size
    assert there - 2 <= len(found) <= there
    assert within(found.s, 0.999 * BAND[1]).size == within(exact, 0.999 * BAND[1]).size


SAMPLES = [(seed, mu) for seed in range(200, 204) for mu in (0.25 * (seed - 199),)]
MORE = [(seed, (seed - 204) / 19) for seed in range(204, 224)]


@pytest.mark.parametrize("samples", [SAMPLES, pytest.param(MORE, marks=pytest.mark.slow)])
def test_tolerance_is_kept_over_samples(two_blocks, samples):
    """95 % within 1e-5 and none beyond 1e-4 uncorrected; 1e-6 corrected; verdicts.

    Scattered over two decades, a third open, mu from 0 to 1. Catches a correction that is none.
    """
    scene = two_blocks("guided")
    red, before, after, corrected = offline(scene), [], [], 0
    for seed, mu in samples:
        k = stiffness(scene.w.size, seed, is_open=0.33)
        exact, floor = dense(scene, k, mu)
        for tolerance, errors in ((np.inf, before), (1e-6, after)):
            m = red.modes(k, mu, tolerance)
            assert len(m) == within(exact, BAND[1]).size
            distance = np.abs(m.s[:, None] - exact)
            round_off = floor * m.condition / (2 * np.abs(m.s))
            assert np.all(distance.min(axis=1) <= m.error + round_off), (seed, tolerance)
            verdicts_agree(m, exact[distance.argmin(axis=1)])
            errors.append(np.maximum(distance.min(axis=1) - round_off, 0) / np.abs(m.s))
            corrected += m.iterations
            assert tolerance < 1 or m.iterations == 0
    before, after = np.concatenate(before), np.concatenate(after)
    assert corrected > 0 and np.median(after) <= np.median(before)
    assert np.mean(before < 1e-5) >= 0.95 and before.max() < 1e-4, (before.max(),)
    assert after.max() < 1e-6, (before.max(), after.max(), corrected)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.3, 0.5, 1.0])
def test_many_interfaces(two_blocks, mu):
    """Forty more samples, stiff ones among them: errors covered and no wrong verdict."""
    scene = two_blocks("guided")
    for seed in range(100, 140):
        k = stiffness(scene.w.size, seed, K0 * 10 ** (seed % 3 - 1), 2 + seed % 2)
        found = offline(scene).modes(k, mu)
        exact, floor = dense(scene, k, mu)
        distance = np.abs(found.s[:, None] - exact)
        round_off = floor * found.condition / (2 * np.abs(found.s))
        assert np.all(distance.min(axis=1) <= found.error + round_off), seed
        verdicts_agree(found, exact[distance.argmin(axis=1)])
        # A mode closer to the edge of the band than its error may fall on either side of it.
        least, most = (within(exact, edge * BAND[1]).size for edge in (0.999, 1.001))
        assert least <= len(found) <= most, seed


@pytest.mark.parametrize("mu", [0.0, 1.0])
def test_left_and_right_vectors_satisfy_the_full_problem(two_blocks, mu):
    """Expanded displacements: the residual of K + (N + mu T)'W k N - kappa M itself."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    red = offline(scene)
    m = red.modes(k, mu)
    X = red.expand(m.s, m.right, k, mu)
    kappa = -(m.s**2)
    K = scene.tangent(k, mu)
    r = K @ X - (scene.M @ X) * kappa
    # In the norm of K0^-1, relative to the norm of K0, as promised.
    reference = scene.tangent(np.full(scene.w.size, K0), 0.0).toarray()
    inverse = la.cho_factor(reference)
    size = np.sqrt(np.einsum("im,im->m", r.conj(), la.cho_solve(inverse, r)).real)
    norm = np.sqrt(np.einsum("im,im->m", X.conj(), reference @ X).real)
    assert np.all(size / norm <= m.residual * 1.01 + 1e-9)
    assert np.all(m.residual < 1e-2)
    # And the displacements are those of the full order, up to a factor.
    exact, _, V = dense_vectors(scene, k, mu)
    for i in range(len(m)):
        j = np.argmin(np.abs(exact - kappa[i]))
        x, v = X[:, i], V[:, j]
        mac = (
            np.abs(np.vdot(v, scene.M @ x)) ** 2
            / (np.vdot(x, scene.M @ x) * np.vdot(v, scene.M @ v)).real
        )
        assert mac > 1 - 1e-4 * min(m.condition[i] ** 2, 1e3)


def test_left_vectors_are_those_of_the_adjoint_sample(two_blocks):
    """psi' M phi vanishes between different modes; the condition is that of the full problem."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 2)
    m = offline(scene).modes(k, 0.5)
    kappa, VL, VR = dense_vectors(scene, k, 0.5)
    MR, ML = scene.M @ VR, scene.M @ VL
    norms = np.sqrt(np.einsum("im,im->m", VR.conj(), MR).real
                    * np.einsum("im,im->m", VL.conj(), ML).real)  # fmt: skip
    full = norms / np.abs(np.einsum("im,im->m", VL.conj(), MR))
    for i, s in enumerate(m.s):
        j = np.argmin(np.abs(kappa + s**2))
        assert m.condition[i] == pytest.approx(full[j], rel=0.02)


def test_reference_itself_is_exact(two_blocks):
    """k = k0 and mu = 0: the real modes, to round-off."""
    scene = two_blocks("guided")
    red = offline(scene)
    m = red.modes(np.full(scene.w.size, K0), 0.0)
    wanted = np.sqrt(red.basis.Lambda) / 2 / np.pi
    np.testing.assert_allclose(m.frequency, wanted[wanted <= BAND[1]], rtol=1e-10)


def test_more_modes_and_another_reference_tell_the_same(two_blocks):
    """Cutoff and k0 are knobs of the method: both answers agree within the sum of their errors."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 5)
    base = offline(scene).modes(k, 0.5)
    for other in (offline(scene, K0, 2.5 * BAND[1]), offline(scene, 10 * K0)):
        m = other.modes(k, 0.5)
        assert len(m) == len(base)
        j = np.abs(base.s[:, None] - m.s).argmin(axis=1)
        assert np.all(np.abs(base.s - m.s[j]) <= base.error + m.error[j])


def test_error_falls_with_the_cutoff(two_blocks):
    """Largest true error of a sample at 1.2, 1.6 and 2.2 times the band."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 5)
    exact, _ = dense(scene, k, 0.5)
    worst = []
    for factor in (1.2, 1.6, 2.2):
        # Uncorrected: a correction would hide the basis.
        m = offline(scene, K0, factor * BAND[1]).modes(k, 0.5, np.inf)
        worst.append(np.max(np.abs(m.s[:, None] - exact).min(axis=1) / np.abs(m.s)))
    assert worst[1] < 0.3 * worst[0] and worst[2] < 0.3 * worst[1], worst


def test_full_order_agrees_with_dense(two_blocks):
    """complex_modes on the assembled scene: the same list, errors covered."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 3)
    for mu in (0.0, 0.7):
        m = complex_modes(scene.M, None, scene.tangent(k, mu), BAND)
        exact, floor = dense(scene, k, mu)
        inside = exact[(exact.imag > 0) & (exact.imag <= 2 * np.pi * BAND[1])]
        assert len(m) == inside.size
        distance = np.abs(m.s[:, None] - exact)
        assert np.all(distance.min(axis=1) <= m.error + floor * m.condition / (2 * np.abs(m.s)))
        verdicts_agree(m, exact[distance.argmin(axis=1)])


def test_a_hidden_mode_of_the_reference_is_noticed(two_blocks, monkeypatch):
    """One real mode withheld: inertia knows, on all processes together."""
    scene = two_blocks("guided")
    real = reduction.lowest_modes

    def hide(*args, **kwargs):
        found = real(*args, **kwargs)
        return type(found)(found.Phi[:, 1:], found.Lambda[1:], found.residual, found.blocks)

    monkeypatch.setattr(reduction, "lowest_modes", hide)
    with pytest.raises(InaccurateResult, match="inertia"):
        Reduced(
            scene.elastic.K, scene.elastic.M, scene.N, scene.T, scene.w, K0, BAND, None, scene.comm
        )


def test_a_failure_of_the_first_process_is_raised_on_all(two_blocks, monkeypatch):
    """Process 0 alone finds the real modes: catches the others waiting for ever."""
    scene = two_blocks("guided")

    def fail(*args, **kwargs):
        raise NotConverged("block Lanczos: said by the test")

    monkeypatch.setattr(reduction, "lowest_modes", fail)
    with pytest.raises(NotConverged, match="said by the test"):
        Reduced(
            scene.elastic.K, scene.elastic.M, scene.N, scene.T, scene.w, K0, BAND, None, scene.comm
        )


def test_one_process_and_all_give_the_same_modes(two_blocks):
    """Eigenvalues to 1e-8, as the program promises."""
    results = []
    for alone in (True, False):
        scene = two_blocks("guided", alone=alone)
        results.append(offline(scene).modes(stiffness(scene.w.size, 7), 0.5))
    tolerance = 1e-8 * np.abs(results[0].s) + 1e-13 * results[0].condition * np.abs(results[0].s)
    assert len(results[0]) == len(results[1])
    assert np.all(np.abs(results[0].s - results[1].s) <= tolerance)


def factored(A):
    return Factor(petsc_matrix(sp.csr_matrix(A)))


@pytest.mark.parametrize("block", [1, 3, 32])
def test_lowest_modes_with_doublets_and_a_triplet(block):
    """A disc's doublets, exactly degenerate: with blocks smaller and larger than them."""
    rng = np.random.default_rng(0)
    n = 60
    values = np.sort(np.r_[np.repeat(rng.uniform(1, 5, 10), 2), [2.5] * 3, rng.uniform(6, 100, 37)])
    M = np.diag(rng.uniform(0.5, 2, n))
    Q = la.qr(rng.normal(size=(n, n)))[0]
    half = np.sqrt(M)
    K = half @ Q @ np.diag(values) @ Q.T @ half
    m = lowest_modes(factored(0.5 * (K + K.T)), sp.csr_matrix(M), 5.5, block=block)
    np.testing.assert_allclose(m.Lambda, values[values <= 5.5], rtol=1e-8)
    np.testing.assert_allclose(m.Phi.T @ M @ m.Phi, np.eye(m.Lambda.size), atol=1e-9)
    r = K @ m.Phi - M @ m.Phi * m.Lambda
    assert np.abs(r).max() < 1e-6


def test_lowest_modes_below_everything_and_above_everything():
    """No mode below the cutoff, and all modes of a small problem."""
    values = np.array([1.0, 2.0, 3.0, 50.0])
    factor = factored(np.diag(values))
    assert lowest_modes(factor, sp.identity(4, format="csr"), 0.5).Lambda.size == 0
    np.testing.assert_allclose(
        lowest_modes(factor, sp.identity(4, format="csr"), 1e3).Lambda, values, rtol=1e-12
    )
