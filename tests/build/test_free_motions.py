"""Parts that move freely: which, in which directions, and what is said of them."""

import re
from dataclasses import asdict, replace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.brake_doubts import check_free_motions
from brake_fenicsx.description import describe
from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.rawmesh import FACETS
from brake_fenicsx.pipeline import run
from brake_fenicsx.scene import read_scene
from places import BLOCK, SCENES
from small_meshes import HELD, SCENE

COARSE = ["stages=['equilibrium']", "parts.block.size='20 mm'", "parts.plate.size='30 mm'"]
CAP = [
    'parts.cap={ builder="block", length="40 mm", width="20 mm", height="8 mm", z="20 mm",'
    ' size="10 mm", material="iron" }',
    'loads={ "cap.top"={ pressure="5 bar" } }',
]  # fmt: skip
GLUE = 'ties={ glue={ faces=["block.top", "cap.bottom"] } }'
BELOW = "supports={ 'plate.bottom'='clamped' }"
BETWEEN = "springs={ s={ faces=['block.top', 'cap.bottom'], stiffness=%s } }"
GROUND = "springs={ 'block.top'={ stiffness=%s } }"
STUCK = "contact.block_plate={ faces=['block.bottom', 'plate.top'], law={ p0='10 MPa', u0='10 um' }"
IN_PLANE = "free to move along x and y and turn about z"


def checked(*changes, scene=BLOCK):
    parsed = read_scene(scene, [*(COARSE if scene == BLOCK else []), *changes])
    brake = assemble_brake(parsed, MPI.COMM_SELF)
    return check_free_motions(parsed, brake), brake


def singular(*changes):
    """Number of zero eigenvalues of the stiffness with springs in the place of the contact."""
    brake = assemble_brake(read_scene(BLOCK, [*COARSE, *changes]), MPI.COMM_SELF)
    K = brake.K + brake.N.T @ sp.diags(1e13 * brake.w) @ brake.N
    # Rows and columns scaled to a unit diagonal: a soft spring is no round-off then.
    d = sp.diags(K.diagonal() ** -0.5)
    return int(np.count_nonzero(np.linalg.eigvalsh((d @ K @ d).toarray()) < 1e-12))


@pytest.mark.parametrize(
    ("changes", "free", "said"),
    [
        ([BELOW], 3, [f"part block: {IN_PLANE}"]),
        (["supports={ 'block.top'=['x', 'y'] }"], 6,
         [f"part plate: {IN_PLANE}",
          "parts block and plate together: free to move along z and turn about x and y"]),
        (["supports={}"], 9, [f"part block: {IN_PLANE}", f"part plate: {IN_PLANE}"]),
        (CAP, 6, ["part cap: free to move along x, y and z and turn about x, y and z"]),
        ([*CAP, GLUE, BELOW], 3, [f"parts block and cap together: {IN_PLANE}"]),
        ([*CAP, GLUE, "supports={ 'plate.bottom'='clamped', 'cap.top'=['x'] }"], 1,
         ["parts block and cap together: free to move along y"]),
        ([*CAP, BETWEEN % ["1e6 N/m", "0 N/m", "1e6 N/m"]], 4, ["part cap: free to move along y"]),
        ([BELOW, "parts.block.axis='30 deg'", GROUND % ["1e4 N/m", "0 N/m", "0 N/m"]], 1,
         ["part block: free to move along (0.5, -0.866, 0)"]),
        (["supports={ 'plate.bottom'=['z'], 'block.top'=['x', 'y'] }"], 3,
         [f"part plate: {IN_PLANE}"]),
    ],
)  # fmt: skip
def test_free_motions_are_those_of_the_singular_stiffness(changes, free, said):
    """As many as zero eigenvalues; part and direction by hand."""
    with pytest.raises(SceneError) as refused:
        checked(*changes)
    text = str(refused.value)
    assert all(words in text for words in said) and "supports, ties or springs" in text
    assert singular(*changes) == free == named(text)


def named(text):
    """Number of directions in a message."""
    lists = re.findall(
        r"(?:along|about) ((?:[xyz]|\(.*?\))(?:(?:, | and )(?:[xyz]\b|\(.*?\)))*)", text
    )
    return sum(len(re.findall(r"[xyz]\b|\(.*?\)", one)) for one in lists)


@pytest.mark.parametrize(
    "changes",
    [
        [],
        [*CAP, GLUE],
        [BELOW, GROUND % ["1e3 N/m", "1e3 N/m", "0 N/m"]],
        [CAP[0], "springs={ 'cap.top'={ stiffness=['1 N/m', '1 N/m', '1 N/m'] } }"],
        [BELOW, "motion={}", STUCK + ", slip='stuck', tangential_stiffness='1e12 Pa/m' }"],
        ["mesh.cells=hexahedra", "mesh.degree=1", "mesh.order=1"],
    ],
)  # fmt: skip
def test_what_is_held_is_not_named(changes):
    """A block that is free along z is held by contact; soft springs hold as stiff ones do."""
    assert checked(*changes)[0] == []


# 400 N on a lever; the edge of the block is 10 mm from its middle.
LEVER = (
    'loads={ "block.top"={ force=["0 N", "0 N", "-400 N"], moment=["%g N m", "0 N m", "0 N m"] }}'
)
CLAMPED = "supports={ 'plate.bottom'='clamped', 'block.top'=['x', 'y'], 'cap.top'='clamped' }"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([*CAP, CLAMPED], "part block: .* not pressed on it by the loads"),
        (['loads={ "block.top"={ force=["0 N", "0 N", "9 N"] } }'], "part block: .* pushed away"),
        ([*CAP, GLUE, 'loads={ "cap.top"={ force=["0 N", "0 N", "9 N"] } }'],
         "part block and cap: .* pushed away"),
        ([LEVER % 4.4], "part block: .* pushed away"),
    ],
)  # fmt: skip
def test_parts_that_rest_on_contact_and_are_not_pressed_are_named(changes, said):
    (line,) = checked(*changes)[0]
    assert re.match(said, line)
    assert checked(LEVER % 2)[0] == []


@pytest.mark.together
def test_several_processes_name_the_same(comm):
    """Each has the whole brake; all refuse together, in the same words."""
    parsed = read_scene(BLOCK, [*COARSE, *CAP])
    with pytest.raises(SceneError) as refused:
        check_free_motions(parsed, assemble_brake(parsed, comm))
    texts = comm.allgather(str(refused.value))
    assert "part cap: free to move along x, y and z" in texts[0] and len({*texts}) == 1


def coarser(scene):
    """Changes that double the cells of all parts that a builder makes: what moves is the same."""
    return ["mesh.quality=1e-4"] + [
        f"parts.{name}.{key}='{2 * size} m'"
        for name, part in scene.parts.items()
        if part.builder
        for key, size in asdict(part.parameters).items()
        if key.endswith("size") and size
    ]


@pytest.mark.parametrize("path", SCENES.glob("*.toml"), ids=lambda path: path.stem)
def test_shipped_scenes_hold_all_their_parts(path):
    if path.stem in ("disc_brake_resolved", "disc_brake_study"):
        pytest.skip("the disc brake of disc_brake.toml, finer")
    if path.stem == "lining_pad":
        pytest.skip("a pad by itself, which `identify` rings freely")
    found, brake = checked(*coarser(read_scene(path)), scene=path)
    assert found == [] and not any("are glued" in line for line in brake.elastic.doubts)


def test_check_and_run_refuse_before_anything_is_written(tmp_path):
    for call in (
        lambda: describe(BLOCK, MPI.COMM_SELF, [*COARSE, BELOW]),
        lambda: run(BLOCK, MPI.COMM_SELF, tmp_path / "out", [*COARSE, BELOW]),
    ):
        with pytest.raises(SceneError, match=r"block_on_plate\.toml: part block: free to move"):
            call()
    assert not (tmp_path / "out").exists()


@pytest.fixture
def deck(tmp_path):
    """Writes a deck and its scene."""

    def write(write_abaqus, mesh, more="", keywords=""):
        write_abaqus(mesh, tmp_path / "deck.inp")
        with (tmp_path / "deck.inp").open("a") as file:
            file.write(keywords)
        (tmp_path / "scene.toml").write_text(SCENE.replace("own.msh", "deck.inp") + more)
        return tmp_path / "scene.toml"

    return write


def test_ties_of_a_deck_that_are_not_read_are_named_beside_what_they_would_hold(deck, meshes):
    tie = "*TIE, NAME=GLUE\npad_bottom, plate_top\n"
    file = deck(meshes.write_abaqus, meshes.boxes(), keywords=tie)
    with pytest.raises(
        SceneError, match=r"deck\.inp, the mesh of block and plate, has \[ties\] GLUE, which"
    ):
        checked(scene=file)


def cut(mesh, pieces):
    """The mesh with the pad in pieces, each with nodes of its own.

    Args:
        mesh: the boxes.
        pieces: number of the piece of each cell of the pad from its centre.
    """
    pad = np.flatnonzero(mesh.part("pad"))
    number = np.asarray(pieces(mesh.points[mesh.cells[pad]].mean(axis=1)), dtype=int)
    moved = np.unique(mesh.cells[pad[number == 1]])
    own = np.arange(len(mesh.points))
    own[moved] = len(mesh.points) + np.arange(moved.size)
    cells, points = mesh.cells.copy(), np.vstack([mesh.points, mesh.points[moved]])
    cells[pad[number == 1]] = own[cells[pad[number == 1]]]
    shared = np.intersect1d(moved, np.unique(mesh.cells[pad[number == 0]])).size
    # A facet goes with the piece that has all its corners.
    both = {frozenset(f) for c in mesh.cells[pad[number == 1]] for f in _facets(mesh, c)}
    facets = np.array([own[f] if frozenset(f) in both else f for f in mesh.facets])
    return replace(mesh, cells=cells, points=points, facets=facets), shared


def _facets(mesh, cell):
    return [cell[list(f)] for f in FACETS[mesh.shape]]


def test_pieces_of_a_part_are_named_with_their_coincident_nodes(deck, meshes):
    """The pad cut across is held in both pieces; cut along the contact its lower piece floats."""
    across, shared = cut(meshes.boxes("hexahedra"), lambda x: x[:, 0] > 0)
    file = deck(meshes.write_abaqus, across, HELD)
    (line,) = checked(scene=file)[0]
    assert line == f"part block: 2 pieces, {shared} coincident node pairs; merge them in the mesh"
    below, shared = cut(meshes.boxes("hexahedra"), lambda x: x[:, 2] < 6e-3)
    file = deck(meshes.write_abaqus, below, HELD)
    with pytest.raises(SceneError) as refused:
        checked(scene=file)
    assert f"part block: {IN_PLANE}" in str(refused.value)
    said = f"part block: 2 pieces, {shared} coincident node pairs: merge them in the mesh"
    assert said in str(refused.value)


def test_a_tie_that_glues_a_part_of_its_faces_is_warned_of():
    """A cap of the block's outline, one longer, and one of 32 x 30 on 40 x 20 mm."""
    cap = CAP[0]
    for outline in (cap, cap.replace('length="40 mm"', 'length="60 mm"')):
        assert checked(outline, *CAP[1:], GLUE)[1].elastic.doubts == ()
    crossed = cap.replace('length="40 mm", width="20 mm"', 'length="32 mm", width="30 mm"')
    (line,) = checked(crossed, *CAP[1:], GLUE)[1].elastic.doubts
    assert line.startswith("ties.glue: 640 of 800 mm^2 of block.top are glued; correct the place")
