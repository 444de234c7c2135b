"""Flexibility of rows from a factorisation with a Schur complement, against dense inverses."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro import solver
from brake_fenicsx.macro.solver import InterfaceFactor, interface_factor

ROWS, SIDE = 40, 8


def system(symmetric):
    """An indefinite difference operator on a cube, skew parts without symmetry, and rows."""
    rng, line = np.random.default_rng(0), sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], (SIDE, SIDE))
    one, n = sp.identity(SIDE), SIDE**3
    P = sum(sp.kron(sp.kron(*a), b) for a, b in (((line, one), one), ((one, line), one)))
    P = P + sp.kron(sp.kron(one, one), line) - 0.71 * sp.identity(n)
    if not symmetric:
        P = P + sp.diags([0.3, -0.3], [1, -1], (n, n))
    B = sp.random(ROWS, n, 0.01, random_state=rng) + sp.identity(n, format="csr")[:ROWS]
    return P.tocsr(), B.tocsr()


@pytest.mark.parametrize("available", [True, False], ids=["complement", "solves"])
@pytest.mark.parametrize("symmetric", [True, False])
def test_flexibility_and_solves(symmetric, available, monkeypatch):
    """By the Schur complement and by blocks of solves; P^-1 and P^-T of other columns."""
    monkeypatch.setattr(solver, "AVAILABLE", available and solver.AVAILABLE)
    P, B = system(symmetric)
    factor, inverse = InterfaceFactor(lambda: P, B, symmetric), np.linalg.inv(P.toarray())
    b = np.random.default_rng(1).standard_normal((P.shape[0], 3))
    pairs = [(factor.flexibility, B @ inverse @ B.T), (factor.solve(b), inverse @ b)]
    pairs.append((factor.solve(b, True), inverse.T @ b))
    for found, exact in pairs:
        assert np.abs(found - exact).max() < 1e-10 * np.abs(exact).max()
    if symmetric:
        assert factor.negative_pivots == np.sum(np.linalg.eigvalsh(P.toarray()) < 0) > 0
    factor.destroy()


def test_this_library_has_the_schur_complement():
    """Catches a name that the library lacks, where blocks of solves took its place in silence."""
    assert solver.AVAILABLE


def test_no_row():
    """A body without contact: solves alone."""
    P, B = system(True)
    factor = InterfaceFactor(lambda: P, B[:0])
    assert factor.flexibility.shape == (0, 0)
    b = np.ones((P.shape[0], 1))
    np.testing.assert_allclose(P @ factor.solve(b), b, atol=1e-10)


@pytest.mark.parametrize("symmetric", [True, False])
def test_rows_of_held_displacements_alone(symmetric):
    """A contact face that is clamped: nothing yields, and no relative error is taken of nothing."""
    P, B = system(symmetric)
    assert not InterfaceFactor(lambda: P, 0 * B).flexibility.any()


@pytest.mark.parametrize("solves", [True, False])
def test_entries_of_one_place_are_added(solves):
    """Matrices whose entries are stored in two halves."""
    P, B = system(True)
    P2, B2 = (
        sp.csr_matrix((np.repeat(A.data / 2, 2), np.repeat(A.indices, 2), 2 * A.indptr), A.shape)
        for A in (P, B)
    )
    exact = B @ np.linalg.inv(P.toarray()) @ B.T
    off = InterfaceFactor(lambda: P2, B2, True, solves).flexibility - exact
    assert np.abs(off).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.parametrize("symmetric", [True, False])
def test_without_the_factor(symmetric):
    """The flexibility and the inertia are those of a factor that is kept."""
    P, B = system(symmetric)
    kept, thrown = (InterfaceFactor(lambda: P, B, symmetric, solves) for solves in (True, False))
    size = np.abs(kept.flexibility).max()
    np.testing.assert_allclose(thrown.flexibility, kept.flexibility, atol=1e-12 * size)
    assert thrown.negative_pivots == kept.negative_pivots
    assert thrown.gigabytes <= kept.gigabytes
    kept.destroy()
    thrown.destroy()


@pytest.mark.parametrize("solves", [True, False])
@pytest.mark.parametrize("symmetric", [True, False])
def test_another_matrix_of_the_same_pattern(symmetric, solves, monkeypatch):
    """Factored without a new analysis it gives the same; one of another pattern is left alone.

    So is any where the library has nothing that writes values.
    """
    P, B = system(symmetric)
    Q = (P - 0.4 * sp.identity(P.shape[0])).tocsr()
    held = []
    first = interface_factor(held, lambda: P, B, symmetric, solves)
    assert interface_factor(held, lambda: Q, 2 * B, symmetric, solves) is first
    known = InterfaceFactor(lambda: Q, 2 * B, symmetric, solves)
    exact = 4 * B @ np.linalg.inv(Q.toarray()) @ B.T
    for factor in (first, known):
        assert np.abs(factor.flexibility - exact).max() < 1e-10 * np.abs(exact).max()
    assert first.negative_pivots == known.negative_pivots
    if solves:
        b = np.random.default_rng(1).standard_normal((P.shape[0], 3))
        for turned in (False, True):
            np.testing.assert_allclose(first.solve(b, turned), known.solve(b, turned), atol=1e-10)
    with monkeypatch.context() as without:
        without.setattr(solver, "AVAILABLE", False)
        assert not first.update(lambda: P, B)
    assert not first.update(lambda: Q, B[:-1])
    other = interface_factor(held, lambda: Q, B[:-1], symmetric, solves)
    assert held == [other] and other.flexibility.shape == (ROWS - 1,) * 2


@pytest.mark.parametrize("where, solves", [("flexibility", 1), ("flexibility", 0), ("solve", 1)])
def test_a_wrong_factor_is_refused(where, solves, monkeypatch):
    """One entry of the flexibility, or all solutions, wrong: said, and no number returned."""
    complement, solve = InterfaceFactor._complement, InterfaceFactor.solve

    def one_entry_off(self):
        G = complement(self)
        G[0, 1] += 1e-2 * np.abs(G).max()
        return G

    wrong = {
        "flexibility": ("_complement", one_entry_off),
        "solve": ("solve", lambda self, *given: 1.001 * solve(self, *given)),
    }
    monkeypatch.setattr(InterfaceFactor, *wrong[where])
    P, B = system(True)
    with pytest.raises(InaccurateResult, match="the factor of a body is wrong"):
        InterfaceFactor(lambda: P, B, solves=bool(solves))
