"""Small brakes with known merging points, as states of a sweep."""

import numpy as np
import scipy.linalg as la

from brake_fenicsx.stability.modes import Count, Modes
from brake_fenicsx.sweeps.matching import State


def modes_of(M, C, K):
    """All modes of a dense problem, vectors in coordinates in which M is the identity."""
    n = len(M)
    L = la.cholesky(M, lower=True)
    inverse = la.inv(L)
    K, C = inverse @ K @ inverse.T, inverse @ C @ inverse.T
    if C.any():
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
        s, left, right = la.eig(A, left=True, right=True)
        kept = s.imag > 0
        s, right, left = s[kept], right[:n, kept], left[n:, kept]
    else:
        kappa, left, right = la.eig(K, left=True, right=True)
        s = np.sqrt(-kappa.astype(complex))
        s = np.where(s.imag < 0, -s, s)
        s = np.where(kappa.imag == 0, 1j * np.abs(s), s)
    zero = np.zeros(s.size)
    error = 1e-13 * np.abs(s)
    overlap = np.abs(np.sum(left.conj() * right, axis=0))
    size = la.norm(left, axis=0) * la.norm(right, axis=0)
    return Modes(
        s,
        right,
        left,
        zero,
        error,
        size / np.maximum(overlap, 1e-300),
        Count("proven", "dense", s.size),
        0.0,
        s.real == 0,
    )


def solver(matrices):
    """States of a model x -> (M, C, K)."""
    return lambda x: State.of(x, modes_of(*matrices(x)))


def hoffmann(mu, damping=(0.0, 0.0)):
    """Minimal model of mode coupling: two modes merge at mu = 2/3 without damping.

    N. Hoffmann, M. Fischer, R. Allgaier and L. Gaul, Mechanics Research Communications 29 (2002)
    197, doi:10.1016/S0093-6413(02)00254-9: a mass on two springs at 45 degrees, here with
    K = [[2, mu - 1/2], [-1/2, 4/3]] of which the eigenvalues merge where
    (2 - 4/3)^2 / 4 = (mu - 1/2) / 2.
    """
    K = np.array([[2.0, mu - 0.5], [-0.5, 4 / 3]])
    return np.eye(2), np.diag(damping), K


MERGED = 0.5 + 2 * (1 / 9)


def along(followed):
    """Values of the parameter and eigenvalues of each branch, the lowest branch first."""
    found = []
    for b in followed.branches:
        states = [followed.states[i] for i in b.states]
        s = [state.s[m] for state, m in zip(states, b.modes, strict=True)]
        found.append((np.array([state.x for state in states]), np.array(s)))
    return sorted(found, key=lambda pair: pair[1][0].imag)
