"""Reference facets of the contact faces: shape functions of degree one and two, and subdivision.

Nodes: corners in cyclic order, then (degree two) middles of edges, then the centre of a
quadrilateral. A triangle's edge a lies opposite to corner a, a quadrilateral's runs from a on.
Reference coordinates (x, y): corners (0,0), (1,0), (0,1) or (0,0), (1,0), (1,1), (0,1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FacetElement:
    """Lagrange facet.

    Attributes:
        corners: 3 or 4.
        degree: 1 or 2.
    """

    corners: int
    degree: int

    @property
    def nodes(self) -> Array:
        """Reference positions of the nodes, shape (nodes, 2)."""
        if self.corners == 3:
            corner = np.array([[0.0, 0], [1, 0], [0, 1]])
            middle = np.array([[0.5, 0.5], [0, 0.5], [0.5, 0]])
        else:
            corner = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
            middle = np.array([[0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5], [0.5, 0.5]])
        return corner if self.degree == 1 else np.vstack([corner, middle])

    @property
    def triangles(self) -> list[tuple[int, int, int]]:
        """Corners of the triangles that a facet is cut into."""
        return [(0, 1, 2)] if self.corners == 3 else [(0, 1, 2), (0, 2, 3)]

    @property
    def tributary(self) -> Array:
        """Share of each node in the area, the facet halved along every edge, shape (nodes,)."""
        if self.corners == 3:
            share = [1 / 3] * 3 if self.degree == 1 else [1 / 12] * 3 + [1 / 4] * 3
        else:
            share = [1 / 4] * 4 if self.degree == 1 else [1 / 16] * 4 + [1 / 8] * 4 + [1 / 4]
        return np.array(share)

    def shape(self, x: Array) -> Array:
        """Shape functions at reference points x, shape (..., 2); returns (..., nodes)."""
        return self._values(x)[0]

    def gradient(self, x: Array) -> Array:
        """Derivatives of the shape functions, shape (..., nodes, 2)."""
        return self._values(x)[1]

    def outside(self, x: Array) -> Array:
        """How far reference points lie outside, 0 inside; shape (..., 2) to (...)."""
        lowest = np.minimum(x[..., 0], x[..., 1])
        if self.corners == 3:
            lowest = np.minimum(lowest, 1 - x[..., 0] - x[..., 1])
        else:
            lowest = np.minimum(lowest, 1 - np.maximum(x[..., 0], x[..., 1]))
        return np.maximum(-lowest, 0.0)

    def _values(self, x: Array) -> tuple[Array, Array]:
        return self._triangle(x) if self.corners == 3 else self._quadrilateral(x)

    def _triangle(self, x: Array) -> tuple[Array, Array]:
        L = np.stack([1 - x[..., 0] - x[..., 1], x[..., 0], x[..., 1]], axis=-1)
        dL = np.array([[-1.0, -1.0], [1, 0], [0, 1]])
        if self.degree == 1:
            return L, np.broadcast_to(dL, (*x.shape[:-1], 3, 2))
        a, b = np.array([1, 0, 0]), np.array([2, 2, 1])
        value = np.concatenate([L * (2 * L - 1), 4 * L[..., a] * L[..., b]], axis=-1)
        corner = (4 * L - 1)[..., None] * dL
        edge = 4 * (L[..., a, None] * dL[b] + L[..., b, None] * dL[a])
        return value, np.concatenate([corner, edge], axis=-2)

    def _quadrilateral(self, x: Array) -> tuple[Array, Array]:
        f, df = zip(*(_line(x[..., c], self.degree) for c in (0, 1)), strict=True)
        place = np.rint(self.degree * self.nodes).astype(int)
        i, j = place[:, 0], place[:, 1]
        value = f[0][..., i] * f[1][..., j]
        slope = np.stack([df[0][..., i] * f[1][..., j], f[0][..., i] * df[1][..., j]], axis=-1)
        return value, slope


def _line(t: Array, degree: int) -> tuple[Array, Array]:
    """Lagrange functions on [0, 1] with equal spacing, and their derivatives; shape (..., n)."""
    one = np.ones_like(t)
    if degree == 1:
        return np.stack([1 - t, t], axis=-1), np.stack([-one, one], axis=-1)
    value = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=-1)
    return value, np.stack([4 * t - 3, 4 - 8 * t, 4 * t - 1], axis=-1)
