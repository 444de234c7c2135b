"""Refinement of single undamped modes on the full problem: that of damped ones, with C = 0."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..complex_columns import times
from ..modes import Complex
from .contact_forces import ContactForces
from .damped_correction import Refined
from .sample import Sample
from .trial_vectors import Reference

Array = NDArray[np.float64]


class Refinement:
    """The full problem of one undamped sample."""

    def __init__(self, sample: Sample, reference: Reference, N: sp.csr_matrix, T: sp.csr_matrix):
        """Keep what the steps need.

        Args:
            sample: the sample in the reduced model.
            reference: the full problem without the sample's contact.
            N: gap operator, shape (elements, dofs).
            T: slip operator.
        """
        none = sp.csr_matrix(reference.M.shape)
        rows = sp.vstack([N, T]).tocsr()
        self._full = Refined(_AsDamped(sample), reference, none, N, rows)

    def __call__(
        self, kappa: Complex, a: Complex, b: Complex, tolerance: float | Array
    ) -> tuple[Complex, Array]:
        """Some eigenvalues of the full problem, and how far off they may be.

        Args:
            kappa: eigenvalues of the reduced model without negative imaginary part [1/s^2], shape
                (modes,); close ones together.
            a: right vectors in the kept modes, shape (kept modes, modes).
            b: left ones.
            tolerance: half the relative error of kappa wanted, one or one per mode.

        Returns:
            Both in 1/s^2; of modes that do not get there the second is what was reached.
        """
        # Of +-lambda the one that swings forward: a conjugate kappa is a neighbour like others.
        pair, n = np.flatnonzero(kappa.imag > 0), kappa.size
        s = np.sqrt(-kappa.astype(complex))
        s = np.where(s.imag < 0, -s, s)
        s = np.r_[s, -s[pair].conj()]
        right, left = (np.hstack([x, x[:, pair].conj()]) for x in (a, b))
        wanted = np.broadcast_to(tolerance, (n,))
        s, bound = self._full(s, right, left, np.r_[wanted, wanted[pair]])
        new, error = -(s**2), 2 * np.abs(s) * bound
        # What is real stays so, and mates stay mates: as far as they do not, nothing is known.
        error[:n] += np.where(kappa.imag == 0, np.abs(new[:n].imag), 0.0)
        error[pair] = np.maximum(error[pair], error[n:]) + np.abs(new[pair] - new[n:].conj())
        # About to merge, the two of a pair may have changed places.
        turned = new[:n].real + 1j * np.abs(new[:n].imag)
        return np.where(kappa.imag == 0, new[:n].real, turned), error[:n]


class _AsDamped:
    """An undamped sample, asked as a damped one: its kappa, shift and all, is -lambda^2."""

    sigma = 0.0

    def __init__(self, sample: Sample):
        n = sample.dD.size
        self.sample = sample
        self.forces = ContactForces(sample.dD, sample.mD, {}, 2 * n)

    def at(self, s: complex, derivative: bool = False) -> Complex:
        """T or T' at lambda = s."""
        K, M, Q = self.sample.operators
        return 2 * s * M + 4 * s**3 * Q if derivative else K + s**2 * M + s**4 * Q

    def gaps(self, s: Complex, a: Complex) -> Complex:
        """Gaps of some right vectors."""
        return self.sample.gaps(a, -(s**2))

    def left_gaps(self, s: Complex, b: Complex) -> Complex:
        """Gap multipliers of some left vectors."""
        return self.answer(s.conj(), times(self.sample.B.T, b), left=True)

    def improved(self, s: Complex, z: Complex, seen: Complex, left: bool) -> Complex:
        """Newton's step, see ``DampedSample``."""
        return z + self.answer(s, (self.forces.left(s, seen) if left else seen) - z, left)

    def answer(self, s: Complex, x: Complex, left: bool) -> Complex:
        """E^-1 x, or E^-H x."""
        return self.sample.answer(-(s**2), x, int(left))
