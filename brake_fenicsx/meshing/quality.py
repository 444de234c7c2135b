"""Shape of cells: how flat, how skew, and whether they are turned inside out."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from brake_fenicsx.arguments import Array, Ints

from .rawmesh import MIDDLES, RawMesh

# Neighbours of each corner of a hexahedron, right-handed.
_NEIGHBOURS = np.array(
    [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]]
)
# Corners of the reference cells, in [0, 1]^3.
_CORNERS = {
    "tetrahedron": np.vstack([np.zeros(3), np.eye(3)]),
    "hexahedron": np.array(
        [[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    ),
}


@dataclass(frozen=True, slots=True)
class Quality:
    """Worst cells of a mesh.

    Attributes:
        worst: the smallest measure: 3 r / R of tetrahedra (inscribed to circumscribed radius, 1 if
            regular), scaled Jacobian of hexahedra (1 for a box).
        cell: number of that cell.
        dihedral: smallest angle between two faces of a cell [rad].
        distortion: smallest Jacobian inside a curved cell, relative to the cell's largest; 1 where
            all cells are straight-sided.
    """

    worst: float
    cell: int
    dihedral: float
    distortion: float = 1.0


def quality(mesh: RawMesh) -> Quality:
    """Measures of a mesh; cells must be oriented, see ``orientation``."""
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        measure, angle = radius_ratio(x), dihedral(x)
    else:
        measure = corner_jacobians(x).min(axis=1)
        three = x[:, np.concatenate([np.arange(8)[:, None], _NEIGHBOURS], axis=1)]
        angle = dihedral(three.reshape(-1, 4, 3), at_first=True)
    worst = int(np.argmin(measure))
    distortion = 1.0
    if mesh.order == 2:
        J = jacobians(mesh)
        distortion = float((J.min(axis=1) / np.abs(J).max(axis=1)).min())
    return Quality(float(measure[worst]), worst, float(angle.min()), distortion)


def orientation(mesh: RawMesh) -> Ints:
    """+1 for cells of positive volume, -1 for cells turned as a whole, 0 for twisted or flat ones.

    Returns:
        Shape (cells,).
    """
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        size = np.prod(_edges_at_corner(x), axis=1)
        j = _volume6(x)[:, None] / np.where(size > 0, size, 1.0)[:, None]
    else:
        j = corner_jacobians(x)
    tiny = 1e-10
    return np.where((j > tiny).all(axis=1), 1, np.where((j < -tiny).all(axis=1), -1, 0))


def _edges_at_corner(x: Array) -> Array:
    """Lengths of the three edges at the first corner [m], shape (cells, 3)."""
    return np.asarray(np.linalg.norm(x[:, 1:4] - x[:, :1], axis=2))


def _volume6(x: Array) -> Array:
    a, b, c = (x[:, i] - x[:, 0] for i in (1, 2, 3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)))


def radius_ratio(x: Array) -> Array:
    """3 r / R of tetrahedra: 1 if regular, 0 if flat.

    Args:
        x: corners [m], shape (cells, 4, 3).
    """
    a, b, c = (x[:, i] - x[:, 0] for i in (1, 2, 3))
    volume6 = np.abs(_volume6(x))
    area = 0.5 * sum(
        np.linalg.norm(np.cross(p, q), axis=1) for p, q in ((a, b), (b, c), (c, a), (b - a, c - a))
    )
    top = (
        np.cross(b, c) * np.sum(a * a, axis=1)[:, None]
        + np.cross(c, a) * np.sum(b * b, axis=1)[:, None]
        + np.cross(a, b) * np.sum(c * c, axis=1)[:, None]
    )
    # r = V6 / (2 A), R = |top| / (2 V6).
    return np.asarray(3 * volume6**2 / (area * np.linalg.norm(top, axis=1)))


def dihedral(x: Array, at_first: bool = False) -> Array:
    """Smallest angle [rad] between two faces of each tetrahedron.

    Args:
        x: corners [m], shape (cells, 4, 3).
        at_first: look only at the three faces that meet at the first corner.

    Returns:
        Shape (cells,).
    """
    faces = ((0, 1, 2), (0, 2, 3), (0, 3, 1)) + (() if at_first else ((1, 3, 2),))
    n = np.stack([np.cross(x[:, b] - x[:, a], x[:, c] - x[:, a]) for a, b, c in faces], axis=1)
    n /= np.maximum(np.linalg.norm(n, axis=2), 1e-300)[:, :, None]
    i, j = np.triu_indices(len(faces), 1)
    cos = -np.einsum("cki,cki->ck", n[:, i], n[:, j])
    return np.asarray(np.arccos(np.clip(cos, -1, 1)).min(axis=1))


def corner_jacobians(x: Array) -> Array:
    """Scaled Jacobians of hexahedra at their corners.

    Args:
        x: corners [m], shape (cells, 8, 3).

    Returns:
        Triple products of the unit edges, shape (cells, 8).
    """
    e = x[:, _NEIGHBOURS] - x[:, :, None]
    e = e / np.maximum(np.linalg.norm(e, axis=3), 1e-300)[..., None]
    return np.asarray(np.einsum("cki,cki->ck", e[:, :, 0], np.cross(e[:, :, 1], e[:, :, 2])))


def jacobians(mesh: RawMesh) -> Array:
    """Jacobian determinants [m^3] of second-order cells at their nodes, shape (cells, nodes)."""
    x = mesh.points[mesh.cells]
    return np.asarray(np.linalg.det(np.einsum("cni,pnj->cpij", x, _gradients(mesh.shape))))


def determinants(mesh: RawMesh) -> Array:
    """Jacobian determinants at the nodes of second-order cells, at the corners of others [m^3].

    Up to a factor for each kind of cell; shape (cells, points).
    """
    if mesh.order == 2:
        return jacobians(mesh)
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        return _volume6(x)[:, None]
    e = x[:, _NEIGHBOURS] - x[:, :, None]
    return np.asarray(np.einsum("cki,cki->ck", e[:, :, 0], np.cross(e[:, :, 1], e[:, :, 2])))


def volumes(mesh: RawMesh) -> Array:
    """Volumes of the cells [m^3], shape (cells,); of curved ones by a rule of third order."""
    x = mesh.points[mesh.corners]
    if mesh.shape == "tetrahedron":
        if mesh.order == 1:
            return _volume6(x) / 6
        # Integrals of the ten shape functions.
        return np.asarray(jacobians(mesh) @ np.repeat([-1 / 120, 1 / 30], [4, 6]))
    if mesh.order == 1:
        middles = [x[:, [*some]].mean(axis=1, keepdims=True) for some in MIDDLES[mesh.shape]]
        x = np.concatenate([x, *middles], axis=1)
        J = np.linalg.det(np.einsum("cni,pnj->cpij", x, _gradients(mesh.shape)))
    else:
        J = jacobians(mesh)
    # Simpson's rule along each direction.
    return np.asarray(J @ (np.repeat([1, 4, 16, 64], [8, 12, 6, 1]) / 216))


def _gradients(shape: str) -> Array:
    """Gradients of the second-order shape functions at their nodes, shape (node, function, 3)."""
    corner = _CORNERS[shape]
    at = np.vstack([corner, *(corner[[*some]].mean(axis=0) for some in MIDDLES[shape])])
    most = 2 if shape == "tetrahedron" else 6
    powers = np.array([p for p in product(range(3), repeat=3) if sum(p) <= most])
    value = np.prod(at[:, None] ** powers, axis=2)
    lower = np.maximum(powers - np.eye(3, dtype=int)[:, None], 0)
    slope = powers.T[:, None] * np.prod(at[:, None] ** lower[:, None], axis=3)
    return np.asarray(np.einsum("kpm,mf->pfk", slope, np.linalg.inv(value)))
