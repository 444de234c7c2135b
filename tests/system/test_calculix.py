"""Modes against CalculiX: another program, its own elements, contact and friction."""

import shutil
import subprocess
import sys
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

import small_decks
from brake_fenicsx.build.bodies import assemble_bodies
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.scene_mesh import scene_mesh
from brake_fenicsx.extras.decks.draft.text import write_scene
from brake_fenicsx.extras.decks.superelement import read_superelement
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.parts_section import Matrices
from places import BLOCK, SCRIPTS

pytestmark = [
    pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed"),
]


@pytest.fixture
def bench(monkeypatch):
    """The script, without a trace of it left behind."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    yield __import__("bench_calculix")
    sys.modules.pop("bench_calculix", None)


@pytest.mark.parametrize("degree", [1, 2])
def test_real_modes_of_the_bodies(bench, tmp_path, degree):
    """With the points by which CalculiX integrates the mass, equal to the digits it prints."""
    table = bench.compare_bodies(BLOCK, [f"mesh.degree={degree}"], 8, tmp_path)
    assert len(table) == 5
    _, here, there = table.T
    assert there == pytest.approx(here, rel=2e-6)


@pytest.mark.slow
def test_flutter_of_a_block(bench, tmp_path):
    """A block that tips under friction, a fifth of it open: frequencies to 0.2 %, growth to 3 %."""
    own = ['contact.block_plate.discretisation="quadrature"', "stability.band=['0 Hz','16 kHz']"]
    table = bench.compare(BLOCK, own, 2e13, 1e-4, 10, tmp_path)
    assert len(table) == 6
    here, there, grows, growth = table.T
    assert abs(there / here - 1).max() < 2e-3
    assert (grows > 1.0).sum() == 1
    assert growth[grows > 1.0] == pytest.approx(grows[grows > 1.0], rel=0.03)
    assert growth[grows <= 1.0] == pytest.approx(0.0, abs=1.0)


def test_a_deck_and_the_scene_of_init(tmp_path):
    """Mass and modes of the deck in CalculiX are those of its scene, to the digits printed: lining
    of nine constants, supports of sets and single nodes; contact has no part in these modes."""
    nine = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n8e3,7e3,2e3,.31,.33,.32,3e3,1.2e3\n1.1e3\n"
    said = "*EL PRINT, ELSET=BLOCK, TOTALS=ONLY\nEMAS\n*EL PRINT, ELSET=PLATE, TOTALS=ONLY\nEMAS\n"
    text = small_decks.deck(
        materials=small_decks.MATERIALS.replace("*ELASTIC\n2000., 0.3\n", nine), pressed="",
        held="*BOUNDARY\nBOTTOM, 1, 3\nTOP, 1, 2\n3, 1\n6, 1\n12, 1\n15, 1\n",
        modes=f"*STEP\n*FREQUENCY\n8\n{said}*END STEP\n",
    )  # fmt: skip
    deck = tmp_path / "deck.inp"
    deck.write_text(text)
    subprocess.run(["ccx", "deck"], cwd=tmp_path, capture_output=True, check=True)
    words = [line.split() for line in (tmp_path / "deck.dat").read_text().splitlines()]
    mass = [float(words[i + 2][0]) for i, row in enumerate(words) if row[1:3] == ["mass", "for"]]
    theirs = [float(row[1]) for row in words if len(row) == 5 and row[0].isdigit()]
    write_scene(deck, tmp_path / "deck.toml")
    scene = read_scene(tmp_path / "deck.toml", ["mesh.degree=1"])
    mesh = scene_mesh(scene, MPI.COMM_SELF)
    elastic = assemble_bodies(scene, mesh)
    ours = eigh(elastic.K.toarray(), elastic.M.toarray(), eigvals_only=True)[: len(theirs)]
    np.testing.assert_allclose(ours, theirs, rtol=2e-6, atol=1e-6 * theirs[-1])
    free = assemble_bodies(replace(scene, supports={}), mesh)
    assert free.M.sum() / 3 == pytest.approx(1e3 * sum(mass[:2]), rel=1e-6)


def test_matrices_of_a_body_from_calculix(bench, tmp_path):
    """A bracket by the matrices that CalculiX stores has the modes of the bracket meshed here:
    with its mass of four points a cell the same, with the exact one within 1 % of the square."""
    parts = [
        'mesh.cells="tetrahedra"', "parts.block.size='8 mm'", "parts.plate.size='12 mm'",
        "parts.plate.z='-40 mm'", "contact.block_plate.search='1 m'", "supports={}", "loads={}",
    ]  # fmt: skip
    scene = read_scene(BLOCK, parts)
    brake = assemble_brake(scene, MPI.COMM_SELF)
    deck = bench.Deck(scene, brake, 1.0, 0.0, 1)
    text = "\n".join(deck.real_modes()).replace("*FREQUENCY", "*FREQUENCY, SOLVER=MATRIXSTORAGE")
    (tmp_path / "brake.inp").write_text(text + "\n")
    subprocess.run(["ccx", "brake"], cwd=tmp_path, capture_output=True, check=True)
    upper = deck.nodes("block.top")
    own = np.unique(deck.cells[brake.mesh.cell_tags.find(brake.mesh.layers["block.body"])])
    rows = [
        f"{n + 1},{x:.17g},{y:.17g},{z:.17g},{'top' if n in upper else ''}"
        for n, (x, y, z) in zip(own, deck.x[own], strict=True)
    ]
    (tmp_path / "nodes.csv").write_text("\n".join(rows) + "\n")
    files = Matrices("brake.sti", "brake.mas", "nodes.csv", ("m", "kg", "s"), dofs="brake.dof")
    body = read_superelement(tmp_path, files)
    block = body.rows[: len(own)].reshape(-1)
    K, M = (A[block][:, block] for A in (body.K, body.M))
    mine = np.sort(np.concatenate([3 * own + c for c in range(3)]))
    found, here = (
        np.sort(eigsh(A, 12, B, sigma=-1e8, return_eigenvectors=False))[6:]
        for A, B in ((K, M), (brake.K[mine][:, mine], brake.M[mine][:, mine]))
    )
    assert body.sets["top"].size == upper.size
    np.testing.assert_allclose(found, here, rtol=1e-2)
    few = bench.mass_of_few_points(scene, brake)[mine][:, mine]
    same = np.sort(eigsh(brake.K[mine][:, mine], 12, few, sigma=-1e8, return_eigenvectors=False))
    np.testing.assert_allclose(found, same[6:], rtol=1e-6)
