"""Sweeps of a scene: against modes at each value alone, resumed, on two processes."""

import csv
import json
import shutil

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare, sweep
from brake_fenicsx.errors import SceneError
from brake_fenicsx.pipeline import run
from brake_fenicsx.report.figures import make_figures
from brake_fenicsx.report.html import write_report
from brake_fenicsx.report.sweep_figures import draw_chart
from brake_fenicsx.results.run import SWEEP as SWEEP_TABLES
from brake_fenicsx.results.run import read_run
from brake_fenicsx.sweeps.events import critical_values
from coarse_block import BLOCK, SWEPT

pytestmark = pytest.mark.long

COMM = MPI.COMM_SELF
KEY = "contact.block_plate.friction"
ONSET = "onset of squeal"
VALUES = "{ start = 0.0, stop = 0.8, steps = 9 }"
SWEEP = [f'sweep.parameters."{KEY}"={VALUES}', "sweep.samples=4"]


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    out = tmp_path_factory.mktemp("swept") / "out"
    run(BLOCK, COMM, out, [*SWEPT, *SWEEP])
    return out


@pytest.fixture(scope="module")
def model():
    return prepare(BLOCK, SWEPT)


def test_every_value_has_the_modes_of_a_run_with_that_value(swept):
    """The scene with another friction, at full order and without any sweep."""
    own = [r for r in rows(swept / "sweep.csv") if not r["sample"]]
    for mu in (0.2, 0.7):
        full = prepare(BLOCK, [*SWEPT, f"{KEY}={mu}", "stability.method=full"])
        for approach in ("multi-scale", "classical"):
            alone = full.modes(approach=approach).s
            here = [
                complex(float(r["real_1_s"]), 2 * np.pi * float(r["frequency_hz"]))
                for r in own
                if r["approach"] == approach and float(r["value"]) == pytest.approx(mu)
            ]
            assert len(here) == len(alone) > 3
            distance = np.abs(np.subtract.outer(alone, here)).min(axis=1)
            assert np.all(distance <= 1e-5 * np.abs(alone))


def test_lock_in_is_where_the_number_of_unstable_modes_changes(swept, model):
    """Full-order eigenvalues alone, just before and just after each merging."""
    events = [r for r in rows(swept / "lock_in.csv") if r["kind"] == "merging" and not r["sample"]]
    assert events
    for r in events:
        x, width = float(r["value"]), 2 * float(r["accuracy"])
        f = 2 * np.pi * float(r["frequency_hz"])
        pair = []
        for side in (-1, 1):
            s = model.modes({KEY: x + side * width}, r["approach"]).s
            near = s[np.argsort(np.abs(s - 1j * f))[:2]]
            pair.append(np.abs(near.real).max() / f)
        assert pair[0] <= 1e-12 < pair[1]


def test_critical_values_are_those_of_the_samples_alone(swept, model):
    """No value before the first onset has an unstable mode, the one just after it has."""
    critical = rows(swept / "critical.csv")
    assert critical[0]["family"] == "" and int(critical[0]["samples"]) == 4
    onsets = [r for r in rows(swept / "lock_in.csv") if r["kind"] == ONSET]
    first = {k: min(float(r["value"]) for r in onsets if r["sample"] == str(k)) for k in range(4)}
    for k, x in first.items():
        for before in (*np.arange(0, x - 0.004, 0.03), x - 0.004):
            assert model.modes({KEY: before}, "multi-scale", k).damping.min() >= -1e-3
        assert model.modes({KEY: x + 0.004}, "multi-scale", k).damping.min() < -1e-3
    middle = sorted(first.values())[1]
    assert float(critical[0]["value_50"]) == pytest.approx(middle)
    curve = [r for r in rows(swept / "critical_curve.csv") if r["family"] == ""]
    assert {float(r["value"]) for r in curve} > set(first.values())
    for r in curve:
        by = sum(x <= float(r["value"]) for x in first.values())
        assert float(r["share"]) == by / 4


def test_families_of_the_sweep_are_those_of_the_samples(swept):
    """What squeals at the friction of the scene, 0.5, has one number in both, and one row."""
    modes = rows(swept / "modes.csv")
    loud = [r for r in modes if r["verdict"] == "unstable" and float(r["damping"]) < -1e-3]
    squealing = {r["family"] for r in loud if r["approach"] == "multi-scale"}
    by = {r["family"]: r for r in rows(swept / "critical.csv") if r["family"]}
    begun = {n for n, r in by.items() if float(r["value_50"] or "inf") < 0.5}
    assert begun == squealing and len(begun) > 0
    assert all(by[n]["squeal_samples"] == "4" for n in begun)


def test_a_critical_value_of_one_sample_has_no_interval():
    (whole, own) = critical_values([[(0, 0.3, 2e3)]], rising=True)
    for c in (whole, own):
        value, *ends = c.quantile(0.5)
        assert value == 0.3 and np.isnan(ends).all()
        assert c.by(0.4).cells == [1.0, None, None]


def test_sweep_from_arrays_in_a_few_lines(model):
    found = sweep(model, KEY, np.linspace(0, 0.8, 9), approach="multi-scale")
    assert found.frequency.shape == found.damping.shape
    assert found.frequency.shape[1] == 9
    assert len(repr(found)) < 120 and len(repr(model)) < 120
    assert len(repr(model.modes())) < 120
    with pytest.raises(SceneError, match="'wrong'"):
        model.modes(approach="wrong")
    with pytest.raises(SceneError, match=r"stability\.band"):
        model.modes({"stability.band": 3.0})


def test_tables_of_a_sweep_go_and_come_with_it_and_samples_stay(swept, tmp_path, without_pixels):
    """A run with another threshold and no sweep leaves no onsets of the earlier threshold; with the
    sweep once more lines are new and the samples are not; its figures are drawn."""
    out = tmp_path / "out"
    shutil.copytree(swept, out)
    before = {p.name: p.stat().st_mtime_ns for p in (out / "samples").glob("multi-scale-*")}
    run(BLOCK, COMM, out, [*SWEPT, "stability.threshold=5e-2"])
    assert not any((out / f"{name}.csv").exists() for name in SWEEP_TABLES)
    assert (out / "modes.csv").exists()
    run(BLOCK, COMM, out, [*SWEPT, *SWEEP])
    after = {p.name: p.stat().st_mtime_ns for p in (out / "samples").glob("multi-scale-*")}
    assert before == after and len(before) == 4
    for name in ("sweep.csv", "lock_in.csv", "critical.csv", "critical_curve.csv"):
        assert (out / name).read_bytes() == (swept / name).read_bytes()
    make_figures(out)
    assert "sweep_branches" in without_pixels
    assert "Lock-in over the parameter" in write_report(out, redraw=False).read_text()


@pytest.mark.together
def test_two_processes_give_the_tables_of_one(processes, tmp_path):
    comm, folder = processes
    run(BLOCK, COMM, tmp_path / "one", [*SWEPT, *SWEEP])
    run(BLOCK, comm, folder / "two", [*SWEPT, *SWEEP])
    comm.Barrier()
    for name in ("critical.csv", "lock_in.csv"):
        one, two = (
            [r for r in rows(out / name) if r.get("kind", ONSET) == ONSET]
            for out in (tmp_path / "one", folder / "two")
        )
        assert len(one) == len(two)
        for a, b in zip(one, two, strict=True):
            for column, x in a.items():
                if column in ("value", "frequency_hz", "value_50") and x:
                    assert abs(float(x) - float(b[column])) <= 1e-4


def test_chart_over_two_parameters(tmp_path):
    """Every point of the chart is a run with these two values."""
    out = tmp_path / "out"
    load = "sweep.parameters.\"loads.block.top.pressure\"={ values=['2 bar', '5 bar'] }"
    friction = f'sweep.parameters."{KEY}"={{ values=[0.4, 0.6] }}'
    changes = [c for c in SWEPT if not c.startswith("stages")]
    stages = "stages=['surface','equilibrium','stability']"
    run(BLOCK, COMM, out, [*changes, stages, "samples.n=1", friction, load])
    chart = rows(out / "chart.csv")
    assert len(chart) == 2 * 4
    found = prepare(BLOCK, [*changes, stages, "samples.n=1"])
    for r in chart:
        values = {KEY: float(r["value"]), "loads.block.top.pressure": float(r["value_2"])}
        modes = found.modes(values, r["approach"])
        assert modes.verdict.count("unstable") == int(r["unstable_modes"])
        assert float(r["worst_damping"]) == pytest.approx(modes.damping.min(), rel=1e-6, abs=1e-12)
    figure = draw_chart(read_run(out))
    assert figure is not None and len(figure.axes) == 8  # four maps with their colour bars
    facts = json.loads((out / "summary.json").read_text())["sweep"]
    assert facts["failed_lines"] == 0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([f'sweep.parameters."{KEY}"={{ start = 0.1 }}'], "start, stop and steps, or values"),
        ([f'sweep.parameters."{KEY}"={{ values = [0.1, 0.3, 0.2] }}'], "rising or falling"),
        ([f'sweep.parameters."{KEY}"={{ start = -0.1, stop = 1.0 }}'], "must be zero or more"),
        (['sweep.parameters."contact.none.friction"={ start = 0.0, stop = 1.0 }'], "no [contact"),
        (
            ['sweep.parameters."parts.block.size"={ start = "1 mm", stop = "2 mm" }'],
            "only these lengths may vary",
        ),
        (["sweep.samples=3"], "0 keys"),
        (
            [
                *SWEEP,
                'sweep.parameters."loads.\\"block.top\\".pressure"={values=["1 bar","2 bar"]}',
            ],
            'leave sweep.parameters."loads.\\"block.top\\".pressure" or sweep.samples out',
        ),
        ([SWEEP[0], "sweep.samples=3", "stages=['equilibrium','stability']"], "uncertainty"),
        ([SWEEP[0], "stages=['equilibrium']"], "stage stability"),
    ],
)
def test_mistakes_are_one_line(changes, said, tmp_path):
    smooth = ["contact.block_plate.gap=none"] if "surface" not in changes[-1] else []
    with pytest.raises(SceneError) as error:
        run(BLOCK, COMM, tmp_path / "out", [*smooth, *changes])
    assert said in str(error.value)
    assert not (tmp_path / "out").exists()


def test_wrong_line_is_kept_with_its_error(tmp_path, monkeypatch):
    """A sample without an equilibrium at the first value is a failed line, and stops nothing."""
    from brake_fenicsx.errors import NotConverged
    from brake_fenicsx.samples.study import Study

    whole = Study.solved

    def failing(self, task, values, start=None, line=None):
        if task == ("multi-scale", 1) and values[KEY] == 0.0:
            raise NotConverged("equilibrium: none")
        return whole(self, task, values, start, line)

    monkeypatch.setattr(Study, "solved", failing)
    few = [f'sweep.parameters."{KEY}"={{ values=[0.0, 0.8] }}', "sweep.samples=2", "samples.n=2"]
    alone = ["samples.approaches=['multi-scale']", "stability.verify=0"]
    done = run(BLOCK, COMM, tmp_path / "out", [*SWEPT, *few, *alone])
    assert done.facts["sweep"]["failed_lines"] == 1
    assert int(rows(tmp_path / "out" / "critical.csv")[0]["samples"]) == 1


def test_values_without_an_equilibrium_end_the_branches(tmp_path):
    """The block tips beyond a friction of about 0.9: what comes before is kept."""
    one = [c for c in SWEPT if not c.startswith("samples.n")]
    wide = f'sweep.parameters."{KEY}"={{ start = 0.0, stop = 1.2, steps = 7 }}'
    done = run(BLOCK, COMM, tmp_path / "out", [*one, "samples.n=1", wide])
    facts = done.facts["sweep"]
    assert (
        facts["failed_lines"] == 0 and facts["lines_without_equilibrium"] == 2
    )  # rough and perfect contact
    values = sorted({float(r["value"]) for r in rows(tmp_path / "out" / "sweep.csv")})
    assert values == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])


@pytest.mark.slow
def test_branches_of_the_demo_brake_are_the_modes_of_full_order():
    """Ten values of friction, rough contact: every mode of full order lies on a branch."""
    from brake_fenicsx.samples.solve import full_modes
    from brake_fenicsx.sweeps.branches import CUT

    key, values = "contact.pad_disc.friction", np.linspace(0.05, 0.75, 10)
    demo = prepare(BLOCK.with_name("disc_brake_demo.toml"), ["micro.laws=10", "samples.n=2"])
    found = demo.sweep(key, values)
    assert not any(end == CUT for end in found.ends)
    for i, x in enumerate(values):
        eq, _ = demo.equilibrium_and_modes({key: x})
        sample = demo.study.sample(("multi-scale", 0), {key: x})
        full = full_modes(demo.study.models, sample, eq)
        f, damping = found.frequency[:, i], found.damping[:, i]
        here = 2 * np.pi * f * (1j - 0.5 * damping)
        here = here[np.isfinite(here)]
        assert here.size == len(full)
        distance = np.abs(np.subtract.outer(full.s, here)).min(axis=1)
        # Next to a merging the error of an eigenvalue is the root of that of its square.
        assert np.all(distance <= 1e-5 * np.abs(full.s) * np.maximum(1, full.condition))


def test_a_merging_next_to_a_third_mode_is_that_of_the_two_that_merge():
    """Three modes within 1 %: on either side of each event the number of growing modes differs.

    A growing mode and the third one have Re (lambda_1 - lambda_2)^2 = 0 where nothing merges.
    """
    block = prepare(BLOCK.with_name("squealing_block.toml"), ["samples.n=1"])
    for values in (np.linspace(0.0, 0.8, 21), np.linspace(0.3, 0.6, 11)):
        found = block.sweep(KEY, values).events
        assert found
        for event in found:
            sides = [
                block.modes({KEY: event.x + side * event.error}).verdict for side in (-5.0, 5.0)
            ]
            before, after = (sum(v == "unstable" for v in verdicts) for verdicts in sides)
            near = [e.kind for e in found if abs(e.x - event.x) < 5 * event.error]
            assert after - before == near.count("merging") - near.count("splitting"), event.kind
