"""Bodies given by their matrices: formats, ties, springs, reduced and full order, mistakes."""

import json
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.io import mmwrite
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh

from brake_fenicsx.build.brake import assemble_brake, check_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.matrix_files import read_matrix
from brake_fenicsx.extras.decks.superelement import doubts, read_superelement
from brake_fenicsx.pipeline import run
from brake_fenicsx.samples.numbering import dof_points
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.parts_section import Matrices
from run_tables import read_columns

BLOCK = Path(__file__).parents[3] / "scripts" / "scenes" / "block_on_plate.toml"
# Cells of 10 mm, so that block and cap have the same nodes where they meet.
COARSE = [
    "parts.block.size='10 mm'", "parts.plate.size='20 mm'", 'mesh.cells="hexahedra"',
    'contact.block_plate.law={ linear="1e12 Pa/m" }', "stability.band=['0 Hz', '25 kHz']",
]  # fmt: skip
FREE = ["supports={ 'plate.bottom'='clamped' }", "loads={}"]
CAP = 'parts.cap={ builder="block", length="40 mm", width="20 mm", height="10 mm", z="20 mm",\
 size="10 mm", material="lining" }'
TIE = 'ties={ glue={ faces=["cap.under", "block.top"] } }'
UNITS = ("mm", "t", "s")


def lowest(brake, count=10):
    """Lowest eigenvalues [1/s^2] of an assembled brake on soft springs in the contact."""
    K = brake.K + 1e9 * brake.N.T @ sp.diags(brake.w) @ brake.N
    return np.sort(eigsh(K, count, brake.M, sigma=-1e7, return_eigenvectors=False))


def assembled(*changes):
    return assemble_brake(read_scene(BLOCK, changes), MPI.COMM_SELF)


@pytest.fixture(scope="module")
def cap():
    """Stiffness, mass, and places and directions of the coordinates of the free cap, in SI."""
    brake = assembled(*COARSE, CAP, *FREE)
    points = dof_points(brake)
    label = connected_components(brake.K, directed=False)[1]
    own = np.flatnonzero(label == label[np.argmax(points[:, 2])])
    own = own[np.lexsort((points[own, 3], *points[own, :3].T))]
    return brake.K[own][:, own], brake.M[own][:, own], points[own]


@pytest.fixture
def exported(tmp_path, cap):
    """Folder with the cap in mm, t, s, and the file of its nodes."""
    K, M, points = cap
    mmwrite(tmp_path / "K.mtx", K / 1e3, precision=17)
    mmwrite(tmp_path / "M.mtx", M / 1e3, precision=17)
    write_nodes(tmp_path, points)
    return tmp_path


def write_nodes(folder, points):
    nodes = 1e3 * points[points[:, 3] == 0, :3]
    rows = [
        f"{100 + i},{x:.17g},{y:.17g},{z:.17g},{'under' if z < 20 + 1e-6 else 'over'} all"
        for i, (x, y, z) in enumerate(nodes)
    ]
    (folder / "nodes.csv").write_text("\n".join(["node,x,y,z,sets", *rows]) + "\n")


def given(folder, **more):
    """Override of a scene that reads the cap."""
    files = {"stiffness": "K.mtx", "mass": "M.mtx", "nodes": "nodes.csv", **more}
    text = ", ".join(
        f'{key}="{folder}/{value}"' if isinstance(value, str) else f"{key}={value}"
        for key, value in files.items()
    )
    return f'parts.cap={{ matrices={{ {text}, units=["mm", "t", "s"] }} }}'


def test_exported_body_gives_the_modes_of_the_whole_mesh(exported):
    """Block and cap of the same nodes against one taller block, to 1e-10."""
    whole = assembled(*COARSE, *FREE, "parts.block.height='30 mm'")
    parts = assembled(*COARSE, *FREE, given(exported), TIE)
    assert parts.elastic.free.size == whole.elastic.free.size
    np.testing.assert_allclose(lowest(parts)[3:], lowest(whole)[3:], rtol=1e-10)
    assert parts.elastic.masses["cap"].shape == parts.M.shape


def test_nodes_between_those_of_the_face(exported):
    """On a coarser face: as a layer so stiff that it does not matter, but for the cells of both."""
    coarse = [*COARSE, *FREE, "parts.block.size='15 mm'"]
    layer = 'ties={ glue={ faces=["cap.bottom", "block.top"], stiffness="1e16 Pa/m" } }'
    nodes = lowest(assembled(*coarse, given(exported), TIE))[3:]
    mesh = lowest(assembled(*coarse, CAP, layer))[3:]
    np.testing.assert_allclose(nodes, mesh, rtol=0.06)


def text_of(A, labels, kind):
    """Entries of the lower triangle in a format of another code, in t, mm, s."""
    A = sp.tril(A / 1e3).tocoo()
    entries = zip(A.row, A.col, A.data, strict=True)
    if kind == "labels":
        lines = ["** a comment", *(
            f"{labels[i][0]},{labels[i][1]}, {labels[j][0]},{labels[j][1]}, {v:.17e}"
            for i, j, v in entries
        )]  # fmt: skip
    elif kind == "coordinates":
        lines = [f"{i + 1} {j + 1} {v:.17E}" for i, j, v in entries]
    else:
        lines = ["DMIG    A              0       6       2       0"]
        for j in np.unique(A.col):
            lines.append(f"DMIG*   {'A':16s}{labels[j][0]:16d}{labels[j][1]:16d}")
            for i, v in zip(A.row[A.col == j], A.data[A.col == j], strict=True):
                lines.append(f"*       {labels[i][0]:16d}{labels[i][1]:16d}{f'{v:.9E}':>16s}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("kind", ["labels", "coordinates", "dmig", "npz"])
def test_formats_of_other_codes(tmp_path, cap, kind):
    """The same matrices, whatever the order of the rows in the files."""
    if kind == "dmig":
        pytest.importorskip("pyNastran")
    K, M, points = cap
    write_nodes(tmp_path, points)
    labels = [(100 + i // 3, 1 + i % 3) for i in range(K.shape[0])]
    turned = np.random.default_rng(0).permutation(len(labels))
    shown = [labels[i] for i in turned]
    names = {}
    for name, A in (("stiffness", K), ("mass", M)):
        A = A[turned][:, turned]
        names[name] = f"{name}.npz" if kind == "npz" else f"{name}.txt"
        if kind == "npz":
            sp.save_npz(tmp_path / names[name], A / 1e3)
        else:
            (tmp_path / names[name]).write_text(text_of(A, shown, kind))
    if kind in ("coordinates", "npz"):
        names["dofs"] = "rows.dof"
        (tmp_path / "rows.dof").write_text("".join(f"{n}.{c}\n" for n, c in shown))
    files = Matrices(**names, nodes="nodes.csv", units=UNITS)
    body = read_superelement(tmp_path, files)
    rows = body.rows.reshape(-1)
    accuracy = 1e-8 if kind == "dmig" else 1e-12
    for A, B in ((body.K, K), (body.M, M)):
        assert abs(A[rows][:, rows] - B).max() < accuracy * abs(B).max()
    np.testing.assert_allclose(body.points, points[::3, :3], rtol=1e-12)
    assert body.sets["under"].size + body.sets["over"].size == body.sets["all"].size


def craig_bampton(cap, modes):
    """Stiffness and mass on the nodes below and some modes of the cap that is held there."""
    K, M, points = cap
    held = points[:, 2] < 20e-3 + 1e-9
    b, i = np.flatnonzero(held), np.flatnonzero(~held)
    K, M = K.toarray(), M.toarray()
    _, Phi = la.eigh(K[np.ix_(i, i)], M[np.ix_(i, i)], subset_by_index=[0, modes - 1])
    T = np.zeros((len(K), b.size + modes))
    T[b, np.arange(b.size)] = 1.0
    T[i, : b.size] = -np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, b)])
    T[i, b.size :] = Phi
    return T.T @ K @ T, T.T @ M @ T, points[b]


def test_craig_bampton_reduction_with_modal_coordinates(tmp_path, cap, exported):
    """The last rows are modal coordinates: modes of the whole, first eight to 1e-4."""
    full = lowest(assembled(*COARSE, *FREE, given(exported), TIE), 11)[3:]
    K, M, points = craig_bampton(cap, 120)
    # Pivots of a mass that round-off leaves a little unsymmetric are no concern of this test.
    mmwrite(tmp_path / "Kc.mtx", sp.csr_matrix(0.5 * (K + K.T) / 1e3), precision=17)
    mmwrite(tmp_path / "Mc.mtx", sp.csr_matrix(0.5 * (M + M.T) / 1e3), precision=17)
    write_nodes(tmp_path, points)
    files = {"stiffness": "Kc.mtx", "mass": "Mc.mtx"}
    reduced = assembled(*COARSE, *FREE, given(tmp_path, **files, modal=120), TIE)
    with pytest.raises(SceneError, match=r"parts.cap.matrices.stiffness: \d+ rows, but .*modal"):
        assembled(*COARSE, *FREE, given(tmp_path, **files), TIE)
    assert np.count_nonzero(dof_points(reduced)[:, 3] == 3) == 120
    found = lowest(reduced, 11)[3:]
    np.testing.assert_allclose(found, full, rtol=1e-4)
    # A reduction only stiffens.
    assert np.all(found > full * (1 - 1e-9))


def test_supports_springs_masses_and_damping_of_sets(exported, cap):
    """Totals along each axis; held nodes leave no coordinate behind."""
    mmwrite(exported / "C.mtx", 2e-6 * cap[0] / 1e3, precision=17)
    springs = 'springs={ "cap.under"={ stiffness=["1 kN/mm", "2 kN/mm", "3 kN/mm"],\
 damping=["5 N s/m", "0 N s/m", "0 N s/m"] }, "join"={ faces=["cap.under", "block.top"],\
 stiffness=["0 N/m", "0 N/m", "7 kN/mm"] } }'
    masses = 'masses={ "cap.all"={ mass="40 g" } }'
    plain = assembled(*COARSE, *FREE, given(exported))
    changed = assembled(*COARSE, *FREE, given(exported, damping="C.mtx"), springs, masses)
    move = np.zeros((3, plain.elastic.free.size))
    points = dof_points(plain)
    cap_ = np.arange(len(points)) >= plain.elastic.free.local.size
    for c in range(3):
        move[c, cap_ & (points[:, 3] == c)] = 1.0
    work = np.einsum("ci,ci->c", move, (changed.K @ move.T).T)
    np.testing.assert_allclose(work, [1e6, 2e6, 10e6], rtol=1e-6)
    added = np.einsum("ci,ci->c", move, ((changed.M - plain.M) @ move.T).T)
    np.testing.assert_allclose(added, 40e-3, rtol=1e-9)
    C = changed.elastic.C
    assert move[0] @ C @ move[0] == pytest.approx(5.0, rel=1e-6)
    bend = points[:, 2] ** 2 * move[2]
    assert bend @ C @ bend == pytest.approx(2e-6 * (bend @ plain.K @ bend), rel=1e-6)
    held = assembled(*COARSE, given(exported), "loads={}",
                     "supports={ 'plate.bottom'='clamped', 'cap.over'=['x', 'z'] }")  # fmt: skip
    over = np.count_nonzero(cap[2][::3, 2] > 20e-3 + 1e-9)
    assert held.elastic.free.size == plain.elastic.free.size - 2 * over


@pytest.mark.long
@pytest.mark.parametrize("damping", [{}, {"damping": "C.mtx"}])
def test_a_run_with_the_reduced_model_against_full_order(exported, cap, damping):
    """Modes by the reduced model, its samples verified, and the share of the body in them.

    A damping among the matrices acts in it too, with no other damping in the scene.
    """
    mmwrite(exported / "C.mtx", 1e-6 * cap[0] / 1e3, precision=17)
    # The plate is pressed against the block, which the cap holds.
    scene = [
        *COARSE, given(exported, **damping), TIE, "stability.method='reduced'",
        "stability.verify=1",
        "samples={ n=2, approaches=['parametric'] }",
        "samples.random.'contact.block_plate.friction'={ law='uniform', min=0.3, max=0.5 }",
        "stages=['equilibrium', 'stability', 'uncertainty']",
        "loads={ 'plate.bottom'={ pressure='1 bar' } }",
        "supports={ 'cap.over'='clamped', 'plate.sides'=['x', 'y'] }",
    ]  # fmt: skip
    run(BLOCK, MPI.COMM_SELF, exported / "out", overrides=scene)
    check = json.loads((exported / "out" / "summary.json").read_text())["verification"]
    assert check["samples_compared"] == 1
    assert check["eigenvalues"] > 3
    # With damping the bound is stability.tolerance.
    assert check["largest_relative_error"] < (1e-5 if damping else 1e-6)
    modes = read_columns(exported / "out" / "modes.csv")
    assert 0.0 < modes["share_cap"].max() < 1.0
    # Without damping growth and decay of coupled modes cancel.
    assert (modes["damping"].sum() > 1e-3) == bool(damping)


def test_a_body_that_nothing_joins_to_the_others(exported, cap):
    """The reduced model keeps its modes: those of the matrices alone, with one face held."""
    K, M, points = cap
    free = points[:, 2] > 20e-3 + 1e-9
    own = la.eigvalsh(K[free][:, free].toarray(), M[free][:, free].toarray())
    scene = [
        *COARSE, given(exported), "stability.method='reduced'", "stability.band=['0 Hz', '20 kHz']",
        "samples={ n=2, approaches=['parametric'] }",
        "samples.random.'contact.block_plate.friction'={ law='uniform', min=0.1, max=0.2 }",
        "stages=['equilibrium', 'stability', 'uncertainty']",
        "supports={ 'plate.bottom'='clamped', 'block.top'=['x', 'y'], 'cap.under'='clamped' }",
    ]  # fmt: skip
    run(BLOCK, MPI.COMM_SELF, exported / "out", overrides=scene)
    found = read_columns(exported / "out" / "modes.csv")["frequency_hz"]
    wanted = np.sqrt(own[own < (2 * np.pi * 20e3) ** 2]) / (2 * np.pi)
    assert wanted.size
    for one in wanted:
        assert abs(found - one).min() < 1e-5 * one


@pytest.mark.parametrize(
    "use",
    [
        'springs={ "cap.under"={ stiffness=["1 kN/mm", 0, 0] } }',
        'springs={ join={ faces=["block.top", "cap.under"], stiffness=["1 kN/mm", 0, 0] } }',
        'masses={ "cap.under"={ mass="1 g" } }',
        'loads={ "cap.under"={ force=["1 N", 0, 0] } }',
        'supports={ "cap.under"=["z"] }',
    ],
)
def test_nodes_of_a_set_that_the_matrices_do_not_have(exported, use):
    """They are named, and not taken for others."""
    with (exported / "nodes.csv").open("a") as file:
        file.write("9999, 1.5, 2, 20, under\n")
    K = read_matrix(exported / "K.mtx").A
    labels = "".join(f"{100 + i // 3}.{i % 3 + 1}\n" for i in range(K.shape[0]))
    (exported / "rows.dof").write_text(labels)
    said = r"under.*|join.*"
    with pytest.raises(SceneError, match=rf"({said}): 1 of the set's .*\(1.5, 2, 20\) mm"):
        assembled(*COARSE, *FREE, given(exported, dofs="rows.dof"), use)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (dict(stiffness="none.mtx"), "stiffness = .*none.mtx': no such file"),
        (dict(nodes="none.csv"), "nodes = .*none.csv': no such file"),
        (
            dict(mass="less.mtx"),
            "mass = .*less.mtx': .* negative eigenvalues; positive semi-definite is needed",
        ),
        (dict(stiffness="skew.mtx"), "stiffness = .*not symmetric"),
        (dict(stiffness="below.mtx"), "stiffness = .*6 negative eigenvalues|negative eigenvalues"),
        (dict(mass="words.txt"), "mass = .*line 2: 'mass of the cap'; text of three columns"),
        (dict(mass="small.mtx"), "mass = .*: 3 rows, but"),
        (dict(dofs="short.dof"), "stiffness = .*rows, but 1 in dofs"),
    ],
)
def test_mistakes_are_named(exported, cap, change, said):
    K, M, _ = cap
    skew = K.copy()
    skew[0, 1] += abs(K).max()
    mmwrite(exported / "skew.mtx", skew)
    mmwrite(exported / "below.mtx", (K - 1e10 * M) / 1e3)
    mmwrite(exported / "small.mtx", M[:3, :3])
    mmwrite(exported / "less.mtx", M - 0.2 * sp.diags(M.diagonal()))
    (exported / "words.txt").write_text("1 1 1.0\nmass of the cap\n")
    (exported / "short.dof").write_text("1.1\n")
    with pytest.raises(SceneError, match=rf"parts.cap.matrices.{said}"):
        assembled(*COARSE, *FREE, given(exported, **change), TIE)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('ties={ glue={ faces=["cap.under", "cap.over"] } }', "tied to a face of the mesh"),
        ('ties={ glue={ faces=["cap.over", "block.top"] } }', "mm from 'block.top'.*write search"),
        ('ties={ glue={ faces=["cap.side", "block.top"] } }', "no face 'cap.side'"),
        ('ties={ glue={ faces=["cap.under", "block.top"], stiffness="1e13 Pa/m" } }', "exactly"),
        ('loads={ "cap.over"={ pressure="1 bar" } }', "no area"),
        ('springs={ "cap.over"={ stiffness_per_area=["0 Pa/m", "0 Pa/m", "1e9 Pa/m"] } }',
         "no area"),
        ('contact.block_plate.faces=["cap.under", "plate.top"]', "no area"),
        ('masses={ "cap.over"={ mass="1 g", inertia=["1 kg mm^2", "0 kg mm^2", "0 kg mm^2"] } }',
         "no area"),
    ],
)  # fmt: skip
def test_what_a_set_of_nodes_cannot_do(exported, change, said):
    scene = read_scene(BLOCK, [*COARSE, *FREE, given(exported), change])
    with pytest.raises(SceneError, match=said):
        check_brake(scene, MPI.COMM_SELF)
        assemble_brake(scene, MPI.COMM_SELF)


def test_what_is_unlikely_of_a_body(exported, cap):
    """Nodes in another order than the rows, a unit of mass or of the nodes; nothing otherwise."""
    files = Matrices("K.mtx", "M.mtx", "nodes.csv", UNITS)
    body = read_superelement(exported, files)
    assert doubts(body) == []
    rows = body.rows.copy()
    rows[:2] = -1
    (said,) = doubts(replace(body, rows=rows, unknown=2))
    assert said.startswith("2 nodes of the table have no displacement in the matrices, and 2 nodes")
    rounded = replace(body, points=np.round(body.points, 4))
    assert doubts(rounded) == []
    # On the ground nothing is known of the order.
    held = replace(body, K=body.K + 1e6 * sp.identity(body.K.shape[0]))
    order = np.roll(np.arange(len(body.points)), 1)
    assert doubts(replace(held, points=body.points[order])) == []
    (said,) = doubts(replace(body, points=body.points[order]))
    assert "order of the table of nodes" in said
    for wrong in (("mm", "kg", "s"), ("m", "t", "s")):
        (said,) = doubts(read_superelement(exported, replace(files, units=wrong)))
        assert "correct units" in said
    kilograms = given(exported).replace('"t"', '"kg"')
    found = assembled(*COARSE, *FREE, kilograms, TIE).elastic.doubts
    assert [text.partition(": ")[0] for text in found] == ["parts.cap.matrices"]


def test_entries_given_twice_are_refused(tmp_path):
    (tmp_path / "K.txt").write_text("1 1 2.0\n1 1 2.0\n")
    with pytest.raises(SceneError, match="given twice"):
        read_matrix(tmp_path / "K.txt")


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["DMIG    A       1       1               x       1       2.5"], "by pyNastran"),
        (
            ["DMIG    A              0       6       2       0", "INCLUDE 'gone.pch'"],
            "INCLUDE: write the DMIG entries into the file itself",
        ),
        (
            ["DMIG    A              0       6       4       0",
             "DMIG    A              1       1               1       1     2.5     1.5"],
            "complex",
        ),
    ],
)  # fmt: skip
def test_dmig_that_is_no_real_matrix(tmp_path, lines, said):
    pytest.importorskip("pyNastran")
    (tmp_path / "K.bdf").write_text("\n".join(lines) + "\n")
    with pytest.raises(SceneError, match=said):
        read_matrix(tmp_path / "K.bdf")


def test_units_are_asked_for(exported):
    files = Matrices("K.mtx", "M.mtx", "nodes.csv", ("mm", "t"))
    with pytest.raises(SceneError, match="length, mass and time"):
        read_superelement(exported, files)
    with pytest.raises(SceneError, match="'N': wrong unit"):
        read_superelement(exported, replace(files, units=("mm", "N", "s")))
