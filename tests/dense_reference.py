"""Dense eigenvalues of small brakes, which the tests hold their modes against."""

from functools import cached_property

import numpy as np
import scipy.linalg as la


def all_kappa(K, M, symmetric=False):
    """All eigenvalues of a pencil [1/s^2], M positive definite; QZ takes ten times as long."""
    A, _ = standard(K, M)
    return la.eigvalsh(0.5 * (A + A.T)) if symmetric else la.eigvals(A)


def standard(K, M):
    """L^-1 K L^-T and L with M = L L'."""
    K, M = (A if isinstance(A, np.ndarray) else A.toarray() for A in (K, M))
    L = la.cholesky(M, lower=True)
    half = la.solve_triangular(L, K, lower=True)
    return la.solve_triangular(L, half.T, lower=True).T, L


def undamped(kappa):
    """lambda with omega >= 0 of each kappa [1/s]."""
    s = np.sqrt(-np.asarray(kappa) + 0j)
    return np.where(s.imag < 0, -s, s)


def all_lambda(K, M):
    """All lambda with omega >= 0 [1/s]."""
    return undamped(all_kappa(K, M))


def all_damped(M, C, K, scale):
    """All lambda of lambda^2 M + lambda C + K [1/s], to some 1e-9, by the linearised problem.

    Args:
        M: mass, positive definite.
        C: damping.
        K: stiffness.
        scale: of lambda [1/s]: both halves of the vectors weigh the same.
    """
    n, factor = len(M), la.cho_factor(M)
    low = [-la.cho_solve(factor, A) / scale**j for A, j in ((K, 2), (C, 1))]
    return scale * la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], low]))


def covered(modes, elastic, nearest, floor=0.0):
    """Errors covered and no verdict wrong; the largest relative error.

    Args:
        modes: what was found.
        elastic: which of them are compared.
        nearest: the exact eigenvalue of each of these.
        floor: round-off of the exact ones.
    """
    s, error = modes.s[elastic], modes.error[elastic]
    off, size = np.abs(s - nearest), np.abs(nearest)
    assert np.all(off <= error + floor), f"largest ratio {(off / (error + floor)).max():.2g}"
    grows = nearest.real > 1e-6 * size
    for verdict, unstable in zip(np.array(modes.verdict)[elastic], grows, strict=True):
        assert verdict == "neutral" or (verdict == "unstable") == unstable
    return float((off / size).max(initial=0.0))


def agrees(modes, exact, band, rigid=10.0):
    """None missed, errors covered, no wrong verdict; largest relative error and estimate.

    Args:
        modes: of the band.
        exact: all lambda, dense: with the round-off of the largest.
        band: in Hz.
        rigid: modes below it [1/s] are not compared.
    """
    elastic = np.abs(modes.s) > rigid
    s, condition = modes.s[elastic], modes.condition[elastic]
    inside = exact[(exact.imag > rigid) & (exact.imag <= 2 * np.pi * band[1])]
    assert s.size == inside.size and len(modes) == modes.count.expected
    if not s.size:
        return 0.0, 0.0
    nearest = inside[np.abs(s[:, None] - inside).argmin(axis=1)]
    size = np.abs(nearest)
    floor = 1e-15 * np.abs(exact).max() ** 2 * condition / size
    off = covered(modes, elastic, nearest, floor)
    return off, float((modes.error[elastic] / size).max(initial=0.0))


class Dense:
    """lambda^2 M + lambda C + K with dense matrices: all of a band, each as sharp as it gets.

    Modes below ``rigid`` times the band's end are none of it.
    """

    def __init__(self, M, C, K, high, zeta, rigid=1e-4):
        self.M, self.C, self.K = (A.toarray() for A in (M, C, K))
        self.high, self.zeta, self.rigid = high, zeta, rigid

    @cached_property
    def eigenvalues(self):
        """All of the band but rigid modes [1/s]."""
        s = all_damped(self.M, self.C, self.K, self.high)
        inside = (s.imag > self.rigid * self.high) & (s.imag <= self.high)
        return s[inside & (s.real >= -self.zeta * np.abs(s))]

    def sharp(self, s):
        """The eigenvalue next to a value, by Newton's method on both sides."""
        x = y = np.random.default_rng(0).standard_normal(len(self.M)) + 0j
        lu = la.lu_factor(s**2 * self.M + s * self.C + self.K)
        for _ in range(5):
            slope = 2 * s * self.M + self.C
            x, y = la.lu_solve(lu, slope @ x), la.lu_solve(lu, slope.conj().T @ y, trans=2)
            x, y = x / la.norm(x), y / la.norm(y)
            P = s**2 * self.M + s * self.C + self.K
            s = s - (y.conj() @ P @ x) / (y.conj() @ slope @ x)
        return s

    def agrees(self, modes):
        """None missed, none twice, errors covered, no wrong verdict; the largest relative error."""
        elastic = modes.s.imag > self.rigid * self.high
        s = modes.s[elastic]
        exact = np.array([self.sharp(value) for value in s])
        assert s.size == self.eigenvalues.size > 0
        assert np.unique(np.round(exact, 3)).size == s.size
        return covered(modes, elastic, exact, 1e-12 * np.abs(exact))
