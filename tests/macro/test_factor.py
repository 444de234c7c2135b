"""The factorisation: its options are the user's first, its failures have names."""

from petsc4py import PETSc

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro import solver
from brake_fenicsx.macro.solver import Factor, InterfaceFactor, interface_factor, joined, separators


def chain(ends: float, n: int = 200) -> sp.csr_matrix:
    """Springs in a row; ends = 2: fixed at both ends, 1: free."""
    return sp.diags(
        [-1.0, np.r_[ends, 2 * np.ones(n - 2), ends], -1.0], [-1, 0, 1], shape=(n, n)
    ).tocsr()


def box(n: int) -> sp.csr_matrix:
    """A cube of trilinear elements, three unknowns at each point that act on each other."""
    line = sp.diags([1.0, 4.0, 1.0], [-1, 0, 1], shape=(n, n))
    return sp.kron(sp.kron(sp.kron(line, line), line), np.full((3, 3), 0.1) + np.eye(3)).tocsr()


def test_user_option_wins_and_ours_leave_no_trace():
    options = PETSc.Options()
    options["brake_test_mat_mumps_icntl_14"] = 77
    try:
        factor = Factor(chain(2.0), "brake_test_")
        assert factor._F.getMumpsIcntl(14) == 77
        assert factor._F.getMumpsIcntl(24) == 1
        assert not options.hasName("brake_test_mat_mumps_icntl_24")
    finally:
        options.delValue("brake_test_mat_mumps_icntl_14")


def test_sparse_right_hand_sides_are_solved_like_dense_ones():
    """Columns of a few entries, some of none; more of them than one block holds."""
    A, b = chain(2.0), sp.random(200, 150, 0.02, format="csc", random_state=0)
    factor = Factor(A)
    x = factor.solve(b)
    assert np.linalg.norm(A @ x - b) < 1e-10 * np.linalg.norm(b.toarray())
    # MUMPS is told again that the next block is dense.
    np.testing.assert_allclose(factor.solve(b.toarray()), x, atol=1e-10 * np.abs(x).max())


def test_inertia_is_counted():
    shifted = chain(2.0) - 0.5 * sp.identity(200)
    exact = 2 - 2 * np.cos(np.pi * np.arange(1, 201) / 201)
    assert Factor(shifted).negative_pivots == int((exact < 0.5).sum())


def test_free_chain_is_singular():
    """Many lengths: the last pivot is zero up to round-off, and now and then just beyond it.

    MUMPS 5.7 lets one of these nineteen through, 5.5 none.
    """
    named = 0
    for n in range(20, 400, 20):
        try:
            Factor(chain(1.0, n))
        except InaccurateResult as error:
            assert "singular" in str(error)
            named += 1
    assert named >= 18


@pytest.mark.skipif(not solver._metis(), reason="PETSc is linked without METIS")
def test_separators_part_a_body():
    """Without the first one a cube falls into two halves; all of them are some of its layers."""
    A = box(14)
    found = separators(A)
    rest = np.setdiff1d(np.arange(A.shape[0]), found[0])
    assert connected_components(A[rest][:, rest])[0] == 2
    assert found[0].size == 3 * 14**2
    every = np.concatenate(found)
    assert np.unique(every).size == every.size
    B = joined(A, found)
    assert abs(A - B).max() == 0 and B.nnz > A.nnz and (B != B.T).nnz == 0
    assert separators(chain(2.0)) == [] and joined(A, []) is A


@pytest.mark.hard
@pytest.mark.parametrize("shift", [0.0, 10.0])
def test_nested_dissection_costs_less_and_gives_the_same(shift, monkeypatch):
    """A solid body with the rows of an interface, definite and not: the same, with less work."""
    A = box(14)
    P = (A - shift * sp.identity(A.shape[0])).tocsr()
    B = sp.random(40, A.shape[0], 1e-3, format="csr", random_state=0)
    found = []
    for least in (1000, 10**9):
        monkeypatch.setattr(solver, "LEAST", least)
        factor = InterfaceFactor(lambda: P, B)
        work = factor._F.getMumpsRinfog(3)
        found.append((factor.flexibility, factor.negative_pivots, work, factor._F.getMumpsInfog(7)))
        factor.destroy()
    (G, negative, work, _), (exact, expected, most, ordering) = found
    np.testing.assert_allclose(G, exact, rtol=0, atol=1e-10 * np.abs(exact).max())
    assert negative == expected and (negative > 0) == (shift > 0)
    if ordering == 0 and solver._metis():  # minimum degree
        assert work < 0.7 * most


def test_a_factor_of_a_symmetric_matrix_is_none_of_an_unsymmetric_one():
    """Of the same pattern, too: at another point of a box a damping may have lost its symmetry."""
    K, B, held = chain(2.0), sp.identity(200, format="csr")[::40], []
    turned = (K + sp.diags([0.3, -0.3], [1, -1], shape=K.shape)).tocsr()
    for A, symmetric in ((K, True), (turned, False), (K, True), (2.0 * K, True)):
        found = interface_factor(held, lambda A=A: A, B, symmetric).flexibility
        exact = B @ np.linalg.solve(A.toarray(), B.T.toarray())
        np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-12)
    held.pop().destroy()
