"""Parts to one distributed mesh: gmsh on rank 0, names kept in a table.

All bodies live in one mesh, as components that share no node; layers of one part share faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError

Builder = tuple[Any, Any]


@dataclass(frozen=True, slots=True)
class Mesh:
    """A tagged mesh.

    Attributes:
        domain: the DOLFINx mesh.
        cell_tags: tag of each cell, by ``layers``.
        facet_tags: tag of each named boundary facet, by ``faces``.
        layers: "part.layer" -> cell tag.
        faces: "part.face" -> facet tag.
        quality: smallest ratio of inscribed to circumscribed radius (3 r / R) over all cells.
    """

    domain: Any
    cell_tags: Any
    facet_tags: Any
    layers: dict[str, int]
    faces: dict[str, int]
    quality: float


def build_mesh(parts: Mapping[str, Builder], comm: MPI.Comm, minimum_quality: float = 0.01) -> Mesh:
    """Build and mesh all parts with gmsh, and distribute the mesh.

    Args:
        parts: part name -> (builder module with ``build(occ, parameters)``, its parameters).
        comm: communicator of the mesh.
        minimum_quality: a mesh with a worse cell is refused.

    Returns:
        The tagged mesh.

    Raises:
        SceneError: a builder refuses its parameters, or the mesh is too bad; on all ranks.
    """
    tables: tuple[dict[str, int], dict[str, int], float] | Exception | None = None
    model = None
    if comm.rank == 0:
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        try:
            gmsh.model.add("brake")
            tables = _gmsh_model(gmsh.model, parts, minimum_quality)
            model = gmsh.model
        except Exception as error:
            tables = SceneError(f"the mesh cannot be built: {error}")
    tables = comm.bcast(tables, root=0)
    try:
        if isinstance(tables, Exception) or tables is None:
            raise tables or SceneError("no mesh was built")
        domain, cell_tags, facet_tags = compat.mesh_from_gmsh(model, comm)
    finally:
        if comm.rank == 0:
            gmsh.finalize()
    layers, faces, quality = tables
    return Mesh(domain, cell_tags, facet_tags, layers, faces, quality)


def check_parts(parts: Mapping[str, Builder], faces: Mapping[str, str], comm: MPI.Comm) -> None:
    """Build the geometry without meshing it, so that a mistake shows before any work.

    Args:
        parts: as for ``build_mesh``.
        faces: face names that the scene uses, with the key that uses each.
        comm: communicator of the run.

    Raises:
        SceneError: a builder refuses its parameters, or there is no such face; on all ranks.
    """
    text = None
    if comm.rank == 0:
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        try:
            gmsh.model.add("check")
            known = set()
            for name, (builder, values) in parts.items():
                text = f"parts.{name}: "
                known |= {f"{name}.{f}" for f in builder.build(gmsh.model.occ, values).faces}
            missing = [(key, face) for key, face in faces.items() if face not in known]
            text = None
            if missing:
                key, face = missing[0]
                text = f"{key}: no face {face!r}; there are {', '.join(sorted(known))}"
        except Exception as error:
            text = f"{text}the geometry cannot be built: {error}; change its parameters"
        finally:
            gmsh.finalize()
    text = comm.bcast(text, root=0)
    if text is not None:
        raise SceneError(text)


def _gmsh_model(
    model: Any, parts: Mapping[str, Builder], minimum_quality: float
) -> tuple[dict[str, int], dict[str, int], float]:
    """Build, name and mesh on rank 0."""
    import gmsh

    built = {name: builder.build(model.occ, values) for name, (builder, values) in parts.items()}
    layers: dict[str, int] = {}
    faces: dict[str, int] = {}
    sizes = []
    for name, part in built.items():
        for layer, tags in part.volumes.items():
            layers[f"{name}.{layer}"] = model.addPhysicalGroup(3, tags)
            sizes.append((part.sizes[layer], tags))
        for face, tags in part.faces.items():
            faces[f"{name}.{face}"] = model.addPhysicalGroup(2, tags)
    # Coarse layers first: where two layers share a face the finer size holds.
    for size, tags in sorted(sizes, key=lambda item: -item[0]):
        points = model.getBoundary([(3, t) for t in tags], recursive=True, combined=False)
        model.mesh.setSize(points, size)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    gmsh.option.setNumber("Mesh.Optimize", 1)
    model.mesh.generate(3)
    quality = _worst_quality(model)
    if quality < minimum_quality:
        raise ValueError(
            f"worst cell has quality {quality:.3g}, at least {minimum_quality} is needed:"
            " change the mesh sizes"
        )
    return layers, faces, quality


def _worst_quality(model: Any) -> float:
    """Smallest 3 r / R over the tetrahedra of the gmsh model; 1 for a regular one."""
    nodes, x, _ = model.mesh.getNodes()
    where = np.zeros(int(nodes.max()) + 1, dtype=int)
    where[nodes.astype(int)] = np.arange(nodes.size)
    _, _, cells = model.mesh.getElements(3)
    corner = x.reshape(-1, 3)[where[cells[0].astype(int)]].reshape(-1, 4, 3)
    a, b, c = (corner[:, i] - corner[:, 0] for i in (1, 2, 3))
    volume6 = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
    area = 0.5 * sum(
        np.linalg.norm(np.cross(p, q), axis=1) for p, q in ((a, b), (b, c), (c, a), (b - a, c - a))
    )
    inscribed = 0.5 * volume6 / area
    top = (
        np.cross(b, c) * np.sum(a * a, axis=1)[:, None]
        + np.cross(c, a) * np.sum(b * b, axis=1)[:, None]
        + np.cross(a, b) * np.sum(c * c, axis=1)[:, None]
    )
    circumscribed = np.linalg.norm(top, axis=1) / (2 * volume6)
    return float(np.min(3 * inscribed / circumscribed))
