"""Full order with friction: Arnoldi from either side, and the count on the interface."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.eigensolvers.argument_principle import Trapezium
from brake_fenicsx.stability.eigensolvers.symmetric import (
    complete,
    count_below,
    factor_near,
    modes_not_counted,
    shifted_factor,
)
from brake_fenicsx.stability.full import friction_modes as friction
from brake_fenicsx.stability.full import general, interface
from brake_fenicsx.stability.full.friction_modes import (
    FRICTIONLESS,
    Determinant,
    InterfaceModes,
    prove,
)
from brake_fenicsx.stability.full.interface import difference_interface
from dense_reference import agrees, all_kappa, all_lambda

BAND = (0.0, 90e3)
K0 = 3e11


def stiffness(n, seed):
    """Two decades about K0, a third of the elements open."""
    rng = np.random.default_rng(seed)
    k = K0 * 10 ** rng.uniform(-1, 1, n)
    k[rng.random(n) < 0.33] = 0.0
    return k


@pytest.mark.long
@pytest.mark.parametrize("mu", [0.3, 1.0, "each"])
def test_all_modes_of_two_blocks(two_blocks, mu):
    """Springs over two decades, a third open; proven, whichever way friction is given.

    Also with mu of every element its own, zero on some. Left vectors fulfil psi^H K = kappa psi^H M
    and are biorthogonal to the right ones.
    """
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    if mu == "each":
        mu = np.random.default_rng(2).uniform(0, 1, k.size) * (np.arange(k.size) % 3 > 0)
    smooth = scene.tangent(k, 0.0)
    K = (smooth + scene.T.T @ sp.diags(mu * scene.w * k) @ scene.N).tocsr()
    exact = all_lambda(K, scene.M)
    assert np.any(exact.real > 1e-3 * np.abs(exact)) or np.max(mu) < 1
    face = contact_interface(scene.N, scene.T, scene.w * k, mu)
    assert face.rank == np.sum((k > 0) & (mu + 0 * k > 0))
    assert abs(K - smooth - face.left.T @ face.right).max() < 1e-12 * abs(K).max()
    for given in (dict(), dict(friction=face), dict(frictionless=smooth),
                  dict(friction=face, frictionless=smooth)):  # fmt: skip
        m = complex_modes(scene.M, None, K, BAND, **given)
        agrees(m, exact, BAND, rigid=0.0)
        if given:
            assert m.count.how.startswith("inertia without friction, winding number")
            assert m.count.kind == "proven", m.count.how
        assert np.all(m.residual < 1e-9)
    kappa, psi = -(m.s**2), m.left.conj().T
    r = psi @ K - kappa[:, None] * (psi @ scene.M)
    assert np.all(np.linalg.norm(r, axis=1) < 1e-8 * np.linalg.norm(psi @ K, axis=1))
    cross = psi @ scene.M @ m.right
    # Rows +-lambda share kappa and vectors with nobody: all are different kappa here.
    size = np.sqrt(np.abs(np.diag(cross))[:, None] * np.abs(np.diag(cross)))
    assert np.abs(cross / size - np.diag(np.diag(cross / size))).max() < 1e-6


def shared(A, comm):
    """A PETSc matrix whose rows the processes share."""
    first, last = np.rint(A.shape[0] * np.array([comm.rank, comm.rank + 1]) / comm.size).astype(int)
    rows = A[first:last]
    size = ((last - first, A.shape[0]), (last - first, A.shape[1]))
    B = PETSc.Mat().createAIJ(size, csr=(rows.indptr, rows.indices, rows.data), comm=comm)
    B.assemble()
    return B


@pytest.mark.long
@pytest.mark.together
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("large", [False, True])
def test_processes_share_a_problem(two_blocks, damped, large, monkeypatch):
    """The same bits as on one: what each does is the same, whoever does it.

    The two sides of a small problem are found by one process, those of a large one by one each.
    """
    monkeypatch.setattr(friction, "SIDE_BY_SIDE", 0 if large else 10**6)
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    K = scene.tangent(k, 0.6)
    C = (1e-7 * scene.K).tocsr() if damped else None
    face = None if damped else contact_interface(scene.N, scene.T, scene.w * k, 0.6)
    alone = complex_modes(scene.M, C, K, BAND, friction=face)
    found = complex_modes(scene.M, C, K, BAND, friction=face, comm=MPI.COMM_WORLD)
    assert len(alone) > 5
    assert found.count == alone.count
    for name in ("s", "right", "left", "error", "condition"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


@pytest.mark.together
def test_distributed_matrices_of_petsc(two_blocks):
    """Each process gathers the matrices and solves for itself."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    K, M = (
        shared(A, scene.comm)
        for A in (tangent(scene.K, scene.N, scene.T, scene.w, k, 0.3), scene.M)
    )
    face = contact_interface(scene.N, scene.T, scene.w * k, 0.3)
    modes = complex_modes(M, None, K, BAND, friction=face)
    agrees(modes, all_lambda(scene.tangent(k, 0.3), scene.M), BAND, rigid=0.0)
    assert modes.right.shape == modes.left.shape == (K.getSize()[0], len(modes))


def test_a_lost_pair_is_noticed(two_blocks, monkeypatch):
    """Withheld from either side alike: the winding number knows."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    real = friction.nearest_modes

    def lossy(*args, **given):
        kappa, X = yield from real(*args, **given)
        keep = np.argsort(kappa.real) != 4
        return kappa[keep], X[:, keep]

    monkeypatch.setattr(friction, "nearest_modes", lossy)
    with pytest.raises(InaccurateResult, match=r"winding number .* counts"):
        complex_modes(
            scene.M, None, scene.tangent(k, 1.0), BAND, frictionless=scene.tangent(k, 0.0)
        )


def prepared(scene, k, mu, cutoff=1.6, orders=1, share=-1e-3):
    """The frictionless modes, as sharp as full order takes them, the interface and its moments."""
    high = (2 * np.pi * BAND[1]) ** 2
    K = scene.tangent(k, 0.0)
    factor, sigma = factor_near(K, scene.M, share * high)
    limit = cutoff**2 * high
    modes = modes_not_counted(scene.M, factor, sigma, limit, tolerance=FRICTIONLESS)
    face = contact_interface(scene.N, scene.T, scene.w * k, mu)
    seen = interface.moments(factor, scene.M, face, orders)
    inside, limit = complete(K, scene.M, modes.kappa, count_below(K, scene.M, limit))
    P, Q = (rows @ modes.Phi[:, inside] for rows in (face.right, face.left))
    return InterfaceModes(modes.kappa[inside], limit, sigma, P, Q), face, seen, high


@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("turned", [0, 1, 3])
def test_inverse_with_and_without_kept_solutions(two_blocks, keep, turned):
    """One solve of a block where S^-1 left' is kept, two where it is not: the same inverse.

    The last columns may be for the transpose.
    """
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 2)
    S, sigma = shifted_factor(scene.tangent(k, 0.0), scene.M, (2 * np.pi * BAND[1]) ** 2)
    face = contact_interface(scene.N, scene.T, scene.w * k, 0.8)
    S.gigabytes = 1.0  # MUMPS counts whole megabytes.
    known = interface.moments(S, scene.M, face, keep=keep)
    assert (known.SL is not None) == keep
    b = np.random.default_rng(0).standard_normal((scene.M.shape[0], 3))
    A = (scene.tangent(k, 0.8) - sigma * scene.M).toarray()
    exact = np.hstack([la.solve(A, b[:, : 3 - turned]), la.solve(A.T, b[:, 3 - turned :])])
    x = interface.Inverse(S, face, known)(b, turned)
    S.destroy()
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-9 * abs(exact).max())


def test_count_needs_no_eigensolver(two_blocks):
    """With values withheld, invented or none at all the count is the truth."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    modes, face, seen, high = prepared(scene, k, 1.0, orders=2)
    kappa = all_kappa(scene.tangent(k, 1.0), scene.M)
    region = Trapezium(-0.02 * high, 1.013 * high, 0.2, 1e-3 * high)
    inside = int(region.holds(kappa).sum())
    near = kappa[np.abs(kappa) < 1.5 * high]
    for believed in (near, near[3:], np.r_[near, 0.5 * high, 0.6 * high], np.zeros(0)):
        proof = prove(Determinant(modes, face, seen), region, believed)
        assert proof.count == inside and proof.remainder < 1


@pytest.mark.hard
@pytest.mark.parametrize("beyond", [50, 200, pytest.param(1000, marks=pytest.mark.slow)])
def test_many_modes_beyond_the_region(beyond):
    """Up to a thousand poles just beyond the edge, which turn the phase: the count is the truth.

    With the shift below the region and amid it.
    """
    for seed in range(8):
        rng = np.random.default_rng(seed)
        poles = np.sort(np.r_[rng.uniform(0.01, 1.0, 20), rng.uniform(1.05, 2.5, beyond)])
        sigma, size = (-1e-3, 0.55)[seed % 2], poles.size
        left, right = (1e-2 * rng.standard_normal((4, size)) for _ in range(2))
        kappa = la.eigvals(np.diag(poles) + left.T @ right)
        S = poles - sigma
        seen = interface.Moments(
            tuple((right / S ** (j + 1)) @ left.T for j in range(3)), (left / S**3) @ left.T,
            (right / S) @ right.T,
        )  # fmt: skip
        face = interface.Interface(sp.csr_matrix(left), sp.csr_matrix(right), False)
        modes = InterfaceModes(poles, 2.6, sigma, right, left)
        region = Trapezium(-0.02, 1.025, 0.45, 1e-3)
        inside, near = int(region.holds(kappa).sum()), kappa[np.abs(kappa) < 1.1]
        for believed in (near, near[2:]):
            proof = prove(Determinant(modes, face, seen), region, believed)
            assert proof.count == inside, (seed, believed.size)
            assert proof.points < 300


@pytest.mark.parametrize(
    "cutoff, orders", [(1.3, 3), (1.6, 1), (1.6, 2), (1.6, 3), (2.5, 1), (2.5, 3), (1.3, 6)]
)
@pytest.mark.parametrize("share", [-1e-3, 0.55])
def test_rest_is_a_bound(two_blocks, cutoff, orders, share):
    """|eigenvalues of G^-1 (exact G - G)| <= rest, by the dense exact G; not vastly above it.

    With the shift below the band and amid it.
    """
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 4)
    modes, face, seen, high = prepared(scene, k, 0.7, cutoff, orders, share)
    K, M = scene.tangent(k, 0.0).toarray(), scene.M.toarray()
    L, R = face.left.toarray(), face.right.toarray()
    for z in (0.9 * high * (1 + 0.2j), 0.3 * high * (1 + 0.1j), high * (1.01 + 0.01j)):
        det = Determinant(modes, face, seen)
        det.phase(z, np.zeros(0), modes.kappa)
        exact = np.eye(face.rank) + R @ la.solve(K - z * M, L.T)
        d = z - modes.sigma
        known = sum(d**j * R for j, R in enumerate(det.R)) + det.P / (modes.kappa - z) @ det.Q.T
        size = np.abs(la.eigvals(la.solve(known, exact - known))).max()
        assert size <= det.remainder * (1 + 1e-6) + 1e-9
        assert det.remainder < 1e4 * size + 1e-6
    assert det.remainder < {(1.3, 3): 3.0, (1.6, 1): 5.0, (1.6, 2): 2.0}.get((cutoff, orders), 1.0)


def test_stiff_contact_is_proven_with_more_moments(two_blocks, monkeypatch):
    """Few real modes and few moments prove nothing, and the record says so; more moments do."""
    scene = two_blocks("fine")
    k = stiffness(scene.w.size, 4)
    given = scene.M, None, scene.tangent(k, 1.0), BAND
    monkeypatch.setattr(friction, "LIMIT", 1.35)
    for more, proven in ((1, False), (12, True)):
        monkeypatch.setattr(interface, "MOST_ORDERS", more)
        count = complex_modes(*given, frictionless=scene.tangent(k, 0.0)).count
        assert count.kind == ("proven" if proven else "counted")
        assert ("which should be below 1" in count.how) != proven


def test_unbounded_interface_gives_the_same_count(two_blocks):
    """Found from the matrices alone, the size of the gaps' compliance is computed."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    F = scene.tangent(k, 1.0) - scene.tangent(k, 0.0)
    face = difference_interface(F)
    assert not face.bounded
    assert face.rank == np.sum(k > 0)
    assert abs(F - face.left.T @ face.right).max() < 1e-12 * abs(F).max()


def test_a_full_difference_is_no_interface(monkeypatch):
    """Rank beyond the limit: SLEPc finds the modes, and the record names the remedy."""
    monkeypatch.setattr(interface, "LARGEST", 50)
    n = 310
    K = sp.diags([np.full(n, 2.0), -1.001 * np.ones(n - 1), -0.999 * np.ones(n - 1)], [0, 1, -1])
    assert difference_interface((0.5 * (K - K.T)).tocsr()) is None
    modes = complex_modes(sp.identity(n, format="csr"), None, K.tocsr(), (0.0, 0.05))
    # A similarity makes it symmetric: omega^2 = 2 - 2 sqrt(1 - 1e-6) cos(k pi / (n + 1)).
    exact = np.sqrt(2 - 2 * np.sqrt(1 - 1e-6) * np.cos(np.arange(1, n + 1) * np.pi / (n + 1)))
    exact = exact[exact < 2 * np.pi * 0.05]
    assert modes.count.kind == "not counted" and "give frictionless=" in modes.count.how
    np.testing.assert_allclose(modes.s.imag, exact, rtol=1e-9)


@pytest.mark.parametrize("damping", [0.0, 1e-7])
def test_an_indefinite_symmetric_half_names_the_remedy(two_blocks, damping):
    """(K + K') / 2 has eigenvalues below zero: not counted; with the stiffness at mu = 0 proven."""
    scene = two_blocks("guided")
    k = 3e12 * 10 ** np.random.default_rng(1).uniform(-1, 1, scene.w.size)
    K, smooth = scene.tangent(k, 1.0), scene.tangent(k, 0.0)
    assert la.eigvalsh(0.5 * (K + K.T).toarray(), subset_by_index=[0, 0]) < 0
    C = (damping * scene.K).tocsr() if damping else None
    alone = complex_modes(scene.M, C, K, BAND)
    helped = complex_modes(scene.M, C, K, BAND, frictionless=smooth)
    assert alone.count.kind == "not counted"
    assert alone.count.how.startswith("the symmetric half of K is not positive")
    assert "give frictionless=" in alone.count.how
    assert helped.count.kind == "proven"
    if C is None:
        agrees(alone, all_lambda(K, scene.M), BAND, rigid=0.0)
    assert len(alone) == len(helped)
    assert np.all(np.abs(alone.s - helped.s) <= alone.error + helped.error)


def test_small_matrices_are_counted_by_their_own_determinant():
    """Two dofs past the onset of flutter."""
    K = sp.csr_matrix(np.array([[1.1, 0.3], [-0.3, 0.9]]))
    m = complex_modes(sp.identity(2, format="csr"), None, K, (0.0, 1.0), zeta_max=0.2)
    assert m.count.how == "winding number of det(K - kappa M)" and m.count.expected == 2
    assert general.DENSE >= 2


def test_moments_of_stiff_contact_keep_their_digits_beside_low_modes(two_blocks):
    """Ten moments and modes from a hundredth of the limit on: what the kept modes leave out.

    The part of the lowest modes in the tenth is 1e20 times as large.
    """
    scene = two_blocks("guided")
    high = (2 * np.pi * BAND[1]) ** 2
    k = stiffness(scene.w.size, 4)
    K, M = scene.tangent(k, 0.0).toarray(), scene.M.toarray()
    face = contact_interface(scene.N, scene.T, scene.w * k, 0.7)
    kappa, Phi = la.eigh(K, M)
    factor, sigma = shifted_factor(sp.csr_matrix(K), scene.M, high)
    count = int(np.sum(kappa < 2.5 * high))
    away, P, Q = kappa - sigma, face.right @ Phi, face.left @ Phi
    modes = InterfaceModes(kappa[:count], 2.5 * high, sigma, P[:, :count], Q[:, :count])
    lowest = np.asfortranarray(Phi[:, kappa < 0.3 * high])
    assert kappa[0] < 0.02 * high and 1 < lowest.shape[1] < count
    plain = interface.moments(factor, scene.M, face, 10)
    seen = interface.moments(factor, scene.M, face, 10, lowest=lowest)
    factor.destroy()
    found, lost = (Determinant(modes, face, m).R for m in (seen, plain))
    for j, R in enumerate(found):
        exact = (P[:, count:] / away[count:] ** (j + 1)) @ Q[:, count:].T
        exact += np.eye(face.rank) * (j == 0)
        size = np.abs(exact).max()
        assert np.abs(R - exact).max() < 1e-2 * size, j
    assert np.abs(lost[-1] - exact).max() > 10 * size
