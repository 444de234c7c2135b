"""Full-order samples shared by all processes of the run, against samples of one process each."""

import csv
import json
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.description import describe
from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.pipeline import run
from brake_fenicsx.stability.full import friction

COMM = MPI.COMM_WORLD
BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
ROUGH = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='10 mm'", "parts.plate.size='14 mm'", "stability.band=['0 Hz','40 kHz']",
    "samples.n=4",
]  # fmt: skip
TOGETHER = f"samples.processes_per_sample={COMM.size}"
DAMPED = "stability.damping={ rayleigh=['20 1/s','1e-8 s'] }"


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture
def folder(tmp_path):
    """One folder for all processes."""
    return Path(COMM.bcast(str(tmp_path), root=0))


def agree(one, two):
    """The same rows, eigenvalues within their errors, verdicts equal."""
    assert len(one) == len(two) > 20
    for a, b in zip(one, two, strict=True):
        for name in ("approach", "sample", "mode", "verdict", "partner"):
            assert a[name] == b[name]
        s = [complex(float(m["real_1_s"]), 2 * np.pi * float(m["frequency_hz"])) for m in (a, b)]
        assert abs(s[0] - s[1]) <= float(a["error_estimate"]) + float(b["error_estimate"])


@pytest.mark.parametrize(
    "changes",
    [[], pytest.param([DAMPED], marks=pytest.mark.slow), ["contact.block_plate.friction=0.0"]],
)
def test_table_is_that_of_samples_of_one_process_each(folder, changes):
    """With friction (shared), with damping and without friction (by the first process)."""
    alone, together = folder / "alone", folder / "together"
    run(BLOCK, MPI.COMM_SELF, alone if COMM.rank == 0 else folder / f"{COMM.rank}",
        [*ROUGH, *changes])  # fmt: skip
    run(BLOCK, COMM, together, [*ROUGH, *changes, TOGETHER])
    one, two = rows(alone / "modes.csv"), rows(together / "modes.csv")
    agree(one, two)
    assert (alone / "samples.csv").read_bytes() == (together / "samples.csv").read_bytes()
    counted = [
        json.loads((path / "summary.json").read_text())["samples"]["multi-scale"]["counted_by"]
        for path in (alone, together)
    ]
    assert counted[0].split("(")[0] == counted[1].split("(")[0]


@pytest.mark.slow
def test_unstable_modes_of_a_coarse_brake(folder):
    """Flutter: verdicts and partners are the same."""
    coarse = [
        "stages=['surface','micro','equilibrium','stability','uncertainty']",
        "parts.disc.size=30 mm", "parts.pad.size=16 mm", "parts.pad.plate_size=20 mm",
        "micro.pixels=64", "micro.laws=4", "samples.n=1", "stability.method=full",
        "stability.band=['0 Hz', '8 kHz']",
    ]  # fmt: skip
    brake = BLOCK.with_name("disc_brake_demo.toml")
    run(brake, MPI.COMM_SELF, folder / f"{COMM.rank}", coarse)
    run(brake, COMM, folder / "together", [*coarse, TOGETHER])
    found = rows(folder / "together" / "modes.csv")
    agree(rows(folder / f"{COMM.rank}" / "modes.csv"), found)
    assert {"unstable", "stable"} <= {r["verdict"] for r in found}


def test_samples_that_are_there_are_kept_whatever_the_groups(folder):
    """One is missing: alone it is computed, on groups of another size."""
    out = folder / "out"
    run(BLOCK, COMM, out, [*ROUGH, TOGETHER])
    files = sorted((out / "samples").glob("*.npz"))
    before = {p.name: p.stat().st_mtime_ns for p in files}
    first = rows(out / "modes.csv")
    COMM.Barrier()
    if COMM.rank == 0:
        files[2].unlink()
    COMM.Barrier()
    run(BLOCK, COMM, out, ROUGH)
    after = {p.name: p.stat().st_mtime_ns for p in files}
    assert [n for n in before if before[n] != after[n]] == [files[2].name]
    agree(first, rows(out / "modes.csv"))


def failing(monkeypatch, error, calls):
    """Some calls of the eigensolver fail on the last process, which finds one of the two sides."""
    real, count = friction.nearest_modes, iter(range(100))

    def sometimes(*args):
        if next(count) in calls and COMM.rank == COMM.size - 1:
            raise error
        return real(*args)

    monkeypatch.setattr(friction, "nearest_modes", sometimes)


def test_failing_sample_is_kept_with_its_error_and_stops_nothing(folder, monkeypatch):
    """One side of one sample does not converge: the process with the other side must not wait."""
    each = 2 if COMM.size == 1 else 1
    failing(monkeypatch, NotConverged("made to fail"), [each])
    run(BLOCK, COMM, folder / "out", [*ROUGH, TOGETHER])
    status = [s["status"] for s in rows(folder / "out" / "samples.csv")]
    assert status == ["ok", "made to fail", "ok", "ok"]
    assert {m["sample"] for m in rows(folder / "out" / "modes.csv")} == {"0", "2", "3"}


def test_defect_on_one_process_ends_the_run_on_all(folder, monkeypatch):
    each = 2 if COMM.size == 1 else 1
    failing(monkeypatch, ZeroDivisionError("a defect"), [2 * each])
    with pytest.raises(RuntimeError, match="a defect"):
        run(BLOCK, COMM, folder / "out", [*ROUGH, TOGETHER])
    assert len(list((folder / "out" / "samples").glob("*.npz"))) == 2


def test_groups_that_do_not_come_out_even_are_refused(folder):
    """By run, and by check where it knows of several processes."""
    wrong = [f"samples.processes_per_sample={COMM.size + 1}"]
    said = rf"samples\.processes_per_sample = {COMM.size + 1}: does not divide the {COMM.size} "
    with pytest.raises(SceneError, match=said):
        run(BLOCK, COMM, folder / "out", [*ROUGH, *wrong])
    assert not (folder / "out").exists()
    if COMM.size > 1:
        with pytest.raises(SceneError, match=said):
            describe(BLOCK, COMM, [*ROUGH, *wrong])


@pytest.mark.parametrize("value", ["0", "-2", "1.5", "two"])
def test_only_a_positive_whole_number_will_do(value):
    with pytest.raises(SceneError, match=r"samples\.processes_per_sample"):
        describe(BLOCK, MPI.COMM_SELF, [f"samples.processes_per_sample={value}"])


def test_check_says_how_many_processes_are_wanted(capsys):
    describe(BLOCK, MPI.COMM_SELF, ["samples.processes_per_sample=3"])
    assert "processes: a multiple of 3" in capsys.readouterr().out
