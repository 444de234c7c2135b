"""A run as it goes from stage to stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from brake_fenicsx.folder.cache import SharedCache
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.processes import peak_memory
from brake_fenicsx.folder.store import Store
from brake_fenicsx.folder.termination import end_of_stage
from brake_fenicsx.scene import Scene


@dataclass(slots=True)
class Run:
    """A run as it goes: what the stages hand on.

    Attributes:
        scene: the scene.
        comm: processes of the run.
        store: its results folder.
        cache: what it shares with others.
        seconds: time of each stage [s].
        peak_memory_mb: peak memory of a node after each stage [MB].
        process_memory_mb: the same of a process.
        facts: sizes and figures for the summary.
        prepare: whether the run ends before the samples.
        pictures: whether figures, mode shapes and the mesh are drawn.
    """

    scene: Scene
    comm: MPI.Comm
    store: Store
    cache: SharedCache
    seconds: dict[str, float] = field(default_factory=dict)
    peak_memory_mb: dict[str, float] = field(default_factory=dict)
    process_memory_mb: dict[str, float] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    prepare: bool = False
    pictures: bool = True

    @property
    def whole(self) -> bool:
        """Whether the run ends with tables and page."""
        return not self.prepare and self.store.share is None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Log and time a stage."""
        logger.info("stage '%s' ...", name)
        start = time.perf_counter()
        yield
        self.comm.Barrier()
        self.seconds[name] = time.perf_counter() - start
        self.process_memory_mb[name], self.peak_memory_mb[name] = peak_memory(self.comm)
        logger.info(
            "stage '%s' finished in %.1f s (peak memory %.0f MB)",
            name,
            self.seconds[name],
            self.peak_memory_mb[name],
        )
        release_memory()
        end_of_stage(self.comm)

    @property
    def page(self) -> Path | None:
        """The page of results; None without the stage report."""
        return self.store.path("report.html") if "report" in self.scene.stages else None

    def outcome(self) -> dict[str, Any]:
        """How the run ended, for other programs."""
        good = {name: about["good"] for name, about in self.facts.get("samples", {}).items()}
        return {
            "directory": str(self.store.directory.resolve()),
            "page": None if self.page is None else str(self.page.resolve()),
            "good_samples": good,
            "failed_samples": self.facts.get("failed_samples", 0),
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
        }

    def ending(self) -> str:
        """How the run ended, and where to look."""
        if not self.whole:
            what = "prepared" if self.prepare else f"share {self.store.share} done"
            return f"{what}; `run` without --share makes tables and page of {self.store.directory}"
        outcome = self.outcome()
        said = "done"
        if failed := outcome["failed_samples"]:
            of = failed + sum(outcome["good_samples"].values())
            said += f", {failed} of {of} samples failed: see {self.store.path('samples.csv')}"
        look = f"results are in {self.store.directory}"
        return f"{said}; {look if self.page is None else f'open {self.page}'}"


def note_warnings(this: Run, lines: list[str]) -> None:
    """Log what is most probably not meant, each once, and keep it for the page."""
    known = this.facts.setdefault("warnings", [])
    for text in lines:
        if text not in known:
            logger.warning("%s", text)
            known.append(text)
