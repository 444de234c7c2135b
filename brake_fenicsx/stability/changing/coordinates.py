"""Coordinates in the spaces of all bodies, in which vectors of samples are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..modes import Complex, Modes
from .view import Seen

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Displacements W a of every body, one after the other.

    Attributes:
        bodies: the bodies.
    """

    bodies: Sequence[Seen]

    def displacements(self, coordinates: Complex) -> Complex:
        """Displacements of some coordinates, shape (dofs, columns); static answers left out."""
        out = np.zeros((sum(b.body.dofs.size for b in self.bodies), coordinates.shape[1]), complex)
        for body, own in zip(self.bodies, self._places(), strict=True):
            W, a, dofs = body.W, coordinates[own], body.body.dofs
            out.real[dofs], out.imag[dofs] = W @ a.real, W @ a.imag
        return out

    def projected(self, A: sp.csr_matrix, shapes: Array | None = None) -> Array:
        """Shapes' A U of the displacements U of all coordinates; U'A U without other shapes.

        Args:
            A: a symmetric matrix that does not couple the bodies, such as the mass, shape (dofs,
                dofs).
            shapes: other displacements, shape (dofs, columns).
        """
        places = self._places()
        size = places[-1].stop
        out = np.zeros((size if shapes is None else shapes.shape[1], size))
        for body, own in zip(self.bodies, places, strict=True):
            dofs = body.body.dofs
            inner = A[dofs][:, dofs].tocsr()
            inner.eliminate_zeros()
            # A layer's mass is there on a part of the body alone.
            rows = np.flatnonzero(np.diff(inner.indptr))
            W = body.W[rows]
            AW = inner[rows][:, rows] @ W
            if shapes is None:
                out[own, own] = W.T @ AW
            else:
                out[:, own] = shapes[dofs[rows]].T @ AW
        return out

    def _places(self) -> list[slice]:
        """Places of each body's."""
        ends = np.cumsum([0, *(body.directions for body in self.bodies)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def in_spaces(found: Modes, shapes: list[Array], function: str) -> Modes:
    """Modes with vectors in the bodies' spaces in place of their modes, the columns of shapes."""
    how = f"winding number of {function}, on bases complete by inertia at the anchors"
    return replace(
        found, right=_turned(shapes, found.right), left=_turned(shapes, found.left),
        count=replace(found.count, how=how),
    )  # fmt: skip


def _turned(shapes: list[Array], vectors: Complex) -> Complex:
    """Coordinates in the bodies' spaces from those in their modes, the columns of ``shapes``."""
    ends = np.cumsum([Q.shape[1] for Q in shapes])[:-1]
    parts = zip(shapes, np.split(vectors, ends), strict=True)
    return np.vstack([Q @ part for Q, part in parts])
