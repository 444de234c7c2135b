"""A user's own mesh: formats, groups, units, orientation, bodies that share nodes."""

import sys
from dataclasses import replace
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from brake_fenicsx.build.scene_mesh import grouped_file
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.abaqus import read_abaqus
from brake_fenicsx.meshing.brake_mesh import check_cells, tagged_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.meshing.groups import mesh_of_file
from brake_fenicsx.meshing.meshfile import read_mesh_file
from brake_fenicsx.meshing.rawmesh import orientation
from brake_fenicsx.scene.parts_section import MeshTable

GROUPS = {
    "pad_body": "pad.lining", "plate_body": "plate.body", "pad_bottom": "pad.friction",
    "plate_top": "plate.top", "pad_top": "pad.back", "plate_bottom": "plate.bottom",
}  # fmt: skip
PARTS = ("pad", "plate")
AREA, VOLUME = 800e-6, {"pad.lining": 800e-6 * 12e-3, "plate.body": 800e-6 * 10e-3}


def table(path, **changes):
    return MeshTable(**{"file": path.name, "unit": "mm", "groups": GROUPS, **changes})


def read(path, **changes):
    return mesh_of_file(grouped_file(path.parent, table(path, **changes)), PARTS)


def volumes(mesh):
    """Volume of each layer by gauss-free means: the divergence over the corners of the cells."""
    from brake_fenicsx.meshing.rawmesh import CORNERS

    x = mesh.points[mesh.corners]
    if CORNERS[mesh.shape] == 4:
        v = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    else:
        # Six tetrahedra about the diagonal 0 6.
        around = (1, 2, 3, 7, 4, 5, 1)
        v = sum(
            np.linalg.det(np.stack([x[:, a] - x[:, 0], x[:, b] - x[:, 0], x[:, 6] - x[:, 0]], 1))
            for a, b in pairwise(around)
        ) / 6  # fmt: skip
    return {name: v[mesh.cell_tag == tag].sum() for name, tag in mesh.layers.items()}


def area(mesh, face):
    x = mesh.points[mesh.facets[mesh.facet_tag == mesh.faces[face]]]
    cross = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    if x.shape[1] == 4:
        cross = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    return 0.5 * np.linalg.norm(cross, axis=1).sum()


KINDS = [("tetrahedra", 1), ("tetrahedra", 2), ("hexahedra", 1), ("hexahedra", 2)]


@pytest.mark.parametrize("cells, order", KINDS)
@pytest.mark.parametrize("form", ["msh2", "msh4", "inp", "cdb"])
def test_round_trip(cells, order, form, tmp_path, meshes):
    """Volumes, faces and node positions come back; catches middle nodes in another's order."""
    mesh = meshes.boxes(cells, order)
    file = tmp_path / f"boxes.{form[:3]}"
    if form in ("inp", "cdb"):
        {"inp": meshes.write_abaqus, "cdb": meshes.write_ansys}[form](mesh, file)
    else:
        meshes.write_gmsh(mesh, file, 2.2 if form == "msh2" else 4.1)
    found = read(file)
    assert found.order == order
    assert (found.shape, len(found.cells)) == (mesh.shape, len(mesh.cells))
    for name, volume in volumes(found).items():
        assert volume == pytest.approx(VOLUME[name], rel=1e-9)
    for face in ("pad.friction", "plate.top", "pad.back", "plate.bottom"):
        assert area(found, face) == pytest.approx(AREA, rel=1e-9), face
    # Boxes have straight edges: a misplaced middle node would distort its cell.
    assert check_cells(found, MeshSettings()).distortion > 0.2
    np.testing.assert_allclose(
        np.sort(found.points[found.cells].mean(axis=1), axis=0),
        np.sort(mesh.points[mesh.cells].mean(axis=1), axis=0),
        atol=1e-12,
    )


@pytest.mark.parametrize("order", [1, 2])
def test_degenerate_bricks_of_ansys_are_tetrahedra(order, tmp_path, meshes):
    """Corners K = L and M = N = O = P, the middle nodes in their places."""
    mesh = meshes.boxes(order=order)
    file = tmp_path / "boxes.cdb"
    meshes.write_ansys(mesh, file, degenerate=True)
    groups = {**GROUPS, "MAT1": "pad.lining"}
    del groups["pad_body"]
    found = read(file, groups=groups)
    assert (found.shape, found.order) == ("tetrahedron", order)
    assert volumes(found)["pad.lining"] == pytest.approx(VOLUME["pad.lining"], rel=1e-9)
    assert check_cells(found, MeshSettings()).distortion > 0.9


def test_elements_of_ansys_without_middle_nodes(tmp_path, meshes):
    """Nodes 0 of SOLID186: all of them make linear cells, one of them is refused by its number."""
    mesh = meshes.boxes("hexahedra", 2)
    file = tmp_path / "boxes.cdb"
    meshes.write_ansys(mesh, file)
    lines = file.read_text().splitlines()
    file.write_text("\n".join("        0" * 12 if len(line) == 108 else line for line in lines))
    found = read(file)
    assert found.order == 1
    assert volumes(found)["pad.lining"] == pytest.approx(VOLUME["pad.lining"], rel=1e-9)
    first = next(i for i, line in enumerate(lines) if len(line) == 108)
    lines[first] = lines[first][:-9] + "        0"
    file.write_text("\n".join(lines))
    with pytest.raises(SceneError, match="element 1 lacks middle nodes; write all"):
        read(file)


def test_middle_nodes_in_whatever_order(tmp_path, meshes):
    """Meshio gives those of Exodus in the file's order: upright edges before the upper ones."""
    meshio = pytest.importorskip("meshio")
    vtk, n = meshes.ABAQUS, np.random.default_rng(1)
    exodus = [vtk[20][i] for i in (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)]
    for kind, order in (
        ("hexahedron20", exodus), ("hexahedron27", [*range(8), *(8 + n.permutation(19))]),
        ("tetra10", [*range(4), *(4 + n.permutation(6))]),
    ):  # fmt: skip
        mesh = meshes.boxes("tetrahedra" if kind == "tetra10" else "hexahedra", 2)
        data = {"material": [mesh.cell_tag]}
        file = tmp_path / "boxes.vtu"
        meshio.Mesh(1e3 * mesh.points, [(kind, mesh.cells[:, order])], cell_data=data).write(file)
        found = read(file, groups=dict(zip(("1", "2"), mesh.layers, strict=True)))
        np.testing.assert_allclose(found.points[found.cells], mesh.points[mesh.cells], atol=1e-9)


def test_med_by_name(tmp_path, meshes):
    """Names of cells and nodes, one name of two families; meshio alone has their numbers."""
    meshio = pytest.importorskip("meshio")
    mesh = meshes.boxes()
    nodes = np.zeros(len(mesh.points), dtype=int)
    faces = ("pad.bottom", "plate.top")
    for family, face in enumerate(faces, 1):
        nodes[mesh.facets[mesh.facet_tag == mesh.faces[face]]] = family
    nodes[(mesh.points[:, 0] > 0) & (nodes == 1)] = 3
    med = meshio.Mesh(
        1e3 * mesh.points, [("tetra", mesh.cells)], cell_data={"cell_tags": [-5 - mesh.cell_tag]},
        point_data={"point_tags": nodes},
    )  # fmt: skip
    med.cell_tags = {-5 - t: [n, "ALL"] for n, t in mesh.layers.items()}
    med.point_tags = {i: [face] for i, face in enumerate(faces, 1)} | {3: [faces[0]]}
    file = tmp_path / "boxes.med"
    med.write(file)
    assert set(nodes) == {0, 1, 2, 3}
    own = {n: n for n in (*mesh.layers, *faces)}
    found = read(file, groups=own)
    assert volumes(found)["pad.body"] == pytest.approx(VOLUME["pad.lining"], rel=1e-9)
    for face in faces:
        assert area(found, face) == pytest.approx(AREA, rel=1e-9)
    assert len(read_mesh_file(file).cell_groups["ALL"]) == len(mesh.cells)


def test_numbers_of_several_arrays_are_told_apart(tmp_path, meshes):
    """Materials 1 and 2 in an order, parts 1 and 2 in the other: neither hides the other."""
    meshio = pytest.importorskip("meshio")
    mesh = meshes.boxes()
    file = tmp_path / "boxes.vtu"
    arrays = {"material": [mesh.cell_tag], "part": [3 - mesh.cell_tag]}
    arrays["volume"] = [7 * (mesh.cell_tag == 2)]
    meshio.Mesh(1e3 * mesh.points, [("tetra", mesh.cells)], cell_data=arrays).write(file)
    for names in (("material:1", "material:2"), ("part:2", "part:1"), ("0", "7")):
        found = read(file, groups=dict(zip(names, mesh.layers, strict=True)))
        assert volumes(found)["pad.body"] == pytest.approx(VOLUME["pad.lining"], rel=1e-9)
    with pytest.raises(SceneError, match=r"mesh.groups.\"1\".*no such group.*material:1"):
        read(file, groups={"1": "pad.body"})


def test_sets_that_meshio_loses_are_refused(tmp_path, meshes):
    """Numbers of cells of gmsh's .vtk arrive; marks of nodes, or names of cells, do not."""
    meshio = pytest.importorskip("meshio")
    mesh = meshes.boxes()
    file = tmp_path / "boxes.vtk"
    meshes.write_gmsh(mesh, file)
    names = {f"cells:{tag}": name for name, tag in mesh.layers.items()}
    assert volumes(read(file, groups=names))["pad.body"] == pytest.approx(
        VOLUME["pad.lining"], rel=1e-9
    )
    marked = tmp_path / "boxes.vtu"
    nodes = {"PAD_CONTACT": (mesh.points[:, 2] == 0).astype(int)}
    cells = {"material": [mesh.cell_tag]}
    meshio.Mesh(1e3 * mesh.points, [("tetra", mesh.cells)], nodes, cells).write(marked)
    said = r"no such group.*there are 1, 2; meshio found no sets of nodes in it.*write .msh, .inp"
    groups = dict(zip(("1", "2"), mesh.layers, strict=True))
    with pytest.raises(SceneError, match=said):
        read(marked, groups={**groups, "PAD_CONTACT": "pad.friction"})
    meshio.Mesh(1e3 * mesh.points, [("tetra", mesh.cells)]).write(marked)
    with pytest.raises(SceneError, match="no sets of cells or nodes in it"):
        read(marked)


def test_surfaces_and_sets_of_abaqus(tmp_path):
    """S1 to S4 by element sets, GENERATE, sets of sets, *INCLUDE, shells, upper and lower case.

    After a comma a keyword goes on in Abaqus, not in CalculiX 2.20, which reads as many numbers as
    an element has nodes: both as in test decks of CalculiX.
    """
    (tmp_path / "nodes.inp").write_text(
        "*NODE\n1,0,0,0\n2,10,0,0\n3,0,10,0\n4,0,0,10\n5,10,10,10\n"
    )
    file = tmp_path / "two.inp"
    file.write_text(
        "*Heading\n*INCLUDE, INPUT=nodes.inp\n*ELEMENT, TYPE=C3D4,\n1,1,2,3,4,6\n2,2,3,\n4,5\n"
        "*ELEMENT, TYPE=S3R, ELSET=skin\n7,1,2,4\n"
        "*ELSET, ELSET=one, GENERATE\n1,1,1\n*ELSET, ELSET=both\none\n2,\n"
        "*ELSET, ELSET=other\n2\n"
        "*SURFACE, NAME=low,\n TYPE=ELEMENT\none, S1\n*SURFACE, NAME=left\n1, S4\n"
        "*NSET, NSET=far,\n3,4,\n5\n*SURFACE, NAME=far_nodes, TYPE=NODE\nfar,\n*STEP\n*END STEP\n"
    )
    names = {"BOTH": "b.all", "Low": "b.low", "left": "b.left", "skin": "b.skin", "far": "b.far"}
    found = mesh_of_file(grouped_file(tmp_path, table(file, groups=names)), ["b"])
    centres = {
        name: 1e3 * found.points[found.facets[found.facet_tag == tag]].mean(axis=1)
        for name, tag in found.faces.items()
    }
    third = 10 / 3
    np.testing.assert_allclose(centres["b.low"], [[third, third, 0]], atol=1e-9)
    np.testing.assert_allclose(centres["b.left"], [[0, third, third]], atol=1e-9)
    np.testing.assert_allclose(centres["b.skin"], [[third, 0, third]], atol=1e-9)
    np.testing.assert_allclose(centres["b.far"], [[third, 2 * third, 2 * third]], atol=1e-9)


PART = """\
*Part, name={name}
*Node
{nodes}
*Element, type=C3D8R
 1, 1, 2, 3, 4, 5, 6, 7, 8
*Nset, nset=Set-1, generate
 5, 8, 1
*Elset, elset=Whole
 1,
*Surface, type=ELEMENT, name=Low
Whole, S1
*End Part
"""
# As Abaqus/CAE writes them: parts, instances that are moved and turned, sets of the assembly.
ASSEMBLY = """\
*Assembly, name=Assembly
*Instance, name=Long-1, part=Long
*End Instance
*Instance, name=Long-2, part=LONG
 30., 0., 0.
 30., 0., 0., 30., 0., 7., 90.
*End Instance
*Instance, name=Cube-1, part=Cube
 0., 50., 3.
 1., 50., 3., 1., 52., 5., 40.
*End Instance
*Node
 1, 900., 900., 900.
*Nset, nset=Reference
 1,
*Nset, nset=Set-1, instance=Cube-1, generate
 1, 4
*Nset, nset=Corner, instance=Long-2
 1
*Nset, nset=Corner, instance=Cube-1
 Set-1
*Elset, elset=_Tops, internal, instance=Long-1
 1
*Elset, elset=_Tops, internal, instance=Long-2
 Whole,
*Surface, type=ELEMENT, name=Tops
_Tops, S2
*Surface, type=ELEMENT, name=Side
Cube-1.Whole, S3
Long-1.1, S3
*Surface, type=NODE, name=Marked
Long-2.Set-1, 1.
Long-1.3, 1.
*End Assembly
"""


def box(x, y, z):
    return np.array([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0],
                     [0, 0, z], [x, 0, z], [x, y, z], [0, y, z]], dtype=float)  # fmt: skip


def turned_about(points, a, b, degrees):
    return a + Rotation.from_rotvec(np.radians(degrees) * (b - a) / np.linalg.norm(b - a)).apply(
        points - a
    )


def test_parts_and_instances_of_abaqus(tmp_path):
    """Moved, then turned about an axis of the assembly; against the places worked out here."""
    parts = {"Long": box(20, 5, 4), "Cube": box(6, 6, 6)}
    for name, points in parts.items():
        rows = "\n".join(f" {i}, " + ", ".join(map(str, p)) for i, p in enumerate(points, 1))
        (tmp_path / f"{name}.inp").write_text(PART.format(name=name, nodes=rows))
    file = tmp_path / "job.inp"
    file.write_text("*Include, input=Long.inp\n*Include, input=Cube.inp\n" + ASSEMBLY)
    mesh = read_abaqus(file)

    a, b = np.array([30.0, 0, 0]), np.array([30.0, 0, 7])
    c, d = np.array([1.0, 50, 3]), np.array([1.0, 52, 5])
    direct = {
        "Long-1": parts["Long"],
        "Long-2": turned_about(parts["Long"] + a, a, b, 90),
        "Cube-1": turned_about(parts["Cube"] + [0, 50, 3], c, d, 40),
    }
    for name, points in direct.items():
        (cell,) = mesh.cell_groups[name]
        found = mesh.points[mesh.cells[cell]]
        np.testing.assert_allclose(found, points, atol=1e-12)

    def same(nodes, expected):
        found = mesh.points[np.unique(nodes)]
        np.testing.assert_allclose(
            found[np.lexsort(found.round(6).T)],
            expected[np.lexsort(expected.round(6).T)],
            atol=1e-12,
        )

    one, two, cube = direct.values()
    # A set of the assembly hides those of its name in the parts; of these each keeps its own.
    same(mesh.node_groups["Set-1"], cube[:4])
    same(mesh.node_groups["Long-2.Set-1"], two[4:])
    same(mesh.node_groups["Corner"], np.vstack([two[:1], cube[4:]]))
    same(mesh.node_groups["Marked"], np.vstack([two[4:], one[2:3]]))
    same(mesh.node_groups["Reference"], np.full((1, 3), 900.0))
    same(mesh.facet_groups["Tops"], np.vstack([one[4:], two[4:]]))
    same(mesh.facet_groups["Side"], np.vstack([cube[[0, 1, 4, 5]], one[[0, 1, 4, 5]]]))
    same(mesh.facet_groups["Low"], np.vstack([one[:4], two[:4], cube[:4]]))
    same(mesh.facet_groups["Cube-1.Low"], cube[:4])
    assert sorted(mesh.cell_groups["Whole"]) == [0, 1, 2]


DECK = """*ELEMENT, TYPE=S3, ELSET=SHIM
90001, 10, 11, 12
*ELEMENT, TYPE=MASS, ELSET=LUMP
90002, 10
*ELEMENT, TYPE=SPRINGA, ELSET=SPRINGS
90003, 10, 11
90004, 10, 12
*SOLID SECTION, ELSET=PAD_LINING, MATERIAL=IRON
*TIE, NAME=GLUE
PAD_TOP, PLATE_TOP
*COUPLING, CONSTRAINT NAME=C, REF NODE=10, SURFACE=PAD_TOP
*MATERIAL, NAME=IRON
*MATERIAL, NAME=LINING
*STEP
*BOUNDARY
PLATE_BOTTOM, 1, 3
*END STEP
"""


def test_what_an_abaqus_deck_holds_beside_its_mesh_is_said(tmp_path, meshes):
    """What no reader takes is named; a tie and supports are kept to be compared with a scene."""
    file = tmp_path / "two_boxes.inp"
    meshes.write_abaqus(meshes.boxes(), file)
    assert read(file).unread.changing == () and read(file).unread.stated == ()
    with file.open("a") as deck:
        deck.write(DECK)
    found = read(file).unread
    assert found.changing == (
        "two_boxes.inp: not read: 1 S3, 1 MASS and 2 SPRINGA elements, *SOLID SECTION;"
        " docs/howto_abaqus_deck.md says what to write instead",
    )
    stated = {one.section: one.faces for _, one in found.stated}
    assert stated["ties"] == ({"pad.back"}, {"plate.top"})
    assert stated["supports"] == ({"plate.bottom"},)


def test_shells_that_mark_a_face_are_no_loss(tmp_path, meshes):
    """Of a set that the scene names; two instances of a part have its masses twice."""
    mesh = meshes.boxes()
    file = tmp_path / "marked.inp"
    meshes.write_abaqus(mesh, file)
    facets = 10 + mesh.facets[mesh.facet_tag == mesh.faces["pad.top"]]
    rows = [f"{90000 + i}, " + ", ".join(map(str, f)) for i, f in enumerate(facets)]
    with file.open("a") as deck:
        deck.write("\n".join(["*ELEMENT, TYPE=S3, ELSET=SKIN", *rows, ""]))
    named = {n: t for n, t in GROUPS.items() if t != "pad.back"}
    assert read(file, groups=named | {"SKIN": "pad.back"}).unread.changing == ()
    # The back of the pad by its own set, on which all shells lie: they are not read.
    (line,) = read(file).unread.changing
    assert f"{len(facets)} S3 elements" in line
    part = "*PART, NAME=P\n" + file.read_text() + "*ELEMENT, TYPE=MASS\n99999, 10\n*END PART\n"
    pair = "".join(f"*INSTANCE, NAME=I{k}, PART=P\n{50 * k}\n*END INSTANCE\n" for k in (1, 2))
    file.write_text(part + "*ASSEMBLY, NAME=A\n" + pair.replace("\n*END I", ", 0, 0\n*END I")
                    + "*END ASSEMBLY\n")  # fmt: skip
    assert read_abaqus(file).elements == {"MASS": 2}


def test_what_an_ansys_file_holds_beside_its_mesh_is_said(tmp_path, meshes):
    file = tmp_path / "two.cdb"
    meshes.write_ansys(meshes.boxes(), file)
    held = "D, 10,UX, 0.0\nD, 10,UY, 0.0\n"
    file.write_text(file.read_text() + "MPTEMP,R5.0, 1, 1,  0.0\nACEL, 0.0, 0.0\nCE,1,2\n" + held)
    found = read(file).unread
    assert found.changing == (
        "two.cdb: not read: 1 CONTA174 element, CE; docs/coming_from_other_codes.md says what to"
        " write instead",
    )
    ((_, one),) = found.stated
    assert one.section == "supports" and one.faces == (set(),)


@pytest.mark.parametrize("cells, order", KINDS)
def test_shared_nodes_are_split_on_request(cells, order, tmp_path, meshes):
    """One glued mesh: refused as it is, two bodies after the split, middle nodes doubled too."""
    mesh = meshes.glued(meshes.boxes(cells, order))
    file = tmp_path / "glued.inp"
    meshes.write_abaqus(mesh, file)
    with pytest.raises(SceneError, match=r"share \d+ nodes.*mesh.split"):
        read(file)
    found = read(file, split={"pad.friction": "plate.top"})
    nodes = [set(found.cells[found.part(part)].ravel()) for part in PARTS]
    assert not nodes[0] & nodes[1]
    assert area(found, "pad.friction") == pytest.approx(area(found, "plate.top"), rel=1e-12)
    count = len(meshes.boxes(cells, order).points)
    assert len(found.points) == count
    for part, face in zip(PARTS, ("pad.friction", "plate.top"), strict=True):
        own = found.facets[found.facet_tag == found.faces[face]]
        assert set(own.ravel()) <= nodes[PARTS.index(part)]
    # The face of the other body need not be a group of the file.
    fewer = {k: v for k, v in GROUPS.items() if v != "plate.top"}
    same = read(file, groups=fewer, split={"pad.friction": "plate.top"})
    assert area(same, "plate.top") == pytest.approx(AREA, rel=1e-9)


def test_gap_of_a_split_mesh_opens(tmp_path, meshes):
    """The pad lifted off by 1: gap 1 everywhere; catches facets left on the other body's nodes."""
    from dolfinx import fem

    from brake_fenicsx.macro.contact_elements import contact_elements
    from brake_fenicsx.macro.contact_forces import Translation
    from brake_fenicsx.macro.elasticity import assemble_elastic
    from brake_fenicsx.macro.material import Material, isotropic

    file = tmp_path / "glued.msh"
    meshes.write_gmsh(meshes.glued(meshes.boxes()), file)
    split = {"pad.friction": "plate.top"}
    mesh = tagged_mesh(lambda: read(file, split=split), MPI.COMM_SELF, MeshSettings())
    steel = Material(isotropic(2e11, 0.3), 7800.0)
    free = assemble_elastic(mesh, dict.fromkeys(mesh.layers, steel), {}).free
    faces = ("pad.friction", "plate.top")
    contact = contact_elements(mesh, free, faces, Translation((1.0, 0, 0), 1.0))
    u = fem.Function(free.V)
    u.interpolate(
        lambda x: np.outer([0, 0, 1.0], np.ones(x.shape[1])),
        mesh.cell_tags.find(mesh.layers["pad.lining"]),
    )
    np.testing.assert_allclose(contact.N @ u.x.array[free.local], 1.0, rtol=1e-12)
    assert contact.w.sum() == pytest.approx(AREA, rel=1e-9)


@pytest.mark.parametrize("cells, order", KINDS)
def test_left_handed_cells_are_turned(cells, order, tmp_path, caplog, meshes):
    """A mesh mirrored by a preprocessor: turned with a note, the same volume, no negative cell."""

    mesh = meshes.boxes(cells, order)
    file = tmp_path / "mirrored.inp"
    meshes.write_abaqus(replace(mesh, points=mesh.points * [1, 1, -1.0]), file)
    with caplog.at_level("INFO", logger="brake_fenicsx"):
        found = read(file)
    assert f"{len(mesh.cells)} cells" in caplog.text
    assert "left-handed" in caplog.text
    assert np.all(orientation(found) == 1)
    assert volumes(found)["pad.lining"] == pytest.approx(VOLUME["pad.lining"], rel=1e-9)
    assert check_cells(found, MeshSettings()).distortion > 0.2


def test_a_twisted_hexahedron_is_refused(tmp_path, meshes):
    """Two corners exchanged: neither turned nor accepted."""
    mesh = meshes.boxes("hexahedra")
    mesh.cells[3, [4, 5]] = mesh.cells[3, [5, 4]]
    file = tmp_path / "twisted.inp"
    meshes.write_abaqus(mesh, file)
    with pytest.raises(SceneError, match=r"1 cells are flat or twisted.*pad.lining"):
        check_cells(read(file), MeshSettings())


def test_serendipity_hexahedra_keep_their_curves(tmp_path, meshes):
    """C3D20 on a cylinder to 27 nodes: edges as in the file, volume within the element's order."""
    from brake_fenicsx.geometry import disc
    from brake_fenicsx.meshing.brake_mesh import raw_mesh

    parts = {"disc": (disc, disc.Disc(size=15e-3))}
    mesh = raw_mesh(parts, MeshSettings(cells="hexahedra", order=2))
    file = tmp_path / "disc.inp"
    meshes.write_abaqus(mesh, file)
    groups = {"disc_body": "disc.body", "disc_rim": "disc.rim"}
    found = mesh_of_file(grouped_file(tmp_path, table(file, groups=groups)), ["disc"])
    r = np.hypot(*found.points[np.unique(found.cells[:, :20])].T[:2])
    assert r.max() == pytest.approx(144e-3, rel=1e-9)
    own, wanted = (np.sort(m.points[m.cells[:, 20:]].reshape(-1, 3), axis=0) for m in (found, mesh))
    # The centres of faces on the cylinder differ by the fourth power of the angle of an element.
    np.testing.assert_allclose(own, wanted, atol=2e-4)
    own, wanted = (check_cells(m, MeshSettings()).distortion for m in (found, mesh))
    assert own == pytest.approx(wanted, rel=0.1)


MISTAKES = [
    ({"unit": None}, "mesh.unit: missing"),
    ({"unit": "m"}, r"mesh.unit = 'm'.*40 m long.*correct the unit"),
    ({"unit": "um"}, r"mesh.unit = 'um'.*correct the unit"),
    ({"unit": "kg"}, "mesh.unit = 'kg': wrong unit"),
    ({"file": "none.msh"}, "no such file"),
    ({"groups": {**GROUPS, "pad_botom": "pad.x"}}, r"pad_botom.*did you mean 'pad_bottom'"),
    ({"groups": {**GROUPS, "plate_sides": "pad.x"}}, r"do not lie on the boundary of 'pad'"),
    ({"groups": {**GROUPS, "pad_sides": "pda.x"}}, "no part 'pda' has cells"),
    ({"groups": {**GROUPS, "pad_body": "pda.lining"}}, r"no part 'pda'.*did you mean 'pad'"),
    ({"groups": {"pad_body": "pad.lining"}}, r"parts.plate: neither builder nor cells"),
    ({"groups": {"pad_top": "pad.lining"}}, "no group of cells is named"),
    ({"split": {"pad.fric": "plate.top"}}, r"mesh.split.\"pad.fric\".*pad.friction"),
    ({"split": {"pad.back": "plate.top"}}, "share no node there"),
]


@pytest.mark.parametrize("change, text", MISTAKES)
def test_mistakes_are_named(change, text, tmp_path, meshes):
    """Key, value and remedy in one line."""
    file = tmp_path / "boxes.msh"
    meshes.write_gmsh(meshes.boxes(), file)
    with pytest.raises(SceneError, match=text):
        read(file, **change)


FLAT = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n*ELEMENT,TYPE=C3D4\n7,1,2,3,3\n"


def test_files_that_are_none(tmp_path, monkeypatch, capsys):
    """Noise, an unknown ending, wedges, collapsed cells and no module: a named error each."""
    monkeypatch.setitem(sys.modules, "netCDF4", None)
    for name, content, text in (
        ("a.msh", "no mesh", r"does not begin with \$MeshFormat"),
        ("a.stp", "x", "not known"),
        ("a.exo", "x", "needs netCDF4: pip install netCDF4"),
        ("a.mesh", "MeshVersionFormatted 2\nNone\n", r"by meshio \(Unknown keyword 'None'"),
        ("a.cdb", "/PREP7\nN,1,0,0,0\n", "no NBLOCK"),
        ("a.bdf", "nothing", "no tetrahedra"),
        ("a.inp", "nothing", "no tetrahedra"),
        ("b.inp", "*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n", "node 2 .*not defined"),
        ("l.inp", FLAT, r"element 7 has a corner twice \(1 such elements\)"),
        ("c.inp", "*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D6\n1,1,1,1,1,1,1\n", "wedge"),
        ("d.inp", "*PART,NAME=a\n*NODE\n1,0,0,0\n", r"ends within \*PART,NAME=a"),
        ("e.inp", "*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D4\n1,1,1", r"ends within \*ELEMENT.*amid"),
        (
            "f.inp",
            "*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D4\n1,1\n2,1,2,3,4\n",
            "has not 4 nodes; is the file",
        ),
        ("g.inp", "*NODE\n1,0,0,0\n2,0,\n*STEP\n", r"\*NODE: node 2 has not 3 coordinates"),
        (
            "k.inp",
            "*PART, NAME=P\n*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n*END PART\n"
            "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I-1, PART=P\n*END INSTANCE\n*END ASSEMBLY\n",
            "node 2 of an element is not defined",
        ),
        ("h.inp", "*INSTANCE, NAME=I-1, PART=P\n*END INSTANCE\n", "part 'P' is not defined"),
        ("i.inp", "*NODE\n1,0,0,0\n*NGEN\n1,3\n", r"\*NGEN: nodes and elements must be"),
        ("j.inp", "*INCLUDE, INPUT=none.inp\n", "none.inp: no such file"),
    ):
        file = tmp_path / name
        file.write_text(content)
        with pytest.raises(SceneError, match=text):
            read(file)
    assert not any(capsys.readouterr())


def test_overlapping_groups_and_faces(tmp_path):
    """A cell in two layers, a facet in two faces."""
    file = tmp_path / "two.inp"
    file.write_text(
        "*NODE\n1,0,0,0\n2,10,0,0\n3,0,10,0\n4,0,0,10\n*ELEMENT, TYPE=C3D4, ELSET=a\n1,1,2,3,4\n"
        "*ELSET, ELSET=b\n1\n*SURFACE, NAME=low\n1, S1\n*NSET, NSET=n\n1,2,3\n"
    )
    with pytest.raises(SceneError, match=r"in 'p.a' already"):
        mesh_of_file(grouped_file(tmp_path, table(file, groups={"a": "p.a", "b": "p.b"})), ["p"])
    groups = {"a": "p.a", "low": "p.low", "n": "p.n"}
    with pytest.raises(SceneError, match=r"'p.low' and 'p.n' have 1 facets in common"):
        mesh_of_file(grouped_file(tmp_path, table(file, groups=groups)), ["p"])


def test_a_cell_of_two_groups_is_one_cell(tmp_path):
    """A plate in two physical volumes: gmsh 2.2 writes its cells twice, 4.1 once; the body is one.

    Volume by hand: a block of 40 x 20 x 20 mm and a plate of 60 x 30 x 10 mm, 34 000 mm^3.
    """
    from brake_fenicsx.meshing.gmsh_mesh import gmsh_session

    meshes, sizes = [], []
    for version in (4.1, 2.2):
        file = tmp_path / f"twice_{version:.0f}.msh"
        with gmsh_session() as gmsh:
            gmsh.model.occ.addBox(10, 5, 0, 40, 20, 20, 1)
            gmsh.model.occ.addBox(0, 0, -10, 60, 30, 10, 2)
            gmsh.model.occ.synchronize()
            for tag, (name, own) in enumerate(
                {"lining": [1], "plate": [2], "steel": [2], "all": [1, 2]}.items(), 1
            ):
                gmsh.model.addPhysicalGroup(3, own, tag)
                gmsh.model.setPhysicalName(3, tag, name)
            gmsh.model.mesh.generate(3)
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.write(str(file))
        meshes.append(read_mesh_file(file))
        sizes.append({name: own.size for name, own in meshes[-1].cell_groups.items()})
        x = meshes[-1].points[meshes[-1].cells]
        volume = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])).sum() / 6
        assert volume == pytest.approx(34000.0, rel=1e-9)
    assert sizes[0] == sizes[1] and sizes[0]["plate"] == sizes[0]["steel"]
    assert sizes[0]["all"] == len(meshes[1].cells) == sizes[0]["plate"] + sizes[0]["lining"]


def test_c3d27_as_gmsh_writes_it(tmp_path):
    """Body first, then the middles of S1 to S6 (gmsh's writer of .inp): each node in its place."""
    from brake_fenicsx.meshing.rawmesh import EDGES, FACETS

    # Middles of faces S1 to S6 of Abaqus, of a box with corners in its order.
    corners = box(20, 30, 40)
    vtk = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6),
           (3, 7))  # fmt: skip
    faces = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
    points = [*corners, *(corners[[*e]].mean(axis=0) for e in vtk), corners.mean(axis=0),
              *(corners[[*f]].mean(axis=0) for f in faces)]  # fmt: skip
    file = tmp_path / "one.inp"
    nodes = "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(points, 1))
    rows = ", ".join(map(str, range(1, 16))) + ",\n" + ", ".join(map(str, range(16, 28)))
    file.write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=C3D27, ELSET=A\n1, {rows}\n")
    mesh = read_abaqus(file)
    x = mesh.points[mesh.cells[0]]
    for k, pair in enumerate(EDGES["hexahedron"]):
        np.testing.assert_allclose(x[8 + k], x[[*pair]].mean(axis=0))
    for k, facet in enumerate(FACETS["hexahedron"]):
        np.testing.assert_allclose(x[20 + k], x[[*facet]].mean(axis=0))
    np.testing.assert_allclose(x[26], x[:8].mean(axis=0))
