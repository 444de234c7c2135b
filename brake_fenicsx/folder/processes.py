"""Processes of a run: work that they take in turns, and their memory.

A result, or what went wrong, reaches all of them.

SuperLU_DIST, which PETSc loads, tells the C library to keep whatever is freed (mallopt: no mmap, no
trimming). A process then holds its peak to its end, and peaks of several processes add up although
they come at different times. Here large blocks get pages of their own again, which go back when
they are freed.
"""

from __future__ import annotations

import ctypes
import mmap
import resource
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Future
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
