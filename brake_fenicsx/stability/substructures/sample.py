"""The reduced problem of one sample: contact and friction that act in it, and errors of its zeros.

To first order a change dD moves a zero by [eta; b]' dD [J y; a] / (b'T'a). Close to
another zero that is not the size of the move: two zeros that merge move by its root (Kato,
Perturbation Theory for Linear Operators, 1980, chapter II).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index

from ..eigensolvers.eigenpairs import times
from .block_matrix import BlockMatrix, Chosen
from .component import AtPoint, Placed
from .contact_rows import ContactLinearisation, Rows
from .polynomials import Zeros, applied
from .sample_problem import ROUND_OFF, Quotient, SampleProblem

# First-order moves larger than this share of the distance to the next zero are not of first order.
CLOSE = 0.125

# An estimate is a few sizes of terms added up; it is stated with this factor.
SAFETY = 2.0


class Sample(SampleProblem):
    """The reduced problem of one sample.

    Attributes:
        bodies: the bodies.
        x: point of the box, shape (d,).
        views: each of them at the sample's point of the box.
        closed: closed contact elements, or all.
        contact: what acts in them, in units of the band's end.
    """

    # The quotient corrects y and eta by residuals with E_0 in double precision.
    _precision = np.float32

    def __init__(
        self,
        bodies: Sequence[Placed],
        x: Array,
        views: Sequence[AtPoint],
        contact: ContactLinearisation,
        rows: Rows,
        closed: Chosen,
        b: BlockMatrix,
    ):
        """Put the bodies under the forces of the contact elements.

        Args:
            bodies: the bodies of the brake.
            x: the sample's point of the box, shape (d,).
            views: each of them at the sample's point of the box.
            contact: what acts in the closed elements, in units of the band's end.
            rows: blocks of contact rows.
            closed: these elements; open ones may be among them.
            b: the bodies seen from them.
        """
        self.bodies, self.x, self.views = bodies, x, views
        self.closed: Chosen = closed
        self.contact = contact
        E = [contact.after(A, rows) for A in b.D]
        E[0][np.diag_indices(len(E[0]))] += 1.0
        forced = np.array([contact.after(A, rows) for A in b.lead])
        super().__init__(E, b.source, forced, b.own, rows)

    def polynomial_errors(self, z: Complex, q: Quotient) -> Array:
        """Estimated errors of z that the polynomials of the bodies make, all of them added."""
        c, f, g = self.closed.count, len(self.rows.followed), len(self.rows.acting)
        total = np.zeros(z.size)
        u = self.gaps_and_rates(z, q.y)
        loads = np.vstack([self.contact.forces(u, self.rows), q.right])
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
                error: NDArray[np.float32], left: AnyArray = left,
                rows: Index = rows, right: AnyArray = right,
            ) -> Complex:  # fmt: skip
                """[eta; b]' A [J u; a] of several matrices A, shape (matrices, zeros)."""
                picked = error if rows.size == error.shape[1] else error[:, rows]
                picked = picked.reshape(-1, error.shape[2])
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


@dataclass(frozen=True, slots=True)
class Corrected:
    """Zeros after the quotient.

    Attributes:
        zeros: with vectors.
        slope: modulus of b' T'(z) a for these unit vectors, shape (zeros,).
        error: what is stated.
    """

    zeros: Zeros
    slope: Array
    error: Array


def corrected(found: Zeros, q: Quotient, interpolated: Array) -> Corrected:
    """Zeros and errors by the two-sided quotient on all vectors together.

    With the vectors A and B of all zeros found, B' T(z) A is diagonal but for small products, those
    of the quotient. The eigenvalues of diag(z) - products / slope hold for close zeros too, which a
    quotient of one vector moves too far; its real form decides whether two of them are real or
    conjugate.

    Args:
        found: zeros of the expanded T.
        q: their quotient.
        interpolated: estimated errors of the polynomials in the frequency and over the box.
    """
    z, number = found.z, found.z.size
    if not number:
        return Corrected(found, np.zeros(0), np.zeros(0))
    pairs = np.flatnonzero(z.imag)
    P, Q = q.products
    products = np.block([[P, Q.conj()[:, pairs]], [Q[pairs], P.conj()[np.ix_(pairs, pairs)]]])
    slope = np.r_[q.slope, q.slope[pairs].conj()]
    # From coordinates along a and its conjugate to those along its real and imaginary part.
    U = np.eye(slope.size, dtype=complex)
    for conjugate, one in enumerate(pairs, number):
        both = np.array([one, conjugate])
        U[np.ix_(both, both)] = [[1, 1], [1j, -1j]]
    back = np.linalg.inv(U)
    H = np.diag(np.r_[z, z[pairs].conj()]) - products / slope[:, None]
    w, L, X = la.eig((U @ H @ back).real, left=True, check_finite=False)
    some = np.flatnonzero(w.imag >= 0)
    X, L = back @ X[:, some], (L[:, some].conj().T @ U).T
    right = np.hstack([found.right, found.right[:, pairs].conj()]) @ X
    left = np.hstack([found.left, found.left[:, pairs].conj()]) @ (L / slope[:, None])
    sizes = la.norm(right, axis=0), la.norm(left, axis=0)
    right, left = right / sizes[0], left / sizes[1]
    new = np.maximum(np.abs(np.sum(L * X, axis=0)) / (sizes[0] * sizes[1]), 1e-300)
    # The old zero that each new one is most of: its first-order moves, but for the slope.
    of = np.r_[np.arange(number), pairs][np.abs(X).argmax(axis=0)]
    others = np.delete(found.every, found.chosen)
    others = others[~np.isin(others, z[pairs].conj())]
    every = np.r_[w, others]
    gap, second = distances(every, some), distances(every, some, 2)
    first = (q.unsolved + interpolated) * np.abs(q.slope) + ROUND_OFF
    # What zeros other than the nearest one would add to the second order.
    coupling = la.norm(products, axis=0) * la.norm(products, axis=1)
    first = (first[of] + coupling[of] / second) / new
    zeros = Zeros(every, some, right, left)
    simple, close = first + first**2 / gap, first + np.sqrt(first * gap)
    return Corrected(zeros, new, SAFETY * np.where(first < CLOSE * gap, simple, close))


def moved_by_others(found: Zeros, some: Index, rest: Complex, T: Array) -> Array:
    """What each of all zeros would add to the quotients of some of them, to second order.

    Args:
        found: all zeros near the band.
        some: those that have a quotient.
        rest: residuals T(z) a of these, shape (kept modes, chosen).
        T: coefficients of the expanded T(z).

    Returns:
        Shape (zeros, chosen).
    """
    slope = [m * A for m, A in enumerate(T)][1:]
    slopes = np.einsum("im,im->m", found.left, applied(slope, found.z, found.right))
    apart = np.abs(found.z[:, None] - found.z[some])
    apart[some] = np.inf
    products = np.abs(found.left.T @ rest) ** 2
    sizes = np.maximum(np.abs(np.outer(slopes, slopes[some])), 1e-300)
    return np.asarray(products / sizes / np.maximum(apart, 1e-300))


def distances(z: Complex, chosen: Index, number: int = 1) -> Array:
    """Distance of some zeros to the next of all zeros, or to the next but one."""
    apart = np.abs(z[chosen][:, None] - z[None, :])
    apart[np.arange(chosen.size), chosen] = np.inf
    if apart.shape[1] <= number:
        return np.full(chosen.size, np.inf)
    return np.asarray(np.maximum(np.partition(apart, number - 1, axis=1)[:, number - 1], 1e-300))
