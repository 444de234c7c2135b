"""How far a run is: counts, runs at work and their shares, time to go; nothing is written."""

import json
import os
import time

from mpi4py import MPI

import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.lock import Lock
from brake_fenicsx.folder.store import PREPARED, RUNNING, Store, read_status
from brake_fenicsx.pipeline import run
from coarse_block import BLOCK, ROUGH


@pytest.fixture
def folder(tmp_path):
    """A prepared folder of eight samples of one approach and one of another, five of them done."""
    store = Store(tmp_path / "out")
    store.digest = "a" * 64
    store.open("", None)
    store.save_json(PREPARED, {"joint": 8, "classical": 1})
    for k in (0, 1, 2, 5):
        store.samples.save(("joint", k), status="ok")
    store.samples.save(("classical", 0), status="ok")
    return store


def test_counts_without_anybody_at_work(folder):
    before = sorted(p for p in folder.directory.rglob("*"))
    found = read_status(folder.directory)
    assert found.done == {"classical": 1, "joint": 4} and found.of == {"joint": 8, "classical": 1}
    assert (found.workers, found.seconds_to_go, found.ended) == ([], None, False)
    assert found.text() == "samples: joint 4 of 8, classical 1 of 1\nat work: nobody"
    assert sorted(p for p in folder.directory.rglob("*")) == before


def test_shares_at_work_and_time_to_go(folder):
    """The fifth file is 40 s older than the last one: 10 s for each of the four left."""
    now = time.time()
    for i, path in enumerate(sorted(folder.path("samples").glob("*.npz"))):
        os.utime(path, (now - 10 * i, now - 10 * i))
    lock = Lock(folder.path(RUNNING))
    assert lock.claim("share-2-of-3") is None
    found = read_status(folder.directory)
    (one,) = found.workers
    assert (one.share, one.done, one.of) == ("2 of 3", 1, 3)  # joint 3, 4, 5
    assert found.seconds_to_go == pytest.approx(40.0, rel=0.5)
    said = found.text().splitlines()
    assert f"process {os.getpid()} on" in said[1]
    assert said[1].endswith(": share 2 of 3, 1 of 3 done")
    assert said[2].startswith("time to go: about ")
    lock.leave()
    assert read_status(folder.directory).workers == []


def test_a_run_that_ended(tmp_path, capsys):
    run(BLOCK, MPI.COMM_SELF, tmp_path / "out", ROUGH)
    assert main(["status", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["of"] == {"multi-scale": 3} == {k: found["done"][k] for k in found["of"]}
    assert found["ended"] and "done" in found["log"] and not found["workers"]
    assert main(["status", str(tmp_path / "out")]) == 0
    assert "at work: nobody; the results are there" in capsys.readouterr().out


def test_a_folder_of_something_else(tmp_path):
    with pytest.raises(SceneError, match="no results folder; give the one that a run wrote"):
        read_status(tmp_path)
