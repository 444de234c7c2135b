"""Lowest real modes by block Lanczos: degenerate ones, none, and all."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.stability.eigensolvers.symmetric import lowest_modes


def factored(A):
    return Factor(sp.csr_matrix(A))


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
    np.testing.assert_allclose(m.kappa, values[values <= 5.5], rtol=1e-8)
    np.testing.assert_allclose(m.Phi.T @ M @ m.Phi, np.eye(m.kappa.size), atol=1e-9)
    r = K @ m.Phi - M @ m.Phi * m.kappa
    assert np.abs(r).max() < 1e-6


def test_lowest_modes_below_everything_and_above_everything():
    """No mode below the cutoff, and all modes of a small problem."""
    values = np.array([1.0, 2.0, 3.0, 50.0])
    factor = factored(np.diag(values))
    assert lowest_modes(factor, sp.identity(4, format="csr"), 0.5).kappa.size == 0
    np.testing.assert_allclose(
        lowest_modes(factor, sp.identity(4, format="csr"), 1e3).kappa, values, rtol=1e-12
    )


def test_one_degree_of_freedom():
    """The block of vectors is used up exactly after one step, without round-off."""
    one = sp.csr_matrix([[1.0]])
    factor = factored(4 * one)
    found = lowest_modes(factor, one, 10.0)
    factor.destroy()
    np.testing.assert_allclose(found.kappa, [4.0], rtol=1e-14)
    assert abs(found.Phi[0, 0]) == 1.0
