"""Refinement of some damped modes on the full problem, with the factor of the reference at hand.

After a few steps on either side the vectors X and Y of modes close to one another span a small
problem of their own, which is quadratic like the full one,

    Y^H P(lambda) X w = 0,     P = K0 + lambda C + lambda^2 M + I' J O,

and sets them right however close they are. What other modes have in them then moves the coordinates
a by a step of Newton's with the T of the reduced model, across the close ones. What is left is the
product of what is left on both sides.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ..complex_columns import on_parts, times
from ..modes import Complex
from .neighbours import near_groups
from .trial_vectors import Asked, Reference, TrialVectors

Array = NDArray[np.float64]

# Steps on either side before the residuals are looked at, and how often at most.
STEPS, ROUNDS = 6, 8

# The coordinates lag behind what the last steps add: the bound is taken so many times.
DOUBT = 3.0


class Refined:
    """The full problem of one sample."""

    def __init__(
        self,
        sample: Asked,
        reference: Reference,
        C: sp.csr_matrix,
        O: sp.csr_matrix,
        I: sp.csr_matrix,
    ):
        """Keep what the steps need.

        Args:
            sample: the sample in the reduced model.
            reference: the full problem without the sample's contact.
            C: damping of the bodies [N s/m].
            O: rows of the interface that are looked at.
            I: rows that forces act along.
        """
        self.sample, self.reference, self._matrices = sample, reference, (C, O, I)

    def _vectors(self, s: Complex, a: Complex, left: bool) -> TrialVectors:
        return TrialVectors(self.sample, self.reference, self._matrices, s, a, left)

    def right(self, s: Complex, a: Complex) -> Complex:
        """Right vectors of some modes, shape (dofs, modes)."""
        side = self._vectors(s, a, left=False)
        for _ in range(STEPS):
            side.take(on_parts(side.rest.solve, side.next()))
        return side.vector

    def __call__(
        self, s: Complex, a: Complex, b: Complex, tolerance: float | Array
    ) -> tuple[Complex, Array]:
        """Some eigenvalues of the full problem, and how far off they may be.

        Args:
            s: eigenvalues of the reduced model [1/s], shape (modes,); close ones together.
            a: right vectors in the kept modes, shape (kept modes, modes).
            b: left ones.
            tolerance: relative error wanted, one or one per mode.

        Returns:
            Both in 1/s; of modes that do not get there the second is what was reached.
        """
        right, left = self._vectors(s, a, left=False), self._vectors(s, b, left=True)
        best: Complex = s.astype(complex)
        least: Array = np.full(s.size, np.inf)
        wanted = np.broadcast_to(tolerance, s.shape)
        groups = near_groups(s)
        going: NDArray[np.intp] = np.arange(s.size)
        for _ in range(ROUNDS):
            for _ in range(STEPS):
                answers = on_parts(right.rest.solve, np.hstack([right.next(), left.next()]))
                right.take(answers[:, : s.size])
                left.take(answers[:, s.size :])
            x, y = right.vector, left.vector
            r, q, dr, dq = right.residual(), left.residual(), right.slope(), left.slope()
            Mx, My = times(right.M, x), times(left.M, y)
            new = s.copy()
            W, V = np.zeros((2, s.size, s.size), complex)
            for g in groups:
                new[g], W[np.ix_(g, g)], V[np.ix_(g, g)] = _small_problem(
                    s[g], *(y[:, g].conj().T @ v[:, g] for v in (r, dr, Mx))
                )
            if not (np.all(np.isfinite(new)) and np.all(np.abs(new - s) < 0.1 * np.abs(s).max())):
                break
            r, dr = _residuals(new, s, (r, dr, Mx), W)
            q, _ = _residuals(new.conj(), s.conj(), (q, dq, My), V)
            # What round-off leaves of the small problem, and what a change of lambda adds.
            missed, scale = (np.abs(np.einsum("im,im->m", (y @ V).conj(), v)) for v in (r, dr))
            s = new
            right.combine(W, s)
            left.combine(V, s)
            da, db, left_over = self._left_over(right, left, r, q, groups)
            bound = (DOUBT * left_over + missed) / np.maximum(scale, 1e-300)
            better, stuck = bound < least[going], bound > 0.5 * least[going]
            best[going] = np.where(better, s, best[going])
            least[going] = np.where(better, bound, least[going])
            # A rigid mode has no relative error to settle at.
            settled = stuck | (least[going] <= wanted[going] * np.abs(s))
            if np.all(settled):
                break
            right.add(da)
            left.add(db)
            # Close ones go on together.
            groups = [g for g in groups if not np.all(settled[g])]
            chosen = np.sort(np.concatenate(groups))
            groups = [np.searchsorted(chosen, g) for g in groups]
            s, going = s[chosen], going[chosen]
            right.keep(chosen)
            left.keep(chosen)
        return best, least

    def _left_over(
        self,
        right: TrialVectors,
        left: TrialVectors,
        r: Complex,
        q: Complex,
        groups: list[NDArray[np.intp]],
    ) -> tuple[Complex, Complex, Array]:
        """Answers da and db of the kept modes to what is left, and |q^H P^-1 r| part by part.

        All else answers first, with its contact; the forces of that answer act on the kept modes.
        """
        n, s = right.s.size, right.s
        both = on_parts(right.rest.solve, np.hstack([r, q]))
        x, y = both[:, :n], both[:, n:]
        forces, seen = self.sample.forces, left.O @ y
        force = forces(s, self.sample.answer(s, right.O @ x, left=False))
        force_left = self.sample.answer(s.conj(), forces.left(s.conj(), seen), left=True)
        kept_r = times(right.Phi.T, r - right.I.T @ force)
        kept_q = times(left.Phi.T, q - left.I.T @ force_left)
        da, db = np.zeros_like(kept_r), np.zeros_like(kept_q)
        for g in groups:
            da[:, g], db[:, g] = self._steps(
                s[g], right.a[:, g], left.a[:, g], kept_r[:, g], kept_q[:, g]
            )
        products = (y.conj(), r), (seen.conj(), force), (kept_q.conj(), da)
        return da, db, sum(np.abs(np.einsum("im,im->m", *pair)) for pair in products)

    def _steps(
        self, s: Complex, a: Complex, b: Complex, r: Complex, q: Complex
    ) -> tuple[Complex, Complex]:
        """Newton's steps of close modes: T a = -Phi' r, across all of them."""
        da, db = np.zeros_like(a), np.zeros_like(b)
        for m, value in enumerate(s):
            T, slope = self.sample.at(value), self.sample.at(value, derivative=True)
            corner = np.zeros((s.size, s.size))
            lu = la.lu_factor(
                np.block([[T, slope @ a], [(slope.conj().T @ b).conj().T, corner]]),
                check_finite=False,
            )
            empty = np.zeros(s.size)
            da[:, m] = -la.lu_solve(lu, np.r_[r[:, m], empty], check_finite=False)[: len(a)]
            db[:, m] = -la.lu_solve(lu, np.r_[q[:, m], empty], 2, check_finite=False)[: len(b)]
        return da, db


def _small_problem(
    s: Complex, P: Complex, slope: Complex, mass: Complex
) -> tuple[Complex, Complex, Complex]:
    """Y^H P(lambda) X w = 0, each eigenvalue where it came from.

    Args:
        s: eigenvalue that belongs to each vector in X [1/s], shape (modes,).
        P: Y^H P X, each column at its own s.
        slope: Y^H P' X.
        mass: Y^H M X.

    Returns:
        Eigenvalues, right and left vectors of unit norm.
    """
    n = s.size
    # In units of a typical eigenvalue, and of the mass: all matrices are of size one.
    unit = float(np.abs(s).max())
    A2, A1, A0 = mass * unit**2, (slope - 2 * mass * s) * unit, P - slope * s + mass * s**2
    size = np.abs(A2).max()
    A2, A1, A0 = A2 / size, A1 / size, A0 / size
    one, zero = np.eye(n), np.zeros((n, n))
    A = np.block([[zero, one], [-A0, -A1]])
    B = np.block([[one, zero], [zero, A2]])
    value, left, right = la.eig(A, B, left=True, right=True, check_finite=False)
    value = value * unit
    distance = np.abs(s[:, None] - value)
    chosen = linear_sum_assignment(np.where(np.isfinite(distance), distance, 1e300))[1]
    W, V = right[:n, chosen], left[n:, chosen]
    return value[chosen], W / np.linalg.norm(W, axis=0), V / np.linalg.norm(V, axis=0)


def _residuals(
    new: Complex, old: Complex, parts: tuple[Complex, Complex, Complex], weights: Complex
) -> tuple[Complex, Complex]:
    """P phi and P' phi of combinations, at new eigenvalues.

    Args:
        new: eigenvalue of each combination [1/s].
        old: eigenvalue at which each vector was looked at.
        parts: P phi, P' phi and M phi of the vectors.
        weights: column by column.
    """
    r, slope, mass = parts
    moved = new - old[:, None]
    return (
        r @ weights + slope @ (moved * weights) + mass @ (moved**2 * weights),
        slope @ weights + 2 * mass @ (moved * weights),
    )
