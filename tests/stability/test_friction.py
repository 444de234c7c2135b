"""Full order with friction: Arnoldi from either side, and the count of its modes."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.full import dense, interface, unsymmetric
from brake_fenicsx.stability.full.interface import Interface, difference_interface
from dense_reference import agrees, all_lambda

BAND = (0.0, 90e3)
K0 = 3e11


def stiffness(n, seed):
    """Two decades about K0, a third of the elements open."""
    rng = np.random.default_rng(seed)
    k = K0 * 10 ** rng.uniform(-1, 1, n)
    k[rng.random(n) < 0.33] = 0.0
    return k


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
            assert (
                m.count.how.startswith("inertia without friction") and m.count.kind == "proven"
            ), m.count.how
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


@pytest.mark.together
@pytest.mark.parametrize("damped", [False, True])
def test_processes_share_a_problem(two_blocks, damped):
    """The same bits as on one: what each does is the same, whoever does it."""
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


@pytest.mark.parametrize("change", ["withheld", "invented"])
def test_a_wrong_number_of_modes_is_noticed(two_blocks, monkeypatch, change):
    """From either side alike: the count owes nothing to the eigensolver."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    real = unsymmetric.nearest_modes

    def lossy(*args, **given):
        kappa, X = real(*args, **given)
        if change == "invented":
            return np.r_[kappa, 0.9 * kappa[:1]], np.hstack([X, X[:, :1]])
        keep = np.argsort(kappa.real) != 4
        return kappa[keep], X[:, keep]

    monkeypatch.setattr(unsymmetric, "nearest_modes", lossy)
    with pytest.raises(InaccurateResult, match="modes found, the reduced problem has"):
        complex_modes(
            scene.M, None, scene.tangent(k, 1.0), BAND, frictionless=scene.tangent(k, 0.0)
        )


@pytest.mark.hard
@pytest.mark.parametrize("beyond", [300, 1000])
def test_many_modes_beyond_the_band(beyond):
    """Up to a thousand modes just beyond the band, coupled by friction: the count is the truth."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        kappa = np.sort(np.r_[rng.uniform(0.01, 1.0, 20), rng.uniform(1.05, 2.5, beyond)])
        left, right = (sp.csr_matrix(1e-2 * rng.standard_normal((4, kappa.size))) for _ in "lr")
        smooth = sp.diags(kappa).tocsr()
        K, band = (smooth + left.T @ right).tocsr(), (0.0, 1 / (2 * np.pi))
        M = sp.identity(kappa.size, format="csr")
        m = complex_modes(M, None, K, band, frictionless=smooth, friction=Interface(left, right))
        assert m.count.kind == "proven", m.count.how
        agrees(m, all_lambda(K, M), band, rigid=0.0)


def test_interface_from_the_matrices_alone(two_blocks):
    """Found from the matrices alone: of the same rank, and the same product."""
    scene = two_blocks("guided")
    k = stiffness(scene.w.size, 1)
    F = scene.tangent(k, 1.0) - scene.tangent(k, 0.0)
    face = difference_interface(F)
    assert face.rank == np.sum(k > 0)
    assert abs(F - face.left.T @ face.right).max() < 1e-12 * abs(F).max()


def test_a_full_difference_is_no_interface(monkeypatch):
    """Rank beyond the limit: the modes are found, not counted, and the record names the remedy."""
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
    assert dense.DENSE >= 2
