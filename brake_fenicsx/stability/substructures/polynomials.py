"""Polynomials in the frequency: through values of a body, and the zeros of those of a sample.

What the kept modes leave out has its poles beyond the cutoff, so that a polynomial through
Chebyshev points of the band gains with every point a factor that Bernstein's ellipse tells: 10.9
for a cutoff of 1.8 times the band's end (L. N. Trefethen, Approximation Theory and Approximation
Practice, 2013, chapter 8). The points are real kappa = -lambda^2 of an undamped body, and lambda on
the imaginary axis of a damped one, where conjugate points come free. The first one lies next to the
equilibrium. The value at one point more, the end of the band, measures the error: it is the largest
of the band, since the nearest pole lies beyond.

Matrix polynomials are arrays of their coefficients, shape (degree + 1, rows, columns). The zeros of
T(z) that matter are those of a right divisor Q of low degree, T = L Q with L = 1 + z L_1 + ...,
found by a fixed point iteration (Dennis, Traub and Weber, SIAM J. Numer. Anal. 15, 1978,
doi:10.1137/0715034; Gohberg, Lancaster and Rodman, Matrix Polynomials, 1982): where L has no zero
within reach, none of T is missing. If there is no such divisor, T itself is taken. Zeros come from
the companion matrix of the reversed polynomial w^d Q_0 + ... + Q_d, w = 1/z: the constant
coefficient is regular, the leading one of a truncated series is not (Tisseur and Meerbergen, SIAM
Review 43, 2001, doi:10.1137/S0036144500381988).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.iteration import Steps, sizes

from ..eigensolvers.eigenpairs import of_parts, on_parts, parts_of, times
from .contact_rows import SIGMA, Rows


@dataclass(frozen=True, slots=True)
class Blocks:
    """A matrix that is zero outside of some blocks, such as those of bodies.

    Attributes:
        shape: of the whole.
        blocks: rows and columns of each block, and its entries; rows of one block differ.
    """

    shape: tuple[int, int]
    blocks: list[tuple[Any, Any, AnyArray]]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Precision of the entries."""
        return np.result_type(*(A for *_, A in self.blocks)) if self.blocks else np.dtype(float)

    @property
    def T(self) -> "Blocks":
        """The transposed matrix."""
        return Blocks(self.shape[::-1], [(j, i, A.T) for i, j, A in self.blocks])

    @property
    def whole(self) -> AnyArray:
        """The matrix with its zeros."""
        out = np.zeros(self.shape, self.dtype)
        for i, j, A in self.blocks:
            place = (i, j) if isinstance(i, slice) or isinstance(j, slice) else np.ix_(i, j)
            out[place] += A
        return out

    def astype(self, kind: type, copy: bool = True) -> "Blocks":
        """The matrix in another precision."""
        return Blocks(self.shape, [(i, j, A.astype(kind, copy=copy)) for i, j, A in self.blocks])

    def __matmul__(self, x: AnyArray) -> AnyArray:
        """Product with a block of columns, shape (columns of the matrix, columns)."""
        out = np.zeros((self.shape[0], x.shape[1]), np.result_type(self.dtype, x))
        for i, j, A in self.blocks:
            out[i] += A @ x[j]
        return out


Coefficients = Array | Sequence[AnyArray | Blocks]

# kappa of the first point: a free body has its rigid motions at 0.
FIRST = -1e-4

# Points keep this distance in kappa from the eigenvalues of the body, if they can within the width
# that they may be moved by.
APART, WIDTH, TRIES = 5e-3, 2e-2, 81

# Least distance of a pole, in units of the band's end, that an error is scaled with.
NEAR = 0.05

# Steps of the division, and the relative change at which it stands still: the zeros of a truncated
# series are corrected afterwards.
STEPS, STILL = 40, 1e-6

# Steps at most for left vectors, b' L = c': each gains a factor of the size of L - 1.
LEFT_STEPS = 16


def real_points(count: int, eigenvalues: Array) -> Array:
    """Chebyshev points in kappa, from ``FIRST`` on, and the end of the band after them.

    Args:
        count: number of points but for the end, two at least.
        eigenvalues: kappa of the body, shape (modes,).

    Returns:
        Shape (count + 1,).
    """
    y = np.cos((2 * np.arange(count)[::-1] + 1) * np.pi / (2 * count))
    points = 1.0 + (1.0 - FIRST) / (1 - y[0]) * (y - 1.0)
    return np.r_[points[0], _away(np.r_[points[1:], 1.0], eigenvalues)]


def imaginary_points(count: int, eigenvalues: Array) -> Complex:
    """Chebyshev points in lambda: a real one at 0 but for ``FIRST``, those above it, i at the end.

    Args:
        count: number of points above the real one.
        eigenvalues: kappa of the body without damping, shape (modes,).

    Returns:
        Shape (count + 2,).
    """
    y = np.cos((2 * np.arange(count)[::-1] + 1) * np.pi / (4 * count + 2))
    return np.r_[np.sqrt(-FIRST), 1j * np.sqrt(_away(np.r_[y**2, 1.0], eigenvalues))]


def _away(points: Array, eigenvalues: Array) -> Array:
    """Points in kappa moved away from the eigenvalues of a body."""
    steps = np.linspace(-WIDTH, WIDTH, TRIES)
    steps = steps[np.argsort(np.abs(steps), kind="stable")]
    out = np.array(points)
    for i, point in enumerate(points):
        apart = np.abs(point + steps[:, None] - eigenvalues[None]).min(axis=1, initial=np.inf)
        far = np.flatnonzero(apart >= APART)
        out[i] += steps[far[0] if far.size else int(apart.argmax())]
    return out


class Polynomial:
    """A polynomial in w through values at some points, and its error.

    Attributes:
        count: number of its coefficients.
    """

    def __init__(self, points: AnyArray, rows: Rows):
        """Take the points.

        Args:
            points: in kappa or, where bodies are damped, in lambda; the end of the band last.
            rows: which of the two.
        """
        w = points - rows.shift if rows.damped else points + SIGMA
        above = w[:-1][np.imag(w[:-1]) > 0]
        self._nodes, self._end, self._rows = np.r_[w[:-1], above.conj()], w[-1], rows
        self.count: int = self._nodes.size
        inverse = np.linalg.inv(np.vander(self._nodes, increasing=True))
        # Conjugate values make twice the real part.
        single = np.where(np.imag(w[:-1]) > 0, 2.0, 1.0)
        self._weights = inverse[:, : w.size - 1] * single

    def coefficients(self, values: Sequence[AnyArray]) -> Array:
        """Real coefficients in powers of w from the values at all points but the end.

        Args:
            values: of each point, shape (...).
        """
        shape = np.shape(values)
        flat = np.reshape(values, (shape[0], int(np.prod(shape[1:]))))
        out = self._weights.real @ flat.real
        if np.iscomplexobj(flat):
            out -= self._weights.imag @ flat.imag
        return np.asarray(out.reshape(self.count, *shape[1:]))

    def missing(self, coefficients: Array, value: Array) -> Array:
        """What the polynomial lacks of a value at the end of the band: real and imaginary parts.

        Args:
            coefficients: in powers of w, shape (count, ...).
            value: at the end of the band, shape (...).

        Returns:
            Shape (1 or 2, ...).
        """
        powers = self._end ** np.arange(self.count)
        rest = value - np.tensordot(powers, coefficients, 1)
        return np.array([rest.real, rest.imag] if np.iscomplexobj(rest) else [rest])

    def growth(self, w: Complex, pole: float) -> Array:
        """Error at some w over that at the end of the band: 1 or less within the band.

        Args:
            w: shape (n,).
            pole: least frequency of a pole of what is left out, over the band's end.
        """
        nodes, end = self._nodes, self._end
        at_end = np.prod(np.abs(end - nodes))
        size = np.prod(np.abs(w[:, None] - nodes), axis=1) / at_end
        others = np.prod(np.abs(nodes[0] - nodes[1:])) / at_end
        within = np.minimum(1.0, others * np.abs(w - nodes[0]))
        # A pole acts by its distance: real ones of kappa, those of a damped body anywhere.
        if self._rows.damped:
            far, apart = pole, pole - np.abs(w + self._rows.shift)
        else:
            far = pole**2
            apart = np.hypot(np.maximum(far + SIGMA - w.real, 0.0), w.imag)
        nearer = (far - 1.0) / np.maximum(apart, NEAR)
        return np.asarray(np.maximum(within, size) * np.maximum(1.0, nearer))


def lowest_coefficients(w: Array, values: Sequence[Array], beyond: Sequence[AnyArray]) -> Array:
    """First coefficients of a polynomial whose others are known, from as many values.

    Args:
        w: where the values are, shape (count,).
        values: shape (count, ...).
        beyond: the coefficients after the first count.

    Returns:
        Shape (count, ...).
    """
    count, given = len(w), [*values]
    for j, A in enumerate(beyond):
        given = [v - x ** (count + j) * A for x, v in zip(w, given, strict=True)]
    inverse = np.linalg.inv(np.vander(w, increasing=True))
    return np.asarray(np.tensordot(inverse, given, 1), float)


@dataclass(frozen=True, slots=True)
class Zeros:
    """Zeros of a matrix polynomial, and unit vectors T(z) a = 0 and b' T(z) = 0 of some of them.

    Attributes:
        every: all zeros that were found.
        chosen: places of those whose vectors were computed.
        right: a, shape (size, chosen).
        left: b, not conjugated, likewise.
    """

    every: Complex
    chosen: Index
    right: Complex
    left: Complex

    @property
    def z(self) -> Complex:
        """The chosen zeros."""
        return np.asarray(self.every[self.chosen])

    def taken(self, some: Index) -> "Zeros":
        """Some of those that were chosen."""
        return Zeros(self.every, self.chosen[some], self.right[:, some], self.left[:, some])


def zeros(T: Array, degree: int, reach: float, near: Callable[[Complex], Index]) -> Zeros:
    """Zeros of a real matrix polynomial whose constant coefficient is regular.

    Args:
        T: coefficients.
        degree: of the divisor.
        reach: no zero up to this modulus may be missing.
        near: chooses the zeros whose vectors are wanted, all of them within reach.
    """
    if not T.shape[1]:
        none = np.zeros((0, 0), complex)
        return Zeros(none.ravel(), np.zeros(0, dtype=np.intp), none, none)
    divisor = _divided(T, degree, reach) if len(T) - 1 > degree else None
    if divisor is None:
        return _companion(T, near)
    Q, L = divisor
    found = _companion(Q, near)
    left, steps = found.left, Steps(found.left.shape[1], STILL, LEFT_STEPS)
    while steps.moving.any():
        series = [found.z ** (j + 1) * times(A.T, left) for j, A in enumerate(L)]
        new = found.left - np.sum(series, axis=0)
        left = np.where(steps.take(*sizes(new - left, left)), new, left)
    # What is left of them moves the quotient to second order: its products show it.
    return Zeros(found.every, found.chosen, found.right, left / la.norm(left, axis=0))


def _divided(T: Array, degree: int, reach: float) -> tuple[Array, Array] | None:
    """Q and [L_1, L_2, ...] of T = L Q; None where the iteration fails or L has zeros in reach."""
    Q, L = T[: degree + 1].copy(), np.zeros_like(T[degree + 1 :])
    last = np.inf
    for _ in range(STEPS):
        lu = la.lu_factor(Q[degree].T, check_finite=False)
        for j in range(len(L), 0, -1):
            rest = T[j + degree].copy()
            for i in range(j + 1, min(len(L), j + degree) + 1):
                rest -= L[i - 1] @ Q[j + degree - i]
            L[j - 1] = la.lu_solve(lu, rest.T, check_finite=False).T
        new = T[: degree + 1].copy()
        for n in range(degree + 1):
            for i in range(1, min(len(L), n) + 1):
                new[n] -= L[i - 1] @ Q[n - i]
        change = float(np.abs(new - Q).max() / np.abs(new).max())
        Q = new
        if not np.isfinite(change) or change > 10 * last:
            return None
        if change <= STILL:
            size = sum(reach ** (j + 1) * _bound(A) for j, A in enumerate(L))
            return (Q, L) if size < 1 else None
        last = change
    return None


def _bound(A: Array) -> float:
    """Bound of the 2-norm, sharp to the square root of a size."""
    return float(min(la.norm(A), np.sqrt(la.norm(A, 1) * la.norm(A, np.inf))))


def _companion(T: Array, near: Callable[[Complex], Index]) -> Zeros:
    """All finite zeros."""
    degree, n, T = len(T) - 1, T.shape[1], T.astype(float)
    A = np.eye(n * degree, k=n)
    lu = la.lu_factor(T[0], check_finite=False)
    A[-n:] = -la.lu_solve(lu, np.hstack([*T[:0:-1]]), check_finite=False)
    w, left, right = la.eig(A, left=True, right=True, check_finite=False)
    kept = np.flatnonzero(w != 0)
    every = 1 / w[kept]
    chosen = near(every)
    # Right vectors are (x, w x, w^2 x, ...): the last block is never small. Of a left vector u'
    # the last block is b' T_0.
    X, U = right[-n:, kept[chosen]], left[-n:, kept[chosen]].conj()
    b = on_parts(lambda x: la.lu_solve(lu, x, trans=1, check_finite=False), U)
    return Zeros(every, chosen, X / la.norm(X, axis=0), b / la.norm(b, axis=0))


def whole(A: Coefficients) -> Array:
    """Coefficients as one array, shape (count, rows, columns)."""
    return np.array([B.whole if isinstance(B, Blocks) else B for B in A])


def applied(
    A: Coefficients, z: Complex, X: Complex, transpose: bool = False, kind: type | None = None
) -> Complex:
    """A(z_j) x_j of each column, or A(z_j)' x_j.

    Args:
        A: coefficients, real.
        z: of each column, shape (columns,).
        X: shape (columns or rows of A, columns).
        transpose: whether A is transposed.
        kind: precision of the products; that of each coefficient if None.
    """
    total, (parts, turned) = None, parts_of(X)
    for n, coefficient in enumerate(A):
        B = coefficient.T if transpose else coefficient
        B = B if kind is None else B.astype(kind, copy=False)
        term = z**n * of_parts(B @ parts.astype(B.dtype, copy=False), turned)
        total = term if total is None else total + term
    return np.asarray(total)
