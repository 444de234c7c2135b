"""The brake without contact as one block matrix over kept coordinates and contact rows.

With the kept coordinates a of all bodies, the motions y that contact forces follow, and the forces
f that they make,

    own(w) a + lead(w) f = 0,        own = W'P W - D_XX,      lead = W'I' - D_XI,
    y + D(w) f = source(w) a,        D = D_OI,                source = O W - D_OX,

and with loads q the terms load(w) q and push(w) q on the right, load = W'F - D_XF, push = -D_OF;
the letters those of ``seen_body``. Each is a polynomial in w, summed over the bodies here and
nowhere else. Samples, lines of them, equilibrium and limit cycles are algebra on it.

At equilibrium, lambda = 0, elastic coordinates are eliminated; those of a body that moves freely
without contact, or nearly so, have no inverse and are kept.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Index, Mask

from .component import AtPoint, Placed
from .contact_rows import SIGMA, Rows
from .parameters import Powers

# A kept mode is free if its frequency at the centre of the box lies below this share of the band's.
FREE = 1e-2


@dataclass(frozen=True, slots=True)
class BlockMatrix:
    """Coefficients in powers of w, in units of the band's end.

    Attributes:
        own: shape (coefficients, kept modes, kept modes).
        lead: shape (coefficients, kept modes, acting rows).
        source: shape (coefficients, followed rows, kept modes).
        D: shape (followed rows, acting rows) each; those beyond the first in single precision.
        load: shape (coefficients, kept modes, loads).
        push: shape (coefficients, followed rows, loads).
    """

    own: Array
    lead: Array
    source: Array
    D: list[AnyArray]
    load: Array
    push: Array


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
    def of(cls, bodies: Sequence[Placed], elements: Index, every: int) -> "Chosen":
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
    bodies: Sequence[Placed],
    views: Sequence[AtPoint],
    rows: Rows,
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
    coupled, count = any(b.component.coupled for b in bodies), len(views[0].D)
    size, last = bodies[-1].modes.stop, count if coupled else 1
    own = np.zeros((max(len(views[0].modal), count if coupled else 0), size, size))
    lead = np.zeros((last, size, g * acting.count))
    source = np.zeros((last, f * followed.count, size))
    D: list[AnyArray] = [
        np.zeros((f * followed.count, g * acting.count), A.dtype) for A in views[0].D
    ]
    loads = bodies[0].component.loads.shape[0]
    load, push = np.zeros((last, size, loads)), np.zeros((count, f * followed.count, loads))
    for number, (body, view) in enumerate(zip(bodies, views, strict=True)):
        modes, m = body.modes, body.elements.size
        O, seen = followed.rows(number, f, m)
        I, met = acting.rows(number, g, m)
        own[: len(view.modal), modes, modes] += view.modal
        source[0][seen, modes] += view.followed[O]
        lead[0][modes, met] += view.acting[I].T
        load[0][modes] += body.component.loads.T
        end = view.D[0].shape[1] - loads
        for n, A in enumerate(view.D):
            push[n][seen] -= A[O, end:]
        if body.component.coupled:
            X = slice(g * m, g * m + modes.stop - modes.start)
            for n, A in enumerate(view.D):
                own[n][modes, modes] -= A[f * m :, X]
                source[n][seen, modes] -= A[O, X]
                lead[n][modes, met] -= A[f * m :, I]
                load[n][modes] -= A[f * m :, end:]
        if O.size and I.size:
            places = [[_square(a, b) for b in np.split(met, g)] for a in np.split(seen, f)]
            _add(D, view.D, O[:, None] * view.D[0].shape[1] + I, places)
    return BlockMatrix(own, lead, source, D, load, push)


def _add(
    D: list[AnyArray],
    coefficients: Powers,
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


def static_compliance(
    b: BlockMatrix, free: Mask, stiffness: Array, rows: Rows, omega: float
) -> tuple[Array, Array, Array]:
    """Static compliance: gaps and free coordinates; see ``macro.condensation.Compliance``.

    Args:
        b: the bodies seen from all contact elements.
        free: kept modes that move freely, shape (kept modes,).
        stiffness: typical one of the contact elements [N/m], shape (elements,): free coordinates
            are scaled so that the gaps, and forces of this stiffness, are about as large as theirs.
        rows: blocks of contact rows.
        omega: end of the band [rad/s].

    Returns:
        Shapes (all, all), (all, elements) and (all, loads) [m/N], all: elements and coordinates.
    """
    n = stiffness.size
    A, lead, load = (_at_rest(X, rows) for X in (b.own, b.lead, b.load))
    D, gaps, push = (_at_rest([Y[:n] for Y in X], rows) for X in (b.D, b.source, b.push))
    NN, NT, NF = D[:, :n], D[:, n : 2 * n], -push
    forces = np.hstack([lead[:, : 2 * n], load, A[:, free]])
    held = np.linalg.solve(A[np.ix_(~free, ~free)], forces[~free])
    through, onto = gaps[:, ~free] @ held, forces[free] - A[np.ix_(free, ~free)] @ held
    ends = np.cumsum([n, n, load.shape[1]])
    (NN_, NT_, NF_, motion), (normal, slip, loads, Z) = (
        np.hsplit(X, ends) for X in (through, onto)
    )
    NN, NT, NF, motion = NN + NN_, NT + NT_, NF + NF_, gaps[:, free] - motion
    column = 1 / np.maximum(np.abs(motion).max(axis=0, initial=0.0), 1e-300)
    row = 1 / np.maximum(np.abs(normal) @ stiffness, 1e-300)[:, None]
    scale = 1 / omega**2
    corner = row * (omega**2 * Z) * column - np.eye(free.sum())
    return (
        np.block([[0.5 * scale * (NN + NN.T), -motion * column], [row * normal, corner]]),
        np.vstack([scale * NT, row * slip]),
        np.vstack([scale * NF, row * loads]),
    )


def _at_rest(A: Iterable[AnyArray], rows: Rows) -> Array:
    """A polynomial in w at lambda = 0."""
    w = -rows.shift if rows.damped else SIGMA
    return np.asarray(sum(w**n * B for n, B in enumerate(A)), float)
