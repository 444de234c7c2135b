"""Largest eigenpairs of a real operator by block Arnoldi: those of a pencil nearest to a shift.

Of K x = kappa M x with A = (K - sigma M)^-1 M, whose eigenvalues are 1 / (kappa - sigma), or of a
linearised quadratic problem. Blocks, because a factor solves many right-hand sides for the price of
a few; small ones, because 32 vectors at once need twice the Krylov space of 8.

Reference: Y. Saad, Numerical Methods for Large Eigenvalue Problems, 2nd ed., chapter 6 (2011),
doi:10.1137/1.9781611970739.

Complex columns in real arithmetic: without complex copies of real matrices or Krylov bases.
"""

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array, Complex
from brake_fenicsx.errors import NotConverged

# Vectors of a block.
BLOCK = 8


def shares(V: Array, W: Array) -> Array:
    """V' W of a tall V whose columns are contiguous, in the order that BLAS is quick at."""
    return np.asarray((W.T @ V).T)


def combined(V: Array, c: Array) -> Array:
    """V c of a tall V whose columns are contiguous, likewise: V @ c takes twice as long."""
    return np.asarray((c.T @ V.T).T)


def plus(out: Array, V: Array, c: Array, factor: float = 1.0) -> Array:
    """Add factor V c to ``out`` in its memory; columns of the tall arrays are contiguous."""
    if not out.size or not V.size:
        return out
    return np.asarray(la.blas.dgemm(factor, V, c, 1.0, out, overwrite_c=True))


def on_parts(real: Callable[[Array], Array], x: Complex) -> Complex:
    """A real operator on complex columns: of imaginary parts only those that are there."""
    n, turned = x.shape[1], np.flatnonzero(np.any(x.imag != 0, axis=0))
    parts = np.empty((len(x), n + turned.size), x.real.dtype)
    parts[:, :n], parts[:, n:] = x.real, x.imag[:, turned]
    product = real(parts)
    out = np.zeros((len(product), n), complex)
    out.real, out.imag[:, turned] = product[:, :n], product[:, n:]
    return out


def times(A: AnyArray | sp.spmatrix, x: AnyArray, kind: type | None = None) -> Complex:
    """A x for real A, in its own precision or in another one."""
    B = A if kind is None else A.astype(kind, copy=False)
    return on_parts(lambda y: B @ y.astype(B.dtype, copy=False), x)


def with_conjugates(values: Complex, X: Complex) -> tuple[Complex, Complex]:
    """Both of each conjugate pair of eigenvalues, and their vectors."""
    pairs = values.imag != 0
    return np.r_[values, values[pairs].conj()], np.hstack([X, X[:, pairs].conj()])


def nearest_modes(
    apply: Callable[[Array], Array],
    n: int,
    sigma: float,
    reach: float,
    expected: int,
    leftmost: float = -np.inf,
    tolerance: float = 1e-11,
    start: Array | None = None,
) -> tuple[Complex, Complex]:
    """All eigenpairs with |kappa - sigma| <= reach and Re kappa >= leftmost.

    kappa = sigma + 1 / theta. Those further left are not waited for: strongly damped bodies gather
    any number of real eigenvalues lambda within reach.

    Args:
        apply: the operator A, on blocks of shape (n, columns).
        n: its size.
        sigma: real shift.
        reach: radius.
        expected: about how many eigenvalues there are, conjugates included.
        leftmost: smallest real part wanted.
        tolerance: relative residual of (A - theta) x.
        start: starting block that is rich in the wanted vectors, shape (n, BLOCK); random if None.

    Returns:
        kappa, those of positive imaginary part for their pairs; vectors, shape (n, modes), after
        one more application of A.

    Raises:
        NotConverged: the Krylov space fills without convergence.
    """
    block = min(BLOCK, n)
    room = min(n, 8 * expected + 48 * block)
    V = np.empty((n, room + block), order="F")
    H = np.zeros((room + block, room + block))
    if start is None:
        start = np.random.default_rng(0).standard_normal((n, block))
    new = _orthonormal(apply(start))[0]
    size = 0
    due = 2 * expected
    while size <= room:
        k, first = new.shape[1], size
        V[:, first : first + k] = new
        size += k
        W = apply(new)
        for _ in range(2):
            c = shares(V[:, :size], W)
            W -= combined(V[:, :size], c)
            H[:size, first:size] += c
        new, coupling = _orthonormal(W)
        full = size >= n or not new.shape[1]
        if full or size > min(due, room):
            # The dense eigenvalues cost as much as several blocks.
            due = int(1.05 * size) + block
            theta, s = la.eig(H[:size, :size])
            near = np.abs(theta) * reach >= 1
            residual = np.linalg.norm(coupling @ s[first:], axis=0) / np.abs(theta)
            beyond = np.abs(theta[~near]).max(initial=0.0) > 0 or full
            near[near] = sigma + (1 / theta[near]).real >= leftmost
            if full or (beyond and np.all(residual[near] < tolerance)):
                return _polished(apply, V[:, :size], sigma, theta[near], s[:, near])
        if size <= room:
            H[size : size + new.shape[1], first:size] = coupling
    raise NotConverged(
        f"block Arnoldi: {size} vectors do not give all modes; take a narrower band, or a smaller"
        " zeta_max where bodies are strongly damped"
    )


def _polished(
    apply: Callable[[Array], Array],
    V: Array,
    sigma: float,
    theta: Complex,
    s: Complex,
) -> tuple[Complex, Complex]:
    """Eigenvalues and vectors, one of each conjugate pair, once more through A.

    The residual of K itself is then that of the Arnoldi process, without the norm of K.
    """
    one = np.flatnonzero(theta.imag <= 0)  # kappa has the other sign.
    X = on_parts(lambda y: apply(combined(V, y)), s[:, one])
    return sigma + 1 / theta[one], X / np.linalg.norm(X, axis=0)


def _orthonormal(W: Array) -> tuple[Array, Array]:
    """Orthonormal basis of a block and the coefficients that give the block back.

    Directions of no length are dropped.
    """
    scale = np.linalg.norm(W, axis=0)
    scale[scale == 0] = 1.0
    Q, R, order = la.qr(W / scale, mode="economic", pivoting=True, check_finite=False)
    good = int(np.sum(np.abs(np.diag(R)) > 1e-13 * max(abs(R[0, 0]), np.finfo(float).tiny)))
    back = np.empty((good, W.shape[1]))
    back[:, order] = R[:good]
    return Q[:, :good], back * scale
