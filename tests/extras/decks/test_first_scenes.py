"""First scenes of mesh files: what `init` writes, and that `check` accepts it."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.draft.text import write_scene
from brake_fenicsx.meshing.meshfile import read_mesh_file
from brake_fenicsx.scene import read_scene
from processes import parallel

ROOT = Path(__file__).parents[3]
SCRIPTS = ROOT / "scripts"
BLOCK = SCRIPTS / "scenes" / "block_on_plate.toml"


def first_scene(deck, units=None):
    """Path and text of the scene of a deck."""
    scene = deck.with_suffix(".toml")
    scene.unlink(missing_ok=True)
    write_scene(deck, scene, units)
    return scene, scene.read_text()


# Parts, instances and assembly of two boxes as Abaqus/CAE writes them, in mm, t, s.
PART = """*PART, NAME={name}
{mesh}*ELSET, ELSET={sides}
1000,
*SURFACE, TYPE=NODE, NAME=Side
{sides},
*ORIENTATION, NAME=Ori
0., 1., 0., -1., 0., 0.
3, 15.
*SOLID SECTION, ELSET={elset}, MATERIAL={material}{orientation}
*END PART
"""
ASSEMBLY = """*ASSEMBLY, NAME=Assembly
*INSTANCE, NAME=Pad-1, PART=Pad
*END INSTANCE
*INSTANCE, NAME=Plate-1, PART=Plate
*END INSTANCE
*NODE
900001, 0., 0., 40.
900002, 0., 0., 41.
900003, 0., 0., 40.
*NSET, NSET=RP-1
900001,
*NSET, NSET=RP-2
900002,
*NSET, NSET=BOTH
Pad-1.pad_sides, Plate-1.plate_sides
*COUPLING, CONSTRAINT NAME=C1, REF NODE=RP-1, SURFACE=Pad-1.pad_top
*DISTRIBUTING
*ELEMENT, TYPE=SPRING1, ELSET=Springs
900001, 900001
*SPRING, ELSET=Springs
1
5000.
*SPRING, ELSET=Springs
2
4000.
*COUPLING, CONSTRAINT NAME=C2, REFNODE=900003, SURFACE=Plate-1.plate_sides
*KINEMATIC
*ELEMENT, TYPE=SPRING2, ELSET=Between
900005, 900001, 900003
*SPRING, ELSET=Between
3, 3
700.
*ELEMENT, TYPE=MASS, ELSET=Lump
900003, 900001
*MASS, ELSET=Lump
2e-5
*ELEMENT, TYPE=CONN3D2, ELSET=Joint
900004, 900001, 900002
*END ASSEMBLY
*MATERIAL, NAME=Lining-A
*DENSITY
2.51e-9,
*ELASTIC, TYPE=ENGINEERING CONSTANTS
5900., 5800., 2000., 0.13, 0.37, 0.36, 2590., 1180.
1170.
*MATERIAL, NAME=GG 20
*DENSITY
7.2e-9,
*ELASTIC
125000., 0.24
*DAMPING, STRUCTURAL=0.004
*EXPANSION
1e-5,
*SURFACE INTERACTION, NAME=Rubs
1.,
*FRICTION
0.45,
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
20000.
*CONTACT PAIR, INTERACTION=Rubs
Plate-1.plate_top, Pad-1.pad_bottom
*EQUATION
2
900001, 1, 1., 900002, 1, -1.
*STEP
*STATIC
*BOUNDARY
Plate-1.plate_bottom, ENCASTRE
Plate-1.plate_sides, 1, 2
RP-2, 1, 6
*CLOAD
RP-1, 3, -700.
Plate-1.plate_sides, 2, 1.5
*DSLOAD
Pad-1.Side, P, 0.25
*END STEP
*STEP
*CLOAD
*INCLUDE, INPUT=loads.dat
*MOTION, ROTATION
Plate-1.plate_top, 6., 0., 90., 0., 0., 90., 1.
*END STEP
"""


@pytest.fixture
def assembly(tmp_path, meshes):
    """A deck of two instances."""
    mesh, parts = meshes.boxes(), []
    for name, elset, material, orientation in (
        ("Pad", "pad_body", "Lining-A", ", ORIENTATION=Ori"),
        ("Plate", "plate_body", "gg 20", ""),
    ):
        own = mesh.part(name.lower())
        faces = {n: t for n, t in mesh.faces.items() if n.startswith(name.lower())}
        tags = np.isin(mesh.facet_tag, [*faces.values()])
        meshes.write_abaqus(
            replace(
                mesh, cells=mesh.cells[own], cell_tag=mesh.cell_tag[own], faces=faces,
                layers={n: t for n, t in mesh.layers.items() if n.startswith(name.lower())},
                facets=mesh.facets[tags], facet_tag=mesh.facet_tag[tags],
            ),
            tmp_path / "part.inp",
        )  # fmt: skip
        text = (tmp_path / "part.inp").read_text().replace("*HEADING\n", "")
        parts.append(PART.format(name=name, elset=elset, material=material, mesh=text,
                                 orientation=orientation,
                                 sides=f"{name.lower()}_sides"))  # fmt: skip
    (tmp_path / "loads.dat").write_text("RP-1, 3, -1200.\n")
    deck = tmp_path / "cae.inp"
    deck.write_text("*HEADING\n" + "".join(parts) + ASSEMBLY)
    return deck


def test_what_an_assembly_says(assembly, capsys):
    """Every value in SI by hand; the deck has mm, t, s. What is left out has its line."""
    path, text = first_scene(assembly)
    scene = read_scene(path)
    pad, plate = scene.parts["pad_1"], scene.parts["plate_1"]
    assert (pad.material, plate.material) == ("Lining-A", "GG 20")
    assert pad.axis == plate.axis == 0.0 and ": write the axis of the part" in text
    lining, iron = scene.materials["Lining-A"], scene.materials["GG 20"]
    assert lining.model == "orthotropic" and lining.rho == pytest.approx(2510.0)
    assert pytest.approx((5.9e9, 5.8e9, 2e9)) == lining.E and lining.nu == (0.13, 0.37, 0.36)
    assert pytest.approx((1.17e9, 1.18e9, 2.59e9)) == lining.G
    assert (iron.E, iron.nu, iron.loss) == (125e9, 0.24, 0.004)
    contact = scene.contact["pad_1_plate_1"]
    # The softer pad first, although the deck has the plate first.
    assert contact.faces == ("pad_1.pad_bottom", "plate_1.plate_top") and contact.friction == 0.45
    assert contact.law.linear == pytest.approx(2e13)
    assert scene.supports == {
        "plate_1.plate_bottom": ("x", "y", "z"),
        "plate_1.plate_sides": ("x", "y"),
    }
    assert scene.loads["pad_1.pad_top"].force == pytest.approx((0.0, 0.0, -1200.0))
    assert scene.loads["pad_1.side"].pressure == pytest.approx(0.25e6)
    assert scene.masses["pad_1.pad_top"].mass == pytest.approx(0.02)
    assert scene.springs["pad_1.pad_top"].stiffness == pytest.approx((5e6, 4e6, 0.0))
    between = scene.springs["pad_1_pad_top_plate_1_plate_sides"]
    assert between.faces == ("pad_1.pad_top", "plate_1.plate_sides")
    assert between.stiffness == pytest.approx((0.0, 0.0, 7e5))
    assert '"nodes:Plate-1.plate_sides" = "plate_1.plate_sides"' in text  # an element set too
    count = read_mesh_file(assembly).node_groups["Plate-1.plate_sides"].size
    assert scene.loads["plate_1.plate_sides"].force == pytest.approx((0.0, 1.5 * count, 0.0))
    motion = scene.motion
    assert motion.turns_about == (0.0, 0.0, 1.0) and motion.point == (0.0, 0.09, 0.0)
    assert motion.rate == 6.0
    lines = assembly.read_text().splitlines()
    for word, section in (
        ("*EQUATION", "ties"),
        ("*ELEMENT, TYPE=CONN3D2, ELSET=Joint", "parts"),
        ("*EXPANSION", "materials"),
    ):
        at = 1 + lines.index(word)
        own = text.partition(f"[{section}]\n")[2].partition("\n\n")[0]
        assert f"# not taken over: {word} (cae.inp:{at})" in own
    assert "Ignored" not in text
    assert '# not taken over: "RP-2": no facet of a boundary' in text
    assert "800 mm^2, normal (0, 0, -1), middle (0, 0, 0) mm" in text
    assert main(["check", str(path)]) == 0
    assert "'plate_1' turns about z through (0, 90, 0) mm under 'pad_1'" in capsys.readouterr().out


def test_ties_take_the_place_of_contact(assembly, capsys):
    """Without contact the scene has no stages; glued faces that touch are not proposed again."""
    text = assembly.read_text()
    pair = re.search(r"\*CONTACT PAIR.*\n(.*)\n", text)
    tie = f"*TIE, NAME=Glue, POSITION TOLERANCE=0.2\n{pair[1]}\n"
    assembly.write_text(text.replace(pair[0], tie))
    path, _ = first_scene(assembly)
    scene = read_scene(path)
    assert scene.ties["glue"].faces == ("plate_1.plate_top", "pad_1.pad_bottom")
    assert scene.ties["glue"].search == pytest.approx(0.2e-3)
    assert not scene.contact and scene.stages == () and main(["check", str(path)]) == 0


def test_a_surface_on_several_parts_is_a_face_of_each(assembly):
    """One set on the sides of both instances, held together; its facets are those of both."""
    text = assembly.read_text().replace("Pad-1.Side, P, 0.25", "")
    text = text.replace("Plate-1.plate_sides, 1, 2", "BOTH, 1, 2")
    assembly.write_text(text)
    path, lines = first_scene(assembly)
    assert 'BOTH = ["pad_1.both", "plate_1.both"]' in lines
    scene = read_scene(path)
    brake = assemble_brake(scene, MPI.COMM_SELF)
    held = [
        brake.mesh.facet_tags.find(brake.mesh.faces[f]).size for f in ("pad_1.both", "plate_1.both")
    ]
    assert scene.supports["plate_1.both"] == ("x", "y") and held[0] == held[1] > 20
    for change, said in (
        ('mesh.groups."Pad-1.pad_body"=["pad_1.body"]', "a group of cells is in one part"),
        ('mesh.groups.BOTH=["pad_1.both"]', "no face 'plate_1.both'"),
        ('mesh.groups.BOTH=["pad_1.both", 2]', "write text"),
    ):
        with pytest.raises(SceneError, match=said):
            assemble_brake(read_scene(path, [change]), MPI.COMM_SELF)


def test_bodies_of_one_part_are_parts_of_their_own(tmp_path):
    """Two tetrahedra of an instance that share no node, each with a material."""
    nodes = ["0,0,0", "10,0,0", "0,10,0", "0,0,10", "50,0,0", "60,0,0", "50,10,0", "50,0,10"]
    (tmp_path / "two.inp").write_text(
        "*PART, NAME=P\n*NODE\n"
        + "".join(f"{i},{x}\n" for i, x in enumerate(nodes, 1))
        + "*ELEMENT, TYPE=C3D4, ELSET=A\n1,1,2,3,4\n*ELEMENT, TYPE=C3D4, ELSET=B\n2,5,6,7,8\n"
        "*SOLID SECTION, ELSET=A, MATERIAL=M\n*SOLID SECTION, ELSET=B, MATERIAL=N\n*END PART\n"
        "*ASSEMBLY, NAME=Q\n*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n*END ASSEMBLY\n"
    )
    _, text = first_scene(tmp_path / "two.inp")
    assert '"P-1.A" = "p_1.body"' in text and '"P-1.B" = "p_1_2.body"' in text
    assert 'p_1 = { material = "M" }' in text and 'p_1_2 = { material = "N" }' in text


@pytest.fixture
def bench(monkeypatch):
    """The script that writes decks of CalculiX."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    yield __import__("bench_calculix")
    sys.modules.pop("bench_calculix", None)


def calculix(bench, scene, changes, deck):
    """The deck of a scene, and its brake."""
    parsed = read_scene(scene, [*bench.overrides_of(scene, 2e13), *changes])
    brake = assemble_brake(parsed, MPI.COMM_SELF)
    deck.write_text("\n".join(bench.Deck(parsed, brake, 2e13, 1e-4, 4).braking()) + "\n")
    return parsed, brake


def same_brake(scene, brake, path):
    """Sums that no order of the nodes changes: stiffness, mass, contact and loads."""
    own = read_scene(path)
    found = assemble_brake(own, MPI.COMM_SELF)
    for name in ("K", "M"):
        a, b = (getattr(x, name).diagonal() for x in (brake, found))
        np.testing.assert_allclose(np.sort(b), np.sort(a), rtol=1e-5)
    assert found.N.shape == brake.N.shape and found.w.sum() == pytest.approx(brake.w.sum(), 1e-9)
    (contact,), (known,) = own.contact.values(), scene.contact.values()
    assert (contact.friction, contact.law) == (known.friction, known.law)


def test_a_deck_of_calculix_by_numbers(bench, tmp_path, capsys):
    """Supports of nodes, pressures of elements, constants of an anisotropic material: the brake
    of the scene that the deck was written from."""
    coarse = ["parts.block.size='10 mm'", "parts.plate.size='14 mm'"]
    scene, brake = calculix(bench, BLOCK, coarse, tmp_path / "block.inp")
    path, text = first_scene(tmp_path / "block.inp")
    same_brake(scene, brake, path)
    assert '"*BOUNDARY xyz" = "plate.boundary_xyz"' in text and "it moves its nodes" in text
    assert 'model = "orthotropic"' in text and "direction = [1.0, 0.0, 0.0]" in text
    assert main(["check", str(path)]) == 0
    assert "not read" not in capsys.readouterr().err


@pytest.mark.slow
def test_a_whole_brake_of_calculix_runs(bench, tmp_path):
    """Disc and two pads with shims, coarse: the same brake, and a run to its page."""
    coarse = ["parts.disc.size='24 mm'", "parts.pad.size='12 mm'", "parts.pad.plate_size='14 mm'"]
    scene, brake = calculix(
        bench, SCRIPTS / "scenes" / "disc_brake_demo.toml", coarse, tmp_path / "whole.inp"
    )
    path, text = first_scene(tmp_path / "whole.inp")
    same_brake(scene, brake, path)
    assert "material = { lining = " in text and 'axis = "z"' in text
    out = tmp_path / "out"
    assert main(["run", str(path), "-o", str(out), "--set", "stability.band=['0 Hz','3 kHz']"]) == 0
    assert (out / "report.html").is_file() and len((out / "modes.csv").read_text()) > 500


EXAMPLE = {
    "materials": "{ rotor={ model='isotropic', E='125 GPa', nu=0.24, rho='7200 kg/m^3' },"
    " lining={ model='isotropic', E='5 GPa', nu=0.2, rho='2510 kg/m^3' },"
    " backplate={ model='isotropic', E='207 GPa', nu=0.28, rho='7820 kg/m^3' } }",
    "supports": "{ 'rotor.clamp'='clamped', 'lining.sides'=['x', 'y'] }",
}


def test_a_deck_without_materials(tmp_path, capsys, monkeypatch):
    """Contact of faces that touch is proposed; `check` names what is missing, one thing a time."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    __import__("example_inputs").write_mesh(tmp_path / "my_brake.inp")
    path, text = first_scene(tmp_path / "my_brake.inp")
    assert 'faces = ["lining.pad_face", "rotor.face"]' in text and "# missing: rotor = {" in text
    given, words = [], ["check", str(path)]
    for missing, key in (("no [materials.rotor]", "materials"), ("move freely", "supports")):
        assert main(words + given) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert missing in line or "free to move" in line
        given += ["--set", f"{key}={EXAMPLE[key]}"]
    assert main(words + given) == 0
    more = ["--set", "mesh.groups.ROTOR_FACE=['rotor.face', 'lining.none']"]
    assert main(words + given + more) == 2
    assert "do not lie on the boundary of 'lining'" in capsys.readouterr().err


CONSTANTS = "{ model='isotropic', E='207 GPa', nu=0.28, rho='7820 kg/m^3' }"
ANSYS = """MPDATA,R5.0, 1,EX  ,       1, 1, 207000. ,
MP,NUXY,1,0.28
MPDATA,R5.0, 1,DENS,       1, 1, 7.82E-9 ,
MP,EX,2,125000.
MP,PRXY,2,0.24
MP,DENS,2,7.2e-9
CE,R5.0,DEFI,1
"""
NASTRAN = """PSOLID,1,7
PSOLID,2,8
MAT1,7,207000.,,.28,7.82-9
MAT1*                  8         125000.                             .24
*                 7.2E-9
RBE2,9,1,123,2
ENDDATA"""


@pytest.mark.parametrize("form", ["msh", "cdb", "bdf"])
def test_other_files(form, tmp_path, meshes, capsys):
    """Materials of Ansys and Nastran, supports of nodes of Ansys; names alone of gmsh."""
    mesh, file = meshes.boxes(), tmp_path / f"boxes.{form}"
    changes = []
    if form == "msh":
        meshes.write_gmsh(mesh, file)
        changes = [f"materials={{ pad_body={CONSTANTS}, plate_body={CONSTANTS} }}"]
    elif form == "cdb":
        meshes.write_ansys(mesh, file)
        low = np.unique(mesh.facets[mesh.facet_tag == mesh.faces["plate.bottom"]])
        held = "".join(f"D,{10 + n},U{c}, 0.0, 0.0\n" for n in low for c in "XYZ")
        file.write_text(file.read_text() + held + ANSYS)
    else:
        meshio = pytest.importorskip("meshio")
        pytest.importorskip("pyNastran")
        blocks = [("tetra", mesh.cells), ("triangle", mesh.facets)]
        refs = {"nastran:ref": [mesh.cell_tag, 100 + mesh.facet_tag]}
        meshio.Mesh(np.round(1e3 * mesh.points, 6) + 0.0, blocks, cell_data=refs).write(file)
        file.write_text(file.read_text().replace("ENDDATA", NASTRAN))
    path, text = first_scene(file)
    scene = read_scene(path, changes)
    (contact,) = scene.contact.values()
    assert len(scene.parts) == 2 and len(contact.faces) == 2 and scene.mesh.unit == "mm"
    assert "normal (0, 0, -1), middle (0, 0, 0) mm" in text and "proposed: the faces touch" in text
    if form != "msh":
        known = sorted((m.E, m.nu, m.rho) for m in scene.materials.values())
        assert known[0] == pytest.approx((125e9, 0.24, 7200.0))
        assert known[1] == pytest.approx((207e9, 0.28, 7820.0))
        lost = {"cdb": "CE,R5.0,DEFI,1", "bdf": "RBE2,9,1,123,2"}[form]
        assert f"[ties]\n# not taken over: {lost} (boxes.{form}:" in text
    if form == "cdb":
        assert [*scene.supports.values()] == [("x", "y", "z")]
    words = [word for change in changes for word in ("--set", change)]
    assert main(["check", str(path), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "free to move" in line


@pytest.mark.parametrize(
    ("keywords", "units", "said"),
    [
        (
            "*SHELL SECTION, ELSET=SHIM, MATERIAL=M\n1.\n",
            None,
            "SHELL SECTION.*add --shells solid",
        ),
        ("*MATERIAL, NAME=M\n*DENSITY\n3.\n", None, "--units: missing; .* densities 3;"),
        ("", ("mm", "t", "kg"), "--units: wrong unit"),
    ],
)
def test_what_is_refused(keywords, units, said, tmp_path, meshes):
    """In one line, and nothing is written."""
    deck = tmp_path / "boxes.inp"
    meshes.write_abaqus(meshes.boxes(), deck)
    deck.write_text(deck.read_text() + keywords)
    with pytest.raises(SceneError, match=said) as refused:
        first_scene(deck, units)
    assert "\n" not in str(refused.value) and not deck.with_suffix(".toml").exists()


def test_a_scene_is_not_overwritten(tmp_path, meshes, monkeypatch, capsys):
    """What the scene does not have stands on the terminal."""
    meshes.write_abaqus(meshes.boxes(), deck := tmp_path / "boxes.inp")
    deck.write_text(deck.read_text() + "*STEP, NLGEOM=YES\n*STATIC\n*END STEP\n")
    monkeypatch.chdir(tmp_path)
    assert main(["init", "boxes.inp", "--units", "mm", "t", "s"]) == 0
    out = capsys.readouterr().out
    assert "wrote boxes.toml: 2 parts, 6 faces\nnot taken over: *STEP, NLGEOM=YES" in out
    assert main(["init", "boxes.inp"]) == 2
    assert "boxes.toml: is there already" in capsys.readouterr().err


@pytest.mark.slow
def test_two_processes_write_one_scene(tmp_path, meshes):
    """PETSc starts on both of them, or on none: the first one alone would wait for ever."""
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        pytest.skip("no mpirun")
    meshes.write_abaqus(meshes.boxes(), tmp_path / "boxes.inp")
    command = [mpirun, "-n", "2", "--oversubscribe", sys.executable, "-m", "brake_fenicsx"]
    done = subprocess.run(
        [*command, "init", "boxes.inp"], capture_output=True, text=True, cwd=tmp_path, timeout=300,
        **parallel(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("wrote boxes.toml") == 1 and (tmp_path / "boxes.toml").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{}.inp"], "{0}.inp: no command; write brake-fenicsx init {0}.inp"),
        (["{}.toml"], "{0}.toml: no command; write brake-fenicsx run {0}.toml"),
        (["run", "{}.inp"], "a mesh file; brake-fenicsx init {0}.inp writes a first scene of it"),
        (["check", "{}.cdb"], "a mesh file; brake-fenicsx init {0}.cdb writes a first scene"),
        (["init", "{}.toml"], "{0}.toml: is a scene; give the mesh file that it is to be of"),
    ],
)
def test_the_command_that_a_file_needs_is_named(words, said, tmp_path, capsys):
    """A mesh file in place of a scene, a file in place of a command: what to write instead."""
    stem = str(tmp_path / "brake")
    for ending, content in ((".inp", b"*NODE\n"), (".cdb", b"\xff/PREP7\n"), (".toml", b"")):
        Path(stem + ending).write_bytes(content)
    assert main([word.format(stem) for word in words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said.format(stem) in line
