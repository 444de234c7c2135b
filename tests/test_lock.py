"""Several runs in one folder: claims, stale claims, another scene, samples that are shared."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import pipeline
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.lock import SILENCE, Lock
from brake_fenicsx.folder.store import RUNNING, Store
from brake_fenicsx.uncertainty.ensemble import run_ensemble

pytestmark = pytest.mark.alone

BLOCK = Path(__file__).parents[1] / "scripts" / "scenes" / "block_on_plate.toml"
TASKS = [("multi-scale", k) for k in range(6)]
ELSEWHERE = "another-machine-7-7"
DIES = """
import os, sys
from pathlib import Path
from brake_fenicsx.folder.lock import Lock
lock = Lock(Path(sys.argv[1]))
assert lock.claim("folder") is None
print(lock.name, flush=True)
os._exit(9)
"""


def surface_of(S_q):
    return ["stages=['surface']", f"surface.statistics={{ S_q = '{S_q} um' }}"]


@pytest.fixture
def lock(tmp_path):
    entered = Lock(tmp_path / RUNNING)
    yield entered
    entered.leave()


@pytest.fixture
def elsewhere(lock):
    """A run on another machine that has the third sample."""
    other = Lock(lock.folder, ELSEWHERE)
    run = lock.folder / f"{ELSEWHERE}.run"
    run.write_text("2026-01-01 00:00:00")
    assert other.claim("multi-scale-00003") is None
    return run


def test_a_piece_of_work_belongs_to_one_run(lock, elsewhere):
    assert lock.claim("multi-scale-00003") == ELSEWHERE
    assert "another-machine, started 2026-01-01" in lock.described(ELSEWHERE)
    assert lock.others() == [ELSEWHERE]
    assert lock.claim("multi-scale-00004") is None


def test_a_lock_of_a_silent_machine_is_named_and_taken_over(lock, elsewhere, caplog):
    old = time.time() - SILENCE - 60
    os.utime(elsewhere, (old, old))
    with caplog.at_level("INFO", logger="brake_fenicsx"):
        assert lock.claim("multi-scale-00003") is None
    assert "another-machine" in caplog.text and "stale" in caplog.text
    assert lock.others() == []


def test_a_lock_is_free_once_its_run_is_removed_by_hand(lock, elsewhere):
    elsewhere.unlink()
    assert lock.claim("multi-scale-00003") is None


def test_a_lock_of_a_dead_process_is_taken_over(lock, caplog):
    words = [sys.executable, "-c", DIES, str(lock.folder)]
    died = subprocess.run(words, capture_output=True, text=True)
    assert died.returncode == 9 and len(list(lock.folder.iterdir())) == 3
    with caplog.at_level("INFO", logger="brake_fenicsx"):
        assert lock.claim("folder") is None
    assert died.stdout.split("-")[-2] in caplog.text
    lock.leave()
    assert not lock.folder.exists()


def test_a_run_of_another_scene_started_at_the_same_time_is_refused(tmp_path, monkeypatch):
    """Between its look at the folder and its first file another scene's run goes through."""
    out, check = tmp_path / "out", pipeline.check

    def slow(scene, comm):
        monkeypatch.setattr(pipeline, "check", check)
        pipeline.run(BLOCK, comm, out, surface_of(3))
        return check(scene, comm)

    monkeypatch.setattr(pipeline, "check", slow)
    with pytest.raises(SceneError, match="another scene"):
        pipeline.run(BLOCK, MPI.COMM_SELF, out, surface_of(5))
    with np.load(out / "surface.npz") as surface:
        assert json.loads(str(surface["stats"]))["S_q"] == pytest.approx(3e-6)
    assert not (out / RUNNING).exists()


def test_a_stage_is_not_taken_away_from_another_run(tmp_path):
    pipeline.run(BLOCK, MPI.COMM_SELF, tmp_path / "out", surface_of(3))
    running = tmp_path / "out" / RUNNING
    running.mkdir()
    (running / f"{ELSEWHERE}.run").write_text("2026-01-01 00:00:00")
    with pytest.raises(SceneError, match=r"--from surface.*process 7 on another-machine"):
        pipeline.run(BLOCK, MPI.COMM_SELF, tmp_path / "out", surface_of(3), "surface")


def test_two_runs_share_the_samples_of_a_scene(lock, elsewhere, monkeypatch):
    """The sample that another run has is waited for, not computed."""
    store = Store(lock.folder.parent)
    store.lock = lock
    store.path("samples").mkdir()
    done = []

    def work(task):
        done.append(task)
        return {"x": np.array(task[1])}

    def others_work(_):
        store.samples.save(TASKS[3], status="ok", x=np.array(-1))

    monkeypatch.setattr("brake_fenicsx.uncertainty.ensemble.time.sleep", others_work)
    run_ensemble(TASKS, work, store, MPI.COMM_SELF)
    assert done == TASKS[:3] + TASKS[4:]
    stored = [int(store.samples.load(t)["x"]) for t in TASKS]
    assert stored == [0, 1, 2, -1, 4, 5]
    assert {p.suffix for p in lock.folder.iterdir()} == {".run", ".claim"}
    assert len(list(lock.folder.glob("*.claim"))) == 1
