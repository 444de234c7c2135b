#!/usr/bin/env bash
# VTK 9.7.2: normals of the surface of a mesh with wedges.
#
# Guess: the faces that a surface filter extracts look outward for every kind of cell, so that the volume inside is the
#   flux of x / 3 through them, and a pressure along the normal pushes inward.
# Behaviour: vtkDataSetSurfaceFilter turns all five faces of a linear wedge inward: its volume is -0.5. It turns those of the
#   quadratic wedge with the same corners outward, and those of tetrahedra, pyramids and bricks too. vtkGeometryFilter
#   has them all outward. The order of the corners is that of Abaqus, Nastran and gmsh, for which VTK's own cell volume is positive.
# Why the guess fails: the two filters are taken for the same thing, and the linear wedge alone is turned. In a swept disc of
#   bricks and wedges the error stays at some faces: an area is right, a resultant is not.
#
# Output seen (volume from the extracted faces):
#   vtkDataSetSurfaceFilter: tetra 0.167, pyramid 0.333, brick 1.000, wedge -0.500, quadratic wedge 0.500
#   vtkGeometryFilter: tetra 0.167, pyramid 0.333, brick 1.000, wedge 0.500, quadratic wedge 0.500
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet vtk==9.7.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PY'
import numpy as np
import vtk

triangle = np.array([[0, 0], [1, 0], [0, 1]], dtype=float)
square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
wedge, brick = (np.vstack([np.c_[f, 0 * f[:, 0]], np.c_[f, 0 * f[:, 0] + 1]]) for f in (triangle, square))
edges = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
cells = {
    "tetra": (vtk.VTK_TETRA, wedge[:4]),
    "pyramid": (vtk.VTK_PYRAMID, np.vstack([brick[:4], [[0.5, 0.5, 1]]])),
    "brick": (vtk.VTK_HEXAHEDRON, brick),
    "wedge": (vtk.VTK_WEDGE, wedge),
    "quadratic wedge": (
        vtk.VTK_QUADRATIC_WEDGE,
        np.vstack([wedge, [(wedge[a] + wedge[b]) / 2 for a, b in edges]]),
    ),
}


def grid_of(kind, points):
    grid, nodes, ids = vtk.vtkUnstructuredGrid(), vtk.vtkPoints(), vtk.vtkIdList()
    for i, x in enumerate(points):
        nodes.InsertNextPoint(*x)
        ids.InsertNextId(i)
    grid.SetPoints(nodes)
    grid.InsertNextCell(kind, ids)
    return grid


def inside(surface):
    total = 0.0
    for i in range(surface.GetNumberOfCells()):
        face = surface.GetCell(i).GetPoints()
        p = np.array([face.GetPoint(j) for j in range(face.GetNumberOfPoints())])
        total += sum(p[0] @ np.cross(p[j], p[j + 1]) for j in range(1, len(p) - 1)) / 6
    return total


right = {"tetra": 1 / 6, "pyramid": 1 / 3, "brick": 1, "wedge": 0.5, "quadratic wedge": 0.5}
for filter_ in (vtk.vtkDataSetSurfaceFilter, vtk.vtkGeometryFilter):
    found = {}
    for name, (kind, points) in cells.items():
        grid, f, size = grid_of(kind, points), filter_(), vtk.vtkCellSizeFilter()
        size.SetInputData(grid)
        size.Update()
        assert np.isclose(size.GetOutput().GetCellData().GetArray("Volume").GetValue(0), right[name])
        f.SetInputData(grid)
        f.Update()
        found[name] = inside(f.GetOutput())
    print(f"{filter_.__name__}: " + ", ".join(f"{k} {v:.3f}" for k, v in found.items()))
    turned = {name for name in cells if np.isclose(found[name], -right[name])}
    assert all(np.isclose(abs(found[name]), right[name]) for name in cells)
    assert turned == ({"wedge"} if filter_ is vtk.vtkDataSetSurfaceFilter else set()), turned
PY
