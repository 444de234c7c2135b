"""One damped sample in the reduced model, as a matrix polynomial in lambda.

With z = O phi, the forces J z of ``contact_forces``, and G_n of ``damped_basis``, its blocks named
by what is looked at and what acts (F for the kept modes),

    E(lambda) z = seen a - lambda G_OF a,      E = 1 + G_OI J,
    T(lambda) a = [Lambda + lambda C + lambda^2 - lambda^2 G_FF] a + B(lambda) z = 0,
    B = forced' J - lambda G_FI J.

z = Z(lambda) a by its power series gives T as one. Left vectors have y^H E = b^H B.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..complex_columns import on_parts, series_answer, times
from ..modes import Complex
from .contact_forces import ContactForces
from .damped_basis import DampedBasis

Array = NDArray[np.float64]

# Powers of lambda in T, and in the left gaps, which only weigh what is small.
TOP, LEFT_TOP = 4, 3

# Terms of the answer of the gaps to an error.
ANSWERS = 2


class DampedSample:
    """Reduced operators of one contact stiffness, friction coefficient and pressure.

    Attributes:
        basis: offline result.
        forces: forces at contact.
        sigma: share of the mass in the bodies' stiffness [1/s^2].
        mu: friction coefficients, shape (elements,).
        T: coefficients of T, shape (modes, modes).
    """

    def __init__(self, basis: DampedBasis, k: Array, mu: Array, along: Array, across: Array):
        """Expand the interface problem in lambda.

        Args:
            basis: offline result.
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient of each element.
            along: p mu'(V) of each element [Pa s/m]; of no effect where ``names`` has no T.
            across: mu p / V of each element [Pa s/m]; of no effect where it has no R.
        """
        b = self.basis = basis
        self.sigma, self.mu = b.sigma, mu
        every = {"T": b.w * along, "R": b.w * across}
        rates = {name: every[name] for name in b.names[1:]}
        columns = b.forced.shape[0]
        J = self.forces = ContactForces(b.w * (k - b.k0), b.w * mu * k, rates, columns)
        powers = range(TOP + 1)
        self._E, self._B = ([f(i) for i in powers] for f in (self.gaps_forced, self.modes_forced))
        E = self._E[0][: J.n, : J.n].copy()
        E[np.diag_indices_from(E)] += 1.0
        # Without contact elements there is nothing to solve.
        self._lu = la.lu_factor(E, overwrite_a=True, check_finite=False) if J.n else None
        self._Z: list[Array] = []
        self._Y: list[Array] = []
        for i in powers:
            x = self.source(i).copy()
            for j in range(1, i + 1):
                x -= self._E[j] @ self._Z[i - j]
            self._Z.append(self._solve(x))
        for i in powers[: LEFT_TOP + 1]:
            x = self._B[i].T.copy()
            for j in range(1, i + 1):
                x -= self._E[j].T @ self._Y[i - j]
            self._Y.append(self._solve_left(x))
        self.T = [
            sum((self._B[j] @ self._Z[i - j] for j in range(i + 1)), self.own(i)) for i in powers
        ]

    def gaps_forced(self, i: int) -> Array:
        """Coefficient of lambda^i in G_OI J."""
        J, G = self.forces, self.basis.G
        own = (slice(J.rows), slice(J.columns))
        return J.after(G[i][own], G[i - 1][own] if i else None)

    def modes_forced(self, i: int) -> Array:
        """Coefficient of lambda^i in B."""
        J, G, forced = self.forces, self.basis.G, self.basis.forced.T
        own = (slice(J.rows, None), slice(J.columns))
        if i == 0:
            return J.after(forced, None)
        out = -J.after(G[i - 1][own], G[i - 2][own] if i > 1 else None)
        return out + J.after(0.0 * forced, forced) if i == 1 else out

    def source(self, i: int) -> Array:
        """Coefficient of lambda^i in seen - lambda G_OF."""
        if i == 0:
            return self.basis.seen
        return np.asarray(-self.basis.G[i - 1][: self.forces.rows, self.forces.columns :])

    def own(self, i: int) -> Array:
        """Coefficient of lambda^i in Lambda + lambda C + lambda^2 - lambda^2 G_FF."""
        b, J = self.basis, self.forces
        if i < 2:
            return np.diag(b.Lambda - b.sigma) if i == 0 else b.C
        out = -b.G[i - 2][J.rows :, J.columns :]
        return out + np.eye(b.Lambda.size) if i == 2 else out

    def at(self, s: complex, derivative: bool = False) -> Complex:
        """T or T' at lambda = s."""
        T = [j * A for j, A in enumerate(self.T) if j] if derivative else self.T
        out = T[-1].astype(complex)
        for A in T[-2::-1]:
            out = out * s + A
        return out

    def gaps(self, s: Complex, a: Complex) -> Complex:
        """Motion z at contact of some right vectors, shape (rows of O, modes)."""
        return np.asarray(sum(self.terms(s, a)))

    def terms(self, s: Complex, a: Complex) -> list[Complex]:
        """Terms of z, by powers of lambda."""
        return [s**j * times(Z, a) for j, Z in enumerate(self._Z)]

    def left_gaps(self, s: Complex, b: Complex) -> Complex:
        """Gap multipliers y of some left vectors, y^H E = b^H B."""
        return np.asarray(sum(self.left_terms(s, b)))

    def left_terms(self, s: Complex, b: Complex) -> list[Complex]:
        """Terms of y, by powers of lambda."""
        return [s.conj() ** j * times(Y, b) for j, Y in enumerate(self._Y)]

    def modal(self, s: Complex, r: Complex) -> Complex:
        """B E^-1 r: what an error r of E z comes to in T a."""
        return np.asarray(sum(s**j * times(Y.T, r) for j, Y in enumerate(self._Y)))

    def improved(self, s: Complex, z: Complex, seen: Complex, left: bool) -> Complex:
        """Newton's step for z = O phi(z), or for y = J^H I psi(y) of left vectors.

        Args:
            s: eigenvalues, conjugate for left vectors [1/s].
            z: what the loads were made of.
            seen: O phi, or I psi, that followed.
            left: which of the two.
        """
        return z + self.answer(s, (self.forces.left(s, seen) if left else seen) - z, left)

    def answer(self, s: Complex, x: Complex, left: bool) -> Complex:
        """E^-1 x, or E^-H x, to some powers of lambda."""
        solve = self._solve_left if left else self._solve
        E1, E2 = (E.T if left else E for E in self._E[1:3])
        return series_answer(lambda v: on_parts(solve, v), E1, E2, s, x, ANSWERS)

    def _solve(self, x: Array) -> Array:
        """E_0^-1 x: of the motions only the gaps act on others."""
        if self._lu is None:
            return x
        n, below = self.forces.n, self._E[0][self.forces.n :, : self.forces.n]
        gaps = la.lu_solve(self._lu, x[:n], check_finite=False)
        return np.vstack([gaps, x[n:] - below @ gaps])

    def _solve_left(self, x: Array) -> Array:
        """E_0^-T x."""
        if self._lu is None:
            return x
        n, below = self.forces.n, self._E[0][self.forces.n :, : self.forces.n]
        gaps = la.lu_solve(self._lu, x[:n] - below.T @ x[n:], trans=1, check_finite=False)
        return np.vstack([gaps, x[n:]])
