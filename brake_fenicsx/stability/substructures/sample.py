"""The reduced problem of one sample: its bodies with the contact and friction that act in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..eigensolvers.arnoldi import times
from ..modes import Complex
from .component import AtPoint, Placed, square_of
from .contact import ContactForces, ContactLinearisation
from .rows import Rows
from .problem import Quotient, SampleProblem

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Closed:
    """Closed contact elements of a body.

    Attributes:
        here: places among the body's own elements.
        there: places among all closed elements.
    """

    here: Index
    there: Index

    def rows(self, blocks: int, own: int, every: int) -> tuple[Index, Index]:
        """Places in rows of several blocks: of the body, and of all closed elements.

        Args:
            blocks: number of blocks.
            own: number of elements of the body.
            every: number of closed elements.
        """
        steps = np.arange(blocks)[:, None]
        return (self.here + own * steps).ravel(), (self.there + every * steps).ravel()


class Sample(SampleProblem):
    """The reduced problem of one sample.

    Attributes:
        bodies: the bodies and where their closed elements are.
        closed: closed contact elements of each body.
        count: number of all of them.
        forces: J of the closed elements.
        E: coefficients of E(w).
        source: coefficients of source(w).
        T: coefficients of T(z).
    """

    # The quotient corrects y and eta by residuals with E_0 in double precision.
    _precision = np.float32

    def __init__(
        self,
        bodies: Sequence[Placed],
        views: Sequence[AtPoint],
        contact: ContactLinearisation,
        w: Array,
        rows: Rows,
        omega: float,
    ):
        """Assemble the bodies and eliminate the motions of the contact elements.

        Args:
            bodies: the bodies of the brake.
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
        self.bodies, self.views, self.rows = bodies, views, rows
        at = np.full(w.size, -1)
        at[closed] = np.arange(closed.size)
        self.closed = []
        for body in bodies:
            here = np.flatnonzero(at[body.elements] >= 0)
            self.closed.append(Closed(here, at[body.elements[here]]))
        self.forces = ContactForces.of(contact, w, closed, rows, omega)
        self.count = closed.size
        self._assemble(contact, w, omega)

    def _assemble(self, contact: ContactLinearisation, w: Array, omega: float) -> None:
        """E, source, forced and own of all bodies together."""
        rows, c = self.rows, self.count
        f, g = len(rows.followed), len(rows.acting)
        any_coupled = any(b.component.coupled for b in self.bodies)
        count = len(self.views[0].D)
        size = self.bodies[-1].modes.stop
        self.E = [np.zeros((f * c, f * c), A.dtype) for A in self.views[0].D]
        self.source = np.zeros((count if any_coupled else 1, f * c, size))
        self.forced = np.zeros((count if any_coupled else 1, size, f * c))
        length = max(len(self.views[0].modal), count if any_coupled else 0)
        self.own = np.zeros((length, size, size))
        for body, view, at in zip(self.bodies, self.views, self.closed, strict=True):
            comp, modes = body.component, body.modes
            m = body.elements.size
            own, place = at.rows(f, m, c)
            acting, _ = at.rows(g, m, c)
            elements = body.elements[at.here]
            J = ContactForces.of(contact, w, elements, rows, omega)
            self.own[: len(view.modal), modes, modes] += view.modal
            self.source[0][place, modes] += view.followed[own]
            lead = [view.acting[acting].T]
            if comp.coupled:
                first, second = f * m, g * m
                X = slice(second, second + comp.W.shape[1])
                for n, A in enumerate(view.D):
                    self.own[n][modes, modes] -= A[first:, X]
                    self.source[n][place, modes] -= A[own, X]
                lead = [-A[first:, acting] for A in view.D]
                lead[0] += view.acting[acting].T
            if at.here.size:
                for n, A in enumerate(lead):
                    self.forced[n][modes, place] += np.hstack([*J.blocks_after(A)])
                # Faster than picking by rows and columns; one moment at a time stays in the cache.
                flat = own[:, None] * view.D[0].shape[1] + acting
                parts = [np.empty(flat.shape, A.dtype) for A in view.D[:2]]
                squares = [[square_of(at.there, i * c, j * c) for j in range(f)] for i in range(f)]
                for n, A in enumerate(view.D):
                    # In place and without checks of bounds it takes two thirds of the time.
                    part = np.take(A, flat, out=parts[min(n, 1)], mode="clip")
                    for i, row in enumerate(np.split(part, f)):
                        for j, block in enumerate(J.blocks_after(row)):
                            self.E[n][squares[i][j]] += block
        self.E[0][np.diag_indices(f * c)] += 1.0

    def interpolation_errors(self, z: Complex, q: Quotient) -> Array:
        """Estimated errors of z that the polynomials of the bodies make, all of them added."""
        c, f, g = self.count, len(self.rows.followed), len(self.rows.acting)
        total = np.zeros(z.size)
        loads = np.vstack([self.forces(self.gaps_and_rates(z, q.y)), q.right])
        w = self.rows.variable(z)
        for body, view, at in zip(self.bodies, self.views, self.closed, strict=True):
            # Where no kept mode couples, D has no rows and columns of them.
            comp, modes = body.component, np.arange(body.modes.start, body.modes.stop)
            modes = modes if comp.coupled else modes[:0]
            m = body.elements.size
            own, place = at.rows(f, m, c)
            acting, there = at.rows(g, m, c)
            rows = np.r_[own, f * m + np.arange(modes.size)]
            left = q.left[np.r_[place, f * c + modes]].astype(np.complex64)
            # Whole rows in one product cost less than picking the closed elements of each moment.
            right = np.zeros((g * m + modes.size + comp.loads.shape[0], z.size), np.complex64)
            right[np.r_[acting, g * m + np.arange(modes.size)]] = loads[np.r_[there, g * c + modes]]

            def terms(error: NDArray[np.float32]) -> Complex:
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
