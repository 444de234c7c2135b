"""How far a run is: samples done, who is at work, time to go; nothing is written."""

import json
import re
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from brake_fenicsx.errors import SceneError

from .lock import Lock, Share
from .log import time_text
from .sample_files import FOLDER, SampleFiles, Task
from .store import PREPARED, RUNNING, SHARE, Store

LATEST = 20  # files of samples whose times tell the present rate


@dataclass(frozen=True, slots=True)
class Worker:
    """A run that is at work in a folder.

    Attributes:
        run: its process, machine and start.
        share: its part of the samples, "3 of 16"; None of a run of all.
        done: samples of its part that are stored.
        of: samples of its part; None where the number is not known.
    """

    run: str
    share: str | None
    done: int
    of: int | None


@dataclass(frozen=True, slots=True)
class Status:
    """How far a run is; ``asdict`` gives it to other programs.

    Attributes:
        done: samples that are stored, by approach.
        of: samples of the scene, by approach; empty before the first sample.
        workers: runs at work.
        ended: whether tables of the results are there.
        seconds_to_go: at the present rate [s]; None where nobody is at work or nothing is known.
        log: last line of the newest log, with its time.
    """

    done: dict[str, int]
    of: dict[str, int]
    workers: list[Worker]
    ended: bool
    seconds_to_go: float | None
    log: str

    def text(self) -> str:
        """What there is to say, a line for each thing."""
        of = {approach: f" of {n}" for approach, n in self.of.items()}
        counts = (f"{a} {self.done.get(a, 0)}{of.get(a, '')}" for a in self.of or self.done)
        lines = [f"samples: {', '.join(counts) or 'not begun'}"]
        for worker in self.workers:
            part = "all samples" if worker.share is None else f"share {worker.share}"
            count = "" if worker.of is None else f", {worker.done} of {worker.of} done"
            lines.append(f"at work: {worker.run}: {part}{count}")
        if not self.workers:
            lines.append("at work: nobody" + ("; the results are there" if self.ended else ""))
        if self.seconds_to_go is not None:
            lines.append(f"time to go: about {time_text(self.seconds_to_go)} for the samples")
        return "\n".join([*lines, *([f"log: {self.log}"] if self.log else [])])


def read_status(directory: str | Path) -> Status:
    """How far the run of a results folder is.

    Args:
        directory: the folder.

    Raises:
        SceneError: no results folder, or a damaged file.
    """
    store = Store(Path(directory))
    store.digest = store.known()
    if not store.digest:
        raise SceneError(f"{directory}: no results folder; give the one that a run wrote")
    there, mark = SampleFiles(store).present(), store.path(PREPARED)
    of = json.loads(mark.read_text("utf-8")) if mark.is_file() else {}
    of = of if isinstance(of, dict) else {}
    tasks = [(name, k) for name, n in of.items() for k in range(n)]
    done = dict(sorted(Counter(name for name, _ in there).items()))
    workers = _workers(store, tasks, there)
    left = len({*tasks} - there)
    each = _seconds_each(store.path(FOLDER)) if workers and left else None
    ended = any(store.path(f"modes.{kind}").is_file() for kind in ("csv", "parquet"))
    return Status(done, of, workers, ended and not workers, each and each * left, _last(store))


def _workers(store: Store, tasks: list[Task], there: set[Task]) -> list[Worker]:
    workers = []
    for name, claim in Lock.watched(store.path(RUNNING)):
        numbers = re.fullmatch(rf"{SHARE}-(\d+)-of-(\d+)", claim)
        share = Share(int(numbers[1]), int(numbers[2])) if numbers else None
        own = {*(share.part(tasks) if share else tasks)}
        of = len(own) if tasks else None
        workers.append(Worker(name, str(share) if share else None, len(own & there), of))
    return workers


def _seconds_each(folder: Path) -> float | None:
    """Seconds for one sample at the present rate, by the times of the latest files."""
    times = sorted((p.stat().st_mtime for p in folder.glob("*.npz")), reverse=True)[:LATEST]
    return (time.time() - times[-1]) / (len(times) - 1) if len(times) > 1 else None


def _last(store: Store) -> str:
    """Last line of the log that was written last."""
    logs = sorted(store.directory.glob("log*.txt"), key=lambda p: p.stat().st_mtime)
    return next(iter(reversed(logs[-1].read_text("utf-8").splitlines())), "") if logs else ""
