"""Log and progress: one logger named ``brake_fenicsx``, rank 0 alone speaks.

A picture, a field, a derivative or a limit cycle is beside the main result of a run: what fails
there costs itself alone, and the log and the page say so (``spared``).
"""

from __future__ import annotations

import errno
import logging
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
logger = logging.getLogger("brake_fenicsx")
# What no later work of the run survives either.
FATAL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO}


def short_line(text: str) -> str:
    """What another package says, in one line of at most 160 characters."""
    line = " ".join(text.split())
    return line if len(line) <= 160 else f"{line[:157]}..."


def start_log(rank: int, file: Path | None = None, level: str | None = None) -> None:
    """Send the package's log to the terminal and to a file on rank 0, and nowhere on the others.

    Args:
        rank: rank of this process in the run's communicator.
        file: path of the log file, appended to; none if not given.
        level: from which level on the terminal shows it; as before if not given.
    """
    before = next((h for h in logger.handlers if isinstance(h, _Terminal)), None)
    # A record that cannot be written, as on a full disc, is no reason for a traceback.
    logging.raiseExceptions = False
    # The form compiler logs its command lines at INFO on the root logger, and distutils lowers the
    # root's level again at the first form; a handler that is there keeps its own.
    root = logging.getLogger()
    if not root.handlers:
        warnings = logging.StreamHandler(sys.stderr)
        warnings.setLevel(logging.WARNING)
        warnings.setFormatter(_Lines())
        root.addHandler(warnings)
    logger.handlers.clear()
    logger.propagate = False
    logger.setLevel(logging.DEBUG)
    if rank != 0:
        logger.addHandler(logging.NullHandler())
        return
    terminal = _Terminal(sys.stderr, keeps=file is None)
    terminal.setLevel(level or (before.level if before else logging.INFO))
    terminal.setFormatter(_Lines())
    logger.addHandler(terminal)
    if file is not None:
        handler = logging.FileHandler(file, encoding="utf-8")
        handler.setLevel(min(terminal.level, logging.INFO))
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        logger.addHandler(handler)
        # What was said before there was a file.
        for record in before.said if before else ():
            handler.handle(record)


class _Lines(logging.Formatter):
    """Lines of the terminal: warnings say so, and those of other packages are short."""

    def format(self, record: logging.LogRecord) -> str:
        """A line; readers of other packages log whole files that they miss."""
        line = "warning: " * (record.levelno == logging.WARNING) + super().format(record)
        return line if record.name == logger.name else short_line(line)


class _Terminal(logging.StreamHandler):
    """The handler whose level the command line sets; keeps what it said until there is a file."""

    def __init__(self, stream: Any, keeps: bool) -> None:
        super().__init__(stream)
        self.keeps = keeps
        self.said: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record."""
        if self.keeps:
            self.said.append(record)
        super().emit(record)


class Progress:
    """A log line every five seconds at most, with the time to go."""

    def __init__(self, what: str, total: int, slow: int = 0):
        """Begin.

        Args:
            what: name of the pieces.
            total: how many there are.
            slow: how many of them, the first ones, say nothing of how long the others take.
        """
        self.what, self.total, self.done = what, total, 0
        self.slow = slow if slow < total else 0
        self.last = self.said = time.perf_counter()
        self.each: float | None = None

    def advance(self, n: int = 1) -> None:
        """Count ``n`` finished pieces and say so when there is something new to say."""
        before, self.done = self.done, self.done + n
        now = time.perf_counter()
        each = (now - self.last) / max(n, 1)
        self.last = now
        if before >= self.slow:
            # Pieces differ in length: the latest count more.
            old = each if self.each is None else self.each
            self.each = 0.8 * old + 0.2 * min(each, 4 * old)
        if self.done < self.total and now - self.said < 5.0:
            return
        self.said = now
        if self.each is None:
            to_go = f"the {self.slow} long ones first"
        else:
            to_go = f"{self.each * (self.total - self.done):.0f} s to go"
        logger.info("%s: %d of %d, %s", self.what, self.done, self.total, to_go)


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


def time_text(seconds: float) -> str:
    """A time for a person."""
    if seconds < 90:
        return f"{seconds:.0f} s" if seconds >= 1 else "< 1 s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    if seconds < 2e5:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 86400:.3g} days" if seconds < 3e7 else f"{seconds / 31557600:.3g} years"
