"""Samples whose materials and loads differ from the scene's, against scenes written that way."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.changes import assemble_changes
from brake_fenicsx.build.material_table import stiffness
from brake_fenicsx.build.parametric import parametric_brake
from brake_fenicsx.macro.equilibrium import (
    BodyOperators,
    compliance,
    corrected_equilibrium,
    equilibrium,
)
from brake_fenicsx.pipeline import run
from brake_fenicsx.samples.sampling import Roughness, draw_inputs, draw_sample
from brake_fenicsx.scene import read_scene
from brake_fenicsx.surface import match_moments
from coarse_block import BLOCK
from full_order import stored_eigenvalues, text_rows

COMM = MPI.COMM_SELF
STAGES = "stages=['surface','equilibrium','stability','uncertainty']"
COARSE = [
    STAGES, "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.axis='30 deg'", "parts.block.size='20 mm'", "parts.plate.size='30 mm'",
    "stability.band=['0 Hz','20 kHz']", "stability.method=reduced",
]  # fmt: skip
HEIGHTS = Roughness(hdf=match_moments(3e-6, 0.0, 3.0))
NAMES = ("C11", "C12", "C13", "C33", "C44")


def random(key, law):
    return f'samples.random."{key}"={law}'


C44 = random("materials.lining.C44", "{ law='uniform', spread=0.2 }")
C33 = random("materials.lining.C33", "{ law='uniform', spread=0.2 }")
LOAD = random("loads.block.top.pressure", "{ law='uniform', min='2 bar', max='9 bar' }")
MU = random("contact.block_plate.friction", "{ law='uniform', min=0.3, max=0.7 }")


@pytest.fixture(scope="module")
def scene():
    return read_scene(BLOCK, [*COARSE, C44, C33])


@pytest.fixture(scope="module")
def brake(scene):
    return assemble_brake(scene, COMM)


def written(scene, inputs, *changes):
    """The scene with the sample's constants written in it."""
    values = {k.rpartition(".")[2]: v for k, v in inputs.items() if "materials" in k}
    sets = [f"materials.lining.{name}='{v!r} Pa'" for name, v in values.items()]
    return read_scene(BLOCK, [*COARSE, *sets, *changes])


def test_stiffness_of_a_sample_is_that_of_the_scene_written_with_its_constants(scene, brake):
    """Axes turned by 30 degrees: unit changes in x, y, z instead would be wrong there."""
    changes = assemble_changes(scene, brake)
    assert {term.constant for term in changes.terms} == {"C33", "C44", "C55"}
    inputs, _ = draw_inputs(scene, "multi-scale", None, np.random.default_rng(4))
    K = brake.K + changes.change(inputs, "K")
    expected = assemble_brake(written(scene, inputs), COMM).K
    assert abs(K - expected).max() < 1e-12 * abs(expected).max()


def test_engineering_constants_move_what_they_must(brake):
    s = read_scene(
        BLOCK, [*COARSE, random("materials.lining.E_3", "{ law='uniform', spread=0.2 }")]
    )
    changes = assemble_changes(s, brake)
    assert {term.constant for term in changes.terms} == {"C11", "C22", "C33", "C12", "C13", "C23"}
    inputs, _ = draw_inputs(s, "multi-scale", None, np.random.default_rng(4))
    usual = stiffness(s.materials["lining"])
    change = inputs.materials["lining"] - usual
    assert abs(change[0, 0]) > 1e-4 * usual[0, 0]


@pytest.fixture(scope="module")
def bodies(brake):
    k0 = np.full(len(brake.w), 1e11)
    c = compliance(brake.K, brake.N, brake.T, brake.w, brake.f, k0, COMM)
    return BodyOperators(brake.N, brake.T, brake.w, brake.g0, brake.f, c)


def test_corrected_equilibrium_is_that_of_the_changed_bodies(scene, brake, bodies):
    """A correction left out after the first would be off by the square of the change."""
    changes = assemble_changes(scene, brake)
    sample = draw_sample(scene, "multi-scale", 0, parametric_brake(scene, brake).at, HEIGHTS)
    change = changes.change(sample.values, "K")
    found = corrected_equilibrium(bodies, change, sample.laws, sample.friction.mu)
    K = brake.K + change
    own = compliance(K, brake.N, brake.T, brake.w, brake.f, bodies.compliance.k0, COMM)
    whole = BodyOperators(brake.N, brake.T, brake.w, brake.g0, brake.f, own)
    direct = equilibrium(whole, sample.laws, sample.friction.mu)
    np.testing.assert_allclose(found.p, direct.p, rtol=1e-8, atol=1e-9 * direct.p.max())
    push = brake.N.T @ (brake.w * found.p) + brake.T.T @ (brake.w * found.p * sample.friction.mu)
    rest = K @ found.u - brake.f - push
    assert np.linalg.norm(rest) < 1e-9 * np.linalg.norm(push)


@pytest.mark.parametrize(
    "change", [["stability.verify=1"], ["stages=['surface','equilibrium','uncertainty']"]]
)
def test_tolerance_of_newton_is_that_of_the_scene(change, tmp_path):
    """Of the condensed, the reduced and, without a reduced model, the corrected equilibrium."""
    found = []
    for tolerance in ("1e-10", "1e-3"):
        folder = tmp_path / tolerance
        own = [*change, f"equilibrium.tolerance={tolerance}"]
        run(BLOCK, COMM, folder, [*COARSE, C44, "samples.n=1", *own])
        found.append([np.load(p) for p in sorted((folder / "samples").iterdir())])
    assert len(found[0]) == len(found[1]) >= 1
    for tight, loose in zip(*found, strict=True):
        assert tight["equilibrium_residual"] < 1e-10 < loose["equilibrium_residual"] < 1e-3
        assert loose["equilibrium_iterations"] < tight["equilibrium_iterations"]


def same_modes(a, b, more=1e-8):
    """Eigenvalues agree within a little and the errors that both state."""
    (s, e), (t, f) = a, b
    assert s.size == t.size > 3
    assert np.all(np.abs(s - t) <= more * np.abs(t) + e + f)
    return np.abs(s - t) / np.abs(t)


def test_random_load_and_material_give_the_modes_of_the_scene_written_so(tmp_path):
    """The whole path of sample 1: draw, equilibrium, full order."""
    run(BLOCK, COMM, tmp_path / "a", [*COARSE, C44, LOAD, "samples.n=2", "stability.method=full"])
    drawn = text_rows(tmp_path / "a" / "samples.csv")[1]
    sets = [
        f"materials.lining.C44='{drawn['materials.lining.C44']} Pa'",
        f"loads.\"block.top\".pressure='{drawn['loads.block.top.pressure']} Pa'",
        "samples.n=2",
    ]
    # The laws of the second scene are not scaled: its own modulus is what they are made for.
    run(BLOCK, COMM, tmp_path / "b", [*COARSE, *sets, "stability.method=full"])
    found = same_modes(*(stored_eigenvalues(tmp_path / n, "multi-scale", 1) for n in "ab"))
    assert found.max() < 1e-8
    assert drawn["rejected"] == "0"
    family = [int(r["family"]) for r in text_rows(tmp_path / "a" / "modes.csv")]
    assert min(family) >= 0


def test_materials_and_load_in_the_reduced_model(tmp_path):
    """Engineering constants and pressure: equilibrium and modes of all samples to 1e-5."""
    constants = [
        random(f"materials.lining.{name}", "{ law='uniform', spread=0.2 }")
        for name in ("E_3", "G_13")
    ]
    given = [*COARSE, *constants, LOAD, MU, "samples.n=2", "stability.verify=1"]
    run(BLOCK, COMM, tmp_path / "a", given)
    run(BLOCK, COMM, tmp_path / "b", [*given, "stability.method=full"])
    for k in range(2):
        both = (stored_eigenvalues(tmp_path / n, "multi-scale", k) for n in "ab")
        # The equilibrium, through the compliance, has an interpolation error of its own.
        assert same_modes(*both, more=1e-6).max() < 1e-5
    a, b = (text_rows(tmp_path / n / "modes.csv") for n in "ab")
    for found, exact in zip(a, b, strict=True):
        assert found["verdict"] in (exact["verdict"], "neutral")
    shares = [[float(r[c]) for r in t for c in r if c.startswith("share_")] for t in (a, b)]
    assert np.abs(np.subtract(*shares)).max() < 0.1
    one = np.load(tmp_path / "a" / "samples" / "multi-scale-00000.npz")
    assert "zeros of T(z)" in str(one["counted"])


FULL_ORDER = "stability.on_tolerance='full order'"


def test_materials_that_no_box_can_hold_go_to_full_order(tmp_path):
    """Draws that are possible may span a box whose corners are not."""
    names = ("nu_12", "nu_31")
    odd = [random(f"materials.lining.{n}", "{ law='uniform', min=0.0, max=0.95 }") for n in names]
    run(BLOCK, COMM, tmp_path / "a", [*COARSE, *odd, FULL_ORDER, "samples.n=2"])
    one = np.load(tmp_path / "a" / "samples" / "multi-scale-00000.npz")
    assert "zeros of T(z)" not in str(one["counted"])
    assert "full order" in (tmp_path / "a" / "log.txt").read_text()


def test_friction_alone_goes_through_the_reduced_path_also_in_perfect_contact(tmp_path):
    """The penalty is far from the reference stiffness: errors grow, and must be stated."""
    fast = ["samples.approaches=['multi-scale','parametric']", "samples.parametric.design=rbd-fast"]
    law = [*COARSE, MU, *fast, "samples.n=2"]
    run(BLOCK, COMM, tmp_path / "a", law)
    run(BLOCK, COMM, tmp_path / "b", [*law, "stability.method=full"])
    for k in range(2):
        found = same_modes(*(stored_eigenvalues(tmp_path / n, "parametric", k) for n in "ab"))
        assert 0 < found.max() < 3e-4
    samples = text_rows(tmp_path / "a" / "samples.csv")
    assert all(s["contact.block_plate.friction"] == "" for s in samples[:2])
    assert len({s["contact.block_plate.friction"] for s in samples[2:]}) == 2


def test_tolerance_of_the_scene_decides_how_accurate_the_model_is(tmp_path):
    """More moments in perfect contact: smaller stated errors."""
    fast = ["samples.approaches=['multi-scale','parametric']", "samples.parametric.design=rbd-fast"]
    worst = []
    for name, tolerance in (("loose", 1e-2), ("tight", 1e-6)):
        given = [*COARSE, MU, *fast, "samples.n=2", f"stability.tolerance={tolerance}"]
        run(BLOCK, COMM, tmp_path / name, given)
        both = [stored_eigenvalues(tmp_path / name, "parametric", k) for k in range(2)]
        worst.append(max(np.max(e / np.abs(s)) for s, e in both))
    assert worst[1] < 0.05 * worst[0]


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """A folder of reduced models that runs share."""
    return tmp_path_factory.mktemp("models")


@pytest.mark.long
@pytest.mark.parametrize("choice", ["warn", "full order"])
def test_what_becomes_of_a_sample_beyond_the_tolerance(tmp_path, choice, models):
    """Counted and said, or solved at full order: the scene's choice."""
    given = [*COARSE, C44, "samples.n=2", "stability.tolerance=1e-8", "stability.verify=0"]
    run(BLOCK, COMM, tmp_path, [*given, f"stability.on_tolerance={choice}"], cache=models)
    log = (tmp_path / "log.txt").read_text()
    for k in range(2):
        one = np.load(tmp_path / "samples" / f"multi-scale-{k:05d}.npz")
        missed = int(one["tolerance_missed"])
        assert (missed > 0) == (choice == "warn")
        assert ("zeros of T(z)" in str(one["counted"])) == (choice == "warn")
    assert ("tolerance not reached" in log) == (choice == "warn")
    assert ("beyond the tolerance 1e-08: full order" in log) == (choice == "full order")


NO_MODES = "stages=['surface','equilibrium','uncertainty']"


def test_material_far_from_the_scene_is_factored_afresh(tmp_path):
    """Where corrections diverge the sample must still come out, and right."""
    stiff = random("materials.lining.C44", "{ law='uniform', min='4 GPa', max='5 GPa' }")
    run(BLOCK, COMM, tmp_path / "a", [*COARSE, stiff, NO_MODES, "samples.n=2"])
    drawn = text_rows(tmp_path / "a" / "samples.csv")[1]
    assert drawn["status"] == "ok"
    assert "the matrices are factored again" in (tmp_path / "a" / "log.txt").read_text()
    value = f"materials.lining.C44='{drawn['materials.lining.C44']} Pa'"
    run(BLOCK, COMM, tmp_path / "b", [*COARSE, value, NO_MODES, "samples.n=2"])
    a, b = (np.load(tmp_path / n / "samples" / "multi-scale-00001.npz")["p"] for n in "ab")
    np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-8 * b.max())


@pytest.mark.long
def test_rejected_draws_are_counted_where_one_looks(tmp_path):
    """In samples.csv and the summary; a rigid design keeps the sample with its error."""
    import json

    bad = random("materials.lining.nu_31", "{ law='uniform', min=0.0, max=0.9 }")
    run(BLOCK, COMM, tmp_path / "a", [*COARSE, bad, NO_MODES, "samples.n=12"])
    counted = [int(r["rejected"]) for r in text_rows(tmp_path / "a" / "samples.csv")]
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert sum(counted) == summary["samples"]["multi-scale"]["rejected_draws"] > 0
    rigid = [*COARSE, bad, NO_MODES, "samples.n=32", "samples.design=saltelli"]
    run(BLOCK, COMM, tmp_path / "b", rigid)
    status = [r["status"] for r in text_rows(tmp_path / "b" / "samples.csv")]
    failed = [s for s in status if s.startswith("draw rejected: materials.lining: ")]
    assert 0 < len(failed) < len(status) == 32
    assert len(failed) + status.count("ok") == 32
