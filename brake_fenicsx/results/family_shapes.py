"""Shapes of families at points of the bodies, by which two runs are compared, whatever their mesh.

Families of another run have coordinates in another basis, on another mesh perhaps. What both have
are places: the displacement of a family at nodes of the mesh, and the body that each belongs to.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from brake_fenicsx.samples.numbering import body_centres

Array = NDArray[np.float64]
Index = NDArray[np.intp]

FILE = "shapes.npz"

# Nodes at most: 3 mm apart on average in the reference brake.
MOST_POINTS = 20_000


def family_shapes(
    points: Array, body: Index, u: NDArray[np.complex128], numbers: Index
) -> dict[str, NDArray]:
    """Displacements of families at nodes, as arrays to store.

    Args:
        points: coordinates [m] and direction (0, 1, 2) of every free dof, shape (dofs, 4).
        body: number of the body of every dof, shape (dofs,).
        u: displacement of a mode of each family, shape (dofs, families).
        numbers: number of each family.

    Returns:
        "points" [m], shape (nodes, 3); "body", the centre of the body of each node [m], likewise;
        "shapes", shape (families, nodes, 3), of unit norm; "families".
    """
    centre = body_centres(points, body)
    moves = points[:, 3] < 3
    points, centre, u = points[moves], centre[moves], u[moves]
    # Rounded, so that the components of one node have one place whatever the round-off.
    nodes, first, place = np.unique(
        np.round(np.column_stack([points[:, :3], centre]), 9),
        axis=0, return_index=True, return_inverse=True,
    )  # fmt: skip
    vectors = np.zeros((u.shape[1], len(nodes), 3), complex)
    vectors[:, place.ravel(), points[:, 3].astype(int)] = u.T
    step = max(1, -(-len(nodes) // MOST_POINTS))
    chosen = vectors[:, ::step]
    size = np.linalg.norm(chosen.reshape(len(chosen), -1), axis=1)
    return {
        "points": nodes[::step, :3], "body": centre[first][::step],
        "shapes": (chosen / np.maximum(size, 1e-300)[:, None, None]).astype(np.complex64),
        "families": numbers,
    }  # fmt: skip


def shapes_at_dofs(
    shapes: Mapping[str, NDArray], points: Array, body: Index
) -> NDArray[np.complex128]:
    """Displacements of stored families at the free dofs of another mesh: of the nearest nodes.

    Args:
        shapes: what ``family_shapes`` gave.
        points: coordinates [m] and direction (0, 1, 2) of every free dof, shape (dofs, 4).
        body: number of the body of every dof, shape (dofs,).

    Returns:
        Shape (dofs, families).
    """
    nodes = np.column_stack([shapes["points"], shapes["body"]])
    places = np.column_stack([points[:, :3], body_centres(points, body)])
    nearest = KDTree(nodes).query(places)[1]
    moves = points[:, 3] < 3
    found = shapes["shapes"][:, nearest, np.where(moves, points[:, 3], 0).astype(int)] * moves
    return np.asarray(found.T, dtype=complex)
