"""The reduced problem of one sample: its bodies with the contact and friction that act in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..eigensolvers.arnoldi import times
from ..modes import Complex
from .block_matrix import Chosen, assembled
from .component import AtPoint, Placed
from .contact_rows import ContactForces, ContactLinearisation, Rows
from .sample_problem import Quotient, SampleProblem

Array = NDArray[np.float64]


class Sample(SampleProblem):
    """The reduced problem of one sample.

    Attributes:
        bodies: the bodies.
        x: point of the box, shape (d,).
        views: each of them at the sample's point of the box.
        closed: closed contact elements.
        forces: J of the closed elements.
    """

    # The quotient corrects y and eta by residuals with E_0 in double precision.
    _precision = np.float32

    def __init__(
        self,
        bodies: Sequence[Placed],
        x: Array,
        views: Sequence[AtPoint],
        contact: ContactLinearisation,
        w: Array,
        rows: Rows,
        omega: float,
    ):
        """Assemble the bodies under the forces of the contact elements.

        Args:
            bodies: the bodies of the brake.
            x: the sample's point of the box, shape (d,).
            views: each of them at the sample's point of the box.
            contact: what acts in its contact elements.
            w: areas of all elements [m^2].
            rows: blocks of contact rows.
            omega: end of the band [rad/s].
        """
        closed = contact.closed
        if not closed.size:
            # One open element in place of none: its force is zero. There may be no element at all.
            closed = np.arange(min(1, w.size))
        self.bodies, self.x, self.views = bodies, x, views
        self.closed: Chosen = Chosen.of(bodies, closed, w.size)
        self.forces = ContactForces.of(contact, w, closed, rows, omega)
        b = assembled(bodies, views, rows, self.closed)
        E = [np.hstack([*self.forces.blocks_after(A)]) for A in b.D]
        E[0][np.diag_indices(len(E[0]))] += 1.0
        forced = np.array([np.hstack([*self.forces.blocks_after(A)]) for A in b.lead])
        super().__init__(E, b.source, forced, b.own, rows)

    def polynomial_errors(self, z: Complex, q: Quotient) -> Array:
        """Estimated errors of z that the polynomials of the bodies make, all of them added."""
        c, f, g = self.closed.count, len(self.rows.followed), len(self.rows.acting)
        total = np.zeros(z.size)
        loads = np.vstack([self.forces(self.gaps_and_rates(z, q.y)), q.right])
        w = self.rows.variable(z)
        for number, (body, view) in enumerate(zip(self.bodies, self.views, strict=True)):
            # Where no kept mode couples, D has no rows and columns of them.
            comp, modes = body.component, np.arange(body.modes.start, body.modes.stop)
            modes = modes if comp.coupled else modes[:0]
            m = body.elements.size
            own, place = self.closed.rows(number, f, m)
            acting, there = self.closed.rows(number, g, m)
            rows = np.r_[own, f * m + np.arange(modes.size)]
            if not rows.size:
                continue
            left = q.left[np.r_[place, f * c + modes]].astype(np.complex64)
            # Whole rows in one product cost less than picking the closed elements of each.
            right = np.zeros((g * m + modes.size + comp.loads.shape[0], z.size), np.complex64)
            right[np.r_[acting, g * m + np.arange(modes.size)]] = loads[np.r_[there, g * c + modes]]

            def terms(
                error: NDArray[np.float32], left: NDArray[Any] = left,
                rows: NDArray[np.intp] = rows, right: NDArray[Any] = right,
            ) -> Complex:  # fmt: skip
                """[eta; b]' A [J u; a] of several matrices A, shape (matrices, zeros)."""
                picked = error[:, rows].reshape(-1, error.shape[2])
                product = times(picked, right).reshape(len(error), rows.size, z.size)
                return np.asarray(np.einsum("im,nim->nm", left, product))

            lacks = np.array([1.0, 1j])[: len(comp.missing)] @ terms(comp.missing)
            total += np.abs(lacks) * comp.growth(w)
            largest: Array = np.zeros(z.size)
            for error in view.errors:
                size = np.abs(terms(error) * w ** np.arange(len(error))[:, None])
                largest = np.maximum(largest, np.sum(size, axis=0))
            total += view.growth * largest
        return np.asarray(total / np.abs(q.slope))
