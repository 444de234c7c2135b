"""Every difference between DOLFINx versions, found by asking for the attribute.

Supported: what Debian ships, 12 (0.5.2), 13 (0.9) and unstable (0.11).
"""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

import os
import sys
import tempfile
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
_jit: Any = import_module("dolfinx.jit")
_own_forms: list[tempfile.TemporaryDirectory[str]] = []


def forms_folder(folder: Path) -> Path:
    """Folder for compiled forms that this process can write to, with those of ``folder`` in it.

    The forms that an image brings may be read-only: they are linked into a folder of this process,
    which takes those that are missing and goes with the process.

    Args:
        folder: where DOLFINx keeps compiled forms.

    Returns:
        The folder itself where it can be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    _own_forms.append(tempfile.TemporaryDirectory(prefix="fenics-"))
    own = Path(_own_forms[-1].name)
    if os.access(folder, os.R_OK | os.X_OK):
        for file in folder.iterdir():
            (own / file.name).symlink_to(file)
    return own


# Both read option files of the account and of the working directory ("scalar_type": "float32",
# "table_rtol": 1), which stand above what a program sets.
for _module in ("dolfinx.jit", "ffcx.options", "ffcx.parameters"):
    for _name in ("_load_options", "_load_parameters"):
        if hasattr(sys.modules.get(_module), _name):
            setattr(sys.modules[_module], _name, lambda: ({}, {}))

# Processes, and tests side by side, compile one form at the same time: the others wait for the
# first one [s]. The default of 10 s is short on a busy machine.
for _name in ("DOLFINX_DEFAULT_JIT_OPTIONS", "DOLFINX_DEFAULT_JIT_PARAMETERS"):
    if hasattr(_jit, _name):
        _options = getattr(_jit, _name)
        _options["timeout"] = (120, "Timeout for JIT compilation")
        _folder, _meaning = _options["cache_dir"]
        _options["cache_dir"] = (forms_folder(Path(_folder).expanduser()), _meaning)


def vector_space(mesh: Any, degree: int) -> Any:
    """Continuous Lagrange space of vectors on a mesh, of a given degree."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", degree))


def mesh_from_gmsh(model: Any) -> tuple[Any, Any, Any]:
    """The current gmsh model as a mesh of this process alone.

    Args:
        model: ``gmsh.model``.

    Returns:
        The mesh, its cell tags and its facet tags.
    """
    try:
        gmshio: Any = import_module("dolfinx.io.gmsh")
    except ImportError:
        gmshio = import_module("dolfinx.io.gmshio")
    data = gmshio.model_to_mesh(model, MPI.COMM_SELF, 0, gdim=3)
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
        raise SceneError(f"""PETSC_DIR = {os.environ.get("PETSC_DIR", "")!r}: this PETSc is built
            for complex numbers; use the real build (on Debian python3-dolfinx-real and
            PETSC_DIR=/usr/lib/petscdir/petsc-real)""")


def meshtags(mesh: Any, dim: int, entities: np.ndarray, value: int) -> Any:
    """Tag some entities of a mesh with one value."""
    entities = np.sort(entities).astype(np.int32)
    return dolfinx.mesh.meshtags(mesh, dim, entities, np.full(entities.size, value, np.int32))


def vtk_cells(V: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """VTK cells (n, nodes) over the dofs of ``V``, their types, and the dofs' positions [m]."""
    from dolfinx import plot

    make: Any = getattr(plot, "vtk_mesh", None) or getattr(plot, "create_vtk_mesh")  # noqa: B009
    cells, types, points = make(V)
    cells = np.asarray(cells)
    nodes = int(cells[0]) if cells.size else 1
    return cells.reshape(-1, nodes + 1)[:, 1:], np.asarray(types), np.asarray(points)
