"""The factorisation: its options are the user's first, its failures have names."""

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.solver import Factor


def chain(ends: float, n: int = 200) -> sp.csr_matrix:
    """Springs in a row; ends = 2: fixed at both ends, 1: free."""
    return sp.diags(
        [-1.0, np.r_[ends, 2 * np.ones(n - 2), ends], -1.0], [-1, 0, 1], shape=(n, n)
    ).tocsr()


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
