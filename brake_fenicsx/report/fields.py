"""Fields for ParaView and pyvista: displacements, modes and contact, one VTKHDF file each.

All dofs of a second-order field are written, on quadratic cells; a complex mode as its real and its
imaginary part, or as a series over one period. Files with steps need ParaView 5.12 or VTK 9.3.

Reference: VTK File Formats, "VTKHDF File Format", https://docs.vtk.org/en/latest/vtk_file_formats.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.folder.files import whole_file

VERTEX, TRIANGLE, QUADRILATERAL = 1, 5, 9  # types of VTK cells

Fields = Mapping[str, AnyArray]


def write_grid(
    path: str | Path,
    points: AnyArray,
    cells: AnyArray,
    kind: int,
    at_points: Fields | None = None,
    at_cells: Fields | None = None,
    times: Sequence[float] = (),
) -> Path:
    """Write an unstructured grid of cells of one kind.

    Args:
        path: the file.
        points: positions [m], shape (n, 3).
        cells: points of each cell in the order of VTK, shape (m, nodes).
        kind: type of the cells as VTK numbers them.
        at_points: values at the points by name, shape (n,) or (n, 3); with times (steps, n, 3).
        at_cells: values of the cells by name, shape (m,) or (m, 3).
        times: of the steps of the values at points; none: the values do not change.

    Returns:
        The path.
    """
    path = Path(path)
    with whole_file(path) as part, h5py.File(part, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = (2, 0) if len(times) else (1, 0)
        text = h5py.string_dtype("ascii", len("UnstructuredGrid"))
        root.attrs.create("Type", b"UnstructuredGrid", dtype=text)
        root["NumberOfPoints"], root["NumberOfCells"] = [len(points)], [len(cells)]
        root["NumberOfConnectivityIds"] = [cells.size]
        # VTK 9.2 and 9.3 show no cell unless both have integers of one kind.
        root["Points"], root["Connectivity"] = np.asarray(points, float), cells.ravel().astype("i8")
        root["Offsets"] = cells.shape[1] * np.arange(len(cells) + 1, dtype="i8")
        root["Types"] = np.full(len(cells), kind, np.uint8)
        for place, fields in (("PointData", at_points), ("CellData", at_cells)):
            group = root.create_group(place)
            for name, values in (fields or {}).items():
                group[name] = np.concatenate(values) if len(times) else values
        if len(times):
            _write_steps(root, times, len(points), list(at_points or {}))
    return path


def _write_steps(root: Any, times: Sequence[float], points: int, names: Sequence[str]) -> None:
    """The steps of a grid that does not change, but for its values at the points."""
    steps, none = root.create_group("Steps"), np.zeros(len(times), dtype=np.int64)
    steps.attrs["NSteps"], steps["Values"] = len(times), np.asarray(times, float)
    steps["PartOffsets"], steps["NumberOfParts"], steps["PointOffsets"] = none, none + 1, none
    steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = none[:, None]
    offsets = steps.create_group("PointDataOffsets")
    for name in names:
        offsets[name] = points * np.arange(len(times))


def write_fields(path: str | Path, V: Any, fields: Fields) -> Path:
    """Write vector fields of one space, with all their dofs.

    Args:
        path: the file.
        V: vector function space of Lagrange elements, on a mesh of this process.
        fields: by name, all dofs of a field of ``V``, shape (dofs,); a complex field is a mode,
            scaled so that its largest displacement is 1, and becomes ``name_re`` and ``name_im``.

    Returns:
        The path.
    """
    parts: dict[str, AnyArray] = {}
    for name, values in fields.items():
        u = _vectors(V, name, values)
        parts |= {f"{name}_re": u.real, f"{name}_im": u.imag} if np.iscomplexobj(u) else {name: u}
    return write_grid(path, *_lagrange_cells(V), parts)


def write_phases(path: str | Path, V: Any, mode: AnyArray, frames: int = 24) -> Path:
    """Write one period of a complex mode as a time series: Re(mode exp(i theta)) over theta.

    Growth or decay is left out: the phase alone runs. The mode is scaled so that its largest
    displacement is 1.

    Args:
        path: the file.
        V: vector function space of Lagrange elements, on a mesh of this process.
        mode: all dofs of the mode, complex, shape (dofs,).
        frames: number of instants; the time in the file is the phase [rad], 0 to 2 pi.

    Returns:
        The path.
    """
    theta = 2 * np.pi * np.arange(frames) / frames
    u = np.real(_vectors(V, "mode", mode) * np.exp(1j * theta)[:, None, None])
    return write_grid(path, *_lagrange_cells(V), {"displacement": u}, times=[*theta])


def write_points(path: str | Path, points: AnyArray, fields: Fields) -> Path:
    """Write contact elements as points with their pressure, gap, ...

    Args:
        path: the file.
        points: positions [m], shape (n, 3).
        fields: by name, shape (n,) or (n, 3).

    Returns:
        The path.
    """
    return write_grid(path, points, np.arange(len(points))[:, None], VERTEX, fields)


def write_facets(path: str | Path, corners: AnyArray, fields: Fields) -> Path:
    """Write the facets of a face with one value each.

    Args:
        path: the file.
        corners: of each facet in cyclic order [m], shape (n, 3 or 4, 3).
        fields: by name, shape (n,) or (n, 3).

    Returns:
        The path.
    """
    kind = {3: TRIANGLE, 4: QUADRILATERAL}[corners.shape[1]]
    cells = np.arange(corners.shape[0] * corners.shape[1]).reshape(corners.shape[:2])
    return write_grid(path, corners.reshape(-1, 3), cells, kind, at_cells=fields)


def facet_means(facet: AnyArray, w: AnyArray, values: AnyArray, facets: int) -> AnyArray:
    """Means over the elements of each facet, weighted with their areas.

    Args:
        facet: facet of each element, -1: none, shape (elements,).
        w: areas [m^2].
        values: one per element.
        facets: number of facets.

    Returns:
        One per facet, nan where a facet holds no element.
    """
    held = facet >= 0
    total = np.bincount(facet[held], w[held], facets)
    mean = np.full(facets, np.nan)
    full = total > 0
    mean[full] = np.bincount(facet[held], (w * values)[held], facets)[full] / total[full]
    return mean


def _lagrange_cells(V: Any) -> tuple[AnyArray, AnyArray, int]:
    """Positions of the dofs of a space [m], its cells over them, and their type."""
    from brake_fenicsx.compat import vtk_cells  # figures, which need no DOLFINx, import this module

    cells, types, points = vtk_cells(V)
    return points, cells, int(types[0])


def _vectors(V: Any, name: str, values: AnyArray) -> AnyArray:
    """A field, shape (points, 3); a complex one, a mode, with a largest displacement of 1.

    Raises:
        ValueError: the field has not one value per dof.
    """
    n = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
    if np.shape(values) != (n,):
        raise ValueError(f"field {name}: shape {np.shape(values)}, the space has {n} dofs")
    u = np.reshape(values, (-1, V.dofmap.index_map_bs))
    if not np.iscomplexobj(u):
        return u
    largest = float(np.linalg.norm(u, axis=1).max(initial=0.0))
    return u / largest if largest > 0 else u
