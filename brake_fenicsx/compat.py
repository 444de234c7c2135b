"""Every difference between DOLFINx versions, found by asking for the attribute.

Supported: what Debian ships, 12 (0.5.2), 13 (0.9) and unstable (0.11).
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import numpy as np
from dolfinx import fem

from brake_fenicsx.errors import SceneError

basix: Any = import_module("basix")


def vector_space(mesh: Any, degree: int) -> Any:
    """Continuous Lagrange space of vectors on a mesh, of a given degree."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", degree))


def mesh_from_gmsh(model: Any, comm: MPI.Comm) -> tuple[Any, Any, Any]:
    """Distribute the current gmsh model from rank 0.

    Args:
        model: ``gmsh.model`` on rank 0, ignored elsewhere.
        comm: communicator of the mesh.

    Returns:
        The mesh, its cell tags and its facet tags.
    """
    # On several threads PT-Scotch, which cuts the mesh, cuts it otherwise from run to run.
    os.environ.setdefault("SCOTCH_PTHREAD_NUMBER", "1")
    try:
        gmshio: Any = import_module("dolfinx.io.gmsh")
    except ImportError:
        gmshio = import_module("dolfinx.io.gmshio")
    data = gmshio.model_to_mesh(model, comm, 0, gdim=3)
    if hasattr(data, "mesh"):
        return data.mesh, data.cell_tags, data.facet_tags
    return data[0], data[1], data[2]


def geometry_dofs(mesh: Any) -> np.ndarray:
    """Geometry node of each cell's vertex, shape (cells, nodes)."""
    geometry = mesh.geometry
    dofs = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
    return dofs if isinstance(dofs, np.ndarray) else dofs.array.reshape(-1, dofs.offsets[1])


def cell_name(mesh: Any) -> str:
    """Name of the mesh's cells, "tetrahedron" or "hexahedron"."""
    name = mesh.ufl_cell().cellname
    return str(name() if callable(name) else name)


def degree(V: Any) -> int:
    """Polynomial degree of a space."""
    found = V.ufl_element().degree
    return int(found() if callable(found) else found)


def facet_vertices(mesh: Any) -> list[list[int]]:
    """Local vertices of each local facet of a cell."""
    cell = getattr(basix.CellType, cell_name(mesh))
    return [list(f) for f in basix.topology(cell)[2]]


def triangle_rule(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Quadrature on the reference triangle: points, shape (n, 2), and weights of sum 1/2."""
    x, w = basix.make_quadrature(basix.CellType.triangle, degree)
    return np.asarray(x), np.asarray(w)


def cell_dofs(V: Any, cells: np.ndarray) -> np.ndarray:
    """Local blocks of dofs of some cells, shape (cells, blocks)."""
    dofs, width = V.dofmap.list, V.dofmap.dof_layout.num_dofs
    table = dofs if isinstance(dofs, np.ndarray) else dofs.array.reshape(-1, width)
    return np.asarray(table[cells], dtype=np.int64)


def require_real_petsc() -> None:
    """Refuse a PETSc of complex scalars: factors, inertia and the real-equivalent forms are real.

    Raises:
        SceneError: one line that names the build in use and the remedy.
    """
    if np.issubdtype(PETSc.ScalarType, np.complexfloating):
        raise SceneError(
            f"PETSC_DIR = {os.environ.get('PETSC_DIR', '')!r}: this PETSc is built for complex"
            " numbers; use the real build (on Debian python3-dolfinx-real and"
            " PETSC_DIR=/usr/lib/petscdir/petsc-real)"
        )


def meshtags(mesh: Any, dim: int, entities: np.ndarray, value: int) -> Any:
    """Tag some entities of a mesh with one value."""
    entities = np.sort(entities).astype(np.int32)
    return dolfinx.mesh.meshtags(mesh, dim, entities, np.full(entities.size, value, np.int32))


def vtx_writer(comm: MPI.Comm, path: Path, functions: list[Any]) -> Any:
    """Writer of functions of one space with all their dofs; None where there is no ADIOS2."""
    from dolfinx import io

    if not hasattr(io, "VTXWriter"):
        return None
    return io.VTXWriter(comm, str(path), functions)
