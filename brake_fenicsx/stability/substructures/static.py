"""Static compliance of the contact elements: elastic motions in it, free ones beside it.

At lambda = 0 the kept coordinates a of a body and its gaps g obey, with the contact forces F along
N and H along T and loads f,

    A a = normal' F + slip' H + load' f,      g = gaps a + NN F + NT H + NF f,

NN, NT, NF what the kept modes leave out. Elastic coordinates are eliminated; those of a body that
moves freely without contact, or nearly so, have no inverse and are kept.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .block_matrix import BlockMatrix
from .contact_rows import SIGMA, Rows

Array = NDArray[np.float64]

# A kept mode is free if its frequency at the centre of the box lies below this share of the band's.
FREE = 1e-2


def static_compliance(
    b: BlockMatrix, free: NDArray[np.bool_], stiffness: Array, rows: Rows, omega: float
) -> tuple[Array, Array, Array]:
    """Gaps and free coordinates of all bodies; see ``macro.condensation.Compliance``.

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


def _at_rest(A: Iterable[NDArray[Any]], rows: Rows) -> Array:
    """A polynomial in w at lambda = 0."""
    w = -rows.shift if rows.damped else SIGMA
    return np.asarray(sum(w**n * B for n, B in enumerate(A)), float)
