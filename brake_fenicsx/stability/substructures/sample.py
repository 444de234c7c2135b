"""The reduced problem of one sample: a block matrix, contact, friction, errors of zeros.

Without contact it is a block matrix over kept coordinates and contact rows. With the kept
coordinates a of all bodies, the motions y that contact forces follow, and the forces f that they
make,

    own(w) a + lead(w) f = 0,        own = W'P W - D_XX,      lead = W'I' - D_XI,
    y + D(w) f = source(w) a,        D = D_OI,                source = O W - D_OX,

and with loads q the terms load(w) q and push(w) q on the right, load = W'F - D_XF, push = -D_OF;
the letters those of ``component``. Each is a polynomial in w, summed over the bodies here and
nowhere else. Samples, lines of them, equilibrium and limit cycles are algebra on it. At
equilibrium, lambda = 0, elastic coordinates are eliminated; those of a body that moves freely
without contact, or nearly so, have no inverse and are kept.

To first order a change dD of a sample's matrix, which contact and friction complete, moves a zero
by [eta; b]' dD [J y; a] / (b'T'a). Close to another zero that is not the size of the move: two
zeros that merge move by its root (Kato, Perturbation Theory for Linear Operators, 1980,
chapter II).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index, Mask

from ..eigensolvers.eigenpairs import of_parts, parts_of
from . import component, contact_rows, parameters, polynomials, sample_problem
from .polynomials import Blocks
from .sample_problem import column_products

# First-order moves larger than this share of the distance to the next zero are not of first order.
CLOSE = 0.125

# An estimate is a few sizes of terms added up; it is stated with this factor.
SAFETY = 2.0

# A kept mode is free if its frequency at the centre of the box lies below this share of the band's.
FREE = 1e-2


@dataclass(frozen=True, slots=True)
class BlockMatrix:
    """Coefficients in powers of w, in units of the band's end.

    Attributes:
        own: shape (kept modes, kept modes) each.
        lead: shape (kept modes, acting rows) each.
        source: shape (followed rows, kept modes) each.
        D: shape (followed rows, acting rows) each; those beyond the first in single precision.
    """

    own: list[Blocks]
    lead: list[Blocks]
    source: list[Blocks]
    D: list[AnyArray]


@dataclass(frozen=True, slots=True)
class Chosen:
    """Some contact elements of all bodies.

    Attributes:
        elements: their numbers.
        here: places of those of a body among its own elements.
        there: places among those chosen.
    """

    elements: Index
    here: list[Index]
    there: list[Index]

    @classmethod
    def of(cls, bodies: Sequence[component.Placed], elements: Index, every: int) -> "Chosen":
        """Choose elements.

        Args:
            bodies: the bodies of the brake.
            elements: numbers of those chosen, shape (chosen,).
            every: number of all of them.
        """
        at = np.full(every, -1)
        at[elements] = np.arange(elements.size)
        here = [np.flatnonzero(at[body.elements] >= 0) for body in bodies]
        there = [at[body.elements[i]] for body, i in zip(bodies, here, strict=True)]
        return cls(elements, here, there)

    @property
    def count(self) -> int:
        """Number of them."""
        return int(self.elements.size)

    def rows(self, number: int, blocks: int, own: int) -> tuple[Index, Index]:
        """Places in several blocks of rows: of a body, and of the chosen elements.

        Args:
            number: of the body.
            blocks: number of blocks.
            own: number of elements of the body.
        """
        steps = np.arange(blocks)[:, None]
        here, there = self.here[number], self.there[number]
        return (here + own * steps).ravel(), (there + self.count * steps).ravel()


def assembled(
    bodies: Sequence[component.Placed],
    views: Sequence[component.AtPoint],
    rows: contact_rows.Rows,
    followed: Chosen,
    acting: Chosen | None = None,
) -> BlockMatrix:
    """Sum the bodies.

    Args:
        bodies: the bodies of the brake.
        views: each of them at a point of the box.
        rows: blocks of contact rows.
        followed: elements whose motions are wanted.
        acting: elements in which forces act; the same if None.
    """
    acting = followed if acting is None else acting
    f, g = len(rows.followed), len(rows.acting)
    size = bodies[-1].modes.stop
    out, D = BlockMatrix([], [], [], []), []
    for number, (body, view) in enumerate(zip(bodies, views, strict=True)):
        modes, m = body.modes, body.elements.size
        O, seen = followed.rows(number, f, m)
        I, met = acting.rows(number, g, m)
        own, lead, source = [*view.modal], [view.acting[I].T], [view.followed[O]]
        if body.component.coupled:
            X = slice(g * m, g * m + modes.stop - modes.start)
            own = _less(own, [A[f * m :, X] for A in view.D])
            lead = _less(lead, [A[f * m :, I] for A in view.D])
            source = _less(source, [A[O, X] for A in view.D])
        _put(out.own, own, (size, size), modes, modes)
        _put(out.lead, lead, (size, g * acting.count), modes, met)
        _put(out.source, source, (f * followed.count, size), seen, modes)
        flat = O[:, None] * view.D[0].shape[1] + I
        if number == 0 and flat.shape == (f * followed.count, g * acting.count):
            # A body that has all elements has them in their order.
            D = [np.take(A, flat, mode="clip") for A in view.D]
            continue
        D = D or [np.zeros((f * followed.count, g * acting.count), A.dtype) for A in view.D]
        if flat.size:
            places = [[_square(a, b) for b in np.split(met, g)] for a in np.split(seen, f)]
            _add(D, view.D, flat, places)
    return replace(out, D=D)


def _put(
    out: list[Blocks], terms: list[Array], shape: tuple[int, int], rows: Any, columns: Any
) -> None:
    """Add the coefficients of a body to those of the brake, of some shape."""
    out += [Blocks(shape, []) for _ in terms[len(out) :]]
    for coefficient, A in zip(out, terms, strict=False):
        coefficient.blocks.append((rows, columns, A))


def _less(terms: list[Array], others: list[AnyArray]) -> list[Array]:
    """Coefficients less others, as many as there are of either."""
    both = zip_longest(terms, others, fillvalue=0.0)
    return [np.asarray(A - B, float) for A, B in both]


def _add(
    D: list[AnyArray],
    coefficients: parameters.Powers,
    flat: Index,
    places: list[list[tuple[Any, Any]]],
) -> None:
    """Add some entries of a body's coefficients to D.

    Args:
        D: shape (followed rows, acting rows) each.
        coefficients: of the body.
        flat: places of the entries in their memory: faster than picking by rows and columns.
        places: rows and columns of each of their blocks in D.
    """
    parts = [np.empty(flat.shape, A.dtype) for A in coefficients[:2]]
    for n, A in enumerate(coefficients):
        # One at a time stays in the cache; in place and without checks of bounds it takes two
        # thirds of the time.
        part = np.take(A, flat, out=parts[min(n, 1)], mode="clip")
        for line, row in zip(places, np.split(part, len(places)), strict=True):
            for place, block in zip(line, np.hsplit(row, len(line)), strict=True):
                D[n][place] += block


def _square(rows: Index, columns: Index) -> tuple[Any, Any]:
    """Rows and columns as slices where they can be, ten times as fast."""
    slices = [
        slice(int(at[0]), int(at[-1]) + 1)
        if np.array_equal(at, np.arange(at[0], at[0] + at.size))
        else None
        for at in (rows, columns)
    ]
    if None not in slices:
        return slices[0], slices[1]
    first, second = np.ix_(rows, columns)
    return first, second


@dataclass(frozen=True, slots=True)
class AtRest:
    """A body at rest, its elastic coordinates eliminated.

    Attributes:
        normal: gaps of its contact elements under normal forces in them [m/N], symmetric, shape
            (elements, elements).
        slip: under friction in them, likewise.
        pushed: under loads, shape (elements, loads).
        motion: gaps of its free coordinates, shape (elements, free).
        onto: forces on the free coordinates, shape (free, 2 elements + loads).
        Z: stiffness of the free coordinates [1/s^2], shape (free, free).
    """

    normal: Array
    slip: Array
    pushed: Array
    motion: Array
    onto: Array
    Z: Array

    @classmethod
    def of(
        cls, body: component.Component, view: component.AtPoint, free: Mask,
        rows: contact_rows.Rows, omega: float,
    ) -> "AtRest":  # fmt: skip
        """Take a body at a point of the box.

        Args:
            body: the body.
            view: the body at this point.
            free: its kept modes that move freely, shape (kept modes,).
            rows: blocks of contact rows.
            omega: end of the band [rad/s].
        """
        m, loads, unit = body.body.elements.size, body.loads.T, 1 / omega**2
        f, g = len(rows.followed), len(rows.acting)
        w = -rows.shift if rows.damped else contact_rows.SIGMA
        own, D = _at(w, view.modal), _at(w, view.D)
        end = D.shape[1] - loads.shape[1]
        forces = np.r_[: 2 * m, end : D.shape[1]]
        seen, pushed = view.followed[:m], np.hstack([view.acting[: 2 * m].T, loads])
        if body.coupled:
            X = slice(g * m, end)
            own, seen, pushed = own - D[f * m :, X], seen - D[:m, X], pushed - D[f * m :, forces]
        held = np.linalg.solve(own[np.ix_(~free, ~free)], np.hstack([pushed, own[:, free]])[~free])
        through, back = seen[:, ~free] @ held, own[np.ix_(free, ~free)] @ held
        count = forces.size
        gaps = through[:, :count]
        motion = seen[:, free] - through[:, count:]
        gaps[:, : 2 * m] += D[:m, : 2 * m]
        gaps[:, 2 * m :] += D[:m, end:]
        gaps *= unit
        normal, slip, loaded = np.split(gaps, [m, 2 * m], axis=1)
        return cls(
            0.5 * (normal + normal.T), slip, loaded, motion,
            pushed[free] - back[:, :count],
            np.asarray((own[np.ix_(free, free)] - back[:, count:]) / unit, float),
        )  # fmt: skip


def _at(w: float, coefficients: Sequence[AnyArray] | Array) -> Array:
    """Value of a polynomial."""
    out = np.array(coefficients[0], float)
    for n, A in enumerate(coefficients[1:], 1):
        out += A.dtype.type(w**n) * A
    return out


def static_compliance(
    bodies: Sequence[component.Placed], parts: Sequence[AtRest], free: Mask, stiffness: Array
) -> tuple[Array, Array, Array]:
    """Static compliance: gaps and free coordinates; see ``macro.equilibrium.Compliance``.

    Args:
        bodies: the bodies of the brake.
        parts: each of them at rest.
        free: kept modes that move freely, shape (kept modes,).
        stiffness: typical one of the contact elements [N/m], shape (elements,): free coordinates
            are scaled so that the gaps, and forces of this stiffness, are about as large as theirs.

    Returns:
        Shapes (all, all), (all, elements) and (all, loads) [m/N], all: elements and coordinates.
    """
    n, count = stiffness.size, int(free.sum())
    loads = bodies[0].component.loads.shape[0]
    NN, NT = np.zeros((n + count, n + count)), np.zeros((n + count, n))
    NF, motion, Z = np.zeros((n + count, loads)), np.zeros((n, count)), np.zeros((count, count))
    normal, slip, pushed = NN[n:, :n], NT[n:], NF[n:]
    first = 0
    for body, part in zip(bodies, parts, strict=True):
        e, m = body.elements, body.elements.size
        own = slice(first, first + len(part.Z))
        first = own.stop
        if m:
            square = _square(e, e)
            NN[square] += part.normal
            NT[square] += part.slip
        NF[e] += part.pushed
        motion[e, own], Z[own, own] = part.motion, part.Z
        normal[own, e], slip[own, e], pushed[own] = np.split(part.onto, [m, 2 * m], axis=1)
    column = 1 / np.maximum(np.abs(motion).max(axis=0, initial=0.0), 1e-300)
    row = 1 / np.maximum(np.abs(normal) @ stiffness, 1e-300)[:, None]
    for onto in (normal, slip, pushed):
        onto *= row
    NN[:n, n:] = -motion * column
    NN[n:, n:] = row * Z * column - np.eye(count)
    return NN, NT, NF


def _forced(
    lead: Blocks, contact: contact_rows.ContactLinearisation, rows: contact_rows.Rows
) -> Blocks:
    """Lead J: each body under the forces in its own elements."""
    count, blocks = contact.k.size, []
    for modes, met, A in lead.blocks:
        there = met[: met.size // len(rows.acting)]
        seen = (there + count * np.arange(len(rows.followed))[:, None]).ravel()
        blocks.append((modes, seen, contact.part(there).after(A, rows)))
    return Blocks((lead.shape[0], count * len(rows.followed)), blocks)


class Sample(sample_problem.SampleProblem):
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
        bodies: Sequence[component.Placed],
        x: Array,
        views: Sequence[component.AtPoint],
        contact: contact_rows.ContactLinearisation,
        rows: contact_rows.Rows,
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
        forced = [_forced(A, contact, rows) for A in b.lead]
        super().__init__(E, b.source, forced, b.own, rows)

    def polynomial_errors(self, z: Complex, q: sample_problem.Quotient) -> Array:
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
            parts, turned = parts_of(loads[np.r_[there, g * c + modes]].astype(np.complex64))
            columns = np.r_[acting, g * m + np.arange(modes.size)]
            flat = rows[:, None] * comp.missing.shape[2] + columns

            def terms(
                errors: NDArray[np.float32], left: AnyArray = left,
                flat: Index = flat, parts: AnyArray = parts, turned: Index = turned,
            ) -> Complex:  # fmt: skip
                """[eta; b]' A [J u; a] of several matrices A, shape (matrices, zeros)."""
                picked = (np.take(error, flat, mode="clip") for error in errors)
                moved = (of_parts(error @ parts, turned) for error in picked)
                return np.array([column_products(left, x) for x in moved])

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

    zeros: polynomials.Zeros
    slope: Array
    error: Array


def corrected(
    found: polynomials.Zeros, q: sample_problem.Quotient, interpolated: Array
) -> Corrected:
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
    first = (q.unsolved + interpolated) * np.abs(q.slope) + sample_problem.ROUND_OFF
    # What zeros other than the nearest one would add to the second order.
    coupling = la.norm(products, axis=0) * la.norm(products, axis=1)
    first = (first[of] + coupling[of] / second) / new
    zeros = polynomials.Zeros(every, some, right, left)
    simple, close = first + first**2 / gap, first + np.sqrt(first * gap)
    return Corrected(zeros, new, SAFETY * np.where(first < CLOSE * gap, simple, close))


def moved_by_others(found: polynomials.Zeros, some: Index, rest: Complex, T: Array) -> Array:
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
    slopes = np.einsum("im,im->m", found.left, polynomials.applied(slope, found.z, found.right))
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
