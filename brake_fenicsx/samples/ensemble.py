"""Many samples over MPI processes: each takes the next one and stores it."""

import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeVar

from mpi4py import MPI

import numpy as np

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.folder.log import Progress, logger
from brake_fenicsx.folder.processes import (
    Terminated,
    TimeUp,
    asked,
    ending,
    finishing,
    on_first,
)
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store

# A sample at full order takes as long as so many others (measured at the reference brake). Where
# these keep all other processes busy, one process computes it alone: two that share it do more work
# in all.
AS_LONG = 400

# Beyond all samples: how a run that is to end keeps its processes from taking more.
_NO_MORE = 2**40

Work = Callable[..., dict[str, Any]]
T = TypeVar("T")


def run_ensemble(
    tasks: Sequence[Task],
    work: Work,
    store: Store,
    comm: MPI.Comm,
    large: Sequence[Task] = (),
    what: str = "samples",
    paired: bool = False,
    beside: Sequence[Callable[[], T]] = (),
    together: Callable[[MPI.Comm], Sequence[Callable[[], T]]] | None = None,
) -> list[T]:
    """Run all samples that are not in the folder yet, or those of the run's share.

    A sample that fails is stored with its error and stops nothing; an error that is not one of
    the program's own is a defect and stops the run, after the others' samples are safe.

    Args:
        tasks: (approach, number) of every sample.
        work: computes one sample; what it returns is stored. Is given a communicator as well where
            several processes share one.
        store: the results folder.
        comm: processes that share the samples.
        large: samples that take longer and come first.
        what: what the samples are called in the log.
        paired: whether two processes may share a long sample, where there are more processes than
            such samples, and not so many others that all are busy anyway.
        beside: other work, which fills the time of processes that have no sample left.
        together: called before that by all processes but the last, which begin with a long sample
            each; gives more work, for the processes that called it. Is given their communicator.
            Work beside the samples may read what it writes, and begins after it.

    Returns:
        What came of the work, first of ``together``, then beside, in its order, on every process.
    """
    if store.share is not None:
        large, tasks = store.share.part(large), store.share.part(tasks)
    wanted = _missing([*large, *tasks], store, comm)
    done = len(large) + len(tasks) - len(wanted)
    if comm.rank == 0 and done:
        logger.info("%d of %d %s were there already", done, len(large) + len(tasks), what)
    if not wanted and not beside and together is None:
        return []
    given = len(set(large) & set(wanted)), what, paired, beside, together
    return _run(wanted, work, store, comm, *given)


def _missing(tasks: Sequence[Task], store: Store, comm: MPI.Comm) -> list[Task]:
    """Samples that are not stored; collective."""

    def missing() -> list[Task]:
        there = store.samples.present()
        return [t for t in tasks if t not in there]

    return on_first(missing, comm)


def _run(
    wanted: Sequence[Task],
    work: Work,
    store: Store,
    comm: MPI.Comm,
    large: int,
    what: str,
    paired: bool,
    beside: Sequence[Callable[[], T]],
    together: Callable[[MPI.Comm], Sequence[Callable[[], T]]] | None,
) -> list[T]:
    """Compute the samples, each on the process that takes it next; large ones come first."""
    count = len(wanted) + len(beside)
    if 0 < large < count:
        logger.info("%s: the first %d of %d may take longer", what, large, count)
    begin, shared = _begin_with(wanted, large, comm, paired, together is not None)
    begun = len(begin) - shared
    wanted = wanted[begun:]
    # The last processes begin with a long sample: the first one has the log.
    last = comm.size - 1 - comm.rank
    defect: BaseException | None = None
    made: dict[tuple[bool, int], T] = {}
    with _Counter(comm) as counter, finishing(), _Team(comm, len(begin) if together else 0) as team:
        # Two processes that share a sample have one number, every other one its own.
        number = last // 2 if last < 2 * shared else comm.size + last
        own = comm.Split(number, comm.rank) if shared else MPI.COMM_SELF
        try:
            if together is not None and not team.busy:
                made |= {(False, i): one for i, one in team.work(together)}
            progress = Progress(what, large, count - large, processes=comm.size)
            for task in begin[last : last + 1]:
                mine = work if own.size == 1 else partial(work, comm=own)
                compute_sample(task, mine, store, own.rank == 0)
                progress.advance(begun)
            while (i := counter.next()) < len(wanted) + len(beside):
                if i < len(wanted):
                    compute_sample(wanted[i], work, store)
                elif team.ready():
                    made[True, i] = beside[i - len(wanted)]()
                progress.advance(begun + i + 1 - progress.done)
        except (BrakeError, OSError, Terminated, TimeUp) as error:
            defect = _of_the_run(error)
        except Exception:
            defect = RuntimeError(traceback.format_exc())
        team.ready()
        stopped = ending(comm)
    return _of_all(made, defect, stopped, comm)


def _begin_with(
    wanted: Sequence[Task], large: int, comm: MPI.Comm, paired: bool, together: bool
) -> tuple[list[Task], int]:
    """What each process begins with, the last one first, and how many samples two share.

    Long samples that are left over when every process has had as many come before all others, each
    shared by two processes, unless the other samples keep all processes busy. Beside work together
    each of the other long ones has its process, however soon that work is done.
    """
    left_over = large % comm.size
    paired = paired and len(wanted) - large < AS_LONG * (comm.size - left_over)
    shared = min(left_over, (comm.size - together) // 2) if paired else 0
    alone = min(large - shared, comm.size - 1 - 2 * shared) if together else 0
    twice = [task for task in wanted[:shared] for _ in range(2)]
    return [*twice, *wanted[shared : shared + alone]], shared


def _of_the_run(error: BaseException) -> BaseException:
    """The error, where it ends all processes together, each after its work at hand.

    Raises:
        Terminated: the error itself, where it is a second signal: this process waits for no other,
            and the command ends them all.
    """
    if isinstance(error, Terminated) and not error.together:
        raise error
    return error


def _of_all(
    made: dict[tuple[bool, int], T], defect: BaseException | None, stopped: BaseException | None,
    comm: MPI.Comm,
) -> list[T]:  # fmt: skip
    """What came of the work of all processes, or what ends them all; collective."""
    defects = [d for d in comm.allgather(defect) if d is not None]
    if defects:
        raise defects[0]
    if stopped is not None:
        raise stopped
    every = {i: one for part in comm.allgather(made) for i, one in part.items()}
    return [every[i] for i in sorted(every)]


def compute_sample(task: Task, work: Work, store: Store, keep: bool = True) -> None:
    """Compute a sample and store it, or its error.

    Args:
        task: approach and number of the sample.
        work: computes it; what it returns is stored.
        store: the results folder.
        keep: whether it is stored by this process.
    """
    try:
        result = {"status": "ok", **work(task)}
    except BrakeError as error:
        result = {**error.known, "status": str(error)}
        if keep:
            logger.warning("%s %d: %s", *task, error)
    if keep:
        store.samples.save(task, **result)


class _Team:
    """Processes that do not begin with a long sample, and their message that ``together`` is done.

    Attributes:
        busy: whether this process begins with a long sample.
    """

    def __init__(self, comm: MPI.Comm, busy: int):
        self._comm, self._others = comm, range(comm.size - busy, comm.size)
        self.busy = comm.rank in self._others
        self._team = comm.Split(int(self.busy), comm.rank) if busy else comm
        self._counter, self._sent = _Counter(self._team), list[MPI.Request]()
        self._ready = None if self.busy else True

    def __enter__(self) -> "_Team":
        self._counter.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: Any) -> None:
        if kind is not Terminated:
            MPI.Request.Waitall(self._sent)
        self._counter.__exit__(kind)

    def work(
        self, together: Callable[[MPI.Comm], Sequence[Callable[[], T]]]
    ) -> Iterator[tuple[int, T]]:
        """Call ``together`` and do its works: number and result of those of this process."""
        more: Sequence[Callable[[], T]] = ()
        failed: BaseException | None = None
        try:
            more = together(self._team)
        except (Exception, Terminated, TimeUp) as error:
            failed = _of_the_run(error)
        self._ready = self._team.allreduce(failed is None, MPI.LAND)
        if self._comm.rank == 0:
            self._sent = [self._comm.isend(self._ready, other) for other in self._others]
        if failed is not None:
            raise failed
        while self._ready and (i := self._counter.next()) < len(more):
            yield i, more[i]()

    def ready(self) -> bool:
        """Whether ``together`` succeeded; a busy process waits for the message the first time."""
        if self._ready is None:
            self._ready = self._comm.recv(source=0)
        return bool(self._ready)


class _Counter:
    """A number shared by all processes; each call raises it by one."""

    def __init__(self, comm: MPI.Comm):
        self.comm, self.local = comm, -1
        self.window: Any = None

    def __enter__(self) -> "_Counter":
        if self.comm.size > 1:
            unit = MPI.INT64_T.Get_size()
            size = unit if self.comm.rank == 0 else 0
            self.window = MPI.Win.Allocate(size, unit, comm=self.comm)  # type: ignore[arg-type]
            if self.comm.rank == 0:
                self.window.Lock(0)
                self.window.Put(np.zeros(1, dtype=np.int64), 0)
                self.window.Unlock(0)
            self.comm.Barrier()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: Any) -> None:
        # After a second signal the others need not come here.
        if self.window is not None and kind is not Terminated:
            self.comm.Barrier()
            self.window.Free()

    def next(self) -> int:
        """The next number; beyond all samples once the run is to end."""
        step = _NO_MORE if asked() else 1
        if self.window is None:
            self.local += step
            return self.local
        one, got = np.full(1, step, dtype=np.int64), np.empty(1, dtype=np.int64)
        self.window.Lock(0)
        self.window.Fetch_and_op(one, got, 0, 0, op=MPI.SUM)
        self.window.Unlock(0)
        return int(got[0]) + step - 1
