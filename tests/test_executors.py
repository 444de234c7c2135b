"""Samples by the workers of executors: the same numbers as a run, and what a dying worker costs."""

import logging
import os
import pickle
import re
import shutil
import subprocess
import sys
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import executor as workers
from brake_fenicsx import prepare, run, sample
from brake_fenicsx.errors import BrakeError, NotConverged, SceneError
from brake_fenicsx.extensions import Extensions
from brake_fenicsx.folder.store import Store
from brake_fenicsx.results.sample_blocks import LARGE
from coarse_block import BLOCK, ROUGH
from places import ROOT
from processes import parallel

COUNT = 6
CHANGES = [*ROUGH, f"samples.n={COUNT}"]
SPAWN = get_context("spawn")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder of a run."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run(BLOCK, MPI.COMM_SELF, out, CHANGES)
    return out


def stored(folder, number):
    store = Store(folder)
    store.digest = (folder / "scene.sha256").read_text()
    return store.samples.load(("multi-scale", number))


def same(records, whole, folder=None):
    """Records, and files where there are any, have the numbers of the run to the last bit."""
    for record in records:
        there = stored(whole, record["sample"])
        assert record["approach"] == "multi-scale" and record["status"] == "ok"
        np.testing.assert_array_equal(record["frequency"], np.abs(there["s"].imag) / 2 / np.pi)
        assert {*there} - {*LARGE} == {*record} - {"approach", "sample", "frequency"}
        kept = stored(folder, record["sample"]) if folder else {}
        assert not folder or kept.keys() == there.keys()
        for name, values in there.items():
            if name.endswith("_seconds"):
                continue
            for found in (mine[name] for mine in (record, kept) if name in mine):
                assert np.asarray(found, values.dtype).tobytes() == values.tobytes(), name


class Dying:
    """An executor whose third job ends its worker as a crash or a lack of memory would."""

    def __init__(self, inner):
        self.inner, self.jobs = inner, 0

    def submit(self, work, *arguments):
        self.jobs += 1
        if self.jobs == 3:
            return self.inner.submit(os._exit, 1)
        return self.inner.submit(work, *arguments)


class Inline(Executor):
    """Jobs are done as they are submitted, or left waiting beyond the first ones."""

    def __init__(self, done=COUNT, directory=None):
        self.done, self.directory, self.jobs = done, directory, []

    def submit(self, work, source, *arguments):
        if self.directory is not None:
            source = source._replace(directory=self.directory)
        self.jobs.append(job := Future())
        if len(self.jobs) <= self.done:
            try:
                job.set_result(work(source, *arguments))
            except Exception as error:
                job.set_exception(error)
        return job


def test_here_they_are_those_of_a_run(whole):
    """One after the other; the folder lives as long as they are asked for."""
    records = list(prepare(BLOCK, CHANGES).samples(3))
    assert [record["sample"] for record in records] == [0, 1, 2]
    same(records, whole)


@pytest.mark.long
def test_processes_one_of_which_dies(whole, tmp_path):
    """Samples that ended are yielded, the others named; a new pool computes these alone.

    A run in the folder then finds all of them.
    """
    out = tmp_path / "out"
    model = prepare(BLOCK, CHANGES, directory=out)
    first = []
    lost = pytest.raises(BrakeError, match=r"multi-scale 2, .* 5 .BrokenProcessPool.*same call")
    with ProcessPoolExecutor(1, mp_context=SPAWN) as pool, lost:
        first.extend(model.samples(executor=Dying(pool)))
    assert {record["sample"] for record in first} == {0, 1}
    before = [(out / "samples" / f"multi-scale-0000{k}.npz").stat().st_mtime_ns for k in (0, 1)]
    with ProcessPoolExecutor(1, mp_context=SPAWN) as pool:
        records = list(model.samples(executor=pool, chunksize=3))
    assert sorted(record["sample"] for record in records) == [*range(COUNT)]
    same([*first, *records], whole, out)
    run(BLOCK, MPI.COMM_SELF, out, CHANGES)
    after = [(out / "samples" / f"multi-scale-0000{k}.npz").stat().st_mtime_ns for k in (0, 1)]
    assert after == before
    for table in ("modes", "samples", "contact", "probabilities"):
        assert (out / f"{table}.csv").read_bytes() == (whole / f"{table}.csv").read_bytes(), table


def test_threads_take_turns(whole, tmp_path):
    """PETSc computes in one thread; gmsh starts in another than the main one."""
    with ThreadPoolExecutor(3) as pool:
        records = list(prepare(BLOCK, CHANGES, directory=tmp_path / "out").samples(executor=pool))
    assert len(records) == COUNT
    same(records, whole)


@pytest.fixture(scope="module")
def model():
    return prepare(BLOCK, CHANGES)


@pytest.mark.long
def test_a_model_is_sent_as_its_folder(model):
    """The same modes there; no extensions, and none of what is in the model."""
    here, value = model.modes(), {"contact.block_plate.friction": 0.4}
    again = pickle.loads(pickle.dumps(model))
    assert again.scene == model.scene and np.array_equal(again.modes().s, here.s)
    with ProcessPoolExecutor(1, mp_context=SPAWN) as pool:
        assert np.array_equal(pool.submit(sample, model, value).result().s, model.modes(value).s)
    own = prepare(BLOCK, CHANGES, extensions=Extensions())
    study = model.study
    for held in (own, study, study.models, study.brake, study.brake.mesh, study.equilibria):
        with pytest.raises(BrakeError, match=r"^pickle: "):
            pickle.dumps(held)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"n": 0}, "sample -1 of"),
        ({"n": COUNT + 1}, f"it has {COUNT} samples"),
        ({"n": 1.5}, "n: an object of the type float; give a number of samples"),
        ({"approach": "joint"}, "approaches are multi-scale"),
        ({"chunksize": 0}, "chunksize = 0; give one positive number"),
        ({"executor": 8}, "executor: an object of the type int; give one of concurrent.futures"),
        ({"executor": Inline(directory="/nowhere")}, "'/nowhere': nothing is prepared there"),
    ],
)
def test_mistakes_are_one_line(model, given, said):
    with pytest.raises(SceneError, match=re.escape(said)):
        list(model.samples(**given))


def test_forked_processes_and_extensions_are_refused(model):
    refused = pytest.raises(SceneError, match=r"executor: its processes are forked.*spawn")
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool, refused:
        list(model.samples(executor=pool))
    own = prepare(BLOCK, CHANGES, extensions=Extensions())
    with pytest.raises(SceneError, match="extensions are objects of this process alone"):
        own.samples(executor=Inline())


def test_a_sample_that_fails_says_why(monkeypatch, tmp_path):
    """It is stored so, and the others are computed."""
    model = prepare(BLOCK, CHANGES, directory=tmp_path / "out")
    work = model.study.work

    def fails(task):
        if task[1] == 1:
            raise NotConverged("no equilibrium")
        return work(task)

    monkeypatch.setattr(model.study, "work", fails)
    records = list(model.samples(3))
    assert records[1] == {"approach": "multi-scale", "sample": 1, "status": "no equilibrium"}
    assert [record["status"] for record in records] == ["ok", "no equilibrium", "ok"]
    assert next(model.samples(1))["status"] == "ok"


def test_jobs_are_taken_back_where_no_more_are_asked_for():
    executor = Inline(done=1)
    samples = prepare(BLOCK, CHANGES).samples(executor=executor)
    assert next(samples)["sample"] == 0
    samples.close()
    assert [job.cancelled() for job in executor.jobs] == [False] + [True] * (COUNT - 1)


def test_an_executor_that_was_shut_down_is_named():
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(BrakeError, match=r"without result: multi-scale 0, .* after shutdown"):
        list(prepare(BLOCK, CHANGES).samples(executor=pool))


def test_threads_of_the_matrix_library(monkeypatch, caplog):
    """One for the processes of this machine; a worker without the variable says so."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    model = prepare(BLOCK, CHANGES)
    with caplog.at_level(logging.WARNING, "brake_fenicsx"):
        workers._compute(model.source, model.study.store.digest, [("multi-scale", 0)])
    assert "OMP_NUM_THREADS=1" in caplog.text
    list(model.samples(1, executor=Inline()))
    assert os.environ["OMP_NUM_THREADS"] == "1"


@pytest.mark.slow
def test_the_program_of_the_page_on_mpi4py_futures(whole, tmp_path):
    """The same numbers as a run."""
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        pytest.skip("no mpirun")
    page = (ROOT / "docs" / "tutorial_cluster.md").read_text()
    code = re.search(r"```python\n# many.py\n(.*?)```", page, re.S)[1]
    scene = '"scripts/scenes/squealing_block.toml", ["samples.n=300"]'
    assert code.count(scene) == 1
    program = tmp_path / "many.py"
    program.write_text(code.replace(scene, f"{str(BLOCK)!r}, {CHANGES!r}"))
    command = [mpirun, "-n", "3", "--oversubscribe", sys.executable, "-m", "mpi4py.futures"]
    done = subprocess.run(
        [*command, str(program)], capture_output=True, text=True, cwd=tmp_path, timeout=300,
        **parallel(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = sorted((int(k), float(d)) for k, d in re.findall(r"^(\d+) ok (\S+)$", done.stdout, re.M))
    assert told == [(k, float(stored(whole, k)["damping"].min())) for k in range(COUNT)]
    records = list(prepare(BLOCK, CHANGES, directory=tmp_path / "many").samples())
    same(records, whole, tmp_path / "many")


@pytest.mark.slow
def test_dask_one_worker_of_which_dies(whole, tmp_path):
    """Dask starts another, and only the job that kills them is lost."""
    distributed = pytest.importorskip("distributed")
    out = tmp_path / "out"
    model = prepare(BLOCK, CHANGES, directory=out)
    given = dict(n_workers=2, threads_per_worker=1, dashboard_address=None)
    first = []
    with distributed.LocalCluster(**given) as cluster, distributed.Client(cluster) as client:
        with pytest.raises(BrakeError, match=r"without result: multi-scale 2 .KilledWorker"):
            first.extend(model.samples(executor=Dying(client.get_executor())))
        records = list(model.samples(executor=client.get_executor()))
    assert sorted(record["sample"] for record in first) == [0, 1, 3, 4, 5]
    assert sorted(record["sample"] for record in records) == [*range(COUNT)]
    same(records, whole, out)
