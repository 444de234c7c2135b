"""Many samples over MPI processes: each, or each group, takes the next one and stores it."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.log import Progress, logger
from brake_fenicsx.store import Store
from brake_fenicsx.termination import Terminated, asked, finishing

from .group import Group, split

_NO_MORE = 2**40

Task = tuple[str, int]
Work = Callable[[Task, Group], dict[str, Any]]


def sample_file(task: Task) -> str:
    """File of a sample in the results folder."""
    return f"samples/{task[0]}-{task[1]:05d}.npz"


def run_ensemble(
    tasks: Sequence[Task],
    work: Work,
    store: Store,
    comm: MPI.Comm,
    large: Sequence[Task] = (),
    size: int = 1,
) -> None:
    """Run all samples that are not in the folder yet.

    A sample that fails is stored with its error and stops nothing; an error that is not one of
    the program's own is a defect and stops the run, after the others' samples are safe.

    Args:
        tasks: (approach, number) of every sample that one process computes by itself.
        work: computes one sample with the processes of a group; what its first process returns is
            stored. See ``Group`` for what it may do with it.
        store: the results folder.
        comm: processes that share the work.
        large: samples that come first, each computed by a group of processes together.
        size: processes of such a group; divides the number of processes.
    """
    wanted = _missing([*large, *tasks], store, comm)
    done = len(large) + len(tasks) - len(wanted)
    if comm.rank == 0 and done:
        logger.info("%d of %d samples were there already", done, len(large) + len(tasks))
    waited = False
    while wanted:
        _run_unclaimed(tasks, wanted, work, store, comm, large, size)
        if store.lock is None:
            return
        if wanted := _missing(wanted, store, comm):
            if not waited:
                logger.info("%d samples are being computed by another run; waiting", len(wanted))
            waited = True
            time.sleep(1.0)


def _missing(tasks: Sequence[Task], store: Store, comm: MPI.Comm) -> list[Task]:
    """Samples that are not stored; collective."""
    found: Any = None
    if comm.rank == 0:
        try:
            found = [t for t in tasks if not store.has_sample(sample_file(t))]
        except BrakeError as error:
            found = error
    found = comm.bcast(found, root=0)
    if isinstance(found, BrakeError):
        raise found
    return list(found)


def _run_unclaimed(
    tasks: Sequence[Task], wanted: Sequence[Task], work: Work, store: Store, comm: MPI.Comm,
    large: Sequence[Task], size: int,
) -> None:  # fmt: skip
    """Compute those of the wanted samples that no other run is computing."""
    open_ = set(wanted)
    parts = [[t for t in part if t in open_] for part in (large, tasks)]
    group, alone = split(comm, size), split(comm, 1)
    progress = Progress("samples", len(wanted), len(parts[0]))
    shared, rest = (_Take(part, work, store, progress) for part in parts)
    defect: Any = None
    with _Counters(comm, 2) as counters, finishing():
        try:
            # No process waits between the two: the groups come apart as they finish.
            shared.run(group, lambda: counters.next(0), 0)
            rest.run(alone, lambda: counters.next(1), len(parts[0]))
        except BrakeError as error:
            defect = error
        except Exception:
            defect = RuntimeError(traceback.format_exc())
        stopped = comm.allreduce(asked(), MPI.LOR)
    group.Free()
    alone.Free()
    defects = [d for d in comm.allgather(defect) if d is not None]
    if defects:
        raise defects[0]
    if stopped:
        raise Terminated(together=True)


class _Take:
    """Samples that groups take one after the other."""

    def __init__(self, tasks: Sequence[Task], work: Work, store: Store, progress: Progress):
        self.tasks, self.work, self.store, self.progress = tasks, work, store, progress

    def run(self, group: Group, number: Callable[[], int], before: int) -> None:
        """Take samples until there is none left; ``before`` of others were handed out first."""
        while (i := group.bcast(number() if group.rank == 0 else None)) < len(self.tasks):
            if group.run(partial(self._one, self.tasks[i], group)):
                self.progress.advance(before + i + 1 - self.progress.done)

    def _one(self, task: Task, group: Group) -> bool:
        """Compute a sample and store it, or its error; False if another run has it."""
        lock, name = self.store.lock, f"{task[0]}-{task[1]:05d}"
        mine = True
        if lock is not None and group.rank == 0:
            mine = lock.claim(name) is None
            # The other run may have finished it since.
            if mine and self.store.has_sample(sample_file(task)):
                lock.release(name)
                mine = False
        if not group.bcast(mine):
            return False
        try:
            result = group.run(lambda: self.work(task, group))
        except BrakeError as error:
            result = {"status": str(error)}
            if group.rank == 0:
                logger.warning("%s %d: %s", *task, error)
        else:
            result = {"status": "ok", **result}
        if group.rank == 0:
            self.store.save_sample(sample_file(task), **result)
            if lock is not None:
                lock.release(name)
        return True


class _Counters:
    """Numbers shared by all processes; each call raises one of them by one."""

    def __init__(self, comm: MPI.Comm, many: int):
        self.comm, self.local = comm, [-1] * many
        self.window: Any = None

    def __enter__(self) -> _Counters:
        if self.comm.size > 1:
            many = len(self.local)
            size = many * MPI.INT64_T.Get_size() if self.comm.rank == 0 else 0
            unit = MPI.INT64_T.Get_size()
            self.window = MPI.Win.Allocate(size, unit, comm=self.comm)  # type: ignore[arg-type]
            if self.comm.rank == 0:
                self.window.Lock(0)
                self.window.Put(np.zeros(many, dtype=np.int64), 0)
                self.window.Unlock(0)
            self.comm.Barrier()
        return self

    def __exit__(self, *_: Any) -> None:
        if self.window is not None:
            self.comm.Barrier()
            self.window.Free()

    def next(self, which: int) -> int:
        """The next number of one of them; beyond all samples once the run is to end."""
        step = _NO_MORE if asked() else 1
        if self.window is None:
            self.local[which] += step
            return self.local[which]
        one, got = np.full(1, step, dtype=np.int64), np.empty(1, dtype=np.int64)
        self.window.Lock(0)
        self.window.Fetch_and_op(one, got, 0, which, op=MPI.SUM)
        self.window.Unlock(0)
        return int(got[0]) + step - 1
