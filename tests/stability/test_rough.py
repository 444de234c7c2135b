"""Products and solves in single precision: their error, whatever the size of the numbers."""

import numpy as np
import pytest
import scipy.linalg as la

from brake_fenicsx.stability.reduced.rough import ROUNDING, Rough, RoughFactor

pytestmark = pytest.mark.alone


def spread(rng, *shape, decades=12):
    """Numbers of both signs over some decades."""
    return rng.choice([-1.0, 1.0], shape) * 10 ** rng.uniform(-decades, 0, shape)


@pytest.mark.parametrize("size", [1e-59, 1.0, 1e45])
def test_products(size):
    """Right to single precision though A and x are far beyond its range, and for zero columns."""
    rng = np.random.default_rng(0)
    A, B, x = size * spread(rng, 300, 300), 1e-3 * size * spread(rng, 300, 300), spread(rng, 300, 7)
    x *= 10.0 ** np.arange(-60, 80, 20)
    x[:, 3] = 0.0
    a, b = spread(rng, 300), 1e6 * spread(rng, 300)
    C = A * a + B * b
    for rough, exact in (
        (Rough(A), A),
        (Rough(A).T, A.T),
        (Rough(A).columns(a, Rough(B), b), C),
        (Rough(A).columns(a, Rough(B), 0 * b), A * a),
    ):
        error = np.abs(rough @ x - exact @ x)
        # Numbers 38 decades below the largest are lost.
        most = ROUNDING * np.abs(exact) @ np.abs(x)
        assert np.all(error <= most) and np.any(error > 1e-3 * most)
    assert not np.any(Rough(0 * A) @ x)


def test_norm_is_never_too_small():
    """Forces that all but cancel: rounding may hide their norm, which bounds an error."""
    rng = np.random.default_rng(1)
    Q = la.qr(rng.standard_normal((200, 200)))[0]
    A = 1e-50 * (Q * 10.0 ** -np.linspace(0, 15, 200)) @ Q.T
    x = Q[:, [0, 50, 120, 199]] * (1 + 2j)
    exact = np.sqrt(np.einsum("im,im->m", x.conj(), A @ x).real)
    found = Rough(A).norm(x)
    assert np.all(found >= exact * (1 - 1e-6))
    assert found[0] == pytest.approx(exact[0], rel=1e-4)


@pytest.mark.parametrize("trans", [0, 1])
def test_solves(trans):
    """As many digits as single precision has beyond the condition of the matrix."""
    rng = np.random.default_rng(2)
    A = np.eye(150) + 0.3 * rng.standard_normal((150, 150)) / np.sqrt(150)
    b = rng.standard_normal((150, 5)) * 10.0 ** np.arange(-50, 50, 20)
    exact = la.solve(A.T if trans else A, b)
    error = la.norm(RoughFactor(la.lu_factor(A)).solve(b, trans) - exact, axis=0)
    assert np.all(error <= 1e-5 * la.norm(exact, axis=0))
