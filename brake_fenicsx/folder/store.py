"""The results folder: files appear whole, a killed run finds its own, and tells how far it is.

A run enters it alone, or as one of several shares of the samples.

scene.toml            the scene as run, with the hash of what its results depend on
running/              the runs at work in the folder (lock.py)
surface.npz laws.npz  stages surface and micro
cache/                what all samples share (interface compliance, reduced basis)
samples/              finished samples (sample_files.py)
"""

from __future__ import annotations

import json
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from brake_fenicsx.errors import SceneError

from .files import ResultFiles, emptied, remove_remains
from .lock import BEAT, Lock, Share
from .log import logger, time_text
from .processes import on_first
from .sample_files import FOLDER as SAMPLES
from .sample_files import SampleFiles, Task

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")

# What to forget when a stage is run again; later stages lose theirs too.
RUNNING, MARK = "running", "scene.sha256"
FOLDER, SHARE = "folder", "share"  # what a run claims
PREPARED = "cache/prepared.json"  # approaches whose samples have all that they share
_FILES = {
    "surface": "surface.npz",
    "micro": "laws.npz zones contact_maps.npz",
    "equilibrium": "cache samples",
    "stability": "cache samples",
    "uncertainty": "samples",
    "report": "figures fields report.html contact_faces.npz laws.csv artificial_surface.csv"
    " artificial_surface.npz",
}

# What is made of the samples and the lines of a sweep at the end of every run.
MADE_OF_SAMPLES = """samples.csv modes.csv modes.parquet contact.csv contact.npz drivers.csv
    drivers_contact.csv probabilities.csv convergence.csv sensitivity.csv causes.npz shapes.npz
    sweep.npz sweep.csv lock_in.csv chart.csv critical.csv critical_curve.csv
    mode_shapes.npz"""


class Store(ResultFiles):
    """One results folder.

    Attributes:
        lock: of the run on its first process; None elsewhere.
        share: the part of the samples that this run computes; all of them if None.
        samples: the finished samples.
    """

    def __init__(self, directory: Path):
        super().__init__(directory)
        self.lock: Lock | None = None
        self.share: Share | None = None
        self.samples: SampleFiles = SampleFiles(self)

    def check(self, digest: str) -> None:
        """Refuse a folder that holds results of another scene, or something else.

        Args:
            digest: hash of the scene.

        Raises:
            SceneError: the folder's scene differs in more than stages and number of samples; the
                folder is none, or holds files that are no results.
        """
        self.digest = digest
        folder, remedy = self.directory, "choose another folder with -o"
        if folder.is_symlink() and not folder.exists():
            to = os.readlink(folder)
            raise SceneError(f"-o {folder}: a broken symbolic link (to {to}); {remedy}")
        mark = self._mark()
        if mark == digest:
            return
        known = self.samples.scene()
        if known == digest:
            logger.warning("%s: damaged or lost; the samples are of this scene", self.path(MARK))
        elif mark or known:
            raise SceneError(f"""{folder}: contains results of another scene, or of other content of
                a file that it names; {remedy}""")
        elif mark is not None:
            raise SceneError(f"""{self.path(MARK)}: damaged, and no sample says which scene the
                folder is of; {remedy}, or remove the folder""")
        elif found := sorted(p.name for p in folder.glob("[!.]*") if p.name != RUNNING):
            raise SceneError(f"-o {folder}: contains {found[0]!r} and no results; {remedy}")

    def _mark(self) -> str | None:
        """Hash of the scene as the folder has it; "" of one that is damaged, None without."""
        path = self.path(MARK)
        text = path.read_text("utf-8", "replace").strip() if path.is_file() else None
        return text if text is None or re.fullmatch("[0-9a-f]{64}", text) else ""

    def known(self) -> str:
        """Hash of the scene of the folder; "" where nothing tells it."""
        return self.samples.scene() or self._mark() or ""

    def open(self, scene: str, from_stage: str | None = None) -> None:
        """Make the folder, or enter it; forget what ``from_stage`` and later stages left.

        Args:
            scene: text of the scene's file.
            from_stage: a stage, or None.
        """
        self.directory.mkdir(parents=True, exist_ok=True)
        if from_stage is not None:
            later = list(_FILES)[list(_FILES).index(from_stage) :]
            for name in dict.fromkeys(file for stage in later for file in _FILES[stage].split()):
                emptied(self.path(name))
            self.samples = SampleFiles(self)
        remove_remains(self.directory)
        self.write_text(MARK, self.digest)
        for name in ("cache", "samples"):
            self.path(name).mkdir(exist_ok=True)
        self.write_text("scene.toml", scene)

    def forget_tables(self) -> None:
        """Remove the tables of an earlier run, of which this one may not make all."""
        for name in MADE_OF_SAMPLES.split():
            self.path(name).unlink(missing_ok=True)


def check_folder(store: Store, digest: str, comm: MPI.Comm) -> None:
    """Refuse a folder of another scene; collective.

    The first process alone looks into it: it may be writing there already while others look.

    Args:
        store: the folder.
        digest: hash of the scene.
        comm: processes of the run.

    Raises:
        SceneError: as ``Store.check``.
    """
    _on_first(lambda: store.check(digest), store, comm)
    store.digest = digest


def open_folder(store: Store, scene: str, from_stage: str | None, comm: MPI.Comm) -> None:
    """Make or enter the results folder and have it alone; collective.

    Args:
        store: the folder.
        scene: text of the scene's file.
        from_stage: stage whose results are forgotten, with those of all later ones.
        comm: processes of the run.

    Raises:
        SceneError: it cannot be written, belongs to another scene, or another run is in it.
    """

    def work() -> None:
        _take(store, FOLDER, f"{SHARE}-*")
        # Another run may have been quicker with another scene.
        store.check(store.digest)
        store.open(scene, from_stage)

    _on_first(work, store, comm)


def enter_prepared(store: Store, wanted: Sequence[str], command: str, comm: MPI.Comm) -> None:
    """Enter a folder that was prepared, to compute a share of its samples; collective.

    Args:
        store: the folder, with the share.
        wanted: approaches of the scene.
        command: what prepares the folder.
        comm: processes of the run.

    Raises:
        SceneError: it was not prepared for all approaches; another run has it, or this share.
    """

    def work() -> None:
        mark = store.path(PREPARED)
        missing = {*wanted} - {*(json.loads(mark.read_text("utf-8")) if mark.exists() else ())}
        if missing:
            raise SceneError(f"""-o {store.directory}: not prepared for
                {", ".join(sorted(missing))}; {command}, with the same changes, makes what all
                shares need""")
        _take(store, f"{SHARE}-{store.share}".replace(" ", "-"), FOLDER)

    _on_first(work, store, comm)


def _take(store: Store, claim: str, others: str) -> None:
    """Take the claim, where no other run has it or one of the others."""
    store.lock = lock = Lock(store.path(RUNNING))
    while owner := lock.claim(claim) or lock.owner(others):
        if not lock.overdue(owner):
            break
        logger.info("waiting for a sign of life, or the end of it: %s", lock.described(owner))
        time.sleep(BEAT)
    else:
        return
    raise SceneError(f"""-o {store.directory}: another run is at work there,
        {lock.described(owner)}; wait for its end or stop it, or choose another folder; to divide
        the samples among runs, see `prepare` and --share""")


def _on_first(work: Callable[[], T], store: Store, comm: MPI.Comm) -> T:
    """What the first process does in the folder; what goes wrong there is raised on all."""

    def guarded() -> T:
        try:
            return work()
        except OSError as error:
            why = error.strerror or str(error)
            raise SceneError(f"""-o {store.directory}: cannot be written ({why}); choose another
                folder with -o""") from None

    return on_first(guarded, comm)


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
        lines = [f"samples: {', '.join(counts) or 'none'}"]
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
    each = _seconds_each(store.path(SAMPLES)) if workers and left else None
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
