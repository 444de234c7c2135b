"""Vectors of some modes on the full problem, improved step by step, from the right or the left.

A mode phi = Phi a + psi of a sample has psi = -R_0 [I' c + lambda C (Phi a + psi) + lambda^2 M psi]
with the forces c = J z at contact, z = O phi, and its left one likewise with the transposed
matrices. Where Phi spans what modes of a sample's own stiffness hardly differ from,

    K0 Phi = M Phi Lambda + E,   Phi'E = 0,

the load is E a more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.condensation import Solves

from ..complex_columns import Operator, times
from ..modes import Complex
from .contact_forces import ContactForces

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Asked(Protocol):
    """A sample in the reduced model, see ``DampedSample``."""

    forces: ContactForces
    sigma: float

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


class Columns(Operator, Protocol):
    """A matrix, or what multiplies like one."""

    @property
    def T(self) -> Operator:
        """The transposed matrix."""


@dataclass(frozen=True, slots=True)
class Reference:
    """The full problem without contact, or on springs k0, and the modes that are kept of it.

    Attributes:
        rest: what the kept modes leave of K0^-1.
        M: mass [kg].
        Phi: kept modes, shape (dofs, modes).
        Lambda: their eigenvalues [1/s^2].
        defect: E, shape (dofs, modes); None where Phi are modes of K0.
    """

    rest: Solves
    M: sp.csr_matrix
    Phi: Columns
    Lambda: Array
    defect: Operator | None = None


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
        reference: Reference,
        matrices: tuple[sp.csr_matrix, sp.csr_matrix, sp.csr_matrix],
        s: Complex,
        a: Complex,
        left: bool,
    ):
        """Begin with the vectors of the reduced model.

        Args:
            sample: the sample in the reduced model.
            reference: the full problem without the sample's contact.
            matrices: damping C of the bodies [N s/m], rows O of the interface that are looked at,
                rows I that forces act along.
            s: eigenvalues of right vectors [1/s], shape (modes,).
            a: coordinates in the kept modes, shape (kept modes, modes).
            left: whether the vectors are left ones.
        """
        self.sample, self.M, self.left, self.a = sample, reference.M, left, a
        self.C, self.O, self.I = matrices
        self.s = s
        if left:
            self.s, self.C, self.O, self.I = s.conj(), self.C.T.tocsr(), self.I, self.O
        self.z = sample.left_gaps(s, a) if left else sample.gaps(s, a)
        self.Phi, self.Lambda, self.rest = reference.Phi, reference.Lambda, reference.rest
        self._sigma, self._defect = sample.sigma, reference.defect
        self.modal, self._missed = times(self.Phi, a), self._defective(a)
        self.load = self.psi = np.zeros_like(self.modal)

    @property
    def vector(self) -> Complex:
        """Phi a + psi."""
        return np.asarray(self.modal + self.psi)

    @property
    def _inertia(self) -> Complex:
        """What the mass is multiplied by, beside its share sigma in K0."""
        return np.asarray(self.s**2 - self._sigma)

    def next(self) -> Complex:
        """Load of the next step, which ``rest`` answers."""
        c = self.z if self.left else self.sample.forces(self.s, self.z)
        self.load = -(self.I.T @ c) - self._inertia * times(self.M, self.psi)
        if self._missed is not None:
            self.load -= self._missed
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
        inertia = self._inertia * self.vector + times(self.Phi, kept)
        r = times(self.M, inertia) + self.load + self.I.T @ force
        if self._missed is not None:
            r += self._missed
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
        if self._missed is not None:
            self._missed = self._missed @ weights

    def keep(self, chosen: Index) -> None:
        """Go on with some of the vectors."""
        self.s = self.s[chosen]
        self.a, self.psi, self.z, self.load, self.modal = (
            x[:, chosen] for x in (self.a, self.psi, self.z, self.load, self.modal)
        )
        if self._missed is not None:
            self._missed = self._missed[:, chosen]

    def add(self, da: Complex) -> None:
        """Change the coordinates."""
        self.a = self.a + da
        self.modal, self._missed = times(self.Phi, self.a), self._defective(self.a)

    def _defective(self, a: Complex) -> Complex | None:
        """E a."""
        return None if self._defect is None else times(self._defect, a)
