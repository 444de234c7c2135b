"""Vectors of some modes on the full problem, improved step by step, from the right or the left.

A mode phi = Phi a + psi of a sample has psi = -R_0 [I' c + lambda C (Phi a + psi) + lambda^2 M psi]
with the forces c = J z at contact, z = O phi, and its left one likewise with the transposed
matrices.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.solver import Factor

from ..complex_columns import times
from ..modes import Complex
from .basis import Basis
from .contact_forces import ContactForces
from .deflation import Deflated

Array = NDArray[np.float64]


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


class Reference(Protocol):
    """The real modes of the reference and its factor, see ``Reduced``."""

    factor: Factor
    basis: Basis
    Phi: Array
    M: sp.csr_matrix
    N: sp.csr_matrix
    T: sp.csr_matrix


class TrialVectors:
    """Right or left vectors of some modes; in the left ones I and O, C and C' change places.

    Attributes:
        s: eigenvalues, conjugate ones of the left vectors [1/s], shape (modes,).
        a: coordinates in the kept modes, shape (kept modes, modes).
        psi: all else, shape (dofs, modes).
        rest: solves with the reference, kept modes taken out.
    """

    def __init__(
        self,
        sample: Asked,
        reduced: Reference,
        matrices: tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix],
        s: Complex,
        a: Complex,
        left: bool,
    ):
        """Begin with the vectors of the reduced model.

        Args:
            sample: the sample in the reduced model.
            reduced: real modes and factor of the reference.
            matrices: damping C of the bodies [N s/m], rows O of the interface that are looked at,
                rows I that forces act along.
            s: eigenvalues of right vectors [1/s], shape (modes,).
            a: coordinates in the kept modes, shape (kept modes, modes).
            left: whether the vectors are left ones.
        """
        self.sample, self.M, self.left, self.a = sample, reduced.M, left, a
        self.C, self.O, self.I = matrices
        self.s = s
        if left:
            self.s, self.C, self.O, self.I = s.conj(), self.C.T.tocsr(), self.I, self.O
        self.z = sample.left_gaps(s, a) if left else sample.gaps(s, a)
        self.Phi, self.Lambda = reduced.Phi, reduced.basis.Lambda
        self.rest = Deflated(reduced.factor, self.Phi, self.Lambda)
        self.modal = times(self.Phi, a)
        self.load = self.psi = np.zeros_like(self.modal)

    @property
    def vector(self) -> Complex:
        """Phi a + psi."""
        return np.asarray(self.modal + self.psi)

    def next(self) -> Complex:
        """Load of the next step, which ``rest`` answers."""
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

    def slope(self) -> Complex:
        """P' phi, or that of the conjugate transposed problem."""
        x = self.vector
        seen, forces = self.O @ x, self.sample.forces
        ones = np.ones_like(self.s)
        rate = (
            forces.left(ones, seen) - forces.left(0 * ones, seen)
            if self.left
            else forces.rate(seen)
        )
        out = 2 * self.s * times(self.M, x) + self.I.T @ rate
        return out + times(self.C, x) if self.C.nnz else out

    def combine(self, weights: Complex, s: Complex) -> None:
        """Go on with combinations of the vectors.

        Args:
            weights: column by column, shape (modes, modes).
            s: their eigenvalues, of right vectors.
        """
        self.s = s.conj() if self.left else s
        self.a, self.psi, self.z, self.load, self.modal = (
            x @ weights for x in (self.a, self.psi, self.z, self.load, self.modal)
        )

    def add(self, da: Complex) -> None:
        """Change the coordinates."""
        self.a = self.a + da
        self.modal = times(self.Phi, self.a)
