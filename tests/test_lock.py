"""Several runs in one folder: claims, stale claims, another scene, runs that are refused."""

import json
import os
import subprocess
import sys
import time

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import pipeline
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder import store
from brake_fenicsx.folder.lock import SILENCE, Lock
from brake_fenicsx.folder.store import RUNNING
from places import BLOCK

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
    """A run on another machine that has the third share."""
    run = lock.folder / f"{ELSEWHERE}.run"
    run.write_text("2026-01-01 00:00:00")
    (lock.folder / "share-3-of-4.claim").write_text(ELSEWHERE)
    return run


def silent_for(run, seconds):
    then = time.time() - seconds
    os.utime(run, (then, then))


def test_a_share_belongs_to_one_run(lock, elsewhere):
    assert lock.claim("share-3-of-4") == ELSEWHERE
    assert "another-machine, started 2026-01-01" in lock.described(ELSEWHERE)
    assert lock.claim("share-4-of-4") is None
    assert lock.owner("share-*") == ELSEWHERE and lock.owner("folder") is None


def test_a_lock_of_a_silent_machine_is_named_and_taken_over(lock, elsewhere, caplog):
    silent_for(elsewhere, SILENCE + 60)
    with caplog.at_level("INFO", logger="brake_fenicsx"):
        assert lock.claim("share-3-of-4") is None
    assert "another-machine" in caplog.text and "stale" in caplog.text
    assert lock.owner("share-*") is None


def test_a_lock_is_free_once_its_run_is_removed_by_hand(lock, elsewhere):
    elsewhere.unlink()
    assert lock.claim("share-3-of-4") is None


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
    out, check = tmp_path / "out", pipeline.checks.check

    def slow(scene, comm):
        monkeypatch.setattr(pipeline.checks, "check", check)
        pipeline.run(BLOCK, comm, out, surface_of(3))
        return check(scene, comm)

    monkeypatch.setattr(pipeline.checks, "check", slow)
    with pytest.raises(SceneError, match="another scene"):
        pipeline.run(BLOCK, MPI.COMM_SELF, out, surface_of(5))
    with np.load(out / "surface.npz") as surface:
        assert json.loads(str(surface["stats"]))["S_q"] == pytest.approx(3e-6)
    assert not (out / RUNNING).exists()


@pytest.mark.parametrize("claim", ["folder", "share-3-of-4"])
def test_a_second_run_is_refused(tmp_path, claim):
    """One line that names the first and the remedy; the folder is left as it was."""
    out = tmp_path / "out"
    pipeline.run(BLOCK, MPI.COMM_SELF, out, surface_of(3))
    running = out / RUNNING
    running.mkdir()
    (running / f"{ELSEWHERE}.run").write_text("2026-01-01 00:00:00")
    (running / f"{claim}.claim").write_text(ELSEWHERE)
    with pytest.raises(SceneError, match=r"process 7 on another-machine.*--share"):
        pipeline.run(BLOCK, MPI.COMM_SELF, out, surface_of(3), "surface")
    assert (out / "surface.npz").exists() and len(list(running.iterdir())) == 2


def test_a_run_that_missed_a_beat_is_waited_for(tmp_path, monkeypatch):
    """A share that was killed on another machine does not refuse the run that makes the tables."""
    out = tmp_path / "out"
    pipeline.run(BLOCK, MPI.COMM_SELF, out, surface_of(3))
    run = out / RUNNING / f"{ELSEWHERE}.run"
    run.parent.mkdir()
    run.write_text("2026-01-01 00:00:00")
    (run.parent / "share-3-of-4.claim").write_text(ELSEWHERE)
    ages = iter([100.0, SILENCE + 1])
    silent_for(run, next(ages))
    monkeypatch.setattr(store.time, "sleep", lambda _: silent_for(run, next(ages)))
    pipeline.run(BLOCK, MPI.COMM_SELF, out, surface_of(3))
    assert next(ages, None) is None and not (out / RUNNING).exists()
