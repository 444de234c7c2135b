"""Decks of Nastran and archives of Ansys: the same body however it is written.

The body is a sector of a ring, radius 96 to 140 mm, 60 degrees, 10 mm thick, of 6 CHEXA.
"""

from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from brake_fenicsx.build.bodies import assemble_bodies
from brake_fenicsx.build.scene_mesh import scene_mesh
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.draft.text import write_scene
from brake_fenicsx.meshing.meshfile import read_mesh_file
from brake_fenicsx.scene import read_scene

pytest.importorskip("pyNastran")
R, ANGLE, Z = (96.0, 118.0, 140.0), (60.0, 80.0, 100.0, 120.0), (0.0, 10.0)
POLAR = np.array([(r, a, z) for z in Z for a in ANGLE for r in R])
_R, _A, _Z = POLAR.T
CARTESIAN = np.column_stack([_R * np.cos(np.radians(_A)), _R * np.sin(np.radians(_A)), _Z])
CELLS = [
    [o + i + 3 * j + d for o in (0, 12) for d in (0, 1, 4, 3)] for j in range(3) for i in range(2)
]
MATERIAL = "PSOLID,1,7\nMAT1,7,125000.,,.24,7.2-9\n"
CORD2C = "CORD2C,5,0,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n"
SHIFTED = "CORD2R,5,0,0.,0.,50.,0.,0.,51.,\n,1.,0.,50.\n"


def grid(points, cp=""):
    """GRID cards in fields of 16 columns."""
    return "".join(
        f"GRID*   {n:16d}{cp:>16}{x:16.9f}{y:16.9f}\n*       {z:16.9f}\n"
        for n, (x, y, z) in enumerate(points, 1)
    )


def cells(rows=CELLS, form="small"):
    """CHEXA cards in fields of 8 columns, with a blank continuation, or free."""
    lines = []
    for number, row in enumerate(rows, 1):
        words = [str(number), "1", *(str(n + 1) for n in row)]
        if form == "free":
            lines.append("CHEXA," + ",".join(words[:8]) + "\n," + ",".join(words[8:]) + "\n")
            continue
        mark = "+" if form == "small" else " "
        first, second = ("".join(f"{w:>8}" for w in part) for part in (words[:8], words[8:]))
        lines.append(f"CHEXA   {first}{mark}\n{mark:8}{second}\n")
    return "".join(lines)


BEGIN, END = "SOL 103\nCEND\nBEGIN BULK\n", "ENDDATA\n"
FORMS = {
    "plain": BEGIN + grid(CARTESIAN) + cells() + MATERIAL + END,
    "no BEGIN BULK": grid(CARTESIAN) + cells() + MATERIAL,
    "blank continuations": BEGIN + grid(CARTESIAN) + cells(form="blank") + MATERIAL + END,
    "free format": BEGIN + grid(CARTESIAN) + cells(form="free") + MATERIAL + END,
    "a spring beside": BEGIN + grid(CARTESIAN) + cells() + "CELAS1,901,7,1,1,2,1\n" + MATERIAL
    + END,
    "cylindrical points": BEGIN + CORD2C + grid(POLAR, "5") + cells() + MATERIAL + END,
    "GRDSET": BEGIN + CORD2C + "GRDSET,,5\n" + grid(POLAR) + cells() + MATERIAL + END,
    "GRDSET, not for 0": BEGIN + CORD2C + "GRDSET,,5\n" + grid(CARTESIAN, "0") + cells() + MATERIAL
    + END,
    "a shifted system": BEGIN + SHIFTED + grid(CARTESIAN - [0, 0, 50.0], "5") + cells() + MATERIAL
    + END,
    "INCLUDE": BEGIN + grid(CARTESIAN) + cells(CELLS[:4]) + "INCLUDE 'rest.inc'\n" + MATERIAL + END,
    "DOS ends": (BEGIN + grid(CARTESIAN) + cells() + MATERIAL + END).replace("\n", "\r\n"),
}  # fmt: skip
REST = cells(CELLS).split("CHEXA")[5:]


def drafted(folder, text, name="sector.bdf"):
    """Mesh, scene and text of the scene."""
    file, scene = folder / name, folder / "sector.toml"
    file.write_bytes(text.encode())
    scene.unlink(missing_ok=True)
    write_scene(file, scene)
    return read_mesh_file(file), read_scene(scene), scene.read_text()


@pytest.mark.parametrize("form", FORMS)
def test_the_same_body(form, tmp_path):
    """Positions of the Cartesian twin to its digits, cells and material; pyNastran 1.4.1 itself
    gives points of GRDSET basic coordinates, and meshio 5.3.5 reads none of these but the plain."""
    (tmp_path / "rest.inc").write_text("".join(f"CHEXA{card}" for card in REST))
    mesh, scene, text = drafted(tmp_path, FORMS[form])
    np.testing.assert_allclose(mesh.points, CARTESIAN, atol=2e-7)
    assert sorted(map(sorted, mesh.cells.tolist())) == sorted(map(sorted, CELLS))
    assert scene.materials["MAT7"].E == 125e9
    assert scene.materials["MAT7"].rho == pytest.approx(7200.0)
    assert text.count("not taken over:") == (form == "a spring beside")
    if form == "a spring beside":
        assert "[springs]\n# not taken over: CELAS1,901,7,1,1,2,1 (sector.bdf:" in text


def test_middle_nodes_of_a_chexa(tmp_path):
    """Nastran has the upright edges before the upper ones; a middle node less is refused."""
    from brake_fenicsx.meshing.rawmesh import EDGES

    low = [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)]
    corners = np.array([(*x, z) for z in (0.0, 40.0) for x in low])
    pairs = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6),
             (6, 7), (7, 4)]  # fmt: skip
    points = np.vstack([corners, corners[np.array(pairs)].mean(axis=1)])
    card = "CHEXA,1,1,1,2,3,4,5,6\n,7,8,9,10,11,12,13,14\n,15,16,17,18,19,20\n"
    mesh, *_ = drafted(tmp_path, grid(points) + card + MATERIAL)
    x = mesh.points[mesh.cells[0]]
    edges = x[np.array(EDGES["hexahedron"])].mean(axis=1)
    np.testing.assert_allclose(x[8:20], edges, atol=1e-9)
    with pytest.raises(SceneError, match=r"CHEXA 1 has 19 nodes; write all middle nodes"):
        drafted(tmp_path, grid(points) + card.replace(",20\n", "\n") + MATERIAL)


def test_what_changes_the_brake_is_taken_or_said(tmp_path):
    """WTMASS multiplies densities; GE is a loss factor; MAT9, SPC1, PS, loads have a line."""
    more = "PARAM,WTMASS,0.5\nPARAM,POST,-1\nSPC1,1,123,1,2\nFORCE,1,1,,1.,0.,0.,1.\nEIGRL,1,,,9\n"
    text = BEGIN + grid(CARTESIAN) + cells() + more + MATERIAL.replace("7.2-9", "7.2-9,,,.02") + END
    _, scene, said = drafted(tmp_path, text)
    assert scene.materials["MAT7"].rho == pytest.approx(3600.0)
    assert scene.materials["MAT7"].loss == 0.02
    assert "[supports]\n# not taken over: SPC1,1,123,1,2 (sector.bdf:" in said
    assert "[loads]\n# not taken over: FORCE,1,1,,1.,0.,0.,1. (sector.bdf:" in said
    assert said.count("not taken over:") == 2
    for card in ("MAT8,7,1.,1.,.3,1.\n", "MAT9,7,1.,0.,0.,0.,0.,0.,1.\n"):
        file, scene = tmp_path / "other.bdf", tmp_path / "other.toml"
        scene.unlink(missing_ok=True)
        file.write_text(BEGIN + grid(CARTESIAN) + cells() + "PSOLID,1,7\n" + card + END)
        write_scene(file, scene, ["mm", "t", "s"])
        said = scene.read_text()
        assert f"# not taken over: {card.strip()} (other.bdf:" in said and "# missing: MAT7" in said
    held = grid(CARTESIAN).replace("*       ", "*       ", 1) + cells() + "GRDSET,,,,,,,123\n"
    _, _, said = drafted(tmp_path, BEGIN + held + MATERIAL + END)
    assert "24 points are held by their GRID or GRDSET: write [supports]" in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (grid(CARTESIAN) + "=,*1,==\n" + cells(), "replicated cards are not read"),
        (BEGIN + grid(CARTESIAN) + "BEGIN SUPER=1\n" + cells(), "superelements are not read"),
        (
            grid(CARTESIAN) + cells() + "INCLUDE 'nowhere.inc'\n",
            "included file cannot be read.*now",
        ),
        (grid(CARTESIAN).replace("GRID*   ", "GRID*   x", 1) + cells(), "sector.bdf:1: GRID"),
        (grid(CARTESIAN, "9") + cells(), "cannot be read"),
        (grid(CARTESIAN) + cells(CELLS + CELLS[:1]), "elements 1 and 7 have the same corners"),
    ],
)
def test_decks_that_are_refused(text, said, tmp_path, monkeypatch, capsys):
    """One line and no file: pyNastran 1.4.1 would leave a pyNastran_crash.bdf where one stands."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match=said) as refused:
        drafted(tmp_path, text)
    assert "\n" not in str(refused.value) and "".join(capsys.readouterr()) == ""
    assert [path.name for path in tmp_path.iterdir()] == ["sector.bdf"]


ARCHIVE = """/PREP7
{types}
NBLOCK,6,SOLID,{count},{count}
{form}
{nodes}N,UNBL,LOC,       -1,
EBLOCK,19,SOLID,{cells},{cells}
(19i9)
{rows}       -1
{more}
FINISH
"""
ISOTROPIC = "MP,EX,1,125000.\nMP,NUXY,1,0.24\nMP,DENS,1,7.2e-9\n"
SHAPES = {"(3i9,6e21.13e3)": (9, 9, 9), "(1i7,2i9,6e21.13)": (7, 9, 9), "(3i8,6e20.13)": (8, 8, 8)}


def archive(types="ET,1,185\nET,2,173", form="(3i9,6e21.13e3)", more=ISOTROPIC, angles="", esys=0):
    """The sector as blocked .cdb, with four contact elements of type 2."""
    widths, real = SHAPES[form], 20 if "20.13" in form else 21
    nodes = "".join(
        f"{n:{widths[0]}d}{0:{widths[1]}d}{0:{widths[2]}d}"
        + "".join(f"{v:{real}.13E}" for v in x) + angles + "\n"
        for n, x in enumerate(CARTESIAN, 1)
    )  # fmt: skip
    rows = [
        [1, 1, 1, 1, esys, 0, 0, 0, 8, 0, k, *(n + 1 for n in c)] for k, c in enumerate(CELLS, 1)
    ]
    rows += [[1, 2, 1, 1, 0, 0, 0, 0, 4, 0, 90 + k, 1, 2, 5, 4] for k in range(4)]
    text = "".join("".join(f"{v:9d}" for v in row) + "\n" for row in rows)
    return ARCHIVE.format(
        types=types, count=24, form=form, nodes=nodes, cells=10, rows=text, more=more
    )


BLOCK = "ETBLOCK,        2,        2\n(2i9,19a9)\n        1      185" + "        0" * 19
BLOCK += "\n        2      173" + "        0" * 19 + "\n       -1"


@pytest.mark.parametrize("form", SHAPES)
@pytest.mark.parametrize("types", ["ET,1,185\nET,2,173", "ET,1,SOLID185\nET,2,CONTA173", BLOCK])
def test_types_and_formats_of_ansys(types, form, tmp_path):
    """By number, by name, and ETBLOCK, the default since 2023 R1; three formats of NBLOCK."""
    mesh, scene, text = drafted(tmp_path, archive(types, form), "sector.cdb")
    np.testing.assert_allclose(mesh.points, CARTESIAN, atol=1e-9)
    assert len(mesh.cells) == 6 and "not taken over: 4 CONTA173 elements" in text
    assert scene.materials["MAT1"].E == 125e9 and text.count("not taken over:") == 1


def test_elements_of_workbench(tmp_path):
    """EBLOCK without SOLID has another layout: counted by the type; solids in it are refused."""
    more = "ET,3,154\neblock,10,,,1\n(15i9)\n       99{:9d}        3        3        0"
    more += "        1        2        5        4\n-1\n" + ISOTROPIC
    _, scene, text = drafted(tmp_path, archive(more=more.format(3)), "sector.cdb")
    assert "4 CONTA173 elements" in text and "1 SURF154 element" in text
    assert scene.materials["MAT1"].E == 125e9
    with pytest.raises(SceneError, match="solids in an EBLOCK without SOLID"):
        drafted(tmp_path, archive(more=more.format(1)), "solids.cdb")


@pytest.mark.parametrize("block", ["NBLOCK", "EBLOCK"])
def test_an_archive_that_is_cut_off(block, tmp_path):
    """Refused; mapdl-archive 0.4.2 reads the nodes and elements up to there, and says nothing."""
    before, found, after = archive().partition(block)
    rows = after.splitlines(keepends=True)[:5]
    with pytest.raises(SceneError, match=f"ends within its {block}: it is cut off"):
        drafted(tmp_path, before + found + "".join(rows), "sector.cdb")


def test_an_unknown_type_is_no_solid(tmp_path):
    with pytest.raises(SceneError, match="no tetrahedra or hexahedra"):
        drafted(tmp_path, archive("ET,2,173"), "sector.cdb")


ORTHOTROPIC = "".join(
    f"MPDATA,R5.0, 1,{label:4},     1, 1, {value},\n"
    for label, value in (
        ("EX", 8000.0), ("EY", 7000.0), ("EZ", 2000.0), ("PRXY", 0.31), ("PRYZ", 0.32),
        ("PRXZ", 0.33), ("GXY", 3000.0), ("GYZ", 1100.0), ("GXZ", 1200.0), ("DENS", 2.5e-9),
    )
)  # fmt: skip


def test_orthotropic_constants_of_ansys(tmp_path):
    """Nine constants in a scene's order; one less, a second value, element axes have a line."""
    _, scene, text = drafted(tmp_path, archive(more=ORTHOTROPIC), "sector.cdb")
    own = scene.materials["MAT1"]
    assert own.model == "orthotropic" and pytest.approx((8e9, 7e9, 2e9)) == own.E
    assert own.nu == (0.31, 0.33, 0.32) and pytest.approx((1.1e9, 1.2e9, 3e9)) == own.G
    assert own.rho == pytest.approx(2500.0) and text.count("not taken over:") == 1
    file, scene = tmp_path / "less.cdb", tmp_path / "less.toml"
    for more, said in (
        (ORTHOTROPIC.replace("GXZ ", "ALPX"), "no elastic constant or density"),
        (ISOTROPIC + "MP,EX,1,5.\n", "several values"),
        (ISOTROPIC + "MP,GXY,1,5.\n", "; the file has EX, NUXY, DENS, GXY"),
        ("MP,DENS,1,7.2e-9\nMP,ALPX,1,1e-5\n", "no elastic constant or density"),
        (ORTHOTROPIC.replace("8000.0,", "8000.0, 9000.0,"), "several values"),
    ):
        file.write_text(archive(more=more))
        scene.unlink(missing_ok=True)
        write_scene(file, scene, ["mm", "t", "s"])
        text = scene.read_text()
        assert said in text and "# missing: MAT1" in text
    _, scene, text = drafted(tmp_path, archive(more=ISOTROPIC + "MP,ALPX,1,1e-5\n"), "sector.cdb")
    assert scene.materials["MAT1"].E == 125e9 and "MP,ALPX,1,1e-5 (sector.cdb:" in text
    _, _, text = drafted(tmp_path, archive(esys=12), "sector.cdb")
    assert "solids have element coordinate systems 12: write the axis of the part" in text


# Their compliance [1/MPa] by the manuals of Abaqus and Ansys, in the order 11, 22, 33, 23, 13, 12.
COMPLIANCE = np.diag([1 / 8000, 1 / 7000, 1 / 2000, 1 / 1100, 1 / 1200, 1 / 3000])
COMPLIANCE[0, 1] = COMPLIANCE[1, 0] = -0.31 / 8000
COMPLIANCE[0, 2] = COMPLIANCE[2, 0] = -0.33 / 8000
COMPLIANCE[1, 2] = COMPLIANCE[2, 1] = -0.32 / 7000
# Numbers of Abaqus: nine constants; nine, or 21, stiffnesses of 11, 22, 33, 12, 13, 23 by columns.
ABAQUS = np.linalg.inv(COMPLIANCE)[np.ix_([0, 1, 2, 5, 4, 3], [0, 1, 2, 5, 4, 3])]
COLUMNS = [ABAQUS[i, j] for j in range(6) for i in range(j + 1)]
ELASTIC = {
    "ENGINEERING CONSTANTS": [8e3, 7e3, 2e3, 0.31, 0.33, 0.32, 3e3, 1.2e3, 1.1e3],
    "ORTHOTROPIC": [*COLUMNS[:6], *(COLUMNS[i] for i in (9, 14, 20))],
    "ANISOTROPIC": COLUMNS,
}
VOIGT = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]


def of_abaqus(kind):
    """The sector with these constants."""
    text = "*NODE\n" + "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(CARTESIAN, 1))
    text += "*ELEMENT, TYPE=C3D8, ELSET=MAT1\n"
    text += "".join(f"{k}, {', '.join(str(n + 1) for n in c)}\n" for k, c in enumerate(CELLS, 1))
    words = [f"{v:.15g}" for v in ELASTIC[kind]]
    rows = [", ".join(words[i : i + 8]) for i in range(0, len(words), 8)]
    text += f"*MATERIAL, NAME=MAT1\n*ELASTIC, TYPE={kind}\n" + "\n".join(rows)
    return text + "\n*DENSITY\n2.5e-9\n*SOLID SECTION, ELSET=MAT1, MATERIAL=MAT1\n"


def test_a_turned_orthotropic_material_in_decks(tmp_path):
    """Energies of the six constant strains, and frequencies, of the sector whose material is turned
    by 30 degrees about z: of MPDATA of Ansys and three kinds of *ELASTIC; MAT9 has its line."""
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    full = np.zeros((3, 3, 3, 3))
    for (a, (i, j)), (b, (k, m)) in product(enumerate(VOIGT), repeat=2):
        C = np.linalg.inv(COMPLIANCE)[a, b] * 1e6
        for left, right in product({(i, j), (j, i)}, {(k, m), (m, k)}):
            full[*left, *right] = C
    full = np.einsum("ai,bj,ck,dl,ijkl->abcd", *[turn] * 4, full)
    strains = [
        np.array([[p in ((i, j), (j, i)) for i in range(3)] for j in range(3)]) for p in VOIGT
    ]
    wanted = [[np.einsum("ij,ijkl,kl", e, full, f) for e in strains] for f in strains]
    found = []
    decks = {f"{kind}.inp": of_abaqus(kind) for kind in ELASTIC}
    for name, text in (decks | {"sector.cdb": archive(more=ORTHOTROPIC)}).items():
        drafted(tmp_path, text, name)
        scene = read_scene(tmp_path / "sector.toml", ["parts.mat1.axis=30 deg"])
        elastic = assemble_bodies(scene, scene_mesh(scene, MPI.COMM_SELF))
        K, M, x = elastic.K, elastic.M, elastic.free.V.tabulate_dof_coordinates()
        u = np.array([(x @ e).ravel() for e in strains])
        energies = u @ (K @ u.T) / (M.sum() / 3 / scene.materials["MAT1"].rho)
        np.testing.assert_allclose(
            energies, wanted, rtol=1e-8, atol=1e-8 * full.max(), err_msg=name
        )
        found.append(eigh(K.toarray(), M.toarray(), eigvals_only=True, subset_by_index=(6, 15)))
        np.testing.assert_allclose(found[-1], found[0], rtol=1e-8)
    card = "MAT9,7,8000.,2480.,2640.,,,,7000.\n,2240.,,,,2000.,,,3000.\n,,,1100.,,1200.,2.5-9\n"
    with pytest.raises(SceneError, match=r"there is no \[materials.MAT7\]"):
        drafted(tmp_path, FORMS["plain"].replace("MAT1,7,125000.,,.24,7.2-9\n", card))
    text = (tmp_path / "sector.toml").read_text()
    assert "not taken over: MAT9,7,8000." in text and "# missing: MAT7" in text


TURNED = "".join(f"{v:21.13E}" for v in (90.0, 0.0, 0.0))
HELD = ISOTROPIC + "".join(f"D,{n},UX,0.\n" for n in range(1, 13))


@pytest.mark.parametrize(("angles", "along"), [("", ("x",)), (TURNED, ("y",)), (None, None)])
def test_turned_nodes_of_ansys(angles, along, tmp_path):
    """UX of nodes that are turned by 90 degrees about z holds y; by 30 degrees it is said."""
    if angles is None:
        angles = TURNED.replace("9.0000000000000E+01", "3.0000000000000E+01")
    _, scene, text = drafted(tmp_path, archive(more=HELD, angles=angles), "sector.cdb")
    assert [*scene.supports.values()] == ([along] if along else [])
    assert ("along axes of its nodes that are not x, y and z" in text) == (along is None)


@pytest.mark.parametrize(
    "words", ["ALL,UX,0.", "RIM,UX,0.", "1,UX,0.,,4", "1,UX,0.,,,,UY", "1,TEMP,0.", "1,UX,2."]
)
def test_supports_of_ansys_that_are_not_taken(words, tmp_path):
    """A component, a range, more directions, no displacement of zero: a line, and nothing held."""
    _, scene, text = drafted(tmp_path, archive(more=f"{ISOTROPIC}D,{words}\n"), "sector.cdb")
    assert not scene.supports and f"[supports]\n# not taken over: D,{words} (sector.cdb:" in text
