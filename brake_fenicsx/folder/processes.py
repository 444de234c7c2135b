"""Processes of a run: work that they take in turns, and the memory of the largest.

A result, or what went wrong, reaches all of them.
"""

import resource
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

T = TypeVar("T")


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
    for node, own in comm.allgather((socket.gethostname(), (peak - mapped, mapped))):
        nodes.setdefault(node, []).append(own)
    whole = (sum(p for p, _ in held) + max(m for _, m in held) for held in nodes.values())
    return comm.allreduce(peak, MPI.MAX), max(whole)
