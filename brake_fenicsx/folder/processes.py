"""Work that processes take in turns: a result, or what went wrong, reaches all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from mpi4py import MPI

from brake_fenicsx.errors import BrakeError

T = TypeVar("T")


def in_turns(count: int, work: Callable[[int], T], comm: MPI.Comm) -> Iterator[T]:
    """work(0), work(1), ... on all processes, each computed by one of them in turn; collective.

    Raises:
        BrakeError: what one of them raises, on all.
    """
    for first in range(0, count, comm.size):
        own: T | BrakeError | None = None
        if first + comm.rank < count:
            try:
                own = work(first + comm.rank)
            except BrakeError as error:
                own = error
        for i in range(min(comm.size, count - first)):
            one = comm.bcast(own, root=i)
            if isinstance(one, BrakeError):
                raise one
            yield one


def on_first(work: Callable[[], T], comm: MPI.Comm) -> T:
    """What the first process computes, on all; collective.

    Raises:
        BrakeError: what it raises, on all.
    """
    (one,) = in_turns(1, lambda i: work(), comm)
    return one
