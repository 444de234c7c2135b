"""The chain from scene to tables: what is built, what is not, resumption, processes."""

import importlib.metadata
import json
import signal
import subprocess
import sys
import time

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake, check_brake
from brake_fenicsx.cli import main
from brake_fenicsx.errors import NotConverged, SceneError, StorageError
from brake_fenicsx.folder.store import Store
from brake_fenicsx.libraries import LIBRARIES, version_of
from brake_fenicsx.pipeline import assemble, run
from brake_fenicsx.samples import solve as one_sample
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK, SCENES
from full_order import text_rows
from processes import command

COARSE = [
    "parts.disc.size=40 mm",
    "parts.pad.size=16 mm",
    "parts.pad.plate_size=20 mm",
    "micro.pixels=64",
    "micro.laws=3",
    "micro.scans=2",
    "samples.n=2",
    "stability.band=['0 Hz', '9 kHz']",
    "stability.verify=1",
]
FEW_CELLS = [
    "parts.block.size='14 mm'",
    "parts.plate.size='20 mm'",
    "stability.band=['0 Hz','20 kHz']",
]
# Several random samples of the block: heights from numbers alone, laws analytic.
MANY = [
    *FEW_CELLS,
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }",
    "contact.block_plate.gap=hdf",
    "stability.method=reduced",
    "samples.n=16",
]


@pytest.fixture(scope="module")
def brake(tmp_path_factory):
    """A coarse brake, all stages but the report."""
    out = tmp_path_factory.mktemp("brake") / "out"
    stages = "stages=['surface','micro','equilibrium','stability','uncertainty']"
    run(SCENES / "disc_brake_demo.toml", MPI.COMM_SELF, out, [*COARSE, stages])
    return out


def test_coarse_brake_is_unstable_with_friction(brake):
    """The whole chain, on a real if coarse brake, finds flutter at mu = 0.5."""
    modes = text_rows(brake / "modes.csv")
    for approach in ("multi-scale", "classical"):
        own = [m for m in modes if m["approach"] == approach]
        unstable = [m for m in own if m["verdict"] == "unstable"]
        assert unstable
        assert all(float(m["damping"]) < 0 < float(m["real_1_s"]) for m in unstable)
    assert (brake / "log.txt").read_text().count("within the outline of") == 1


@pytest.mark.long
def test_coarse_brake_is_stable_without_friction(tmp_path):
    stages = "stages=['surface','micro','equilibrium','stability','uncertainty']"
    no_friction = ["contact.pad_disc.friction=0.0", "samples.classical.friction=0.0"]
    few = ["micro.laws=1", "micro.scans=1", "samples.n=1", "stability.verify=0"]
    change = [*COARSE, stages, *no_friction, *few]
    run(SCENES / "disc_brake_demo.toml", MPI.COMM_SELF, tmp_path, change)
    modes = text_rows(tmp_path / "modes.csv")
    assert len(modes) > 20
    assert {m["verdict"] for m in modes} == {"stable"}
    assert {float(m["real_1_s"]) for m in modes} == {0.0}
    # The symmetric solver ran: only there inertia alone proves that no mode is missing.
    facts = json.loads((tmp_path / "summary.json").read_text())["samples"]
    assert facts["classical"]["counted_by"] == "inertia of K - kappa M"


def test_reduced_sample_agrees_with_full_order(brake):
    """Certified errors cover the true ones, and no verdict differs."""
    full, reduced = (
        np.load(brake / "samples" / f"{n}-00000.npz") for n in ("verify", "multi-scale")
    )
    assert full["s"].size == reduced["s"].size
    error = np.abs(full["s"] - reduced["s"])
    assert np.all(error <= reduced["error"] + full["error"])
    assert np.max(error / np.abs(full["s"])) < 1e-4
    pairs = set(zip(full["verdict"], reduced["verdict"], strict=True))
    assert not pairs & {("stable", "unstable"), ("unstable", "stable")}


def test_contact_carries_the_piston_force(brake):
    """5 bar on the piston circle comes back as contact pressure, half of it on either pad."""

    scene = read_scene(SCENES / "disc_brake_demo.toml", COARSE)
    pressed = assemble_brake(scene, MPI.COMM_SELF).pressed
    # The circle of 54 mm, cut by the pad's edges, has 2078 mm^2; the coarse mesh loses some.
    assert pressed == pytest.approx(2 * 5e5 * 2078e-6, rel=0.1)
    contact = text_rows(brake / "contact.csv")
    for approach in ("multi-scale", "classical"):
        own = [c for c in contact if c["approach"] == approach]
        force = {
            side: sum(float(c["p"]) * float(c["area"]) for c in own if side * float(c["z"]) > 0)
            for side in (-1, 1)
        }
        assert sum(force.values()) == pytest.approx(pressed, rel=1e-8)
        assert force[1] == pytest.approx(force[-1], rel=0.02)


def test_tables_name_every_sample(brake):
    samples = text_rows(brake / "samples.csv")
    assert [(s["approach"], s["sample"]) for s in samples] == [
        ("multi-scale", "0"), ("multi-scale", "1"), ("classical", "0"),
    ]  # fmt: skip
    assert {s["status"] for s in samples} == {"ok"}
    assert len({s["seed"] for s in samples if s["approach"] == "multi-scale"}) == 2


@pytest.mark.parametrize(
    ("changes", "layers"),
    [
        (["parts.pad.shim=0", "parts.pad.side=top"], {"pad.lining", "pad.plate", "disc.body"}),
        (["parts.pad.shim=1 mm"], {"pad.lining", "pad.plate", "pad.shim", "disc.body"}),
    ],
)
def test_shim_and_second_pad_are_built_only_if_named(changes, layers):
    scene = read_scene(SCENES / "disc_brake_demo.toml", [*COARSE, *changes])
    found = assemble_brake(scene, MPI.COMM_SELF)
    assert {*found.mesh.layers} == layers
    sides = {-1.0, 1.0} if len(changes) == 1 else {1.0}
    assert {*np.sign(found.points[:, 2])} == sides


def test_no_ears_if_none_are_named():
    scene = read_scene(SCENES / "disc_brake_demo.toml", ["parts.pad.ear_length=0"])
    with pytest.raises(SceneError, match=r"pad\.ears"):
        check_brake(scene, MPI.COMM_SELF)


@pytest.mark.long
@pytest.mark.parametrize(
    ("stages", "absent"),
    [
        ("['equilibrium']", ["slepc4py", "SurfaceTopography", "matplotlib", "vtkmodules"]),
        (
            "['equilibrium','stability']",
            ["SurfaceTopography", "matplotlib", "brake_fenicsx.extras.limit_cycle.cycles"],
        ),
        ("['surface']", ["dolfinx", "petsc4py", "slepc4py", "gmsh", "matplotlib", "vtkmodules"]),
    ],
)
def test_unnamed_stage_is_not_imported(stages, absent, tmp_path):
    changes = [*FEW_CELLS, f"stages={stages}", "surface.statistics={ S_q = '3 um' }"]
    words = command(BLOCK, tmp_path / "out", changes)
    code = words[2].replace("sys.exit(main(sys.argv[1:]))", "main(sys.argv[1:]);")
    words[2] = code + f"print([m for m in {absent!r} if m in sys.modules])"
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_version_of_every_library_is_known():
    """SALib has no __version__; gmsh's module names that of its interface, 4.8.0 for 4.8.4."""
    import gmsh
    import SALib  # noqa: F401
    import SurfaceTopography  # noqa: F401

    # Its __version__ is that of the checkout in which .venv lies.
    assert version_of("SurfaceTopography") == importlib.metadata.version("SurfaceTopography")
    assert version_of("SALib")[0].isdigit()
    assert version_of("gmsh").split(".")[:2] == gmsh.__version__.split(".")[:2]
    assert all(version_of(name) != "?" for name in LIBRARIES if name in sys.modules)


def test_assemble_gives_the_public_operators():
    ops = assemble(BLOCK, MPI.COMM_SELF)
    elements, dofs = ops.N.shape
    assert ops.T.shape == ops.R.shape == (elements, dofs)
    assert ops.K.shape == ops.M.shape == (dofs, dofs)
    assert (len(ops.w), ops.points.shape, len(ops.f)) == (elements, (elements, 3), dofs)
    assert ops.w.sum() == pytest.approx(40e-3 * 20e-3, rel=1e-12)


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Random samples of the block, uninterrupted."""
    out = tmp_path_factory.mktemp("many") / "out"
    run(BLOCK, MPI.COMM_SELF, out, MANY)
    return out


@pytest.mark.long
@pytest.mark.parametrize("samples", [1, pytest.param(5, marks=pytest.mark.slow)])
def test_killed_run_goes_on_to_the_same_bytes(samples, many, tmp_path):
    """SIGKILL after some samples; the second start must not compute or number anything afresh."""
    out = tmp_path / "out"
    going = subprocess.Popen(command(BLOCK, out, MANY), stderr=subprocess.DEVNULL)
    while going.poll() is None and len(list(out.glob("samples/*.npz"))) < samples:
        time.sleep(0.005)
    going.send_signal(signal.SIGKILL)
    going.wait()
    assert not (out / "modes.csv").exists()
    before = {p.name: p.stat().st_mtime_ns for p in out.glob("samples/*.npz")}
    subprocess.run(command(BLOCK, out, MANY), check=True, capture_output=True)
    assert (out / "modes.csv").read_bytes() == (many / "modes.csv").read_bytes()
    assert (out / "samples.csv").read_bytes() == (many / "samples.csv").read_bytes()
    after = {p.name: p.stat().st_mtime_ns for p in out.glob("samples/*.npz")}
    assert {name: after[name] for name in before} == before


@pytest.mark.together
def test_two_processes_give_the_modes_of_one(processes, tmp_path):
    """Relative 1e-8, or the certified error where that is larger."""
    comm, folder = processes
    run(BLOCK, MPI.COMM_SELF, tmp_path / "one", MANY)
    run(BLOCK, comm, folder / "two", MANY)
    comm.Barrier()
    one, two = text_rows(tmp_path / "one" / "modes.csv"), text_rows(folder / "two" / "modes.csv")
    assert len(one) == len(two) > 50
    for a, b in zip(one, two, strict=True):
        assert (a["approach"], a["sample"], a["mode"]) == (b["approach"], b["sample"], b["mode"])
        s = [complex(float(m["real_1_s"]), 2 * np.pi * float(m["frequency_hz"])) for m in (a, b)]
        assert abs(s[0] - s[1]) <= max(1e-8 * abs(s[0]), 2 * float(a["error_estimate"]))


@pytest.mark.together
def test_a_sample_at_full_order_is_computed_beside_all_others(processes, monkeypatch):
    """By the last of several processes, from the reduced model on; stages have their own times."""
    comm, folder = processes
    teams, work = [], Study.work

    def noted(self, task, **shared):
        teams.append((task[0], self.comm.size))
        return work(self, task, **shared)

    monkeypatch.setattr(Study, "work", noted)
    drawn = MANY[3].replace("'uncertainty'", "'uncertainty','report'")
    this = run(BLOCK, comm, folder / "out", [*MANY, drawn, "stability.verify=1"], pictures=False)
    others = {size for approach, size in teams if approach != "verify"}
    assert others <= {max(comm.size - 1 - (comm.size > 2), 1)}
    assert sum(part.count(("verify", comm.size)) for part in comm.allgather(teams)) == 1 + (
        comm.size > 2
    )
    assert this.comm is comm and this.facts["verification"]
    if comm.rank == 0:
        found = json.loads((folder / "out" / "summary.json").read_text())
        assert {"samples", "results", "pictures", "report"} <= {*found["seconds"]}
        assert min(found["seconds"].values()) >= 0.0
        assert found["verification"] and (folder / "out" / "report.html").exists()
    assert comm.allgather(this.facts["samples"]) == [this.facts["samples"]] * comm.size


@pytest.mark.together
@pytest.mark.parametrize("name", ["save_json", "forget_tables"])
def test_a_folder_that_cannot_be_written_ends_all_processes(processes, monkeypatch, name):
    """The first one writes; no other waits for it then."""
    comm, folder = processes

    def fail(*_):
        raise StorageError("cannot be written")

    monkeypatch.setattr(Store, name, fail)
    with pytest.raises(StorageError):
        run(BLOCK, comm, folder / "out", MANY, pictures=False)


def test_failed_samples_have_seed_and_inputs(tmp_path, monkeypatch):
    """Where in the space of the inputs samples fail: seed, friction and random inputs of each."""

    more = [
        *MANY, "samples.n=4", "samples.approaches=['joint']",
        "samples.random={'contact.block_plate.friction'={law='uniform', min=0.1, max=0.6}}",
    ]  # fmt: skip
    run(BLOCK, MPI.COMM_SELF, tmp_path / "good", more)
    solved = Study._solved

    def sometimes(self, task, *args):
        if task[1] % 2:
            raise NotConverged("made to fail")
        return solved(self, task, *args)

    monkeypatch.setattr(Study, "_solved", sometimes)
    run(BLOCK, MPI.COMM_SELF, tmp_path / "out", more)
    good, some = (text_rows(tmp_path / name / "samples.csv") for name in ("good", "out"))
    assert [s["status"] for s in some] == ["ok", "made to fail", "ok", "made to fail"]
    assert {m["sample"] for m in text_rows(tmp_path / "out" / "modes.csv")} == {"0", "2"}
    for one, two in zip(good, some, strict=True):
        for name in ("seed", "mu", "contact.block_plate.friction"):
            assert one[name] == two[name] != ""


def test_rejected_points_have_their_inputs(tmp_path):
    """A point of a design that no material has: its values stand beside the reason."""
    more = [
        *MANY, "stages=['surface','equilibrium','uncertainty']", "samples.n=32",
        "samples.approaches=['joint']", "samples.design='saltelli'",
        "samples.random={'materials.lining.C13'={law='uniform', min='0.5 GPa', max='6 GPa'}}",
    ]  # fmt: skip
    run(BLOCK, MPI.COMM_SELF, tmp_path / "out", more)
    refused = [s for s in text_rows(tmp_path / "out" / "samples.csv") if s["status"] != "ok"]
    assert refused and all("draw rejected" in s["status"] and s["seed"] for s in refused)
    # C13^2 < C33 (C11 + C12) / 2 of the lining.
    assert all(float(s["materials.lining.C13"]) > 2.757e9 for s in refused)


def test_a_run_of_failed_samples_alone_is_an_error(tmp_path, monkeypatch, capsys):
    """With status 0 a script would take the empty tables for a brake without squeal."""

    def never(*args, **kwargs):
        raise NotConverged("made to fail")

    monkeypatch.setattr(one_sample, "equilibrium", never)
    monkeypatch.setattr(one_sample, "raised_friction", never)
    out = tmp_path / "out"
    assert main(["run", str(BLOCK), "-o", str(out), "--set", "stages=['equilibrium']"]) == 1
    assert "all samples failed (1 of 1)" in capsys.readouterr().err
    assert [s["status"] for s in text_rows(out / "samples.csv")] == ["made to fail"]
    assert (out / "summary.json").exists()


def test_the_ramp_is_gone_through_where_the_full_load_does_not_converge(tmp_path, monkeypatch):
    """The scene's two load steps, only for the sample that needs them, with the same result."""

    solve, steps = one_sample.equilibrium, []

    def sometimes(ops, laws, mu, n=1, tolerance=None, start=None):
        steps.append(n if start is None else "near")
        if len(steps) in (3, 4):
            raise NotConverged("made to fail")
        return solve(ops, laws, mu, n, tolerance, start=start)

    monkeypatch.setattr(one_sample, "equilibrium", sometimes)
    changes = [*MANY, "samples.n=3", "equilibrium.tolerance=1e-12"]
    run(BLOCK, MPI.COMM_SELF, tmp_path / "ramp", changes)
    # The first sample, its gaps from which the others start, the second one, the third one.
    assert steps == [1, 1, "near", 1, 2, "near"]
    monkeypatch.undo()
    run(BLOCK, MPI.COMM_SELF, tmp_path / "full", changes)
    a, b = (text_rows(tmp_path / name / "modes.csv") for name in ("ramp", "full"))
    for one, two in zip(a, b, strict=True):
        assert float(one["frequency_hz"]) == pytest.approx(float(two["frequency_hz"]), rel=1e-9)
