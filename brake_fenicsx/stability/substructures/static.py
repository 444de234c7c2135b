"""Static compliance of the contact elements: elastic motions in it, free ones beside it.

At lambda = 0 the kept coordinates a of a body and its gaps g obey, with the contact forces F along
N and H along T and loads f,

    A a = normal' F + slip' H + load' f,      g = gaps a + NN F + NT H + NF f,

NN, NT, NF what the kept modes leave out. Elastic coordinates are eliminated; those of a body that
moves freely without contact, or nearly so, have no inverse and are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .component import AtPoint, Component, Placed, square_of
from .rows import SIGMA, Rows

Array = NDArray[np.float64]

# A kept mode is free if its frequency at the centre of the box lies below this share of the band's.
FREE = 1e-2


@dataclass(frozen=True, slots=True)
class BodyCompliance:
    """A body seen from its contact elements, in units of the band's end.

    Attributes:
        NN: gaps by forces along N, shape (elements, elements).
        NT: gaps by forces along T.
        NF: gaps by loads, shape (elements, loads).
        motion: gaps by free coordinates, shape (elements, free).
        normal: forces on free coordinates along N, shape (free, elements).
        slip: the same along T.
        load: the same of loads, shape (free, loads).
        Z: forces on free coordinates that move, shape (free, free): round-off if they are free.
    """

    NN: Array
    NT: Array
    NF: Array
    motion: Array
    normal: Array
    slip: Array
    load: Array
    Z: Array


def body_compliance(comp: Component, view: AtPoint, rows: Rows, omega: float) -> BodyCompliance:
    """Static compliance of a body.

    Args:
        comp: the body.
        view: the body at a point of the box.
        rows: blocks of contact rows.
        omega: end of the band [rad/s].
    """
    # lambda = 0: z = sigma in kappa, z = -lambda_0 in lambda.
    z = -rows.shift if rows.damped else SIGMA
    D: Array = sum((z**n * A for n, A in enumerate(view.D)), start=np.zeros(1))
    A = np.tensordot(z ** np.arange(len(view.modal)), view.modal, 1)
    m, loads = comp.body.elements.size, comp.loads.shape[0]
    last = D.shape[1] - loads
    NN, NT, NF = D[:m, :m], D[:m, m : 2 * m], D[:m, last:]
    gaps, normal, slip, load = (
        view.followed[:m], view.acting[:m].T, view.acting[m : 2 * m].T, comp.loads.T,
    )  # fmt: skip
    if comp.coupled:
        X, first = slice(len(rows.acting) * m, last), len(rows.followed) * m
        A = A - D[first:, X]
        gaps, normal = gaps - D[:m, X], normal - D[first:, :m]
        slip, load = slip - D[first:, m : 2 * m], load - D[first:, last:]
    free = comp.kappa <= (FREE * omega) ** 2
    forces = np.hstack([normal, slip, load, A[:, free]])
    held = np.linalg.solve(A[np.ix_(~free, ~free)], forces[~free])
    through, onto = gaps[:, ~free] @ held, forces[free] - A[np.ix_(free, ~free)] @ held
    parts = (slice(m), slice(m, 2 * m), slice(2 * m, 2 * m + loads), slice(2 * m + loads, None))
    NN, NT, NF = (B + through[:, part] for B, part in zip((NN, NT, NF), parts, strict=False))
    motion = gaps[:, free] - through[:, parts[3]]
    return BodyCompliance(0.5 * (NN + NN.T), NT, NF, motion, *(onto[:, part] for part in parts))


def static_compliance(
    bodies: Sequence[Placed], parts: Sequence[BodyCompliance], stiffness: Array, omega: float
) -> tuple[Array, Array, Array]:
    """Gaps and free coordinates of all bodies; see ``macro.condensation.Compliance``.

    Args:
        bodies: the bodies of the brake.
        parts: the compliance of each.
        stiffness: typical one of the contact elements [N/m], shape (elements,): free coordinates
            are scaled so that the gaps, and forces of this stiffness, are about as large as theirs.
        omega: end of the band [rad/s].

    Returns:
        Shapes (all, all), (all, elements) and (all, loads) [m/N], all: elements and coordinates.
    """
    n, scale = stiffness.size, 1 / omega**2
    size = n + sum(part.Z.shape[0] for part in parts)
    loads = parts[0].NF.shape[1]
    NN, NT, NF = np.zeros((size, size)), np.zeros((size, n)), np.zeros((size, loads))
    first = n
    for body, part in zip(bodies, parts, strict=True):
        at = body.elements
        square = square_of(at)
        NN[square] += scale * part.NN
        NT[square] += scale * part.NT
        NF[at] += scale * part.NF
        own = slice(first, first + part.Z.shape[0])
        column = 1 / np.maximum(np.abs(part.motion).max(axis=0, initial=0.0), 1e-300)
        row = 1 / np.maximum(np.abs(part.normal) @ stiffness[at], 1e-300)
        NN[at, own] = -part.motion * column
        NN[own, at], NT[own, at] = row[:, None] * part.normal, row[:, None] * part.slip
        NF[own] = row[:, None] * part.load
        NN[own, own] = row[:, None] * (omega**2 * part.Z) * column
        first = own.stop
    NN[n:, n:] -= np.eye(size - n)
    return NN, NT, NF
