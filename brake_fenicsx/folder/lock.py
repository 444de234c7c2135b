"""Who is at work in a results folder: one run of all samples, or several of its shares.

Every run keeps a file ``running/HOST-PROCESS-START.run`` in the folder and touches it twice a
minute. The folder, or a share of its samples, belongs to the run whose name stands in its claim
file; creating this file is atomic (O_EXCL). A claim is stale if the file of its run is gone, if its
process on this machine has ended, or if, on another machine, its file was not touched for
``SILENCE`` seconds. A stale claim is named in the log and taken over, at once: the leases of
filelock 4.3 watch an unchanged claim of another machine for the whole term first, however old.

Shares of a run: the tasks of a job array compute the samples of one scene in parts.
"""

import os
import re
import socket
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from brake_fenicsx.errors import SceneError

from .log import logger

T = TypeVar("T")
# What SLURM, Grid Engine, LSF and PBS tell a task of a job array: its number, the lowest and the
# highest number, their step, and how many there are.
ARRAYS = (
    [f"SLURM_ARRAY_TASK_{name}" for name in ("ID", "MIN", "MAX", "STEP", "COUNT")],
    [f"SGE_TASK_{name}" for name in ("ID", "FIRST", "LAST", "STEPSIZE", "")],
    ["LSB_JOBINDEX", "", "LSB_JOBINDEX_END", "LSB_JOBINDEX_STEP", ""],
    ["PBS_ARRAY_INDEX", "", "", "", ""],
)
BEAT, SILENCE = 30.0, 240.0  # [s]
_CLAIM, _RUN = ".claim", ".run"
_UNKNOWN = "unknown-0-0"
_NAME = re.compile(r"(.+)-(\d+)-(\d*)")  # of a process


@dataclass(frozen=True, slots=True)
class Share:
    """One of several parts of about equal size.

    Attributes:
        number: which one, from 1 to ``of``.
        of: how many there are.
    """

    number: int
    of: int

    def __str__(self) -> str:
        return f"{self.number} of {self.of}"

    def part(self, tasks: Sequence[T]) -> list[T]:
        """The tasks of this share: neighbours, so that few archives hold samples of several."""
        n = len(tasks)
        return list(tasks[n * (self.number - 1) // self.of : n * self.number // self.of])


def read_share(text: str) -> Share:
    """Read ``I/N``. Without I the number is that of this task of a job array; without N as well.

    Raises:
        SceneError: the text is no share, or the environment does not say what is left out.
    """
    match = re.fullmatch(r"(\d*)/(\d+)|", text)
    number, count = (int(group or 0) for group in match.groups()) if match else (0, 0)
    if match is not None and not match[1]:
        number, tasks = _task_of_array(text)
        count = count if text else tasks
        if tasks not in (0, count):
            raise SceneError(f"--share {text}: the job array has {tasks} tasks; write --share")
        if not count:
            raise SceneError("--share: how many tasks there are is not known; write --share /N")
    if not 1 <= number <= count:
        raise SceneError(f"--share {text}: write I/N with I from 1 to N, such as --share 3/16")
    return Share(number, count)


def _task_of_array(text: str) -> tuple[int, int]:
    """Number of this task of a job array, from 1, and number of all tasks; 0 where it is not said.

    Raises:
        SceneError: this is no task, or the numbers have gaps.
    """
    for names in ARRAYS:
        here, low, high, step, count = (_integer(name) for name in names)
        # A job of LSF that is no task has the number 0; one of Grid Engine has "undefined".
        if here is None or (here == 0 and low is None):
            continue
        if high is None:
            return here, 0
        low = 1 if low is None else low
        count = (high - low) // (step or 1) + 1 if count is None else count
        # Numbers may have steps, as in --array=0-30:2; a list with gaps has no such order.
        step = max((high - low) // max(count - 1, 1), 1)
        if count > 1 and (low + (count - 1) * step != high or (here - low) % step):
            raise SceneError(f"""--share: {count} tasks of a job array from {low} to {high} are not
                evenly spaced; number them from 1 to N, or write --share I/N""")
        return (here - low) // step + 1, count
    raise SceneError(f"""--share {text}: none of {", ".join(names[0] for names in ARRAYS)} is set,
        this is no task of a job array; write I/N, such as --share 3/16""")


def _integer(name: str) -> int | None:
    """Value of an environment variable; None where it is not set or no number."""
    text = os.environ.get(name, "")
    return int(text) if text.isdecimal() else None


class Lock:
    """Work in one folder, as one run sees it.

    Attributes:
        name: name of this run, HOST-PROCESS-START.
    """

    def __init__(self, folder: Path):
        """Enter the folder.

        Args:
            folder: where the files of runs and claims are; made if it is not there.
        """
        self.folder: Path = folder
        self._ended = threading.Event()
        self.name: str = process_name()
        folder.mkdir(parents=True, exist_ok=True)
        self._file(self.name).write_text(time.strftime("%Y-%m-%d %H:%M:%S"), "utf-8")
        threading.Thread(target=self._beat, daemon=True).start()

    @classmethod
    def watched(cls, folder: Path) -> list[tuple[str, str]]:
        """Runs at work in a folder, which is not entered: process and machine, and their claim."""
        lock = cls.__new__(cls)
        lock.folder, lock.name = folder, ""
        owners = {p.name.removesuffix(_CLAIM): _read(p) for p in sorted(folder.glob(f"*{_CLAIM}"))}
        return [(lock.described(n), claim) for claim, n in owners.items() if n and lock.alive(n)]

    def leave(self) -> None:
        """Give back all claims of this run and remove its file, and those of runs that ended."""
        self._ended.set()
        for claim in self.folder.glob(f"*{_CLAIM}"):
            owner = _read(claim)
            if owner == self.name or (owner and not self.alive(owner)):
                claim.unlink(missing_ok=True)
        for path in self.folder.glob(f"*{_RUN}"):
            if not self.alive(path.name.removesuffix(_RUN)):
                path.unlink(missing_ok=True)
        self._file(self.name).unlink(missing_ok=True)
        with suppress(OSError):  # Another run is in the folder.
            self.folder.rmdir()

    def claim(self, work: str) -> str | None:
        """Take the folder or a share, from a run that has ended too.

        Returns:
            None if this run has it now, else the name of the run that has it.
        """
        path = self.folder / f"{work}{_CLAIM}"
        for _ in range(2):
            try:
                with path.open("x") as file:
                    file.write(self.name)
                return None
            except FileExistsError:
                owner = _read(path)
            if owner == self.name:
                return None
            if owner is None:
                continue
            if self.alive(owner):
                return owner
            logger.info("%s: the lock of %s is stale: taken over", work, self.described(owner))
            # Of two runs that see a stale claim one moves it away, and no other than the stale one.
            aside = path.with_suffix(f".{self.name}")
            with suppress(FileNotFoundError):
                os.rename(path, aside)
                if _read(aside) != owner:
                    with suppress(FileExistsError):
                        os.link(aside, path)
                aside.unlink()
        return owner or _UNKNOWN

    def owner(self, pattern: str) -> str | None:
        """Name of another run at work that has a claim of such a name; None if there is none."""
        names = (_read(path) for path in self.folder.glob(f"{pattern}{_CLAIM}"))
        return next((n for n in names if n and n != self.name and self.alive(n)), None)

    def described(self, name: str) -> str:
        """Process, machine and start of a run, and the file that stands for it."""
        host, process, _ = name.rsplit("-", 2)
        since = "at an unknown time"
        with suppress(OSError):
            since = self._file(name).read_text("utf-8", "replace") or since
        return f"process {process} on {host}, started {since} ({self._file(name)})"

    def alive(self, name: str) -> bool:
        """Whether a run still works, as far as can be seen from here."""
        host, process, start = name.rsplit("-", 2)
        touched = self._touched(name)
        if touched is None:
            return False
        if host == socket.gethostname():
            return _start(int(process)) == start
        # Both times are those of the file system: clocks of two machines may differ.
        return (self._touched(self.name) or time.time()) - touched < SILENCE

    def overdue(self, name: str) -> bool:
        """Whether a run on another machine, not yet given up, has missed a sign of life."""
        host, touched = name.rsplit("-", 2)[0], self._touched(name)
        now = self._touched(self.name) or time.time()
        return host != socket.gethostname() and touched is not None and now - touched > 2.0 * BEAT

    def _touched(self, name: str) -> float | None:
        """When the file of a run was touched last; None if there is no such file."""
        with suppress(FileNotFoundError):
            return self._file(name).stat().st_mtime
        return None

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}{_RUN}"

    def _beat(self) -> None:
        while not self._ended.wait(BEAT):
            with suppress(OSError):
                os.utime(self._file(self.name))


def process_name() -> str:
    """Name of this process among those of all machines: HOST-PROCESS-START."""
    return f"{socket.gethostname()}-{os.getpid()}-{_start(os.getpid())}"


def has_ended(name: str) -> bool:
    """Whether a process of this machine has ended, by its name; not of what is no such name."""
    match = _NAME.fullmatch(name)
    return match is not None and match[1] == socket.gethostname() and _start(match[2]) != match[3]


def _read(path: Path) -> str | None:
    """Name in a claim file, that of nobody where it is damaged; None if the file is gone."""
    for _ in range(10):
        try:
            if text := path.read_text("utf-8", "replace"):
                return text if _NAME.fullmatch(text) else _UNKNOWN
        except FileNotFoundError:
            return None
        time.sleep(0.01)
    return _UNKNOWN


def _start(process: int | str) -> str:
    """When a process of this machine started [clock ticks since the boot]; "" if it has ended."""
    try:
        words = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if words[0] in "ZX" else words[19]
