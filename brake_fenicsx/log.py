"""Log and progress: one logger named ``brake_fenicsx``, rank 0 alone speaks."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

logger = logging.getLogger("brake_fenicsx")


def start_log(rank: int, file: Path | None = None) -> None:
    """Send the package's log to the terminal and to a file on rank 0, and nowhere on the others.

    Args:
        rank: rank of this process in the run's communicator.
        file: path of the log file, appended to; none if not given.
    """
    # The form compiler logs its command lines at INFO on the root logger.
    logging.getLogger().setLevel(logging.WARNING)
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


@contextmanager
def stage(name: str, times: dict[str, float] | None = None) -> Iterator[None]:
    """Log the start and the seconds of a stage; keep the seconds in ``times``.

    Args:
        name: name of the stage.
        times: receives ``times[name]`` [s].
    """
    logger.info("%s ...", name)
    start = time.perf_counter()
    yield
    seconds = time.perf_counter() - start
    if times is not None:
        times[name] = seconds
    logger.info("%s: %.1f s", name, seconds)


class Progress:
    """A log line per tenth of the work, or per five seconds, with the time to go."""

    def __init__(self, what: str, total: int):
        self.what, self.total, self.done = what, total, 0
        self.start = self.last = time.perf_counter()

    def advance(self, n: int = 1) -> None:
        """Count ``n`` finished pieces and say so when there is something new to say."""
        self.done += n
        now = time.perf_counter()
        if self.done < self.total and now - self.last < 5.0:
            return
        self.last = now
        rate = (now - self.start) / max(self.done, 1)
        to_go = rate * (self.total - self.done)
        logger.info("%s: %d of %d, %.0f s to go", self.what, self.done, self.total, to_go)
