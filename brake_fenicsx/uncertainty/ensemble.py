"""Many samples over MPI processes: each takes the next one, and stores it as it finishes."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.log import Progress, logger
from brake_fenicsx.store import Store

Task = tuple[str, int]


def sample_file(task: Task) -> str:
    """File of a sample in the results folder."""
    return f"samples/{task[0]}-{task[1]:05d}.npz"


def run_ensemble(
    tasks: Sequence[Task],
    work: Callable[[Task], dict[str, Any]],
    store: Store,
    comm: MPI.Comm,
) -> None:
    """Run all samples that are not in the folder yet.

    A sample that fails is stored with its error and stops nothing; an error that is not one of
    the program's own is a defect and stops the run, after the others' samples are safe.

    Args:
        tasks: (approach, number) of every sample wanted.
        work: computes one sample; returns arrays to store.
        store: the results folder.
        comm: processes that share the work.
    """
    todo = [task for task in tasks if not store.path(sample_file(task)).exists()]
    todo = comm.bcast(todo, root=0)
    if comm.rank == 0 and len(todo) < len(tasks):
        logger.info("%d of %d samples were there already", len(tasks) - len(todo), len(tasks))
    progress = Progress("samples", len(todo))
    defect = None
    with _Counter(comm) as counter:
        handed = 0
        while (i := counter.next()) < len(todo):
            task = todo[i]
            try:
                result = {"status": "ok", **work(task)}
            except BrakeError as error:
                result = {"status": str(error)}
                logger.warning("%s %d: %s", *task, error)
            except Exception:
                defect = traceback.format_exc()
                break
            store.save(sample_file(task), **result)
            progress.advance(min(i + 1, len(todo)) - handed)
            handed = i + 1
    defects = [d for d in comm.allgather(defect) if d]
    if defects:
        raise RuntimeError(defects[0])


class _Counter:
    """A number shared by all processes that each call raises by one."""

    def __init__(self, comm: MPI.Comm):
        self.comm, self.local = comm, -1
        self.window: Any = None

    def __enter__(self) -> _Counter:
        if self.comm.size > 1:
            size = MPI.INT64_T.Get_size() if self.comm.rank == 0 else 0
            self.window = MPI.Win.Allocate(size, comm=self.comm)  # type: ignore[arg-type]
            if self.comm.rank == 0:
                self.window.Lock(0)
                self.window.Put(np.zeros(1, dtype=np.int64), 0)
                self.window.Unlock(0)
            self.comm.Barrier()
        return self

    def __exit__(self, *_: Any) -> None:
        if self.window is not None:
            self.comm.Barrier()
            self.window.Free()

    def next(self) -> int:
        """The next number."""
        if self.window is None:
            self.local += 1
            return self.local
        one, got = np.ones(1, dtype=np.int64), np.empty(1, dtype=np.int64)
        self.window.Lock(0)
        self.window.Fetch_and_op(one, got, 0, op=MPI.SUM)
        self.window.Unlock(0)
        return int(got[0])
