"""Moments of what the kept modes leave out."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.stability.substructures.low_rank import combinations, completed
from brake_fenicsx.stability.substructures.moments import (
    SIGMA,
    Rows,
    moments,
    plan_of,
    shifted_polynomial,
)
from brake_fenicsx.stability.substructures.substructure import Substructure


def body_of(K, M, at, loads):
    elements = np.arange(at["N"].shape[0])
    return Substructure(np.arange(K.shape[0]), elements, K, M, None, at, loads)


@pytest.mark.parametrize("count", [5, 8, 11])
def test_a_body_without_damping_has_the_moments_of_its_modes(count):
    """In powers of kappa, so that half of the solves reach as far: a sum over the modes left out.

    sum phi phi' / (kappa_j + lambda^2), lambda = z + lambda_0, is a series in z^2 + 2 z lambda_0.
    """
    rng, n, kept = np.random.default_rng(3), 12, 4
    mass = rng.uniform(1, 2, n)
    Phi = np.linalg.qr(rng.standard_normal((n, n)))[0] / np.sqrt(mass)[:, None]
    kappa = np.r_[rng.uniform(0, 1, kept), rng.uniform(2.56, 90, n - kept)]
    M = sp.diags(mass).tocsr()
    K = sp.csr_matrix((M @ Phi * kappa) @ (M @ Phi).T)
    at = {name: sp.csr_matrix(rng.standard_normal((2, n))) for name in "NTR"}
    body = body_of(K, M, at, rng.standard_normal((n, 1)))
    rows = Rows("NR", True)
    P = shifted_polynomial(K, None, M, 1.0, rows)
    D = moments(body, P, M, Phi[:, :kept], rows, count, MPI.COMM_SELF)
    followed, acting = (sp.vstack([at[name] for name in x]) @ Phi[:, kept:] for x in ("NR", "NTR"))
    acting, beyond = np.vstack([acting, body.loads.T @ Phi[:, kept:]]), kappa[kept:]
    assert D.shape == (count, 4, 7)
    for z in (0.5, 1j - rows.shift):
        w = z**2 + 2 * z * rows.shift
        got = sum(z**k * A for k, A in enumerate(D))
        exact = (followed / (beyond + SIGMA + w)) @ acting.T
        known = sum((followed * (-w) ** k / (beyond + SIGMA) ** (k + 1)) @ acting.T
                    for k in range(count // 2 + 1))  # fmt: skip
        if count % 2:
            np.testing.assert_allclose(got, known, atol=1e-11)
        far = (abs(w) / (beyond.min() + SIGMA)) ** (count // 2)
        assert np.abs(got - exact).max() < far * np.abs(exact).max()


@pytest.mark.parametrize("followed, damped", [("N", False), ("NR", False), ("NR", True)])
def test_the_variable_of_the_bodies(followed, damped):
    """By kappa = -lambda^2, in powers of the eigenvalue z, and its slope by a difference."""
    rows, lam, h = Rows(followed, damped), np.array([0.3j, -0.1 + 0.9j]), 1e-6
    z = lam - rows.shift if rows.rates else SIGMA - lam**2
    w = rows.variable(z)
    np.testing.assert_allclose(w, z if damped else SIGMA - lam**2, rtol=1e-14)
    C = rows.powers(4)
    np.testing.assert_allclose(z[:, None] ** np.arange(len(C)) @ C, w[:, None] ** np.arange(4))
    change = (rows.variable(z + h) - rows.variable(z - h)) / (2 * h)
    np.testing.assert_allclose(rows.slope(z), change, rtol=1e-9)


@pytest.mark.hard
@pytest.mark.together
@pytest.mark.parametrize(("falls", "damped"), [(True, False), (True, True), (False, False)])
def test_high_moments_of_low_rank_and_of_none(falls, damped):
    """As sums over the modes left out: by combinations of contact rows, and where these fail."""
    rng, n, kept, elements = np.random.default_rng(5), 300, 3, 150
    Phi = np.linalg.qr(rng.standard_normal((n, n)))[0]
    kappa = np.r_[0.1, 0.4, 0.9, 3.3 * (1 + np.arange(n - kept)) ** (1.5 if falls else 0.0)]
    M = sp.identity(n, format="csr")
    K = sp.csr_matrix((Phi * kappa) @ Phi.T)
    at = {name: sp.csr_matrix(rng.standard_normal((elements, n)) / n) for name in "NTR"}
    body = body_of(K, M, at, rng.standard_normal((n, 1)))
    rows, count = (Rows("NR", True), 9) if damped else (Rows("N", False), 6)
    assert plan_of(body, kept, rows, count).further > 0
    P = shifted_polynomial(K, None, M, 1.0, rows)
    D = moments(body, P, M, Phi[:, :kept], rows, count, MPI.COMM_WORLD)
    left_out = {name: at[name] @ Phi[:, kept:] for name in rows.acting}
    followed = np.vstack([left_out[name] for name in rows.followed])
    acting = np.vstack([*left_out.values(), body.loads.T @ Phi[:, kept:]])
    pole = kappa[kept:] + SIGMA
    for z in (0.5, 1j - rows.shift):
        w = -(z**2 + 2 * z * rows.shift) if damped else z
        terms = [(followed * w**k / pole ** (k + 1)) @ acting.T for k in range(5 if damped else 6)]
        error = np.abs(sum(z**k * A for k, A in enumerate(D)) - sum(terms)).max()
        assert error < (0.05 * np.abs(terms[-1]).max() if falls else 1e-9)


def test_an_error_that_nothing_measures_is_infinite():
    """Against a last moment of zero: all columns are solved then."""
    omega = combinations(60, 20)
    assert completed(np.zeros((2, 20, 70)), omega, np.arange(60))[1] == np.inf
