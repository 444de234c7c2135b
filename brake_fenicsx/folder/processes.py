"""Processes of a run: work that they take in turns, and the memory of the largest.

A result, or what went wrong, reaches all of them.
"""

from __future__ import annotations

import resource
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

T = TypeVar("T")


def in_turns(count: int, work: Callable[[int], T], comm: MPI.Comm) -> Iterator[T]:
    """work(0), work(1), ... on all processes, each computed by one of them in turn; collective.

    Raises:
        Exception: what one of them raises, on all.
    """
    for first in range(0, count, comm.size):
        own: T | Exception | None = None
        if first + comm.rank < count:
            try:
                own = work(first + comm.rank)
            except Exception as error:
                own = error
        for i in range(min(comm.size, count - first)):
            # One process needs no copy: it may be all vectors of a large problem.
            one: Any = comm.bcast(own, root=i) if comm.size > 1 else own
            if isinstance(one, Exception):
                raise one
            yield one


def on_first(work: Callable[[], T], comm: MPI.Comm) -> T:
    """What the first process computes, on all; collective.

    Raises:
        Exception: what it raises, on all.
    """
    (one,) = in_turns(1, lambda i: work(), comm)
    return one


def peak_memory(comm: MPI.Comm) -> tuple[float, float]:
    """Peak memory so far of the largest process and of the largest node [MB]; collective.

    What processes of a node map from files counts once there.
    """
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    lines = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
    mapped = sum(int(w[1]) for w in lines if w[0] in ("RssFile:", "RssShmem:")) / 1024
    nodes: dict[str, list[tuple[float, float]]] = {}
    for node, own in comm.allgather((socket.gethostname(), (peak - mapped, mapped))):
        nodes.setdefault(node, []).append(own)
    whole = (sum(p for p, _ in held) + max(m for _, m in held) for held in nodes.values())
    return comm.allreduce(peak, MPI.MAX), max(whole)
