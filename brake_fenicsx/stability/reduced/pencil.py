"""Eigenpairs of the small quadratic pencil T(z) = K - z M + z^2 Q of a sample, and their number.

Q is a correction: the linear pencil K - z M comes first, by a dense eigensolver. With its vectors V
and W = V^-1, so that W M^-1 K V = diag(k), the quadratic one reads

    W M^-1 T(z) V = diag(k) - z + z^2 q,     q = W M^-1 Q V.

Eigenvalues whose coupling through q is small against their distances are followed one by one by a
fixed-point iteration for all of them together. Where it is not (a pair on the point of merging, a
complex pair that is really two reals, or the other way round), the whole cluster is followed, see
``clusters``.

The zeros of det T in a region are those of det(K - z M) plus the turns of

    det(I + z^2 (diag(k) - z)^-1 q)

along its edge; the logarithm of this is a trace as long as the product is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from ..complex_columns import unit
from ..full.completeness import Trapezium, count_turns, count_zeros
from ..modes import Complex
from .clusters import CONVERGED, STEPS, cluster_pairs, coupled_groups

Array = NDArray[np.float64]

# Coupling relative to the distance from which on two eigenvalues are followed together: first, and,
# where one does not settle or the count does not agree, again.
COUPLED = (0.3, 0.1, 0.03)

# Norm of the product up to which the logarithm of the determinant is taken from its traces.
SMALL = 0.3

# Condition of the vectors of the linear pencil from which on the count does without them.
ILL = 1e8


@dataclass(frozen=True, slots=True)
class Pairs:
    """Eigenpairs near a band.

    Attributes:
        kappa: eigenvalues [1/s^2], conjugates side by side, the positive imaginary part first.
        right: right vectors of unit norm, shape (size, pairs).
        left: left vectors, b^H T(kappa) = 0.
        expected: number of eigenvalues counted in the region.
        clustered: how many of them were followed in clusters.
        near: which eigenvalues of the linear pencil they belong to, shape (size,).
    """

    kappa: Complex
    right: Complex
    left: Complex
    expected: int
    clustered: int
    near: NDArray[np.bool_]


class Pencil:
    """K - z M + z^2 Q in the coordinates of the linear pencil."""

    def __init__(self, K: Array, M: Array, Q: Array):
        """Solve the linear pencil; all matrices real, shape (size, size)."""
        self.K, self.M, self.Q = K, M, Q
        self._M = la.lu_factor(M, check_finite=False)
        self.k, self.V = la.eig(la.lu_solve(self._M, K, check_finite=False), check_finite=False)
        self.W = la.inv(self.V, check_finite=False)
        self.q = self.W @ (la.lu_solve(self._M, Q, check_finite=False) @ self.V)
        self.condition = float(np.linalg.norm(self.V) * np.linalg.norm(self.W))

    def pairs(self, highest: float, region: Trapezium) -> Pairs:
        """All eigenpairs of a region, and those near it.

        Args:
            highest: values up to this one are near [1/s^2].
            region: where they are counted.

        Raises:
            InaccurateResult: the count differs however the clusters are chosen.
        """
        k = self.k
        near = np.isfinite(k) & (k.real < highest) & (np.abs(k) < 2 * highest)
        why = ""
        for coupled in COUPLED:
            try:
                kappa, right, left, clustered = self._followed(near, coupled)
            except InaccurateResult as error:
                why = str(error)
                continue
            found = int(region.holds(kappa).sum())
            expected = self.count(region, np.concatenate([kappa, k[~near & np.isfinite(k)]]))
            if found == expected and not _twice(kappa, right):
                return Pairs(kappa, right, left, expected, clustered, near)
            why = (
                f"reduced model: {found} modes found in the band, the winding number of the"
                f" determinant counts {expected}"
            )
        raise InaccurateResult(why)

    def _followed(
        self, near: NDArray[np.bool_], coupled: float
    ) -> tuple[Complex, Complex, Complex, int]:
        """Eigenpairs that belong to some of the linear pencil; how many of them in clusters."""
        chosen = np.flatnonzero(near)
        groups = coupled_groups(self.k, self.q, chosen, coupled)
        single = np.array([g[0] for g in groups if len(g) == 1 and self.k[g[0]].imag >= 0], int)
        kappa, right, left, failed = self._singles(single)
        values, rights, lefts = [kappa], [right], [left]
        again = [np.flatnonzero(np.isclose(self.k, self.k[m].conj(), rtol=1e-13)) for m in failed]
        again = [np.union1d(g, [m]) for g, m in zip(again, failed, strict=True)]
        clusters = [g for g in groups if len(g) > 1] + again
        for group in clusters:
            W = la.lu_solve(self._M, self.W[group].conj().T, trans=1, check_finite=False)
            z, x, y = cluster_pairs((self.K, self.M, self.Q), self.k[group], self.V[:, group], W)
            values.append(z)
            rights.append(x)
            lefts.append(y)
        kappa, right, left = np.concatenate(values), np.hstack(rights), np.hstack(lefts)
        return *with_conjugates(kappa, right, left)[1:], sum(len(g) for g in clusters)

    def _singles(self, m: NDArray[np.intp]) -> tuple[Complex, Complex, Complex, NDArray[np.intp]]:
        """Eigenpairs far enough from all others, and the numbers of those that did not converge."""
        n, j = self.k.size, np.arange(m.size)
        x, y = np.zeros((2, n, m.size), complex)
        x[m, j] = y[m, j] = 1.0
        z, change = self.k[m].copy(), np.full(m.size, np.inf)
        with np.errstate(all="ignore"):
            for _ in range(STEPS):
                qx, qy = self.q @ x, self.q.T @ y
                z = self.k[m] + z**2 * qx[m, j]
                away = self.k[:, None] - z
                away[m, j] = 1.0
                new, other = -(z**2) * qx / away, -(z**2) * qy / away
                new[m, j] = other[m, j] = 1.0
                change = np.maximum(np.abs(new - x).max(axis=0), np.abs(other - y).max(axis=0))
                x, y = new, other
                if change.max(initial=0.0) <= CONVERGED:
                    break
        good = change <= CONVERGED
        real = self.k[m[good]].imag == 0
        x, y, z = x[:, good], y[:, good], z[good]
        a = self.V @ x
        b = la.lu_solve(self._M, (self.W.T @ y).conj(), trans=1, check_finite=False)
        a, b = (unit(np.where(real, v.real, v)) for v in (a, b))
        z = self._quotient(np.where(real, z.real, z), a, b)
        return z, a, b, m[~good]

    def _quotient(self, z: Complex, a: Complex, b: Complex) -> Complex:
        """One Newton step for z of b^H T(z) a = 0, for each pair."""
        Ka, Ma, Qa = (np.einsum("im,im->m", b.conj(), A @ a) for A in (self.K, self.M, self.Q))
        return np.asarray(z - (Ka - z * Ma + z**2 * Qa) / (2 * z * Qa - Ma))

    def coupled_shift(self, kappa: Complex, residual: Complex, known: NDArray[np.bool_]) -> Array:
        """Second-order shift of each eigenvalue by what a small residual mixes in of far ones.

        Args:
            kappa: some of the eigenvalues, shape (pairs,).
            residual: residuals of their unit right vectors, shape (size, pairs).
            known: eigenvalues of the linear pencil whose share is not looked at, shape (size,).

        Returns:
            sum_j |c_j|^2 condition_j / |k_j - kappa| over the others, c the residual in the
            coordinates of the vectors; the left residual is taken to be of the right one's size.
        """
        solved = la.lu_solve(self._M, residual.real) + 1j * la.lu_solve(self._M, residual.imag)
        c = np.abs(self.W @ solved)
        condition = np.linalg.norm(self.W, axis=1) * np.linalg.norm(self.V, axis=0)
        away = np.abs(self.k[:, None] - kappa)
        away[away.argmin(axis=0), np.arange(kappa.size)] = np.inf
        away[known] = np.inf
        floor = 1e-12 * np.abs(kappa).max(initial=0.0)
        return np.asarray((condition[:, None] * c**2 / np.maximum(away, floor)).sum(axis=0))

    def count(self, region: Trapezium, believed: Complex) -> int:
        """Zeros of det T inside a region.

        Args:
            region: where to count.
            believed: values taken for zeros.

        Raises:
            InaccurateResult: an eigenvalue lies on the edge.
        """
        if not (self.condition < ILL and np.all(np.isfinite(self.k))):
            K, M, Q = self.K, self.M, self.Q
            return count_zeros(lambda z: K - z * M + z**2 * Q, region, believed)
        squares, pairs = np.abs(self.q) ** 2, self.q * self.q.T
        diagonal = np.diag(self.q)

        def phase(z: complex) -> complex:
            away = self.k - z
            x = z**2 / away
            size = np.abs(x)
            if size @ squares @ size < SMALL**2:
                turn = np.imag(x @ diagonal - 0.5 * (x @ pairs @ x))
            else:
                scaled = np.sqrt(x)[:, None] * self.q * np.sqrt(x)
                turn = _angle(np.eye(x.size) + scaled)
            factors = np.concatenate([away, np.conj(believed - z)])
            product: complex = np.prod(factors / np.abs(factors)) * np.exp(1j * turn)
            return product

        return count_turns(phase, region, believed)


def with_conjugates(
    kappa: Complex, a: Complex, b: Complex
) -> tuple[NDArray[np.intp], Complex, Complex, Complex]:
    """Eigenpairs in ascending order, each complex one followed by its conjugate.

    Args:
        kappa: eigenvalues without negative imaginary part, shape (pairs,).
        a: right vectors, shape (size, pairs).
        b: left ones.

    Returns:
        The number of each one's pair, eigenvalues, right and left vectors.
    """
    order = np.argsort(kappa.real, kind="stable")
    repeat = np.repeat(order, 1 + (kappa[order].imag > 0))
    second = np.r_[False, repeat[1:] == repeat[:-1]]
    kappa, a, b = kappa[repeat], a[:, repeat], b[:, repeat]
    return (
        repeat,
        np.where(second, kappa.conj(), kappa),
        np.where(second, a.conj(), a),
        np.where(second, b.conj(), b),
    )


def _twice(kappa: Complex, a: Complex) -> bool:
    """Whether one eigenpair stands there twice."""
    order = np.lexsort((kappa.imag, kappa.real))
    i, j = order[:-1], order[1:]
    close = np.abs(kappa[i] - kappa[j]) <= 1e-9 * np.abs(kappa).max(initial=0.0)
    cosine = np.abs(np.einsum("im,im->m", a[:, i].conj(), a[:, j]))
    same = close & (cosine > 1 - 1e-12) & (np.abs(kappa[i] - kappa[j]) <= 1e-12 * np.abs(kappa[i]))
    return bool(np.any(same))


def _angle(A: Complex) -> float:
    """Angle of the determinant, up to whole turns."""
    lu, pivots = la.lu_factor(A, overwrite_a=True, check_finite=False)
    swaps = int(np.sum(pivots != np.arange(pivots.size)))
    return float(np.angle(np.diag(lu)).sum() + np.pi * (swaps % 2))
