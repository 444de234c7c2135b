"""A named face of the distributed mesh, gathered on every process in one order.

The order and the corners' order come from the mesh generator's node numbers, so that nothing
depends on how the mesh was distributed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx import compat

from .elasticity import FreeDofs, face_tag
from .mesh import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Face:
    """Triangular facets with quadratic displacement.

    Attributes:
        corners: corner positions [m], shape (facets, 3, 3).
        normal: outward unit normals, shape (facets, 3).
        area: areas [m^2], shape (facets,).
        columns: free number of each dof, -1 where held, shape (facets, 6, 3): corners, then
            middles of the edges opposite to corners 0, 1, 2.
    """

    corners: Array
    normal: Array
    area: Array
    columns: NDArray[np.int64]

    @property
    def centre(self) -> Array:
        """Centres [m], shape (facets, 3)."""
        return np.asarray(self.corners.mean(axis=1))

    @property
    def radius(self) -> Array:
        """Largest distance of a corner from the centre [m], shape (facets,)."""
        away = self.corners - self.centre[:, None]
        return np.asarray(np.linalg.norm(away, axis=2).max(axis=1))


def gather_face(mesh: Mesh, free: FreeDofs, face: str) -> Face:
    """Collect a named face on every process.

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs of a space of degree 2.
        face: name of the face.

    Returns:
        The face, identical on every process.
    """
    parts = mesh.domain.comm.allgather(_local_facets(mesh, free, face_tag(mesh, face, "contact")))
    key, corners, apex, columns = map(np.concatenate, zip(*parts, strict=True))
    order = np.lexsort(np.sort(key, axis=1).T[::-1])
    key, corners, apex, columns = key[order], corners[order], apex[order], columns[order]
    turn = np.argsort(key, axis=1)
    corners = np.take_along_axis(corners, turn[:, :, None], axis=1)
    # Corner a and the middle of the edge opposite to it keep the same place.
    columns = np.take_along_axis(columns, np.hstack([turn, turn + 3])[:, :, None], axis=1)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    inward = np.einsum("ij,ij->i", cross, apex - corners[:, 0]) > 0
    normal = np.where(inward, -1.0, 1.0)[:, None] * cross / length[:, None]
    return Face(corners, normal, 0.5 * length, columns)


def _local_facets(
    mesh: Mesh, free: FreeDofs, tag: int
) -> tuple[NDArray[np.int64], Array, Array, NDArray[np.int64]]:
    """Facets owned here: node numbers of the generator, corners, opposite corner, dof columns."""
    domain = mesh.domain
    topology, dim = domain.topology, domain.topology.dim
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    to_cell, to_facet = topology.connectivity(dim - 1, dim), topology.connectivity(dim, dim - 1)
    facets = mesh.facet_tags.find(tag)
    facets = facets[facets < topology.index_map(dim - 1).size_local]
    nodes, x = compat.geometry_dofs(domain), domain.geometry.x
    generator = np.asarray(domain.geometry.input_global_indices)
    columns = free.column.reshape(-1, 3)
    key = np.empty((facets.size, 3), dtype=np.int64)
    corners, apex = np.empty((facets.size, 3, 3)), np.empty((facets.size, 3))
    dofs = np.empty((facets.size, 6, 3), dtype=np.int64)
    for k, facet in enumerate(facets):
        cell = to_cell.links(facet)[0]
        # In a tetrahedron facet i lies opposite to corner i.
        i = int(np.flatnonzero(to_facet.links(cell) == facet)[0])
        local = [a for a in range(4) if a != i]
        key[k], corners[k] = generator[nodes[cell, local]], x[nodes[cell, local]]
        apex[k] = x[nodes[cell, i]]
        closure = free.V.dofmap.dof_layout.entity_closure_dofs(dim - 1, i)
        dofs[k] = columns[free.V.dofmap.cell_dofs(cell)[closure]]
    return key, corners, apex, dofs
