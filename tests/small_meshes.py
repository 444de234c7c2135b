"""Small mesh files for the tests: two boxes, one on the other, written in several formats."""

from dataclasses import replace

import numpy as np

from brake_fenicsx.geometry import block
from brake_fenicsx.meshing.brake_mesh import raw_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings, discrete_model, gmsh_session
from brake_fenicsx.meshing.rawmesh import facet_nodes, joined, turned

LOW = block.Block(length=40e-3, width=20e-3, height=10e-3, z=-10e-3, size=8e-3)
HIGH = block.Block(length=40e-3, width=20e-3, height=12e-3, z=0.0, size=8e-3)
# A scene with these boxes from a file, and what holds them there.
SCENE = """
stages = ["equilibrium"]
[mesh]
file = "own.msh"
unit = "mm"
[mesh.groups]
pad_body = "block.body"
plate_body = "plate.body"
pad_bottom = "block.bottom"
pad_top = "block.top"
plate_top = "plate.top"
plate_bottom = "plate.bottom"
[parts]
block = { material = "iron" }
plate = { material = "iron" }
[materials]
iron = { model = "isotropic", E = "125 GPa", nu = 0.24, rho = "7200 kg/m^3" }
[contact.both]
faces = ["block.bottom", "plate.top"]
law = { linear = "1e12 Pa/m" }
[loads]
"block.top" = { pressure = "5 bar" }
"""
HELD = '[supports]\n"plate.bottom" = "clamped"\n"block.top" = ["x", "y"]\n'
# Abaqus's order of the nodes, as places in gmsh's.
ABAQUS = {
    4: range(4),
    8: range(8),
    10: (0, 1, 2, 3, 4, 5, 6, 7, 9, 8),
    20: (0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
}
TYPES = {4: "C3D4", 8: "C3D8", 10: "C3D10", 20: "C3D20"}


# Faces of the pad's mirror image, which is the plate.
MIRRORED = {
    "pad.body": "plate.body",
    "pad.bottom": "plate.top",
    "pad.top": "plate.bottom",
    "pad.sides": "plate.sides",
}


def boxes(cells="tetrahedra", order=1, size=HIGH.size):
    """Two boxes with coincident nodes at z = 0, each with nodes of its own.

    The plate is the pad's mirror image, flattened: meshed apart, two faces of one shape have the
    same mesh with some versions of gmsh only.
    """
    pad = raw_mesh(
        {"pad": (block, replace(HIGH, size=size))}, MeshSettings(cells=cells, order=order)
    )
    image = turned(pad, np.ones(len(pad.cells), dtype=bool))
    names = ({MIRRORED[n]: tag for n, tag in own.items()} for own in (pad.layers, pad.faces))
    layers, faces = names
    flat = np.array([1.0, 1.0, -LOW.height / HIGH.height])
    plate = replace(image, points=pad.points * flat, layers=layers, faces=faces)
    return joined([pad, plate])


def glued(mesh):
    """The mesh with coincident nodes made one."""
    _, first, number = np.unique(
        np.rint(mesh.points / 1e-7).astype(int), axis=0, return_index=True, return_inverse=True
    )
    number = number.reshape(-1)
    return replace(
        mesh, points=mesh.points[first], cells=number[mesh.cells], facets=number[mesh.facets]
    )


def write_gmsh(mesh, path, version=4.1, scale=1e3):
    """Write with gmsh; groups are named as layers and faces, with _ for the dot."""
    with gmsh_session() as gmsh:
        rename = {n.replace(".", "_"): t for n, t in mesh.layers.items()}
        faces = {n.replace(".", "_"): t for n, t in mesh.faces.items()}
        named = replace(mesh, points=scale * mesh.points, layers=rename, faces=faces)
        discrete_model(gmsh, named, facet_nodes(named))
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.write(str(path))


def write_abaqus(mesh, path, scale=1e3, sets="nodes"):
    """Write an .inp by hand: element sets of the layers, node sets or surfaces of the faces."""
    count = {27: 20}.get(mesh.cells.shape[1], mesh.cells.shape[1])
    lines = ["*HEADING", "** two boxes", "*NODE, NSET=ALL"]
    used = np.unique(mesh.cells[:, :count])
    lines += [f"{10 + i}, " + ", ".join(f"{scale * v:.12e}" for v in mesh.points[i]) for i in used]
    element = 1000
    for layer, tag in mesh.layers.items():
        lines.append(f"*Element, type={TYPES[count]}, elset={layer.replace('.', '_')}")
        for cell in mesh.cells[mesh.cell_tag == tag][:, list(ABAQUS[count])]:
            words = [str(element), *(str(10 + i) for i in cell)]
            lines += [", ".join(words[:10]) + ","] + ([", ".join(words[10:])] if count > 9 else [])
            element += 1
    for face, tag in mesh.faces.items():
        lines.append(f"*NSET, NSET={face.replace('.', '_')}")
        nodes = np.unique(facet_nodes(mesh)[mesh.facet_tag == tag])
        lines += [", ".join(str(10 + i) for i in row) for row in np.array_split(nodes, 9)]
    path.write_text("\n".join(lines) + "\n")


def write_ansys(mesh, path, scale=1e3, degenerate=False):
    """Write a .cdb by hand: element components of the layers, node components of the faces.

    Args:
        degenerate: tetrahedra as bricks with equal corners.
    """
    count = {27: 20}.get(mesh.cells.shape[1], mesh.cells.shape[1])
    routine = {4: 285, 10: 187, 8: 185, 20: 186}[count]
    if degenerate:
        routine = {4: 185, 10: 186}[count]
    lines = ["/PREP7", f"ET,        1,{routine}", "ET,2,174"]
    used = np.unique(mesh.cells[:, :count])
    lines += [f"NBLOCK,6,SOLID,{10 + used.max():9d},{used.size:9d}", "(3i9,6e21.13e3)"]
    for i in used:
        x = "".join(f"{scale * v:21.13E}" for v in mesh.points[i])
        lines.append(f"{10 + i:9d}{0:9d}{0:9d}" + x)
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,{len(mesh.cells):9d}", "(19i9)"]
    brick = {4: [0, 1, 2, 2, 3, 3, 3, 3],
             10: [0, 1, 2, 2, 3, 3, 3, 3, 4, 5, 2, 6, 3, 3, 3, 3, 7, 8, 9, 9]}  # fmt: skip
    for k, cell in enumerate(mesh.cells[:, list(ABAQUS[count])]):
        nodes = 10 + (cell[brick[count]] if degenerate else cell)
        head = [mesh.cell_tag[k], 1, 1, 1, 0, 0, 0, 0, len(nodes), 0, 1 + k]
        for row in ([*head, *nodes[:8]], nodes[8:]):
            lines += ["".join(f"{v:9d}" for v in row)] if len(row) else []
    # A contact element, which is no solid.
    lines.append("".join(f"{v:9d}" for v in [9, 2, 1, 1, 0, 0, 0, 0, 4, 0, 10**6, 10, 11, 12, 13]))
    lines.append("       -1")
    for layer, tag in mesh.layers.items():
        own = 1 + np.flatnonzero(mesh.cell_tag == tag)
        # Cells of a layer stand in a row.
        lines += [f"CMBLOCK,{layer.replace('.', '_')},ELEM,       2  ! users element component",
                  "(8i10)", f"{own[0]:10d}{-own[-1]:10d}"]  # fmt: skip
    for face, tag in mesh.faces.items():
        nodes = 10 + np.unique(facet_nodes(mesh)[mesh.facet_tag == tag])
        lines += [f"CMBLOCK,{face.replace('.', '_')},NODE,{nodes.size:8d}", "(8i10)"]
        rows = [nodes[i : i + 8] for i in range(0, nodes.size, 8)]
        lines += ["".join(f"{v:10d}" for v in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
