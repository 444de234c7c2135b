#!/usr/bin/env bash
# meshio 5.3.5, mapdl-archive 0.4.2: what joins the parts of a deck.
#
# Guess: a reader of meshes leaves out rigid elements, equations and springs, all of them alike, and says so.
# Behaviour: RBE2, RBE3, RBAR, MPC and CELAS2 of Nastran, *EQUATION, *MPC and *RIGID BODY of Abaqus, CE and CP of Ansys
#   are gone without a word. But one CELAS1 makes the whole deck unreadable ("Illegal cell type vertex"), and a CBUSH to
#   the ground becomes a line of one node: the mesh is read, and no format writes it; beside a CBUSH of two nodes the
#   error is NumPy's, about an inhomogeneous shape. mapdl-archive counts MPC184 among the elements and their pilot
#   node among the nodes, and its grid has neither.
# Why the guess fails: a table of meshio takes CELAS1, of two grid points, for a vertex, and knows no other spring; a
#   cell has as many nodes as words are left. Types that are no cells of VTK leave the grid, with the nodes that only
#   they have.
#
# Output seen (cells; error, or what is said):
#   RBE2, RBE3, RBAR, MPC, CELAS2: hexahedron 1 of 8 nodes; nothing
#   CELAS1: AssertionError: Illegal cell type vertex
#   CBUSH to the ground: hexahedron 1 of 8 nodes, line 1 of 1 nodes; WriteError: Unexpected cells array shape (1, 1) for
#     line cells. Expected shape [:, 2].
#   CBUSH to the ground and one of two nodes: ValueError: setting an array element with a sequence
#   *EQUATION, *MPC, *RIGID BODY: hexahedron 1 of 8 nodes; nothing
#   CE, CP, MPC184: 3 elements and 9 nodes, in the grid 1 and 8; nothing
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet meshio==5.3.5 mapdl-archive==0.4.2 pyvista==0.48.4 vtk==9.6.2 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import contextlib
import io
from itertools import product

import mapdl_archive
import meshio

POINTS = [(x ^ y, y, z) for z, y, x in product((0, 1), repeat=3)] + [(0, 0, 5)]
NASTRAN = "BEGIN BULK\n" + "".join(f"GRID,{i},,{x}.,{y}.,{z}.\n" for i, (x, y, z) in enumerate(POINTS, 1))
NASTRAN += "CHEXA,1,1,1,2,3,4,5,6,+\n+,7,8\n"
ABAQUS = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(POINTS, 1))
ABAQUS += "*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 7, 8\n*NSET, NSET=TOP\n5, 6, 7, 8\n"
RIGID = (
    "RBE2,10,9,123456,5,6\nRBE3,11,,9,123456,1.,123,7,8\nRBAR,12,5,6,123456\nMPC,5,5,1,1.,6,1,-1.\n"
    "CELAS2,14,1000.,5,1,6,1\n"
)
TIED = "*EQUATION\n2\n5, 1, 1., 6, 1, -1.\n*MPC\nBEAM, TOP, 9\n*RIGID BODY, REF NODE=9, NSET=TOP\n"


def read(name, text):
    with open(name, "w") as file:
        file.write(text)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        mesh = meshio.read(name)
    return [(block.type, len(block.data), block.data.shape[1]) for block in mesh.cells], said.getvalue(), mesh


def error(call, *args):
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            call(*args)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "no error"


rigid, tied = read("rigid.bdf", NASTRAN + RIGID + "ENDDATA\n"), read("tied.inp", ABAQUS + TIED)
spring = error(read, "spring.bdf", NASTRAN + "CELAS1,14,2,5,1,6,1\nENDDATA\n")
ground = read("ground.bdf", NASTRAN + "CBUSH,15,2,5\nENDDATA\n")
unwritten = error(meshio.write, "ground.vtu", ground[2])
both = error(read, "both.bdf", NASTRAN + "CBUSH,15,2,5\nCBUSH,16,2,5,6\nENDDATA\n")

row = "".join(f"{word:9d}" for word in (1, 1, 1, 1, 0, 0, 0, 0, 8, 0, 1, 1, 2, 3, 4, 5, 6, 7, 8))
for number, node in ((2, 5), (3, 6)):
    row += "\n" + "".join(f"{word:9d}" for word in (1, 2, 1, 1, 0, 0, 0, 0, 2, 0, number, 9, node))
nodes = "".join(f"{i:9d}{0:9d}{0:9d}" + "".join(f"{v:20.12E}" for v in x) + "\n" for i, x in enumerate(POINTS, 1))
with open("tied.cdb", "w") as file:
    file.write(
        f"/PREP7\nET,1,185\nET,2,184\nNBLOCK,6,SOLID,9,9\n(3i9,6e20.12)\n{nodes}N,R5.3,LOC,-1,\nEBLOCK,19,SOLID,3,3\n"
        f"(19i9)\n{row}\n       -1\nCE,R5.0,1,2,0.\nCE,R5.0,1,7,UX,1.,8,UX,-1.\nCP,1,UX,7,8\nFINISH\n"
    )
said = io.StringIO()
with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
    archive = mapdl_archive.Archive("tied.cdb")
    counts = len(archive.enum), len(archive.nnum), archive.grid.n_cells, archive.grid.n_points



def line(what, found, error=""):
    cells = ", ".join(f"{kind} {count} of {nodes} nodes" for kind, count, nodes in found[0])
    print(f"{what}: {cells}; {error or found[1] or 'nothing'}")


line("RBE2, RBE3, RBAR, MPC, CELAS2", rigid)
print("CELAS1:", spring)
line("CBUSH to the ground", ground, unwritten)
print("CBUSH to the ground and one of two nodes:", both.partition(".")[0])
line("*EQUATION, *MPC, *RIGID BODY", tied)
print("CE, CP, MPC184: {} elements and {} nodes, in the grid {} and {};".format(*counts), said.getvalue() or "nothing")
cube = [("hexahedron", 1, 8)]
assert (rigid[:2], tied[:2]) == ((cube, ""), (cube, "")) and ground[0] == [*cube, ("line", 1, 1)]
assert spring == "AssertionError: Illegal cell type vertex" and unwritten.startswith("WriteError")
assert both.startswith("ValueError") and "inhomogeneous" in both
assert counts == (3, 9, 1, 8) and not said.getvalue()
PY
