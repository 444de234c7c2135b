"""What a space leaves out of a body's answer, seen from its contact elements.

A is a positive definite stiffness, W an M-orthonormal space, B = [N; T] and

    B (A - kappa' M)^-1 B' = B W (W'A W - kappa')^-1 W'B' + R_0 + kappa' R_1 + kappa'^2 R_2 + ...

With c = (W'A W)^-1 W'B', E = A^-1 B' - W c and s = W'M E (so that W'M A^-1 B' = c + s),

    R_0 = B E,   R_1 = B A^-1 M E + s'c,
    R_2 = B A^-1 M Y + s'(W'A W)^-1 (c + s) + c'(W'A W)^-1 s,   Y = D M E + D M W c,

D = A^-1 - W (W'A W)^-1 W': no difference of large terms is left.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.solver import Factor, blocks

from .bodies import Body

Array = NDArray[np.float64]


def rest_moments(
    factor: Factor, body: Body, W: Array, W_B: Array, stiffness: Array, count: int
) -> list[Array]:
    """The first R_j, one to three of them.

    Args:
        factor: factor of A.
        body: the body.
        W: M-orthonormal space, shape (dofs, directions).
        W_B: W'B', shape (directions, 2 elements + loads).
        stiffness: W'A W.
        count: how many.

    Returns:
        N R_j [N' T'], shape (elements, 2 elements + loads).
    """
    n, M = body.N.shape[0], body.M
    both, columns = sp.vstack([body.N, body.T]).tocsr(), body.N.T.tocsc()
    A_W = la.cho_factor(stiffness)
    c = la.cho_solve(A_W, W_B)
    R = [np.empty((both.shape[0], n)) for _ in range(count)]
    if count > 1:
        AMW = factor.solve(M @ W)
        s = (both @ AMW).T - c
    for part in blocks(n):
        X = factor.solve(columns[:, part])
        R[0][:, part] = both @ X - W_B.T @ c[:, part]
        if count > 1:
            Y = factor.solve(M @ (X - W @ c[:, part]))
            R[1][:, part] = both @ Y + s.T @ c[:, part]
        if count > 2:
            answer = la.cho_solve(A_W, s[:, part])
            other = la.cho_solve(A_W, c[:, part])
            Y += AMW @ c[:, part] - W @ (answer + other)
            R[2][:, part] = both @ factor.solve(M @ Y) + s.T @ (answer + other) + c.T @ answer
    return [_rows_of_gaps(r, n) for r in R]


def _rows_of_gaps(columns: Array, n: int) -> Array:
    """N R [N' T'] from B R N', the first of it symmetric as it must be."""
    rows = np.ascontiguousarray(columns.T)
    rows[:, :n] += columns[:n]
    rows[:, :n] *= 0.5
    return rows
