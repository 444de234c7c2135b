"""The early end of a run: SIGTERM, as a batch system sends it, or a limit of time.

At SIGTERM, while samples are computed the sample at hand is finished and stored, and none is begun
after it; elsewhere, and at the second signal, the run ends at once.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mpi4py import MPI

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
    """A block that looks at ``asked`` by itself."""
    _State.finishing = True
    try:
        yield
    finally:
        _State.asked = _State.finishing = False


def _on_signal(*_: Any) -> None:
    again, _State.asked = _State.asked, True
    if again or not _State.finishing:
        raise Terminated
