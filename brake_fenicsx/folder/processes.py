"""Processes of a run: work that they take in turns, their memory, their early end.

A result of work in turns, or what went wrong, reaches all of them.

SuperLU_DIST, which PETSc loads, tells the C library to keep whatever is freed (mallopt: no mmap, no
trimming). A process then holds its peak to its end, and peaks of several processes add up although
they come at different times. Here large blocks get pages of their own again, which go back when
they are freed.

A run ends early at SIGTERM, as a batch system sends it, or at a limit of time. At SIGTERM, while
samples are computed the sample at hand is finished and stored, and none is begun after it;
elsewhere, and at the second signal, the run ends at once.
"""

from __future__ import annotations

import ctypes
import mmap
import resource
import signal
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakSet

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")
_trim, _option = (getattr(ctypes.CDLL(None), name, None) for name in ("malloc_trim", "mallopt"))
# Numbers of mallopt's options, and blocks that get pages of their own: those from LARGE bytes on,
# the most that the C library chooses by itself, and so many of them.
MMAP_THRESHOLD, MMAP_MAX, LARGE, BLOCKS = -3, -4, 2**25, 2**16

# Files that are mapped into memory, while anything reads their arrays.
mapped_files: WeakSet[mmap.mmap] = WeakSet()


def in_turns(count: int, work: Callable[[int], T], comm: MPI.Comm, aside: int = 0) -> Iterator[T]:
    """work(0), work(1), ... on all processes, each computed by one of them in turn; collective.

    Args:
        count: number of works.
        work: computes one of them.
        comm: the processes.
        aside: the first so many take none, as long as others are there, and may be long in coming:
            the others do all of theirs before they send any of it.

    Raises:
        Exception: what one of them raises, on all.
    """
    aside = min(aside, comm.size - 1)
    team, rank = comm.size - aside, comm.rank - aside
    together = max(count, team) if aside else team

    def attempt(i: int) -> T | Exception:
        try:
            return work(i)
        except Exception as error:
            return error

    for first in range(0, count, together):
        last = min(first + together, count)
        own = {i: attempt(i) for i in range(first + rank, last, team)} if rank >= 0 else {}
        for i in range(first, last):
            # One process needs no copy: it may be all vectors of a large problem.
            root = aside + i % team
            one: Any = comm.bcast(own.get(i), root=root) if comm.size > 1 else own[i]
            if isinstance(one, Exception):
                raise one
            yield one


def on_first(work: Callable[[], T], comm: MPI.Comm) -> T:
    """What the first process computes, on all; collective.

    Raises:
        Exception: what it raises, on all.
    """
    return next(in_turns(1, lambda i: work(), comm))


def meanwhile(work: Callable[[], T], comm: MPI.Comm) -> Callable[[], T]:
    """Work of the first process that the others do not wait for.

    Returns:
        What gives its result on all of them, or raises what it raised; collective.
    """
    done = Future[T]()
    if comm.rank == 0:
        try:
            done.set_result(work())
        except Exception as error:
            done.set_exception(error)
    return lambda: on_first(done.result, comm)


def peak_memory(comm: MPI.Comm) -> tuple[float, float]:
    """Peak memory so far of the largest process and of the largest node [MB]; collective.

    What processes of a node map from files counts once there.
    """
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    lines = (line.split() for line in Path("/proc/self/status").read_text("utf-8").splitlines())
    mapped = sum(int(w[1]) for w in lines if w[0] in ("RssFile:", "RssShmem:")) / 1024
    nodes: dict[str, list[tuple[float, float]]] = {}
    for node, own in comm.allgather((socket.gethostname(), (peak, mapped))):
        nodes.setdefault(node, []).append(own)
    whole = (sum(p - m for p, m in held) + max(m for _, m in held) for held in nodes.values())
    return max(p for held in nodes.values() for p, _ in held), max(whole)


def release_memory() -> None:
    """Return free pages to the system, and those of mapped files, which are read again on demand.

    Free pages stay where the C library cannot return them.
    """
    for file in mapped_files:
        file.madvise(mmap.MADV_DONTNEED)
    if _trim is not None and _option is not None:
        _option(MMAP_MAX, BLOCKS)
        _option(MMAP_THRESHOLD, LARGE)
        _trim(ctypes.c_size_t(0))


STATUS = 128 + signal.SIGTERM
AGAIN = 5.0  # [s] between two alarms


class Terminated(BaseException):
    """SIGTERM ended the run.

    Attributes:
        together: whether all processes of the run raise it.
    """

    def __init__(self, together: bool = False):
        super().__init__()
        self.together = together


class TimeUp(BaseException):
    """The time of a block is over."""


class _State:
    asked = finishing = limited = time_up = False


@contextmanager
def watching() -> Iterator[None]:
    """A block in which SIGTERM is ours."""
    _State.asked = _State.finishing = False
    before = signal.signal(signal.SIGTERM, _on_signal)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def asked() -> bool:
    """Whether nothing new may be begun."""
    return _State.asked or _State.time_up


def ending(comm: MPI.Comm) -> BaseException | None:
    """What ends the run on all processes together, if any of them is to end; collective."""
    from mpi4py import MPI

    how = comm.allreduce(2 * _State.asked + _State.time_up, MPI.MAX)
    return Terminated(together=True) if how >= 2 else TimeUp() if how else None


def end_of_stage(comm: MPI.Comm) -> None:
    """End a run whose time is over; collective."""
    if _State.limited and (end := ending(comm)) is not None:
        raise end


@contextmanager
def limited(seconds: float | None, comm: MPI.Comm) -> Iterator[None]:
    """A block that raises `TimeUp` after some time; collective.

    One process ends at once, or where a library hands back to Python. Several end together: after
    the samples at hand, or at the end of a stage.

    Args:
        seconds: time of the block [s]; without a limit if None.
        comm: the processes of the block.
    """
    if seconds is None:
        yield
        return

    def on_alarm(*_: Any) -> None:
        _State.time_up = True
        if comm.size == 1:
            raise TimeUp

    before = signal.signal(signal.SIGALRM, on_alarm)
    _State.limited = True
    # Once more, since a library may lose what is raised within it.
    signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-3), AGAIN)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        _State.limited = _State.time_up = False


@contextmanager
def finishing() -> Iterator[None]:
    """A block that looks at ``asked`` by itself; what is asked within it holds for an outer one."""
    before, _State.finishing = _State.finishing, True
    try:
        yield
    finally:
        _State.finishing = before
        _State.asked = _State.asked and before


def _on_signal(*_: Any) -> None:
    again, _State.asked = _State.asked, True
    if again or not _State.finishing:
        raise Terminated
