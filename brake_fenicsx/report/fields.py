"""Fields for ParaView: displacements of the equilibrium and of complex modes.

XDMF is written everywhere. It holds the values at the nodes of the mesh: on a mesh of straight
cells its vertices. There a second-order field is first interpolated into the first-order space,
openly: DOLFINx 0.5 would take the second-order field, write its vertex values and say nothing. Each
file says so in a comment at its head, and the log says so too. A mesh of curved second-order cells
has a node for every dof of a second-order field, and nothing is lost.

Where DOLFINx was built with ADIOS2 the same fields are written a second time as VTX (a folder
``.bp``), with every dof. ParaView opens both.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.compat import vector_space, vtx_writer
from brake_fenicsx.folder.log import logger
from brake_fenicsx.report.xdmf_text import write_tree

LOSS = (
    "Vertex values: the second-order field was interpolated into the first-order space of the same "
    "mesh; its mid-edge values are not in this file."
)
LOGGED = "values at vertices; mid-edge values are not exported to XDMF"
VTX_TOO = "{} contains the full quadratic field"
NO_VTX = "VTX files of the full quadratic field need a DOLFINx with ADIOS2"
NO_LOSS = "Values at all nodes of the mesh, one for every dof of the field."


def _geometry_degree(mesh: Any) -> int:
    """Order of the mesh's cells: 1 straight, 2 curved."""
    cmap = mesh.geometry.cmaps[0] if hasattr(mesh.geometry, "cmaps") else mesh.geometry.cmap
    return int(cmap.degree)


def _nodal_space(V: Any) -> tuple[Any, str]:
    """Space with one dof vector per node of the mesh, and what its files say of themselves."""
    nodal = vector_space(V.mesh, _geometry_degree(V.mesh))
    lost = V.dofmap.dof_layout.num_dofs > nodal.dofmap.dof_layout.num_dofs
    return nodal, LOSS if lost else NO_LOSS


def _function(V: Any, values: NDArray | float, name: str) -> Any:
    """Real function of ``V`` with the given local dofs."""
    from dolfinx import fem

    f = fem.Function(V)
    f.name = name
    f.x.array[:] = values
    return f


@contextmanager
def _xdmf(comm: Any, path: Path) -> Iterator[Any]:
    """XDMF file open for writing."""
    from dolfinx.io import XDMFFile

    with XDMFFile(comm, str(path), "w") as file:
        yield file


def write_fields(path: str | Path, V: Any, fields: Mapping[str, NDArray]) -> Path:
    """Write vector fields on one mesh for ParaView, at its nodes.

    On a mesh of straight cells the fields of the second-order space are interpolated into the
    first-order one before writing: what lies between the vertices is not in the file.

    Args:
        path: the XDMF file; its data go beside it, into the same name with ``.h5`` (``.bp``: VTX).
        V: vector function space of Lagrange elements, on a mesh of this process.
        fields: by name, all dofs of a field of ``V``, shape (dofs,); a complex field is a mode,
            scaled so that its largest displacement is 1, and becomes ``name_re`` and ``name_im``.

    Returns:
        The path of the XDMF file.
    """
    path = Path(path)
    parts = _parts(V, fields)
    nodal, note = _nodal_space(V)
    with _xdmf(V.mesh.comm, path) as file:
        file.write_mesh(V.mesh)
        for name, values in parts.items():
            file.write_function(_at_nodes(nodal, V, values, name), 0.0)
    _one_grid(path, note)
    functions = [_function(V, values, name) for name, values in parts.items()]
    _say(path, note, _write_vtx(path, functions, [(0.0, list(parts.values()))]))
    return path


def write_phases(path: str | Path, V: Any, mode: NDArray, frames: int = 24) -> Path:
    """Write one period of a complex mode as a time series: Re(mode exp(i theta)) over theta.

    Growth or decay is left out: the phase alone runs. The mode is scaled so that its largest
    displacement is 1. Values at the nodes, as in `write_fields`.

    Args:
        path: the XDMF file.
        V: vector function space of Lagrange elements, on a mesh of this process.
        mode: all dofs of the mode, complex, shape (dofs,).
        frames: number of instants; the time in the file is the phase [rad], 0 to 2 pi.

    Returns:
        The path of the XDMF file.
    """
    path = Path(path)
    _check_length(V, "mode", mode)
    mode = _unit_amplitude(V, mode)
    nodal, note = _nodal_space(V)
    with _xdmf(V.mesh.comm, path) as file:
        file.write_mesh(V.mesh)
        for theta in 2 * np.pi * np.arange(frames) / frames:
            instant = np.real(mode * np.exp(1j * theta))
            file.write_function(_at_nodes(nodal, V, instant, "displacement"), float(theta))
    _one_series(path, note)
    angles = 2 * np.pi * np.arange(frames) / frames
    steps = ((float(a), [np.real(mode * np.exp(1j * a))]) for a in angles)
    _say(path, note, _write_vtx(path, [_function(V, 0.0, "displacement")], steps))
    return path


def _write_vtx(
    path: Path, functions: list[Any], steps: Iterable[tuple[float, list[NDArray]]]
) -> bool:
    """Write functions with all their dofs beside ``path``; False where DOLFINx cannot.

    Args:
        path: the XDMF file.
        functions: of one space.
        steps: time, and the dofs of every function.
    """
    comm = functions[0].function_space.mesh.comm
    writer = vtx_writer(comm, path.with_suffix(".bp"), functions)
    if writer is None:
        return False
    for time, values in steps:
        for f, own in zip(functions, values, strict=True):
            f.x.array[:] = own
        writer.write(time)
    writer.close()
    return True


def _say(path: Path, note: str, vtx: bool) -> None:
    """Log what the file holds, and where the rest is."""
    rest = VTX_TOO.format(path.with_suffix(".bp").name) if vtx else NO_VTX
    logger.debug("%s: %s", path.name, f"{LOGGED}; {rest}" if note == LOSS else note)


def say_once(V: Any, folder: Path) -> None:
    """Log what the files of a folder lack, if they lack anything."""
    if _nodal_space(V)[1] == LOSS:
        rest = VTX_TOO.format("*.bp") if any(folder.glob("*.bp")) else NO_VTX
        logger.info("%s/*.xdmf: %s; %s", folder.name, LOGGED, rest)


def _parts(V: Any, fields: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Real fields by name; a complex one gives its real and its imaginary part."""
    parts: dict[str, NDArray] = {}
    for name, values in fields.items():
        _check_length(V, name, values)
        if np.iscomplexobj(values):
            values = _unit_amplitude(V, values)
            parts[f"{name}_re"], parts[f"{name}_im"] = values.real, values.imag
        else:
            parts[name] = values
    return parts


def _unit_amplitude(V: Any, mode: NDArray) -> NDArray:
    """A mode, which has no size of its own, with a largest displacement of 1."""
    size = np.linalg.norm(np.abs(mode).reshape(-1, V.dofmap.index_map_bs), axis=1)
    largest = float(size.max(initial=0.0))
    return mode / largest if largest > 0 else mode


def _check_length(V: Any, name: str, values: NDArray) -> None:
    """Raise if a field has not one value per dof."""
    n = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
    if np.shape(values) != (n,):
        raise ValueError(f"field {name}: shape {np.shape(values)}, the space has {n} dofs")


def _at_nodes(nodal: Any, V: Any, values: NDArray, name: str) -> Any:
    f = _function(nodal, 0.0, name)
    f.interpolate(_function(V, values, name))
    return f


def _one_grid(path: Path, note: str) -> None:
    """Move all fields into the grid of the mesh, so that ParaView shows them as one data set."""
    root = ElementTree.parse(path).getroot()
    domain = root.find("Domain")
    if domain is None:
        raise OSError(f"{path}: no domain in the file just written")
    mesh, *series = domain.findall("Grid")
    for collection in series:
        for attribute in collection.iter("Attribute"):
            mesh.append(attribute)
        domain.remove(collection)
    write_tree(path, root, note)


def _one_series(path: Path, note: str) -> None:
    """Give every instant the mesh itself, so that ParaView shows no second, resting body."""
    root = ElementTree.parse(path).getroot()
    domain = root.find("Domain")
    if domain is None:
        raise OSError(f"{path}: no domain in the file just written")
    mesh, series = domain.findall("Grid")
    for instant in series:
        for pointer in instant.findall("{http://www.w3.org/2001/XInclude}include"):
            instant.remove(pointer)
        instant[:0] = list(mesh)
    domain.remove(mesh)
    write_tree(path, root, note)
