"""Samples of a prepared scene one after the other, computed here or by the workers of an executor.

A worker is given paths, words and numbers. It enters the folder of the scene as a share of a job
array does, keeps what it has loaded, and stores each sample as a run does: a run in the same folder
makes tables and page of them.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from functools import lru_cache
from pathlib import Path
from socket import gethostname
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from mpi4py import MPI

import numpy as np

from brake_fenicsx.errors import BrakeError, SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.sample_files import BLOCK, Task

if TYPE_CHECKING:
    from brake_fenicsx.samples.study import Study

Record = dict[str, Any]

PAUSE = 0.01  # s, between two looks at what has ended
NAMED = 8  # samples that an error names
# The process that imported this module; MPI does not work in one that is forked from it.
_PROCESS = os.getpid()
# PETSc computes in one thread of a process.
_ALONE = threading.Lock()


class Source(NamedTuple):
    """What a model is prepared from.

    Attributes:
        scene: path of the scene.
        overrides: "key=value" replacements in it.
        parameters: keys and ranges of scalars that take other values than in the scene, SI.
        directory: results folder.
        table: the scene as text, if it is no file.
    """

    scene: str
    overrides: tuple[str, ...]
    parameters: tuple[tuple[str, tuple[float, ...]], ...]
    directory: str
    table: str = ""


class Prepared(Protocol):
    """What has the samples of a prepared scene, and keeps their folder while it is there."""

    study: Study


def samples_here(model: Prepared, tasks: Sequence[Task]) -> Iterator[Record]:
    """Samples by this process; those that are stored are read.

    Args:
        model: the scene.
        tasks: approach and number of the samples wanted.
    """
    study = model.study
    _prepare(study, tasks)
    there = study.store.samples.present()
    for task in tasks:
        yield _read(study, task) if task in there else _computed(study, task)


def samples_elsewhere(
    model: Prepared, tasks: Sequence[Task], source: Source, executor: Executor, chunksize: int
) -> Iterator[Record]:
    """Samples by the workers of an executor as they end; those that are stored come first.

    Args:
        model: the scene.
        tasks: approach and number of the samples wanted.
        source: what the workers load it from.
        executor: what has the workers; its jobs have the methods done, exception, result, cancel.
        chunksize: samples of a job.

    Raises:
        SceneError: a worker cannot enter the folder.
        BrakeError: samples are missing since workers ended; raised after all others.
    """
    from brake_fenicsx.samples.numbering import with_shared_matrices

    study = model.study
    _prepare(study, tasks)
    left = dict.fromkeys(tasks)
    yield from _stored(study, left)
    with_shared_matrices(study.brake, study.store, MPI.COMM_SELF)
    # Inherited by processes that an executor of this machine starts from here on.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    jobs, given = set[Any](), [*left]
    why: BaseException | None = None
    try:
        for i in range(0, len(given), chunksize):
            chunk = given[i : i + chunksize]
            try:
                jobs.add(executor.submit(_compute, source, study.store.digest, chunk))
            except RuntimeError as refusal:  # no worker is left
                why = refusal
        while jobs:
            ended = {job for job in jobs if job.done()}
            jobs -= ended
            for job in ended:
                error = job.exception()
                if isinstance(error, SceneError):
                    raise error
                why = error or why
                for record in () if error else job.result():
                    del left[record["approach"], record["sample"]]
                    yield record
            if not ended:
                time.sleep(PAUSE)
    finally:
        for job in jobs:
            job.cancel()
    # A worker that ended had stored all samples but its last one.
    yield from _stored(study, left)
    if left:
        names = [f"{approach} {number}" for approach, number in left]
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        raise BrakeError(f"""samples without result: {", ".join(names[:NAMED])}{more}
            ({type(why).__name__}: {why}); the same call with a new executor computes these
            alone""") from why


def _compute(source: Source, digest: str, tasks: Sequence[Task]) -> list[Record]:
    """Compute and store samples in a worker."""
    study = loaded(source, digest)
    with _ALONE:
        return [_computed(study, task) for task in tasks]


def loaded(source: Source, digest: str) -> Study:
    """What the samples of a prepared model share, in another process.

    Args:
        source: of the model.
        digest: of its scene.

    Raises:
        SceneError: this process cannot load the folder.
    """
    if os.getpid() != _PROCESS:
        raise SceneError("""executor: its processes are forked, which MPI does not survive; give
            ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn"))""")
    with _ALONE:
        return _entered(source, digest)


@lru_cache(maxsize=1)
def _entered(source: Source, digest: str) -> Study:
    """What the samples share, loaded from the prepared folder and kept by the process."""
    from brake_fenicsx.model import entered

    if not Path(source.directory, "scene.sha256").is_file():
        raise SceneError(f"""directory = {source.directory!r}: nothing is prepared there on
            {gethostname()}; name a folder that all workers see""")
    if not {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} & {*os.environ}:
        logger.warning("a worker may use several BLAS threads: start it with OMP_NUM_THREADS=1")
    study = entered(source)
    # After ``entered``, which starts PETSc for this process alone: an import of PETSc before would
    # wait for all processes of mpi4py.futures.
    from brake_fenicsx.results.output import prepare_blocks

    prepare_blocks(study)
    return study


def _prepare(study: Study, tasks: Sequence[Task]) -> None:
    """Compute the first samples where blocks of samples are asked for."""
    from brake_fenicsx.results.output import prepare_blocks

    if len(tasks) > BLOCK:
        prepare_blocks(study)


def _computed(study: Study, task: Task) -> Record:
    from brake_fenicsx.samples.ensemble import compute_sample

    compute_sample(task, study.work, study.store)
    return _read(study, task)


def _stored(study: Study, left: dict[Task, None]) -> Iterator[Record]:
    """Records of the samples that are stored; they are taken out of what is left."""
    there = study.store.samples.present()
    for task in [task for task in left if task in there]:
        del left[task]
        yield _read(study, task)


def _read(study: Study, task: Task) -> Record:
    """What was stored of a sample, but for values of every contact element or coordinate."""
    from brake_fenicsx.results.sample_blocks import LARGE

    stored = {k: v for k, v in study.stored(task).items() if k not in LARGE}
    small = {k: v.item() if v.ndim == 0 else v for k, v in stored.items()}
    if "s" in small:
        small["frequency"] = np.abs(small["s"].imag) / (2 * np.pi)
    return {"approach": task[0], "sample": task[1], **small}
