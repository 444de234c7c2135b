"""Log and progress: one logger named ``brake_fenicsx``, rank 0 alone speaks."""

from __future__ import annotations

import logging
import sys
import time
from pathlib import Path

logger = logging.getLogger("brake_fenicsx")


def start_log(rank: int, file: Path | None = None) -> None:
    """Send the package's log to the terminal and to a file on rank 0, and nowhere on the others.

    Args:
        rank: rank of this process in the run's communicator.
        file: path of the log file, appended to; none if not given.
    """
    # The form compiler logs its command lines at INFO on the root logger, and distutils lowers the
    # root's level again at the first form; a handler that is there keeps its own.
    root = logging.getLogger()
    if not root.handlers:
        warnings = logging.StreamHandler(sys.stderr)
        warnings.setLevel(logging.WARNING)
        root.addHandler(warnings)
    logger.handlers.clear()
    logger.propagate = False
    logger.setLevel(logging.INFO)
    if rank != 0:
        logger.addHandler(logging.NullHandler())
        return
    terminal = logging.StreamHandler(sys.stderr)
    terminal.setFormatter(logging.Formatter("%(message)s"))
    logger.addHandler(terminal)
    if file is not None:
        handler = logging.FileHandler(file)
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        logger.addHandler(handler)


class Progress:
    """A log line every five seconds at most, with the time to go."""

    def __init__(self, what: str, total: int):
        self.what, self.total, self.done = what, total, 0
        self.last = self.said = time.perf_counter()
        self.each: float | None = None

    def advance(self, n: int = 1) -> None:
        """Count ``n`` finished pieces and say so when there is something new to say."""
        self.done += n
        now = time.perf_counter()
        each = (now - self.last) / max(n, 1)
        # Pieces differ in length: the latest count more.
        self.each = each if self.each is None else 0.8 * self.each + 0.2 * min(each, 4 * self.each)
        self.last = now
        if self.done < self.total and now - self.said < 5.0:
            return
        self.said = now
        to_go = self.each * (self.total - self.done)
        logger.info("%s: %d of %d, %.0f s to go", self.what, self.done, self.total, to_go)
