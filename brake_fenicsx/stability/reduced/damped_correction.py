"""Refinement of single damped modes on the full problem, with the factor of the reference at hand.

A mode phi = Phi a + psi of a sample has psi = -R_0 [I' c + lambda C (Phi a + psi) + lambda^2 M psi]
with the forces c = J z at contact, z = O phi, and its left one likewise with the transposed
matrices. A few steps on either side, and the two-sided quotient of the full problem

    lambda -> lambda - psi^H P phi / psi^H P' phi,     P = K0 + lambda C + lambda^2 M + I' J O,

is wrong by the product of what is left on both sides. Phi' P phi moves the coordinates a by a step
of Newton's with the T of the reduced model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from ..complex_columns import on_parts, times
from ..modes import Complex
from .contact_forces import ContactForces
from .deflation import Deflated

if TYPE_CHECKING:
    from ..reduction import Reduced

Array = NDArray[np.float64]

# Steps on either side before the residuals are looked at, and how often at most.
STEPS, ROUNDS = 6, 8

# The coordinates lag behind what the last steps add: the bound is taken so many times.
DOUBT = 3.0


class Asked(Protocol):
    """A sample in the reduced model, see ``DampedSample``."""

    forces: ContactForces

    def at(self, s: complex, derivative: bool = False) -> Complex:
        """T or T' at lambda = s."""

    def gaps(self, s: Complex, a: Complex) -> Complex:
        """Motion z at contact of some right vectors."""

    def left_gaps(self, s: Complex, b: Complex) -> Complex:
        """Gap multipliers of some left vectors."""

    def improved(self, s: Complex, z: Complex, seen: Complex, left: bool) -> Complex:
        """Newton's step for z = O phi(z), or for its left counterpart."""

    def answer(self, s: Complex, x: Complex, left: bool) -> Complex:
        """E^-1 x, or E^-H x."""


class Refined:
    """The full problem of one sample."""

    def __init__(
        self,
        sample: Asked,
        reduced: Reduced,
        C: sp.csr_matrix,
        O: sp.csr_matrix,
        I: sp.csr_matrix,
    ):
        """Keep what the steps need.

        Args:
            sample: the sample in the reduced model.
            reduced: real modes and factor of the reference.
            C: damping of the bodies [N s/m].
            O: rows of the interface that are looked at.
            I: rows that forces act along.
        """
        self.sample, self.reduced = sample, reduced
        self.C, self.O, self.I = C, O, I

    def right(self, s: Complex, a: Complex) -> Complex:
        """Right vectors of some modes, shape (dofs, modes)."""
        side = _Side(self, s, a, self.sample.gaps(s, a), left=False)
        for _ in range(STEPS):
            side.take(on_parts(side.rest.solve, side.next()))
        return side.vector

    def __call__(
        self, s: Complex, a: Complex, b: Complex, tolerance: float
    ) -> tuple[Complex, Array]:
        """Some eigenvalues of the full problem, and how far off they may be.

        Args:
            s: eigenvalues of the reduced model [1/s], shape (modes,).
            a: right vectors in the kept modes, shape (kept modes, modes).
            b: left ones.
            tolerance: relative error wanted.

        Returns:
            Both in 1/s; of modes that do not get there the second is what was reached.
        """
        right = _Side(self, s, a, self.sample.gaps(s, a), left=False)
        left = _Side(self, s, b, self.sample.left_gaps(s, b), left=True)
        best: Complex = s
        least: Array = np.full(s.size, np.inf)
        before: Array = np.full(s.size, np.inf)
        for _ in range(ROUNDS):
            for _ in range(STEPS):
                answers = on_parts(right.rest.solve, np.hstack([right.next(), left.next()]))
                right.take(answers[:, : s.size])
                left.take(answers[:, s.size :])
            x, y = right.vector, left.vector.conj()
            r, q = right.residual(), left.residual()
            slope = 2 * s * times(self.reduced.M, x) + times(self.C, x)
            slope += self.I.T @ self.sample.forces.rate(self.O @ x)
            scale = np.einsum("im,im->m", y, slope)
            with np.errstate(all="ignore"):
                change = -np.einsum("im,im->m", y, r) / scale
                left_over = self._product(s, right.rest.solve, r, q) / np.abs(scale)
            change = np.where(s.imag == 0, change.real, change)
            # One change may be small by chance, two in a row are not.
            bound = DOUBT * (left_over + np.sqrt(np.abs(change) * before))
            before = np.abs(change)
            s = s + change
            if not np.all(np.isfinite(s)):
                break
            better = bound < least
            best, least = np.where(better, s, best), np.where(better, bound, least)
            if np.all(least <= tolerance * np.abs(s)):
                break
            right.move(s, left.a, r)
            left.move(s, right.a, q)
        return best, least

    def _product(
        self, s: Complex, solve: Callable[[Array], Array], r: Complex, q: Complex
    ) -> Array:
        """|q^H x| of the answer x to r that the kept modes have no part in."""
        both = on_parts(solve, np.hstack([r, q]))
        x, y = both[:, : s.size], both[:, s.size :]
        z = self.sample.answer(s, self.O @ x, left=False)
        contact = np.einsum("im,im->m", (self.I @ y).conj(), self.sample.forces(s, z))
        return np.asarray(np.abs(np.einsum("im,im->m", y.conj(), r)) + np.abs(contact))


class _Side:
    """Right or left vectors of some modes; in the left ones I and O, C and C' change places."""

    def __init__(self, full: Refined, s: Complex, a: Complex, z: Complex, left: bool):
        reduced = full.reduced
        self.sample, self.M, self.z, self.left = full.sample, reduced.M, z, left
        self.s, self.C, self.O, self.I = s, full.C, full.O, full.I
        if left:
            self.s, self.C, self.O, self.I = s.conj(), full.C.T.tocsr(), full.I, full.O
        self.Phi, self.Lambda, self.a = reduced.Phi, reduced.basis.Lambda, a
        self.rest = Deflated(reduced.factor, self.Phi, self.Lambda)
        self.modal = times(self.Phi, a)
        self.load = self.psi = np.zeros_like(self.modal)

    @property
    def vector(self) -> Complex:
        """Phi a + psi."""
        return np.asarray(self.modal + self.psi)

    def next(self) -> Complex:
        """Load of the next step."""
        c = self.z if self.left else self.sample.forces(self.s, self.z)
        self.load = -(self.I.T @ c) - self.s**2 * times(self.M, self.psi)
        if self.C.nnz:
            self.load -= self.s * times(self.C, self.vector)
        return self.load

    def take(self, psi: Complex) -> None:
        """Go on with the answer to the load."""
        self.psi = psi
        self.z = self.sample.improved(self.s, self.z, self.O @ self.vector, self.left)

    def residual(self) -> Complex:
        """P phi, or that of the conjugate transposed problem."""
        seen = self.O @ self.vector
        force = (self.sample.forces.left if self.left else self.sample.forces)(self.s, seen)
        # K0 psi is the last load, less what its kept modes carry.
        kept = self.Lambda[:, None] * self.a - times(self.Phi.T, self.load)
        inertia = self.s**2 * self.vector + times(self.Phi, kept)
        r = times(self.M, inertia) + self.load + self.I.T @ force
        return r + self.s * times(self.C, self.vector) if self.C.nnz else r

    def move(self, s: Complex, others: Complex, r: Complex) -> None:
        """Newton's step of the coordinates: T a = -Phi' r, across the mode itself.

        Args:
            s: new eigenvalues, of the right vectors.
            others: coordinates of the other side.
            r: residual of the full problem.
        """
        kept = times(self.Phi.T, r)
        for m, value in enumerate(s):
            T, slope = self.sample.at(value), self.sample.at(value, derivative=True)
            if self.left:
                T, slope = T.conj().T, slope.conj().T
            own, other = slope @ self.a[:, m], slope.conj().T @ others[:, m]
            bordered = np.block([[T, own[:, None]], [other.conj()[None], np.zeros((1, 1))]])
            lu = la.lu_factor(bordered, check_finite=False)
            step = la.lu_solve(lu, -np.r_[kept[:, m], 0.0], check_finite=False)
            self.a = self.a + step[:-1, None] * (np.arange(s.size) == m)
        self.s, self.modal = s.conj() if self.left else s, times(self.Phi, self.a)
