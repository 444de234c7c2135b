"""Finished samples on disk: single files, archives of full blocks, other scenes, damage."""

import json
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder import sample_files
from brake_fenicsx.folder.processes import release_memory
from brake_fenicsx.folder.store import Store
from brake_fenicsx.results.families import ModeFamilies
from brake_fenicsx.results.sample_blocks import Tabulation
from brake_fenicsx.results.stored import StoredSamples
from brake_fenicsx.samples.ensemble import run_ensemble

TASKS = [("parametric", k) for k in range(10)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder whose archives hold four samples."""
    monkeypatch.setattr(sample_files, "BLOCK", 4)
    (tmp_path / "samples").mkdir()
    return tmp_path


def of(folder, digest="this"):
    """The folder as a run sees it."""
    store = Store(folder)
    store.digest = digest
    return store


def arrays(task):
    return {"status": "ok", "x": np.arange(3.0) + task[1], "names": np.array(["a", "b"])}


def filled(folder, tasks=TASKS):
    store = of(folder)
    for task in tasks:
        store.samples.save(task, **arrays(task))
    return store


def never(task):
    raise AssertionError(task)


def test_full_blocks_become_archives(folder):
    """In any order of the samples: two archives, what is left of the third block, same arrays."""
    filled(folder, TASKS[::-1])
    assert sorted(os.listdir(folder / "samples")) == [
        "parametric-00000-00003.zip", "parametric-00004-00007.zip", "parametric-00008.npz",
        "parametric-00009.npz",
    ]  # fmt: skip
    store = of(folder)
    assert store.samples.present() == set(TASKS)
    for task in TASKS:
        assert task in store.samples.present()
        data = store.samples.load(task)
        assert set(data) == {"status", "x", "names"} and str(data["status"]) == "ok"
        np.testing.assert_array_equal(data["x"], arrays(task)["x"])
    assert store.samples.present() == {*TASKS}
    assert store.samples.load(("parametric", 10)) is store.samples.load(("joint", 0)) is None
    run_ensemble(TASKS, never, store, MPI.COMM_SELF)


def test_archives_do_not_depend_on_the_order_of_work(folder, tmp_path_factory):
    filled(folder)
    other = tmp_path_factory.mktemp("other")
    (other / "samples").mkdir()
    filled(other, TASKS[::-1])
    for name in os.listdir(folder / "samples"):
        assert (folder / "samples" / name).read_bytes() == (other / "samples" / name).read_bytes()


def test_samples_that_are_packed_meanwhile_are_found(folder):
    """A run that saw single files finds them after another one has packed them."""
    filled(folder, TASKS[:3])
    store = of(folder)
    assert store.samples.present() == set(TASKS[:3])
    of(folder).samples.save(TASKS[3], **arrays(TASKS[3]))
    assert os.listdir(folder / "samples") == ["parametric-00000-00003.zip"]
    assert {*TASKS[:4]} <= store.samples.present()
    assert store.samples.present() == set(TASKS[:4])
    np.testing.assert_array_equal(store.samples.load(TASKS[2])["x"], [2.0, 3.0, 4.0])
    # Of two processes that pack a block the second one finds nothing to do.
    store.samples._pack(TASKS[:4])
    assert os.listdir(folder / "samples") == ["parametric-00000-00003.zip"]


def test_a_stage_run_again_forgets_archives(folder):
    store = filled(folder)
    store.samples.present()
    store.open("", "uncertainty")
    assert store.samples.present() == set()


@pytest.mark.parametrize(
    ("name", "k", "value"),
    [("parametric-00000-00003.zip", 1, 3.0), ("parametric-00009.npz", 9, 9.0)],
)
def test_samples_of_another_scene_and_damaged_ones_are_named(folder, name, k, value):
    filled(folder)
    run_ensemble(TASKS, never, of(folder), MPI.COMM_SELF)
    with pytest.raises(SceneError, match=r"0000-0.*zip: does not belong to the scene"):
        run_ensemble(TASKS, never, of(folder, "another"), MPI.COMM_SELF)
    path = folder / "samples" / name
    whole = path.read_bytes()
    path.write_bytes(whole[:100])
    with pytest.raises(SceneError, match=rf"{name}: .*damaged"):
        run_ensemble(TASKS, never, of(folder), MPI.COMM_SELF)
    # A bit that is lost within a sample is noticed where the sample is read.
    cut = bytearray(whole)
    cut[whole.index(np.float64(value).tobytes())] ^= 1
    path.write_bytes(cut)
    with pytest.raises(SceneError, match=rf"{name}: .*damaged"):
        of(folder).samples.load(TASKS[k])


def test_tables_need_some_hundred_bytes_for_a_mode(tmp_path, monkeypatch):
    """Arrays of contact elements and coordinates are not kept: 50 modes, 1000 elements."""
    rng, modes, elements = np.random.default_rng(0), 50, 1000
    names = np.array([f"materials.lining.E_{i}" for i in range(9)])
    basis = np.linalg.qr(rng.normal(size=(60, modes)))[0]

    def data(task):
        number = {name: rng.normal(size=modes) for name in ("damping", "residual", "error")}
        large = {name: rng.normal(size=elements) for name in ("g", "g_cr", "p", "k", "mu")}
        verdict = np.where(rng.random(modes) < 0.1, "unstable", "stable")
        return {
            **number, **large, "s": 1j * np.arange(1.0, modes + 1), "status": np.array("ok"),
            "condition": np.ones(modes), "verdict": verdict, "coordinates": basis + 0j,
            "layers": np.array(["lining", "plate", "disc"]), "shares": rng.random((3, modes)),
            "partner": np.full(modes, -1), "random_names": names, "random": rng.random(9),
        }  # fmt: skip

    monkeypatch.setattr(sample_files, "BLOCK", 20)
    store = of(tmp_path)
    store.path("samples").mkdir()
    tasks = [("joint", k) for k in range(220)]
    founders = ModeFamilies()
    founders.add(basis + 0j, np.arange(1.0, modes + 1) / (2 * np.pi), np.zeros(modes, bool))
    tabulate = Tabulation(founders=founders)
    store.samples.tabulate = tabulate
    for task in tasks:
        store.samples.save(task, **data(task))
    tracemalloc.start()
    few = StoredSamples(store, tasks[:40], tabulate)
    before = tracemalloc.get_traced_memory()[0]
    many = StoredSamples(store, tasks, tabulate)
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert len(few.members.vectors) == len(many.members.vectors) == modes
    # Those of the first sample and the families are in both; packed blocks stay in their files.
    assert (after - before - before) / (180 * modes) < 50
    assert many.modes["mode"].size == 220 * modes


def test_json_of_a_folder_is_strict(tmp_path):
    """JSON knows neither infinity nor nan; readers other than Python's refuse them."""

    def refuse(constant):
        raise ValueError(constant)

    store = Store(tmp_path)
    store.save_json("a.json", {"a": float("inf"), "b": [np.float64("nan"), 0.1], "c": np.int64(2)})
    found = json.loads((tmp_path / "a.json").read_text(), parse_constant=refuse)
    assert found == {"a": None, "b": [None, 0.1], "c": 2}


def resident_megabytes():
    """Memory of this process, mapped files included."""
    lines = Path("/proc/self/status").read_text().splitlines()
    words = dict(line.split(":") for line in lines)
    return int(words["VmRSS"].split()[0]) / 1024


def test_memory_of_large_arrays_goes_back_at_once():
    """In a fresh process: a heap with room for them would hold them until it is trimmed."""
    script = (
        "import numpy as np\nfrom petsc4py import PETSc\n"
        "from brake_fenicsx.folder.processes import release_memory\n"
        "def pages(): return int(open('/proc/self/statm').read().split()[1])\n"
        "release_memory()\nbefore = pages()\nvalues = np.ones(2**23)\n"
        "assert pages() > before + 2**13\ndel values\nassert pages() < before + 2**12\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_memory_goes_back(tmp_path):
    """That of freed arrays and of mapped files when asked; their numbers stay."""
    release_memory()
    before = resident_megabytes()
    values = np.random.default_rng(1).random((8, 2**20))
    store = Store(tmp_path)
    store.save("a.npz", values=values, few=values[0, :3])
    mapped = store.load("a.npz", mapped=True)
    np.testing.assert_array_equal(mapped["values"], values)
    np.testing.assert_array_equal(mapped["few"], values[0, :3])
    assert resident_megabytes() > before + 100
    del values
    release_memory()
    assert resident_megabytes() < before + 20
    assert mapped["values"].sum() == np.random.default_rng(1).random((8, 2**20)).sum()
    with pytest.raises(ValueError, match="read-only"):
        mapped["values"][0, 0] = 1.0
