"""Log and progress: one logger named ``brake_fenicsx``, rank 0 alone speaks.

A picture, a field, a derivative or a limit cycle is beside the main result of a run: what fails
there costs itself alone, and the log and the page say so (``spared``).
"""

import errno
import logging
import sys
import time
from bisect import bisect_right
from collections.abc import Callable
from contextlib import nullcontext
from itertools import accumulate
from logging.handlers import MemoryHandler
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
    early = next((h for h in logger.handlers if isinstance(h, MemoryHandler)), None)
    # A record that cannot be written, as on a full disc, is no reason for a traceback.
    logging.raiseExceptions = False
    # The form compiler logs its command lines at INFO on the root logger, and distutils lowers the
    # root's level again at the first form; a handler that is there keeps its own.
    root = logging.getLogger()
    if not root.handlers:
        root.addHandler(_set(_Terminal(), logging.WARNING))
    logger.handlers.clear()
    logger.propagate = False
    logger.setLevel(logging.DEBUG)
    if rank != 0:
        logger.addHandler(logging.NullHandler())
        return
    shown = level or (before.level if before else logging.INFO)
    logger.addHandler(terminal := _set(_Terminal(), shown))
    if file is None:
        # What is said before there is a file is kept for it.
        logger.addHandler(_set(MemoryHandler(sys.maxsize, sys.maxsize), terminal.level))
        return
    form = logging.Formatter("%(asctime)s %(levelname)s %(message)s")
    handler = logging.FileHandler(file, encoding="utf-8")
    logger.addHandler(_set(handler, min(terminal.level, logging.INFO), form))
    if early is not None:
        early.setTarget(handler)
        early.flush()


def _set(handler: Any, level: int | str, form: logging.Formatter | None = None) -> Any:
    handler.setLevel(level)
    handler.setFormatter(form or _Lines())
    return handler


class _Lines(logging.Formatter):
    """Lines of the terminal: warnings say so, and those of other packages are short."""

    def format(self, record: logging.LogRecord) -> str:
        """A line; readers of other packages log whole files that they miss."""
        line = "warning: " * (record.levelno == logging.WARNING) + super().format(record)
        return line if record.name == logger.name else short_line(line)


class _Terminal(logging.StreamHandler):
    """The handler whose level the command line sets, on the stderr of the moment.

    Who calls from Python may have closed the one that a command was given.
    """

    def __init__(self) -> None:
        """A handler without a stream of its own."""
        logging.Handler.__init__(self)

    @property
    def stream(self) -> Any:
        """Where lines go."""
        return sys.stderr

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record."""
        bars = sys.modules.get("tqdm")  # a bar below the lines makes room
        with bars.tqdm.external_write_mode(self.stream) if bars else nullcontext():
            super().emit(record)

    def bar(self, what: str, total: int) -> Any:
        """A bar that is updated in place; None where lines are not shown, or no terminal is."""
        if self.level > logging.INFO or not self.stream.isatty():
            return None
        from tqdm import tqdm

        form = "{desc}: {n_fmt} of {total_fmt}{postfix} |{bar}|"
        return tqdm(total=total, desc=what, leave=False, bar_format=form, file=self.stream)


class Progress:
    """A bar on a terminal, else a line of the log every five seconds, with the time to go.

    Pieces of one kind take about as long: those to come take the mean of those that were measured.
    """

    def __init__(self, what: str, *counts: int, processes: int = 1):
        """Begin.

        Args:
            what: what is counted, as the line begins.
            counts: how many pieces there are of each kind, in the order in which they come.
            processes: how many processes share them.
        """
        self.what, self.processes, self.done = what, processes, 0
        self.ends, self.measured = [*accumulate(counts)], [list[float]() for _ in counts]
        self.start = self.last = self.said = time.perf_counter()
        terminal = next((h for h in logger.handlers if isinstance(h, _Terminal)), None)
        self.bar = terminal.bar(what, self.ends[-1]) if terminal and self.ends[-1] else None

    def advance(self, n: int = 1) -> None:
        """Count ``n`` finished pieces, one of which this process has made since the last call."""
        now, kind = time.perf_counter(), bisect_right(self.ends, self.done + n - 1)
        self.measured[min(kind, len(self.ends) - 1)].append(now - self.last)
        self.done, self.last = self.done + n, now
        ended = self.done >= self.ends[-1]
        text = f"in {time_text(now - self.start)}" if ended else self.to_go()
        if self.bar is not None:
            self.bar.set_postfix_str(text, refresh=False)
            self.bar.update(n)
        if self.bar is not None and ended:
            self.bar.close()
        if ended or (self.bar is None and now - self.said >= 5.0):
            self.said = now
            logger.info("%s: %d of %d, %s", self.what, self.done, self.ends[-1], text)

    def to_go(self) -> str:
        """The time to go as text."""
        seconds = 0.0
        for begin, end, measured in zip([0, *self.ends], self.ends, self.measured, strict=False):
            left = max(0, end - max(self.done, begin))
            if left and not measured:
                return "time to go not known yet"
            seconds += left * sum(measured) / max(len(measured), 1)
        return f"{time_text(seconds / self.processes)} to go"


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
        logger.debug("%s", what, exc_info=True)
        return None, [f"{what} left out: {' '.join(str(error).split()) or type(error).__name__}"]


def time_text(seconds: float) -> str:
    """A time for a person."""
    if seconds < 90:
        return f"{seconds:.0f} s" if seconds >= 1 else "< 1 s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    if seconds < 2e5:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 86400:.3g} days" if seconds < 3e7 else f"{seconds / 31557600:.3g} years"
