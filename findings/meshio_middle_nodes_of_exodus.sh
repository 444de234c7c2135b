#!/usr/bin/env bash
# meshio 5.3.5, with VTK 9.5.2 as a second reader: a HEX20 of Exodus II.
#
# Guess: meshio gives the nodes of hexahedron20 in one order, VTK's, whatever the format; it reorders those of gmsh and Kratos.
# Behaviour: those of Exodus come as they stand in the file, upright edges before the upper ones: eight middle nodes of a
#   cube lie half an edge from where hexahedron20 has them. Its writer does not reorder either: a file that meshio reads back
#   unchanged is torn for VTK (and so for ParaView), whose own reader has the first file right.
# Why the guess fails: a round trip through meshio is exact, both errors cancel, and corners, tetrahedra and sets are right.
#
# Output seen (largest distance of a middle node from its edge, unit cube):
#   file of Exodus: VTK 0.0, meshio 0.7071
#   file that meshio wrote from a right mesh: VTK 0.7071, meshio 0.0
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet meshio==5.3.5 netCDF4==1.7.2 vtk==9.5.2 numpy==2.2.6
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import meshio
import numpy as np
from netCDF4 import Dataset
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOExodus import vtkExodusIIReader

# Edges of middle nodes 9 to 20, in VTK's order; Exodus has 13 to 16 on the upright edges.
EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
EXODUS = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
points = np.vstack([CORNERS, CORNERS[EDGES].mean(axis=1)])


def off(x, cell):
    x = x[cell]
    return round(float(np.linalg.norm(x[8:] - x[EDGES].mean(axis=1), axis=1).max()), 4)


def by_vtk(name):
    reader = vtkExodusIIReader()
    reader.SetFileName(name)
    reader.Update()
    grid = reader.GetOutput().GetBlock(0).GetBlock(0)
    cell = grid.GetCell(0)
    return off(vtk_to_numpy(grid.GetPoints().GetData()), [cell.GetPointId(i) for i in range(20)])


def by_meshio(name):
    mesh = meshio.read(name)
    return off(np.asarray(mesh.points), np.asarray(mesh.cells[0].data[0]))


with Dataset("exodus.exo", "w", format="NETCDF3_64BIT_OFFSET") as file:
    file.setncatts({"api_version": np.float32(5.1), "version": np.float32(5.1), "floating_point_word_size": np.int32(8),
                    "file_size": np.int32(1), "title": "cube"})
    sizes = {"len_string": 33, "len_line": 81, "four": 4, "num_dim": 3, "num_nodes": 20, "num_elem": 1,
             "num_el_blk": 1, "num_el_in_blk1": 1, "num_nod_per_el1": 20, "time_step": None}
    for name, size in sizes.items():
        file.createDimension(name, size)
    file.createVariable("time_whole", "f8", ("time_step",))
    file.createVariable("eb_status", "i4", ("num_el_blk",))[:] = 1
    ids = file.createVariable("eb_prop1", "i4", ("num_el_blk",))
    ids.setncattr("name", "ID")
    ids[:] = 1
    for axis, x in zip("xyz", points.T):
        file.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = x
    cell = file.createVariable("connect1", "i4", ("num_el_in_blk1", "num_nod_per_el1"))
    cell.elem_type = "HEX20"
    cell[:] = [np.array(EXODUS) + 1]
meshio.Mesh(points, [("hexahedron20", [np.arange(20)])]).write("meshio.exo")
found = {name: (by_vtk(name), by_meshio(name)) for name in ("exodus.exo", "meshio.exo")}
print("file of Exodus: VTK {}, meshio {}".format(*found["exodus.exo"]))
print("file that meshio wrote from a right mesh: VTK {}, meshio {}".format(*found["meshio.exo"]))
assert found["exodus.exo"][0] == 0.0 < found["exodus.exo"][1]
assert found["meshio.exo"][1] == 0.0 < found["meshio.exo"][0]
PY
