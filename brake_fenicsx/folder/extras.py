"""Work beside the main result of a run: what fails costs itself, and the log and the page say so.

A picture, a field, a derivative or a limit cycle is an extra: equilibria, modes and tables stand
without it.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import TypeVar

from .log import logger

T = TypeVar("T")

# What no later work of the run survives either.
FATAL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO}


def spared(what: str, work: Callable[[], T]) -> tuple[T | None, list[str]]:
    """What work() gives, and nothing; or None, and what was lost and why, as a line for the page.

    Args:
        what: the extra, as the line names it: "picture of the mesh".
        work: makes it; where processes share it, all must fail together.

    Raises:
        OSError: the disc is full or gone.
    """
    try:
        return work(), []
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FATAL:
            raise
        reason = " ".join(str(error).split()) or type(error).__name__
        logger.debug("%s", what, exc_info=True)
        return None, [f"{what} left out: {reason}"]
