"""A budget of a small real scene: knobs, order, time, interruption, failures."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import pytest

from brake_fenicsx import pipeline
from brake_fenicsx.cli import main
from brake_fenicsx.errors import BrakeError, NotConverged, SceneError
from brake_fenicsx.extras.variants import budget as study
from brake_fenicsx.extras.variants.budget import run_budget
from brake_fenicsx.extras.variants.knobs import Knob, Variant, knobs
from brake_fenicsx.extras.variants.runs import Runs
from brake_fenicsx.scene import read_scene
from coarse_block import SCENES
from run_tables import read_rows

COMM = MPI.COMM_SELF
BLOCK, DEMO = SCENES / "block_on_plate.toml", SCENES / "disc_brake_demo.toml"
ROUGH = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '0.05 um' }", "contact.block_plate.gap=hdf",
    "contact.block_plate.law={ p0 = '10 MPa', u0 = '0.05 um' }",
    "stability.band=['0 Hz','20 kHz']", "stability.method=reduced", "samples.n=2",
    "parts.plate.size='30 mm'", "parts.block.size='20 mm'",
]  # fmt: skip


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Folder of a budget whose scene itself was run: others go on from a copy."""
    folder = tmp_path_factory.mktemp("budget") / "b"
    Runs(BLOCK, COMM, folder, [*ROUGH, *study._lean(BLOCK, ROUGH)]).run(study.REFERENCE)
    return folder


@pytest.fixture
def few(monkeypatch):
    """Three knobs alone, and the names of the runs that are started."""
    started = []
    run = pipeline.run

    def counted(scene, comm, directory, *args, **keys):
        started.append(Path(directory).name)
        return run(scene, comm, directory, *args, **keys)

    monkeypatch.setattr(pipeline, "run", counted)
    wanted = ("body-mesh", "reduction", "level")
    monkeypatch.setattr(study, "knobs", lambda *a: [k for k in knobs(*a) if k.name in wanted])
    return started


def table(folder):
    return read_rows(folder / "budget.csv")


@pytest.mark.long
def test_budget_end_to_end_is_interrupted_and_goes_on(few, tmp_path, monkeypatch):
    counted = pipeline.run

    def interrupted(scene, comm, directory, *args, **keys):
        if len(few) == 2:
            raise KeyboardInterrupt
        return counted(scene, comm, directory, *args, **keys)

    monkeypatch.setattr(pipeline, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_budget(BLOCK, COMM, tmp_path / "b", ROUGH)
    assert few[0] == "reference" and len(few) == 2
    monkeypatch.setattr(pipeline, "run", counted)
    run_budget(BLOCK, COMM, tmp_path / "b", ROUGH)
    # Every run once; each knob is turned once before any is turned twice.
    assert sorted(few) == ["body-mesh-1", "body-mesh-2", "reduction-1", "reference"]
    assert few[-1] == "body-mesh-2"
    page = run_budget(BLOCK, COMM, tmp_path / "b", ROUGH)
    assert len(few) == 4 and page.is_file()
    rows = table(tmp_path / "b")
    assert {r["knob"] for r in rows} == {"samples", "body-mesh", "reduction", "level"}
    own = [r for r in rows if r["knob"] == "reduction" and r["family"] not in (None, "any")]
    assert own
    for row in own:  # a knob without effect: the model was made for 1e-5 of the eigenvalues
        assert row["paired"] == "yes" and row["change"] == 0.0
        assert row["change_low"] <= 0.0 <= row["change_high"]
        assert abs(row["frequency_bias_hz"]) < 1e-4 * row["frequency_hz"]
    (level,) = (r for r in rows if r["knob"] == "level")
    assert level["status"] == "not run" and level["reason"] == "the scene has no scan"
    fine = [json.loads((tmp_path / "b" / n / "summary.json").read_text())["dofs"]
            for n in ("reference", "body-mesh-1", "body-mesh-2")]  # fmt: skip
    assert fine == sorted(fine) and len(set(fine)) == 3
    with pytest.raises(SceneError, match="another scene"):
        run_budget(BLOCK, COMM, tmp_path / "b", [*ROUGH, "contact.block_plate.friction=0.4"])


@pytest.mark.hard
def test_budget_without_time_names_what_it_left_out(few, reference, tmp_path):
    """Time only for the scene: the row of every variant gives its estimated time."""
    shutil.copytree(reference, tmp_path / "b")
    assert main(["budget", str(BLOCK), "-o", str(tmp_path / "b"), "--minutes", "1e-3",
                 *(w for text in ROUGH for w in ("--set", text))]) == 0  # fmt: skip
    assert few == []
    left = [r for r in table(tmp_path / "b") if r["status"] == "not run" and r["variant"]]
    assert len(left) == 3 and all(r["reason"].startswith("no time is left for about") for r in left)


def test_a_run_whose_time_is_over_is_stopped_and_goes_on_later(tmp_path):
    """A named error; the same call goes on, and its tables are those of one run."""
    runs = Runs(BLOCK, COMM, tmp_path / "limited", ROUGH)
    with pytest.raises(BrakeError, match="stopped after 0 s, no time is left"):
        runs.run("a", ["samples.n=3"], limit=1e-3)
    assert not runs.is_done("a", ["samples.n=3"])
    whole = Runs(BLOCK, COMM, tmp_path / "whole", ROUGH).run("a", ["samples.n=3"])
    folder = runs.run("a", ["samples.n=3"], limit=1e6)
    assert (folder / "modes.csv").read_bytes() == (whole / "modes.csv").read_bytes()
    assert runs.is_done("a", ["samples.n=3"]) and not runs.is_done("a", ["samples.n=2"])


@pytest.mark.together
def test_processes_end_together_where_their_time_is_over(processes):
    comm, folder = processes
    with pytest.raises(BrakeError, match="no time is left"):
        Runs(BLOCK, comm, folder / "two", ROUGH).run("a", limit=1e-3)


@pytest.mark.hard
def test_budget_stops_a_variant_at_its_limit_and_names_it(few, reference, tmp_path, monkeypatch):
    """A variant gets what is left of the time; those that are stopped stand in one sentence."""
    shutil.copytree(reference, tmp_path / "b")
    limits, run = [], Runs.run

    def limited(self, name, changes=(), limit=None):
        limits.append(limit)
        return run(self, name, changes, limit and 1e-3)

    monkeypatch.setattr(Runs, "run", limited)
    run_budget(BLOCK, COMM, tmp_path / "b", ROUGH, minutes=30)
    assert limits[0] is None and all(0 < limit < 1800 for limit in limits[1:])
    left = [r for r in table(tmp_path / "b") if r["variant"] != "samples" and r["variant"]]
    assert len(left) == 3 == len(limits) - 1
    assert all(r["reason"].startswith("stopped after") for r in left)
    page = (tmp_path / "b" / "budget.html").read_text()
    assert page.count("Not varied:") == 1 and page.count("the mesh of the bodies") == 2
    assert "<td>not run" not in page


@pytest.mark.long
@pytest.mark.hard
def test_variant_that_fails_is_a_row_and_the_others_go_on(few, tmp_path, monkeypatch):
    """The table shows the error message; the next call repeats the failed variant.

    The scene falls back to full order where it must, a variant does not.
    """
    monkeypatch.setattr(study, "knobs", lambda *a: [
        replace(k, variants=k.variants[:1])
        for k in knobs(*a) if k.name in ("body-mesh", "reduction")
    ])  # fmt: skip
    falls_back = [*ROUGH, "stability.on_tolerance='full order'"]
    counted = pipeline.run

    def failing(scene, comm, directory, *args, **keys):
        if Path(directory).name == "reduction-1":
            raise NotConverged("equilibrium: residual 1e-2\nafter 50 iterations")
        return counted(scene, comm, directory, *args, **keys)

    monkeypatch.setattr(pipeline, "run", failing)
    run_budget(BLOCK, COMM, tmp_path / "b", falls_back)
    (row,) = (r for r in table(tmp_path / "b") if r["knob"] == "reduction")
    assert row["status"] == "not run"
    assert row["reason"] == "equilibrium: residual 1e-2 after 50 iterations"
    assert {r["status"] for r in table(tmp_path / "b") if r["knob"] == "body-mesh"} == {"run"}
    monkeypatch.setattr(pipeline, "run", counted)
    run_budget(BLOCK, COMM, tmp_path / "b", falls_back)
    assert few[-1] == "reduction-1" and few.count("body-mesh-1") == 1
    settings = [
        json.loads((tmp_path / "b" / name / "summary.json").read_text())["in_effect"]["stability"]
        for name in ("reference", "body-mesh-1")
    ]
    assert [s["on_tolerance"] for s in settings] == ["full order", "warn"]


def test_knobs_of_the_demo_are_scenes_that_can_be_read():
    scene = read_scene(DEMO)
    found = {knob.name: knob for knob in knobs(scene, 625)}
    assert all(bool(k.variants) != bool(k.reason) for k in found.values())
    assert {n for n, k in found.items() if not k.variants} == {"variance"}
    for knob in found.values():
        for variant in knob.variants:
            other = read_scene(DEMO, variant.overrides)
            assert other.table != scene.table
    sizes = [
        read_scene(DEMO, v.overrides).parts["pad"].parameters.size
        for v in found["face-mesh"].variants
    ]
    assert sizes == pytest.approx([7e-3 / 1.25, 7e-3 / 1.25**2])
    assert scene.micro.hardness == 200e6
    assert read_scene(DEMO, found["hardness"].variants[0].overrides).micro.hardness == 400e6


def test_knobs_of_a_smooth_scene_say_why_they_are_not_turned():
    found = {k.name: k for k in knobs(read_scene(BLOCK), None)}
    assert "no laws" in found["pixels"].reason and "full order" in found["cutoff"].reason
    assert "no approach 'classical'" in found["penalty"].reason and found["body-mesh"].variants


@pytest.mark.slow
def test_frequency_of_a_refined_body_has_its_order(tmp_path, monkeypatch):
    """Plate of 2, 4 and 8 cells on springs: the patches' pressures jump, so that u is in H^(5/2-e).

    Frequencies of elements of the second order then converge with the third power of the size.
    """
    plate = {"length": 40, "width": 40, "height": 20, "z": -20, "size": 20}
    block = {"length": 30, "width": 20, "height": 10, "size": 10}
    sizes = [f"parts.{part}.{k}='{v} mm'" for part, lengths in (("plate", plate), ("block", block))
             for k, v in lengths.items()]  # fmt: skip
    scene = [
        *ROUGH, *sizes, "mesh.cells=hexahedra", "samples.n=2", "stability.band=['23 kHz','26 kHz']",
        "surface.statistics={ S_q = '1 nm' }", "supports={ 'block.top' = ['x','y'] }",
        "springs={ 'plate.bottom' = { stiffness = ['1e8 N/m','1e8 N/m','1e9 N/m'] } }",
    ]  # fmt: skip
    variants = tuple(Variant((f"parts.plate.size='{20 / n} mm'",), f"{n} times") for n in (2, 4))
    plates = Knob("plate", "the mesh of the plate", variants, 2.0)
    monkeypatch.setattr(study, "knobs", lambda *_: [plates])
    run_budget(BLOCK, COMM, tmp_path / "b", scene)
    rows = [r for r in table(tmp_path / "b") if r["variant"] == "plate-2" and r["family_variant"]]
    assert len(rows) == 2
    for row in rows:
        assert row["paired"] == "yes"
        assert 2.0 < row["frequency_order"] < 4.0


@pytest.mark.slow
@pytest.mark.together
def test_two_processes_give_the_rows_of_one(few, processes, tmp_path):
    comm, folder = processes
    run_budget(BLOCK, comm, folder / "two", ROUGH)
    run_budget(BLOCK, COMM, tmp_path / "one", ROUGH)
    one, two = table(tmp_path / "one"), table(folder / "two")
    assert len(one) == len(two) and len(one) >= 8
    for a, b in zip(one, two, strict=True):
        for column in a.keys() - {"seconds", "memory_mb"}:
            exact = not isinstance(a[column], float)
            near = pytest.approx(a[column], rel=1e-6, abs=1e-3 if "hz" in column else 1e-7)
            assert b[column] == (a[column] if exact else near), column


@pytest.mark.parametrize(
    ("scene", "more", "says"),
    [
        (BLOCK, ["--set", "stages=['equilibrium']"], "a budget needs"),
        (BLOCK, ["--set", "sweep.parameters.'contact.block_plate.friction'={ start=0, stop=1 }"],
         "remove [sweep]"),
        (BLOCK, ["--minutes", "0"], "--minutes 0"),
        (BLOCK.with_name("none.toml"), [], "no such file"),
    ],
)  # fmt: skip
def test_scenes_without_a_budget_are_refused(scene, more, says, tmp_path, capsys):
    assert main(["budget", str(scene), "-o", str(tmp_path / "b"), *more]) == 2
    assert says in capsys.readouterr().err and not (tmp_path / "b").exists()
