"""Dense eigenvalues of small brakes, which the tests hold their modes against."""

import numpy as np
import scipy.linalg as la


def all_kappa(K, M, symmetric=False):
    """All eigenvalues of a pencil [1/s^2], M positive definite; QZ takes ten times as long."""
    A = standard(K, M)
    return la.eigvalsh(0.5 * (A + A.T)) if symmetric else la.eigvals(A)


def standard(K, M):
    """L^-1 K L^-T with M = L L'."""
    K, M = (A if isinstance(A, np.ndarray) else A.toarray() for A in (K, M))
    L = la.cholesky(M, lower=True)
    half = la.solve_triangular(L, K, lower=True)
    return la.solve_triangular(L, half.T, lower=True).T


def undamped(kappa):
    """lambda with omega >= 0 of each kappa [1/s]."""
    s = np.sqrt(-np.asarray(kappa) + 0j)
    return np.where(s.imag < 0, -s, s)


def all_lambda(K, M):
    """All lambda with omega >= 0 [1/s]."""
    return undamped(all_kappa(K, M))


def agrees(modes, exact, band, rigid=10.0):
    """None missed, errors covered, no wrong verdict; largest relative error and estimate.

    Args:
        modes: of the band.
        exact: all lambda, dense: with the round-off of the largest.
        band: in Hz.
        rigid: modes below it [1/s] are not compared.
    """
    elastic = np.abs(modes.s) > rigid
    s, error, condition = modes.s[elastic], modes.error[elastic], modes.condition[elastic]
    inside = (exact.imag > rigid) & (exact.imag <= 2 * np.pi * band[1])
    assert s.size == inside.sum() and len(modes) == modes.count.expected
    distance = np.abs(s[:, None] - exact)
    nearest = exact[distance.argmin(axis=1)]
    off, size = distance.min(axis=1), np.abs(nearest)
    assert np.all(off <= error + 1e-15 * np.abs(exact).max() ** 2 * condition / size)
    grows = nearest.real > 1e-6 * size
    for verdict, unstable in zip(np.array(modes.verdict)[elastic], grows, strict=True):
        assert verdict == "neutral" or (verdict == "unstable") == unstable
    return float((off / size).max()), float((error / size).max())
