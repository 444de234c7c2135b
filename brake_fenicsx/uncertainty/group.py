"""Processes that compute one sample together: it ends well on all of them, or on none.

An exception on one process alone would leave the others waiting in their next common call. Here
each such call first tells whether all are well. A process that fails says so by taking part once
more, in whatever call the others are in, and there the error is raised on all of them.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from functools import reduce
from typing import Any, TypeVar

from mpi4py import MPI

from brake_fenicsx.errors import BrakeError

Value = TypeVar("Value")


class Group(MPI.Intracomm):
    """A communicator whose common calls fail together; only those below are to be used.

    Attributes:
        known: the last error that all processes were told of.
    """

    known: Exception | None = None

    def run(self, work: Callable[[], Value]) -> Value:
        """Do common work; may be nested.

        Args:
            work: what each process does; it may call this group on its way, all in one order. It
                must not go on after an error of such a call.

        Returns:
            What it returns here.

        Raises:
            BrakeError: the first process's that failed; the same on all.
            RuntimeError: another process met a defect, whose traceback it holds; there it is
                raised as it is.
        """
        try:
            value = work()
        except Exception as error:
            if error is not self.known:
                self._agree(error)
                self.known = error
            raise
        self._agree()
        return value

    def _agree(self, error: Exception | None = None) -> None:
        """Tell the others how it goes; raise what went wrong, but for a defect of one's own."""
        said: Any = error
        if error is not None and not isinstance(error, BrakeError):
            said = "".join(traceback.format_exception(error))
        failed = [e for e in super().allgather(said) if e is not None]
        if not failed or isinstance(said, str):
            return
        # A defect comes before an error that has a name.
        defect = next((e for e in failed if isinstance(e, str)), None)
        self.known = failed[0] if defect is None else RuntimeError(defect)
        raise self.known

    def allgather(self, sendobj: Any) -> list[Any]:
        """What every process gives, in their order."""
        self._agree()
        return super().allgather(sendobj)

    def bcast(self, obj: Any, root: int = 0) -> Any:
        """What process ``root`` gives."""
        self._agree()
        return super().bcast(obj, root)

    def allreduce(self, sendobj: Any, op: MPI.Op | Callable[[Any, Any], Any] = MPI.SUM) -> Any:
        """All that the processes give, put together."""
        return reduce(op, self.allgather(sendobj))


def split(comm: MPI.Comm, size: int) -> Group:
    """Groups of neighbouring processes; collective.

    Args:
        comm: all processes.
        size: processes of each group; divides their number.

    Returns:
        The group of this process.
    """
    return Group(comm.Split(comm.rank // size, comm.rank))
