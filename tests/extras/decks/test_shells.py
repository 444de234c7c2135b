"""Shells of a deck made solid: volume, plate of Kirchhoff, the same brake, and what is refused."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.scene_mesh import grouped_file
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.draft.text import write_scene
from brake_fenicsx.extras.measured.part_modes import part_body, part_modes
from brake_fenicsx.geometry import block, disc, pad
from brake_fenicsx.meshing.brake_mesh import raw_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.meshing.groups import mesh_of_file
from brake_fenicsx.meshing.rawmesh import cell_facets, facet_keys, facet_nodes
from brake_fenicsx.scene import read_scene

E, NU, RHO = 207e9, 0.3, 7820.0
STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n207000., 0.3\n*DENSITY\n7.82e-9\n"
IRON = STEEL.replace("STEEL", "IRON").replace("207000", "125000")
SECTION = "*SHELL SECTION, ELSET={}, MATERIAL=STEEL, OFFSET={}\n{}, 5\n"
KINDS = ("S4R", "S3", "S8R", "S6")


def rows(table):
    return "".join(", ".join(map(str, row)) + "\n" for row in table)


def grid(kind, nx, ny, size, bend=lambda x, y: (x, y, 0.0)):
    """Points and shells of a strip, numbered from 1; ``bend`` places it."""
    step = 2 if kind in ("S8R", "S6") else 1
    u, v = (np.linspace(0.0, own, step * n + 1) for own, n in zip(size, (nx, ny), strict=True))
    points = [bend(x, y) for x in u for y in v]

    def node(i, j):
        return i * v.size + j + 1

    cells = []
    for i in range(0, step * nx, step):
        for j in range(0, step * ny, step):
            a, b, c, d = (
                node(i + step * p, j + step * q) for p, q in ((0, 0), (1, 0), (1, 1), (0, 1))
            )
            e, f, g, h, m = (
                node(i + p, j + q) for p, q in ((1, 0), (2, 1), (1, 2), (0, 1), (1, 1))
            ) if step == 2 else [0] * 5  # fmt: skip
            cells += {
                "S4R": [[a, b, c, d]], "S3": [[a, b, c], [a, c, d]],
                "S8R": [[a, b, c, d, e, f, g, h]], "S6": [[a, b, c, e, f, m], [a, c, d, m, g, h]],
            }[kind]  # fmt: skip
    return points, cells


def deck_of(points, *sets):
    """A deck of shells: sets of kind, name and rows."""
    text = "*HEADING\n*NODE\n" + rows([k, *map(float, p)] for k, p in enumerate(points, 1))
    start = 1000
    for kind, name, cells in sets:
        text += f"*ELEMENT, TYPE={kind}, ELSET={name}\n"
        text += rows([start + k, *cell] for k, cell in enumerate(cells))
        start += len(cells)
    return text + STEEL


def made(folder, text, name="shim"):
    """The scene of a deck whose shells become solid, its path and lines."""
    deck = folder / f"{name}.inp"
    deck.write_text(text)
    scene = deck.with_suffix(".toml")
    for old in (scene, deck.with_name(f"{name}_solid.inp")):
        old.unlink(missing_ok=True)
    write_scene(deck, scene, None, solid=True)
    return read_scene(scene), scene, scene.read_text()


def raw(scene, path):
    return mesh_of_file(grouped_file(path.parent, scene.mesh), scene.parts)


def mass(scene):
    """Of the shim [kg]: of a motion along all three axes a third."""
    M = part_body(scene, "shim", np.zeros((1, 3)))[1].M
    return M.sum() / 3.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("offset", "low"), [("SNEG", 0.0), ("SPOS", -2.0), ("0.25", -1.5)])
def test_mass_and_place_of_a_plate(kind, offset, low, tmp_path):
    """Density times area times thickness; the nodes lie on the side that the offset says."""
    text = deck_of(*plate(kind)) + SECTION.format("SHIM", offset, 2.0)
    scene, path, lines = made(tmp_path, text)
    mesh = raw(scene, path)
    z = 1e3 * mesh.points[:, 2]
    assert (z.min(), z.max()) == pytest.approx((low, low + 2.0), abs=1e-12)
    assert mass(scene) == pytest.approx(RHO * 60e-3 * 20e-3 * 2e-3, rel=1e-9)
    assert mesh.shape == ("hexahedron" if kind in ("S4R", "S8R") else "tetrahedron")
    assert mesh.order == (2 if kind in ("S8R", "S6") else 1)
    assert (
        f'"SHIM.SPOS" = "shim.spos"   # 1200 mm^2, normal (0, 0, 1), middle (30, 10, {low + 2:g}'
        in lines
    )


def plate(kind):
    points, cells = grid(kind, 6, 2, (60.0, 20.0))
    return points, (kind, "SHIM", cells)


@pytest.mark.parametrize(("held", "turns"), [("1, 3", True), ("1, 6", False), ("XSYMM", False)])
def test_edges_that_may_turn(held, turns, tmp_path):
    """An edge at x = 0 that is held in its displacements alone is a hinge: in CalculiX 2.20 the
    first frequency of its deck leifer1 is 0.43 Hz, here 1.02 Hz. It is said. A plane of symmetry
    and a clamp are what a layer has that is held through its thickness."""
    text = deck_of(*plate("S4R")) + SHIM.format("0") + "*NSET, NSET=EDGE\n1, 2, 3\n"
    scene, _, lines = made(tmp_path, text + f"*BOUNDARY\nEDGE, {held}\n")
    assert scene.supports["shim.edge"] == (("x",) if held == "XSYMM" else ("x", "y", "z"))
    assert ("shells that are held here may turn" in lines) == turns
    _, _, lines = made(tmp_path, text + f"*BOUNDARY\n1, {held}\n2, {held}\n3, {held}\n")
    assert ("shells that are held here may turn" in lines) == turns


@pytest.mark.parametrize(
    ("kind", "offset", "radius"),
    [("S4R", "0", 50.0), ("S3", "0", 50.0), ("S8R", "0", 50.0), ("S6", "SNEG", 51.0)],
)
def test_volume_of_a_curved_shim(kind, offset, radius, tmp_path):
    """Mean length times thickness: of the polygon of straight shells exactly, of the arc by curved
    ones within 2e-5; layers of 2 mm about the middle radius, or outside of 50 mm."""
    n, angle = 12, 1.2
    bend = lambda x, y: (50 * np.sin(x), y, 50 * np.cos(x))  # noqa: E731
    points, cells = grid(kind, n, 2, (angle, 20.0), bend)
    text = deck_of(points, (kind, "SHIM", cells)) + SECTION.format("SHIM", offset, 2.0)
    scene, _, _ = made(tmp_path, text)
    straight = kind in ("S4R", "S3")
    length = 2 * n * radius * np.sin(angle / 2 / n) if straight else angle * radius
    expected = RHO * length * 20.0 * 2.0 * 1e-9
    assert mass(scene) == pytest.approx(expected, rel=1e-9 if straight else 2e-5)


@pytest.mark.parametrize(("kind", "within"), [("S4R", 0.007), ("S8R", 0.007), ("S3", 0.012)])
def test_free_square_plate_of_kirchhoff(kind, within, tmp_path):
    """omega a^2 sqrt(rho h / D) of the free square plate with nu = 0.3, thickness a / 100; one
    element through the thickness, displacements of second order. Twisting, saddle, bowl.

    Reference: A. W. Leissa, The free vibration of rectangular plates, J. Sound Vib. 31 (1973) 257;
    limits of finer series: 13.468, 19.596, 24.270.
    """
    points, cells = grid(kind, 10, 10, (100.0, 100.0))
    text = deck_of(points, (kind, "SHIM", cells)) + SECTION.format("SHIM", "SPOS", 1.0)
    scene, _, _ = made(tmp_path, text)
    frequency = part_modes(scene, "shim", np.zeros((1, 3)), 800.0).frequency[:3]
    h, a = 1e-3, 0.1
    D = E * h**3 / 12 / (1 - NU**2)
    found = 2 * np.pi * frequency * a**2 * np.sqrt(RHO * h / D)
    np.testing.assert_allclose(found, [13.468, 19.596, 24.270], rtol=within)


def brake(order):
    """Disc and pad with a shim, hexahedra, in metres."""
    shapes = {
        "disc": (disc, disc.Disc(size=13e-3)),
        "pad": (pad, pad.Pad(shim=(1e-3,), shape="parallel", size=22e-3, plate_size=22e-3)),
    }
    return raw_mesh(shapes, MeshSettings(cells="hexahedra", order=order))


def without_shim(mesh):
    """The brake without its shim, and the shells on the plate's back: their nodes, towards the
    outside; first those that the piston presses.
    """
    shim = mesh.cell_tag == mesh.layers["pad.shim"]
    plate = mesh.cell_tag == mesh.layers["pad.plate"]
    on_plate = facet_keys(cell_facets(mesh)[plate]).reshape(-1)
    facets = cell_facets(mesh)[shim]
    keys = facet_keys(facets)
    low = np.isin(keys, on_plate)
    assert (low.sum(axis=1) == 1).all()  # one element through the thickness
    pressed = np.isin(keys, facet_keys(mesh.facets[mesh.facet_tag == mesh.faces["pad.piston"]]))
    back = facets[low]
    named = facet_nodes(replace(mesh, facets=back, facet_tag=np.ones(len(back), dtype=int)))
    a, b, c = (mesh.points[back[:, k]] for k in (0, 1, 3))
    inwards = np.cross(b - a, c - a)[:, 2] * a[:, 2] < 0
    mirrored = [0, 3, 2, 1] if mesh.order == 1 else [0, 3, 2, 1, 7, 6, 5, 4]
    named = named[:, : len(mirrored)]
    named[inwards] = named[inwards][:, mirrored]
    first = np.argsort(~pressed.any(axis=1), kind="stable")
    gone = mesh.facet_tag == mesh.faces["pad.piston"]
    rest = replace(
        mesh, cells=mesh.cells[~shim], cell_tag=mesh.cell_tag[~shim], facets=mesh.facets[~gone],
        facet_tag=mesh.facet_tag[~gone],
        layers={n: t for n, t in mesh.layers.items() if n != "pad.shim"},
        faces={n: t for n, t in mesh.faces.items() if n != "pad.piston"},
    )  # fmt: skip
    return rest, named[first], int(np.count_nonzero(pressed.any(axis=1)))


SAID = """*SOLID SECTION, ELSET=pad_lining, MATERIAL=IRON
*SOLID SECTION, ELSET=pad_plate, MATERIAL=STEEL
*SOLID SECTION, ELSET=disc_body, MATERIAL=IRON
*SURFACE INTERACTION, NAME=RUBS
*FRICTION
0.4,
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
20000.
*CONTACT PAIR, INTERACTION=RUBS
pad_friction, disc_friction
*BOUNDARY
disc_bore, ENCASTRE
pad_ears, 1, 2
"""
# The parts touch, but share no node; the second face is on both sides of the disc.
BAND = ["stability.band=['0 Hz', '4 kHz']", "contact.pad_disc.law.linear='2e13 Pa/m'"]


@pytest.fixture
def pair(meshes, tmp_path):
    """Scenes of a brake with its shim as solids, and as shells made solid, by order."""

    def scenes(order):
        mesh = brake(order)
        rest, shells, pressed = without_shim(mesh)
        kind, text = "S4" if order == 1 else "S8R", {}
        for name, own in (("solids", mesh), ("shells", rest)):
            meshes.write_abaqus(own, tmp_path / f"{name}.inp")
            text[name] = (tmp_path / f"{name}.inp").read_text() + STEEL + IRON + SAID
        deck = tmp_path / "solids.inp"
        deck.write_text(
            text["solids"] + "*SOLID SECTION, ELSET=pad_shim, MATERIAL=STEEL\n"
            "*DSLOAD\npad_piston, P, 0.5\n"
        )
        write_scene(deck, deck.with_suffix(".toml"))
        numbered = [[900000 + k, *(10 + row)] for k, row in enumerate(shells)]
        more = (
            f"*ELEMENT, TYPE={kind}, ELSET=PISTON\n{rows(numbered[:pressed])}"
            f"*ELEMENT, TYPE={kind}, ELSET=REST\n{rows(numbered[pressed:])}"
            "*ELSET, ELSET=pad_shim\nPISTON, REST\n*SURFACE, NAME=BACK\nPISTON, SPOS\n"
            + SECTION.format("pad_shim", "SNEG", 1.0)
            + "*DSLOAD\nBACK, P, 0.5\n"
        )
        _, path, lines = made(tmp_path, text["shells"] + more, "shells")
        assert 'shim = "STEEL"' in lines and "not taken over:" not in lines, lines
        return deck.with_suffix(".toml"), path

    return scenes


@pytest.mark.long
@pytest.mark.parametrize("order", [1, 2])
def test_a_brake_with_its_shim_as_shells(order, pair, capsys):
    """The same matrices, contact and load as with the shim as solids, in another order of nodes."""
    solids, shells = pair(order)
    assert main(["check", str(shells)]) == 0
    assert "not read" not in capsys.readouterr().err
    a, b = (assemble_brake(read_scene(path), MPI.COMM_SELF) for path in (solids, shells))
    for name in ("K", "M"):
        one, other = (np.sort(getattr(x, name).diagonal()) for x in (a, b))
        np.testing.assert_allclose(other, one, rtol=1e-9)
    assert a.N.shape == b.N.shape and b.w.sum() == pytest.approx(a.w.sum(), rel=1e-12)
    np.testing.assert_allclose(np.sort(b.f), np.sort(a.f), atol=1e-9 * np.abs(a.f).max())


@pytest.mark.slow
def test_modes_of_a_brake_with_its_shim_as_shells(pair):
    """Complex modes with friction, one of them growing."""
    found = [prepare(path, BAND).modes().s for path in pair(2)]
    a, b = map(np.sort_complex, found)
    assert a.size > 8 and a.real.max() > 1.0
    np.testing.assert_allclose(b, a, rtol=1e-7, atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(
    ("cells", "order", "nodes"),
    [("tetrahedra", 1, 3), ("tetrahedra", 2, 3), ("tetrahedra", 2, 6), ("hexahedra", 2, 4)],
)
def test_a_layer_on_solids_makes_one_body(cells, order, nodes, meshes, tmp_path):
    """Shells of first and second order on the nodes of a box of 12 mm, 1.5 mm thick: mass and
    frequencies are those of a box of 13.5 mm, also where the middle nodes are those of the solids.
    """
    mesh = meshes.boxes(cells, order)
    own = mesh.facet_tag == mesh.faces["pad.top"]
    facets = facet_nodes(mesh)[own][:, :nodes]
    x = mesh.points[facets]
    down = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])[:, 2] < 0
    turned = {3: [0, 2, 1], 4: [0, 3, 2, 1], 6: [0, 2, 1, 5, 4, 3]}[nodes]
    facets[down] = facets[down][:, turned]
    deck = tmp_path / "solids.inp"
    meshes.write_abaqus(mesh, deck)
    said = "".join(f"*SOLID SECTION, ELSET={n}_body, MATERIAL=STEEL\n" for n in ("pad", "plate"))
    text = f"*ELEMENT, TYPE=S{nodes}, ELSET=SHIM\n" + rows(
        [5000 + k, *(10 + row)] for k, row in enumerate(facets)
    )
    text = deck.read_text() + text + STEEL + said + SECTION.format("SHIM", "SNEG", 1.5)
    scene, _, _ = made(tmp_path, text, "pad")
    whole = {"pad": (block, block.Block(length=40e-3, width=20e-3, height=13.5e-3, size=4e-3))}
    meshes.write_abaqus(raw_mesh(whole, MeshSettings(cells="hexahedra")), tmp_path / "whole.inp")
    one = (tmp_path / "whole.inp").read_text() + STEEL + said.splitlines(keepends=True)[0]
    (tmp_path / "whole.inp").write_text(one)
    write_scene(tmp_path / "whole.inp", tmp_path / "whole.toml")
    known = read_scene(tmp_path / "whole.toml")
    found, exact = (part_modes(s, "pad", np.zeros((1, 3)), 50e3).frequency for s in (scene, known))
    np.testing.assert_allclose(found, exact, rtol=0.012)
    masses = [part_body(s, "pad", np.zeros((1, 3)))[1].M.sum() for s in (scene, known)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-9)


# Two hexahedra of 10 mm on each other, each face of the upper one with 4 nodes.
POINTS = [(x, y, z) for z in (0.0, 10.0, 20.0) for x, y in ((0, 0), (10, 0), (10, 10), (0, 10))]
SOLIDS = (
    "*ELEMENT, TYPE=C3D8, ELSET=BODY\n1, 1, 2, 3, 4, 5, 6, 7, 8\n2, 5, 6, 7, 8, 9, 10, 11, 12\n"
    "*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL\n"
)
TOP = [[9, 10, 11, 12]]
SHIM = SECTION.format("SHIM", "{}", 1.0)
BENT = [(x, y, 0) for x, y, _ in POINTS[:4]]
BENT += [(x, y, z) for x, z in ((5, 5), (20, 0)) for y in (0, 10)]
ONE = deck_of(POINTS[:4], ("S4", "SHIM", [[1, 2, 3, 4]]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ONE, "has no \\*SHELL SECTION"),
        (
            ONE + SECTION.format("SHIM", 0, 0.0),
            r"deck.inp:14: \*SHELL SECTION, .*: no thickness above 0; write one for each layer",
        ),
        (
            ONE + SECTION.format("SHIM", 0, "nan"),
            "no thickness above 0",
        ),
        (
            ONE + SHIM.format("DIST"),
            "OFFSET=DIST: its lines are not understood",
        ),
        (
            ONE + "*SHELL SECTION, ELSET=SHIM, MATERIAL=STEEL, NODAL THICKNESS\n",
            "no thickness above 0",
        ),
        (
            ONE + SECTION.format("OTHER", 0, 1.0),
            "no shell of 3, 4, 6 or 8 nodes is in this set",
        ),
        (  # a branch: three shells at the edge from node 2 to node 3
            deck_of(BENT, ("S4", "SHIM", [[1, 2, 3, 4], [2, 7, 8, 3], [2, 3, 6, 5]]))
            + SHIM.format(0),
            r"near \(10, (0|10), 0\) more than two shells meet at an edge; mesh this branch as",
        ),
        (
            deck_of(BENT, ("S4", "SHIM", [[1, 2, 3, 4], [7, 2, 3, 8]])) + SHIM.format(0),
            "near .* the normals of two neighbours are opposed; reverse the nodes of one",
        ),
        (  # back over itself by 135 degrees
            deck_of(BENT, ("S4", "SHIM", [[1, 2, 3, 4], [2, 5, 6, 3]])) + SHIM.format(0),
            "folded too sharply for their thickness",
        ),
        (  # a tube of 8 mm inside, 10 mm thick inwards
            deck_of(
                *(lambda p, c: (p, ("S4R", "SHIM", c)))(
                    *grid("S4R", 6, 1, (2.0, 5.0), lambda x, y: (8 * np.sin(x), y, 8 * np.cos(x)))
                )
            )
            + SECTION.format("SHIM", "SPOS", 10.0),
            "folded too sharply for their thickness",
        ),
        (
            deck_of(BENT, ("S4", "SHIM", [[1, 2, 3, 4]]), ("S4", "OTHER", [[2, 7, 8, 3]]))
            + SHIM.format(0)
            + SECTION.format("OTHER", 0, 2.0),
            "near .* it meets .*ELSET=.*, of another thickness or offset; give both the same",
        ),
        (
            deck_of(POINTS, ("S3", "SHIM", [[9, 10, 11], [9, 11, 12]])) + SOLIDS + SHIM.format(0),
            "2 of its shells are triangles, while other elements have faces of 4 corners",
        ),
        (deck_of(POINTS, ("S4", "SHIM", TOP)) + SOLIDS + SHIM.format("SPOS"), "write OFFSET=SNEG"),
        (deck_of(POINTS, ("S4", "SHIM", TOP)) + SOLIDS + SHIM.format("0."), "write OFFSET=SNEG"),
        (
            deck_of(POINTS, ("S4", "SHIM", [[1, 2, 3, 4]])) + SOLIDS + SHIM.format("SNEG"),
            "the layer would lie within the solid that its nodes are on; write OFFSET=SPOS",
        ),
        (
            deck_of(POINTS, ("S4", "SHIM", [[5, 6, 7, 8]])) + SOLIDS + SHIM.format("SNEG"),
            "shells lie between two solids",
        ),
        (  # stands on an edge of the solid
            deck_of([*POINTS, (10, 0, 30), (10, 10, 30)], ("S4", "SHIM", [[10, 13, 14, 11]]))
            + SOLIDS
            + SHIM.format("0"),
            "shells share nodes, but no whole face, with solids; tie them",
        ),
    ],
)
def test_what_is_no_layer_is_refused(text, said, tmp_path):
    """In one line that names section, place and remedy; nothing is written."""
    with pytest.raises(SceneError, match=said) as refused:
        made(tmp_path, text, "deck")
    assert "\n" not in str(refused.value)
    assert [path.name for path in tmp_path.iterdir()] == ["deck.inp"]


def test_without_being_asked(tmp_path, monkeypatch, capsys):
    """One line says what they are and what to write; with it the scene is written."""
    (tmp_path / "deck.inp").write_text(deck_of(*plate("S4R")) + SHIM.format("SNEG"))
    monkeypatch.chdir(tmp_path)
    assert main(["init", "deck.inp"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "shells (12 S4R) are no part of a scene; add --shells solid" in line
    assert main(["init", "deck.inp", "--shells", "solid"]) == 0
    assert "wrote deck.toml and deck_solid.inp: 1 part, 2 faces" in capsys.readouterr().out


TIED = """*SURFACE, NAME=UNDER
BODY, S2
*SURFACE, NAME=LAYER
SHIM{side}
*TIE, NAME=GLUE
UNDER, LAYER
"""


@pytest.mark.parametrize("side", ["", ", SNEG"])
def test_sides_of_a_surface(side, tmp_path):
    """A middle surface half a thickness above the body: the lower side of the layer is glued to
    it, named or found; a pressure on the elements acts along their normal, on the lower side too.
    """
    points = [*POINTS[:8], *((x, y, 10.5) for x, y, _ in POINTS[:4])]
    solid = SOLIDS.replace("2, 5, 6, 7, 8, 9, 10, 11, 12\n", "")
    text = deck_of(points, ("S4", "SHIM", TOP)) + solid + SHIM.format("0") + TIED.format(side=side)
    scene, path, lines = made(tmp_path, text)
    (tie,) = scene.ties.values()
    low = tie.faces[1]
    assert tie.faces[0] == "body.under" and "not taken over:" not in lines
    mesh = raw(scene, path)
    z = mesh.points[mesh.facets[mesh.facet_tag == mesh.faces[low]]][..., 2]
    np.testing.assert_allclose(z, 10e-3, atol=1e-12)
    assert mass(scene) == pytest.approx(RHO * 1e-7)
    text = text.partition("*SURFACE")[0]
    scene, path, lines = made(tmp_path, text + "*DLOAD\nSHIM, P, 0.3\n")
    ((face, load),) = scene.loads.items()
    mesh = raw(scene, path)
    z = mesh.points[mesh.facets[mesh.facet_tag == mesh.faces[face]]][..., 2]
    np.testing.assert_allclose(z, 10e-3, atol=1e-12)
    assert load.pressure == pytest.approx(0.3e6)


def test_the_last_section_of_a_set_counts(tmp_path):
    text = deck_of(*plate("S4R")) + SHIM.format(0) + SECTION.format("SHIM", 0, 2.0)
    assert mass(made(tmp_path, text)[0]) == pytest.approx(RHO * 60e-3 * 20e-3 * 2e-3, rel=1e-9)


def test_continuum_shells_are_solids(tmp_path):
    """SC8R has the nodes of a hexahedron: no option, and no thickness but that of its nodes."""
    text = deck_of(POINTS, ("SC8R", "SHIM", [[5, 6, 7, 8, 9, 10, 11, 12]]))
    text += SOLIDS.replace("2, 5, 6, 7, 8, 9, 10, 11, 12\n", "") + SHIM.format("0")
    (tmp_path / "deck.inp").write_text(text)
    write_scene(tmp_path / "deck.inp", tmp_path / "deck.toml")
    scene = read_scene(tmp_path / "deck.toml")
    (part,) = scene.parts
    assert scene.parts[part].material == "STEEL"
    M = part_body(scene, part, np.zeros((1, 3)))[1].M
    assert M.sum() / 3 == pytest.approx(RHO * 2e-6, rel=1e-9)


def test_a_corner_of_a_box(tmp_path):
    """Three shells at right angles, folds of 90 degrees, outside of a cube of 10 mm: 11^3 - 10^3
    mm^3 of it; a coordinate that is blank or left out is 0, and a set may name one of beams.
    """
    corners = [[v, w, x] for v in (0, 10) for w in (0, 10) for x in (0, 10)]
    faces = [[3, 7, 5, 1], [2, 4, 3, 1], [5, 6, 2, 1]]  # z, x and y = 0, normals outwards
    text = deck_of(corners, ("S4", "SHIM", faces)).replace("1, 0.0, 0.0, 0.0\n", "1, , 0.0\n")
    assert "1, , 0.0\n" in text
    text += "*ELEMENT, TYPE=B31, ELSET=BARS\n5000, 1, 2\n*ELSET, ELSET=ALL\nBARS, SHIM\n"
    scene, _, _ = made(tmp_path, text + SECTION.format("SHIM", "SNEG", 1.0))
    assert mass(scene) == pytest.approx(RHO * (11**3 - 10**3) * 1e-9, rel=1e-9)


def test_layers_of_a_composite_in_two_instances(tmp_path):
    """From SNEG to SPOS, each with its material; triangles and quadrilaterals of one set."""
    part = deck_of(BENT, ("S4", "SHIM", [[1, 2, 3, 4]]), ("S3", "SHIM", [[2, 7, 8], [2, 8, 3]]))
    part = part.replace("*HEADING\n", "").replace(STEEL, "")
    text = (
        "*HEADING\n*PART, NAME=P\n" + part + "*SHELL SECTION, ELSET=SHIM, COMPOSITE, OFFSET=SPOS\n"
        "0.5, 3, STEEL\n0.1, 3, IRON, 0.\n0.4, 3, STEEL, -45.\n*END PART\n*ASSEMBLY, NAME=A\n"
        "*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n*INSTANCE, NAME=P-2, PART=P\n0., 0., 50.\n"
        "*END INSTANCE\n*END ASSEMBLY\n" + STEEL + IRON
    )
    scene, path, lines = made(tmp_path, text)
    assert '"P-1.SHIM.1" = ' in lines and len(scene.parts) == 2
    assert "layers turned by -45.: make each a part" in lines
    mesh = raw(scene, path)
    assert mesh.shape == "tetrahedron"
    for name, part in scene.parts.items():
        assert [*part.material.values()] == ["STEEL", "IRON", "STEEL"]
        for (layer, low), high in zip(
            zip(part.material, (-1.0, -0.5, -0.4), strict=True), (-0.5, -0.4, 0.0), strict=True
        ):
            own = mesh.cells[mesh.cell_tag == mesh.layers[f"{name}.{layer}"]]
            z = 1e3 * mesh.points[own][..., 2]
            z = z - 50.0 * (z.max() > 10)
            assert (z.min(), z.max()) == pytest.approx((low, high), abs=1e-9)


def test_shells_of_nastran(tmp_path):
    """PSHELL and PCOMP of a .bdf: grid points in the middle, and below all layers."""
    pytest.importorskip("meshio")
    pytest.importorskip("pyNastran")
    grids = "".join(f"GRID,{k},,{x}.,{y}.,{z}.\n" for k, (x, y, z) in enumerate(BENT, 1))
    text = (
        f"CEND\nBEGIN BULK\n{grids}CQUAD4,1,5,1,2,3,4\nCQUAD4,2,5,2,7,8,3\n"
        "{}MAT1,7,207000.,,.3,7.82-9\nMAT1,8,125000.,,.3,7.82-9\nENDDATA\n"
    )
    deck, scene = tmp_path / "shim.bdf", tmp_path / "shim.toml"
    plain, layered = "PSHELL,5,7,1.5,7\n", "PCOMP,5,0.,,,,,,,\n,7,1.,0.,YES,8,.5,0.,YES\n"
    deck.write_text(text.format(plain))
    with pytest.raises(SceneError, match=r"PSHELL,5,7,1.5,7: shells \(2 CQUAD4\) are no part"):
        write_scene(deck, scene)
    half = "PCOMP,5,,,,,,,SYM,\n,7,.5,0.,YES,8,.25,0.,YES\n"
    for cards, low, layers in ((plain, -0.75, 1), (layered, 0.0, 2), (half, -0.75, 4)):
        deck.write_text(text.format(cards))
        for old in (scene, tmp_path / "shim_solid.inp"):
            old.unlink(missing_ok=True)
        write_scene(deck, scene, solid=True)
        read = read_scene(scene)
        mesh, (part,) = raw(read, scene), read.parts
        z = 1e3 * mesh.points[:, 2]
        assert (z.min(), z.max()) == pytest.approx((low, low + 1.5), abs=1e-9)
        assert len(mesh.layers) == layers
        M = part_body(read, part, np.zeros((1, 3)))[1].M
        assert M.sum() / 3 == pytest.approx(RHO * 20e-3 * 10e-3 * 1.5e-3, rel=1e-9)
    deck.write_text(text.format(plain + "PSOLID,9,7,0,0   THREE\n"))
    write_scene(deck, tmp_path / "odd.toml", solid=True)
    assert "PSOLID,9,7,0,0   THREE (shim.bdf:14): its lines" in (tmp_path / "odd.toml").read_text()
    card = f"{'CQUAD4':8}{''.join(f'{n:8d}' for n in (2, 5, 2, 7, 8, 3))}      0.   7.5-1\n"
    for first, again, low in (
        ("1,5,1,2,3,4,,.75", card, 0.0),
        ("1,5,1,2,3,4,30.,", "CQUAD4,2,5,2,7,8,3,30.\n", -0.75),
    ):
        shells = "CQUAD4,1,5,1,2,3,4\nCQUAD4,2,5,2,7,8,3\n"
        deck.write_text(text.format(plain).replace(shells, f"CQUAD4,{first}\n{again}"))
        for old in (scene, tmp_path / "shim_solid.inp"):
            old.unlink()
        write_scene(deck, scene, solid=True)
        z = 1e3 * raw(read_scene(scene), scene).points[:, 2]
        assert (z.min(), z.max()) == pytest.approx((low, low + 1.5), abs=1e-9)
    for cards, turned, said in (
        (half.replace(",0.,YES,8", ",45.,YES,8"), "", "layers turned by 45, 45: make each a part"),
        (layered.replace("0.,,,", "0.,2-9,,"), "", "a mass of 2e-09 per area: write [masses]"),
        (plain.replace(",7\n", "\n"), "", "its own bending stiffness"),
        (half.replace("SYM", "SMEAR"), "", "its own bending stiffness"),
        (plain, ",30.", "THETA or MCID 30.0: write the axis of the part"),
        (plain, ",0", "THETA or MCID 0: write the axis of the part"),
    ):
        deck.write_text(text.format(cards).replace("2,7,8,3\n", f"2,7,8,3{turned}\n"))
        for old in (scene, tmp_path / "shim_solid.inp"):
            old.unlink()
        write_scene(deck, scene, solid=True)
        (line,) = (one for one in scene.read_text().splitlines() if "not taken over:" in one)
        assert line.endswith(said), line
    deck.write_text(text.format(plain).replace("2,7,8,3\n", "2,7,8,3,,.75\n"))
    with pytest.raises(SceneError, match="shells with several ZOFFS; give each a property"):
        write_scene(deck, tmp_path / "other.toml", solid=True)
