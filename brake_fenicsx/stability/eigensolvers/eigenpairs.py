"""Eigenpairs by block Arnoldi, and their checks: residual, backward error, condition, error, pairs.

The problem is P(lambda) phi = 0 and psi^H P(lambda) = 0, P(lambda) = lambda^2 M + lambda C + K;
without damping kappa = -lambda^2 and K phi = kappa M phi. Complex columns are treated in real
arithmetic, without complex copies of real matrices or Krylov bases.

Block Arnoldi finds the largest eigenpairs of a real operator, those of a pencil nearest to a shift:
of K x = kappa M x with A = (K - sigma M)^-1 M, whose eigenvalues are 1 / (kappa - sigma), or of a
linearised quadratic problem. Blocks, because a factor solves many right-hand sides for the price of
a few; small ones, because 32 vectors at once need twice the Krylov space of 8.

References: F. Tisseur, Linear Algebra Appl. 309 (2000) 339, doi:10.1016/S0024-3795(99)00063-4;
Y. Saad, Numerical Methods for Large Eigenvalue Problems, 2nd ed., chapter 6 (2011),
doi:10.1137/1.9781611970739.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.folder.processes import in_turns

# Eigenvalues closer than this, relatively, share their vectors: each of them has these to about
# round-off over the distance, 1e-9.
CLUSTER = 1e-7

# Backward error that is all round-off: residuals cannot be smaller than that of a stiff matrix. On
# cells of an aspect of ten vectors of block Lanczos were left with less than 1e-14 by the kernels
# of Prescott, and with 4e-14 by those of Haswell. Errors are stated from the residual.
ROUND_OFF = 1e-13

# Relative error of an eigenvalue from the round-off of the solves, times its condition and relative
# to the largest one: the tolerance of the block Arnoldi process.
SOLVES = 1e-11

# Left and right eigenvalues agree to this share of the region searched; near an exceptional point
# both lose half of their digits.
MATCH = 1e-5

# Vectors of a block.
BLOCK = 8

# Blocks to apply an operator to, for the products; ends with eigenvalues and vectors.
Search = Generator[Array, Array, tuple[Complex, Complex]]

# Residuals are relative to the eigenvalue where it is smaller than its distance from the shift, but
# to no less than this share of that.
SMALLEST = 1e-2


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
    parts, turned = parts_of(x)
    return of_parts(real(parts), turned)


def parts_of(x: Complex) -> tuple[Array, Index]:
    """Real parts and those imaginary parts that are there, and of which columns these are."""
    n, turned = x.shape[1], np.flatnonzero(np.any(x.imag != 0, axis=0))
    parts = np.empty((len(x), n + turned.size), x.real.dtype)
    parts[:, :n], parts[:, n:] = x.real, x.imag[:, turned]
    return parts, turned


def of_parts(parts: Array, turned: Index) -> Complex:
    """Complex columns of such parts."""
    n = parts.shape[1] - turned.size
    out = np.zeros((len(parts), n), complex)
    out.real, out.imag[:, turned] = parts[:, :n], parts[:, n:]
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
    n: int,
    sigma: float,
    reach: float,
    expected: int,
    leftmost: float = -np.inf,
    tolerance: float = 1e-11,
    start: Array | None = None,
) -> Search:
    """All eigenpairs with |kappa - sigma| <= reach and Re kappa >= leftmost.

    kappa = sigma + 1 / theta. Those further left are not waited for: strongly damped bodies gather
    any number of real eigenvalues lambda within reach.

    Args:
        n: size of the operator A.
        sigma: real shift.
        reach: radius.
        expected: about how many eigenvalues there are, conjugates included.
        leftmost: smallest real part wanted.
        tolerance: residual of (A - theta) x relative to theta, and to kappa.
        start: starting block that is rich in the wanted vectors, shape (n, BLOCK); random if None.

    Yields:
        Blocks of shape (n, columns), to be sent A times the block, see ``searched``.

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
    new = _orthonormal((yield start))[0]
    size = 0
    due = 2 * expected
    while size <= room:
        k, first = new.shape[1], size
        V[:, first : first + k] = new
        size += k
        W = yield new
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
            kappa = sigma + 1 / theta[near]
            # Relative to kappa where that is smaller than its distance from the shift, as far as
            # the round-off of the largest theta lets it be.
            small = np.clip(np.abs(kappa * theta[near]), SMALLEST, 1.0)
            noise = ROUND_OFF * np.abs(theta).max(initial=0.0) / np.abs(theta[near])
            good = residual[near] < np.maximum(tolerance * small, noise)
            near[near] = kept = kappa.real >= leftmost
            if full or (beyond and np.all(good[kept])):
                return (yield from _polished(V[:, :size], sigma, theta[near], s[:, near]))
        if size <= room:
            H[size : size + new.shape[1], first:size] = coupling
    raise NotConverged(f"""block Arnoldi: {size} vectors do not give all modes; take a narrower
        band, or a smaller zeta_max where bodies are strongly damped""")


def searched(
    searches: dict[bool, Search], apply: Callable[[dict[bool, Array]], dict[bool, Array]]
) -> dict[bool, tuple[Complex, Complex]]:
    """What searches find that go on side by side: their operators are applied together.

    Args:
        searches: of right eigenpairs (False), of left ones (True), or either.
        apply: applies the operators of those that are not done yet to a block of each.
    """
    found = dict[bool, tuple[Complex, Complex]]()
    asked = {side: next(search) for side, search in searches.items()}
    while asked:
        for side, product in apply(asked).items():
            try:
                asked[side] = searches[side].send(product)
            except StopIteration as ended:
                found[side] = ended.value
                del asked[side]
    return found


def _polished(V: Array, sigma: float, theta: Complex, s: Complex) -> Search:
    """Eigenvalues and vectors, one of each conjugate pair, once more through A.

    The residual of K itself is then that of the Arnoldi process, without the norm of K.
    """
    one = np.flatnonzero(theta.imag <= 0)  # kappa has the other sign.
    parts, turned = parts_of(s[:, one])
    X = of_parts((yield combined(V, parts)), turned)
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


@dataclass(frozen=True, slots=True)
class QuadraticPencil:
    """P(lambda) = lambda^2 M + lambda C + K.

    Attributes:
        M: mass [kg].
        C: damping [N s/m]; None without damping.
        K: stiffness [N/m].
    """

    M: sp.spmatrix
    C: sp.spmatrix | None
    K: sp.spmatrix

    def times(self, s: Complex, X: Complex) -> Complex:
        """P(lambda) x for each pair."""
        out = times(self.M, X) * s**2 + times(self.K, X)
        return out if self.C is None else out + times(self.C, X) * s

    def slope(self, s: Complex, X: Complex) -> Complex:
        """P'(lambda) x = (2 lambda M + C) x for each pair."""
        out = times(self.M, X) * (2 * s)
        return out if self.C is None else out + times(self.C, X)


def residuals(
    p: QuadraticPencil, s: Complex, X: Complex, R: Complex, MX: Complex
) -> tuple[Array, Array]:
    """Relative residual and normwise backward error of each mode, Euclidean norms.

    The first is |P(lambda) phi| / |lambda^2 M phi|; of rigid modes, whose lambda^2 is round-off,
    relative to a millionth of the largest. The second (Tisseur 2000) divides by
    (|lambda|^2 |M| + |lambda| |C| + |K|) |phi|: with a spring 1e12 times stiffer than the rest it
    is small whatever phi is.

    Args:
        p: the problem.
        s: eigenvalues lambda [1/s], shape (modes,).
        X: their right vectors, shape (dofs, modes).
        R: residual vectors P(lambda) X.
        MX: M X.
    """
    r, squared, tiny = np.linalg.norm(R, axis=0), np.abs(s) ** 2, np.finfo(float).tiny
    inertia = np.maximum(squared, 1e-6 * squared.max(initial=0.0))
    inertia = np.maximum(inertia * np.linalg.norm(MX, axis=0), tiny)
    norm = squared * norm_bound(p.M) + norm_bound(p.K)
    if p.C is not None:
        norm = norm + np.abs(s) * norm_bound(p.C)
    return r / inertia, r / np.maximum(norm * np.linalg.norm(X, axis=0), tiny)


def norm_bound(A: sp.spmatrix) -> float:
    """Bound of the 2-norm: root of the largest row sum times the largest column sum."""
    size = abs(A)
    return float(np.sqrt(size.sum(axis=0).max() * size.sum(axis=1).max()))


def inner(left: Complex, right: Complex) -> Complex:
    """Products psi^H x of the columns of two matrices, one by one."""
    return np.asarray(np.einsum("im,im->m", left.conj(), right))


def undamped_errors(
    M: sp.spmatrix, kappa: Complex, right: Complex, left: Complex, R: Complex, MX: Complex
) -> tuple[Array, Array]:
    """Condition numbers in the norm of M, and errors from the two-sided quotient [1/s^2].

    Args:
        M: mass [kg].
        kappa: eigenvalues [1/s^2], shape (modes,).
        right: right vectors, shape (dofs, modes).
        left: left vectors, likewise.
        R: residual vectors K phi - kappa M phi.
        MX: M phi.
    """
    overlap = inner(left, MX)
    norms = np.sqrt(inner(right, MX).real * inner(left, times(M, left)).real)
    with np.errstate(divide="ignore"):
        condition = norms / np.abs(overlap)
    first = np.abs(inner(left, R) / overlap)
    # What the quotient of two inexact vectors leaves open, and the round-off of the solves.
    return condition, first + SOLVES * condition * np.abs(kappa).max(initial=0.0)


def damped_errors(
    p: QuadraticPencil, s: Complex, right: Complex, left: Complex
) -> tuple[Array, Array]:
    """Condition numbers in the norm of M, and errors from the two-sided quotient [1/s]."""
    overlap = np.abs(inner(left, p.slope(s, right)))
    first, second = (inner(X, times(p.M, X)).real for X in (right, left))
    condition = 2 * np.abs(s) * np.sqrt(first * second) / overlap
    first = np.abs(inner(left, p.times(s, right))) / overlap
    # The round-off of K phi, which is all that there is of a rigid mode.
    lengths = np.linalg.norm(right, axis=0) * np.linalg.norm(left, axis=0)
    floor = np.finfo(float).eps * norm_bound(p.K) * lengths / overlap
    return condition, first + floor + SOLVES * condition * np.abs(s).max(initial=0.0)


def rayleigh_quotient(p: QuadraticPencil, s: Complex, right: Complex, left: Complex) -> Complex:
    """One Newton step of psi^H P(lambda) phi = 0 where it is well-posed.

    It squares the error of the vectors; next to an exceptional point it is left undone.
    """
    slope = p.slope(s, right)
    overlap = inner(left, slope)
    size = np.linalg.norm(left, axis=0) * np.linalg.norm(slope, axis=0)
    step = inner(left, p.times(s, right)) / overlap
    sane = (np.abs(overlap) > 1e-4 * size) & (np.abs(step) < 1e-6 * np.abs(s))
    step = np.where(s.imag == 0, step.real, step)
    return np.where(sane, s - step, s)


def paired(s: Complex, left: Complex, weighted: Complex) -> Complex:
    """Left vectors biorthogonal to the right ones within clusters of equal eigenvalues.

    Args:
        s: eigenvalues.
        left: left vectors, shape (dofs, modes).
        weighted: derivative of the pencil times the right vectors: M phi, or (2 lambda M + C) phi.

    Returns:
        New left vectors of unit norm.
    """
    left = left / np.linalg.norm(left, axis=0)
    order = np.lexsort((s.real, s.imag))
    gaps = np.abs(np.diff(s[order])) > CLUSTER * np.abs(s[order][1:])
    for group in np.split(order, np.flatnonzero(gaps) + 1):
        if group.size > 1:
            overlap = left[:, group].conj().T @ weighted[:, group]
            turned = left[:, group] @ la.pinv(overlap).conj().T
            left[:, group] = turned / np.linalg.norm(turned, axis=0)
    return left


def matched(
    right: Complex, left: Complex, sigma: float, reach: float, leftmost: float = -np.inf
) -> tuple[Index, Index]:
    """Right eigenvalues within reach of a shift, and for each of them its own left one.

    Args:
        right: eigenvalues of the right vectors, some beyond the reach among them.
        left: those of the left vectors.
        sigma: the shift.
        reach: radius.
        leftmost: right eigenvalues of smaller real part are none of it.

    Raises:
        InaccurateResult: a right eigenvalue has no left one.
    """
    inside = np.flatnonzero((np.abs(right - sigma) <= reach) & (right.real >= leftmost))
    distance = np.abs(right[inside, None] - left[None, :])
    rows, columns = linear_sum_assignment(distance)
    far = distance[rows, columns] > MATCH * reach
    if rows.size < inside.size or np.any(far):
        raise InaccurateResult(f"""{inside.size} right eigenvectors, {rows.size - far.sum()} of them
            with a left one""")
    return inside, columns


def both_sides(
    side: Callable[[bool], tuple[Complex, Complex]],
    sigma: float,
    reach: float,
    comm: MPI.Comm = MPI.COMM_SELF,
    leftmost: float = -np.inf,
    symmetric: bool = False,
) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues within reach of a shift with right and left vectors; collective.

    Args:
        side: finds eigenvalues, one of each conjugate pair, and vectors of the problem (False) or
            of the transposed one.
        sigma: the shift.
        reach: radius.
        comm: two processes that take a side each, or one.
        leftmost: smallest real part wanted.
        symmetric: whether the transposed problem is the same one.

    Returns:
        Eigenvalues, conjugates included, right and left vectors.

    Raises:
        InaccurateResult: a right vector has no left one.
    """
    found = list(in_turns(1 if symmetric else 2, lambda i: side(i > 0), comm))
    # Both of each pair: round-off splits a true doublet into a pair on one side alone.
    (right, X), (left, Y) = (with_conjugates(*found[i]) for i in (0, -1))
    i, j = matched(right, left, sigma, reach, leftmost)
    return right[i], X[:, i], Y[:, j].conj()
