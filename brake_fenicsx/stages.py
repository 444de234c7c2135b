"""A run as it goes from stage to stage: what it hands on, its log, its summary and its ending."""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mpi4py import MPI

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.folder import files, processes
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.store import Store
from brake_fenicsx.libraries import versions
from brake_fenicsx.results.answer import STAGES
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.digest import in_effect


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
    cache: files.SharedCache
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
        """Log and time a stage, without the seconds of stages within it."""
        title = STAGES.get(name, name)
        logger.info("%s ...", title)
        start, before = time.perf_counter(), sum(self.seconds.values())
        yield
        self.comm.Barrier()
        elapsed = time.perf_counter() - start - (sum(self.seconds.values()) - before)
        self.seconds[name] = self.seconds.get(name, 0.0) + elapsed
        self.process_memory_mb[name], self.peak_memory_mb[name] = processes.peak_memory(self.comm)
        numbers = self.seconds[name], self.peak_memory_mb[name]
        logger.info("%s: done in %.1f s (peak memory %.0f MB)", title, *numbers)
        processes.release_memory()
        processes.end_of_stage(self.comm)

    def warn(self, lines: Iterable[str]) -> None:
        """Log what is most probably not meant, each line once, and keep it for the page."""
        known = self.facts.setdefault("warnings", [])
        for text in lines:
            if text not in known:
                logger.warning("%s", text)
                known.append(text)

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

    def refuse_if_all_failed(self) -> None:
        """A run without a single good sample is no result, whatever page it has; collective.

        Raises:
            BrakeError: how many failed, and where their errors are.
        """
        good = sum(about["good"] for about in self.facts.get("samples", {}).values())
        failed = self.comm.bcast(0 if good else self.facts.get("failed_samples", 0), root=0)
        if failed:
            raise BrakeError(f"""all samples failed ({failed} of {failed});
                {self.store.path("samples.csv")} names the error of each, and --from uncertainty
                computes them again""")

    def write_summary(self) -> None:
        """summary.json: settings, sizes, times, versions."""
        # Once: the page, written after the first summary, carries this date.
        self.facts.setdefault("finished", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")
        seeds = {"samples": self.scene.samples.seed}
        if self.scene.micro is not None:
            seeds["laws"] = self.scene.micro.seed
        summary = {
            "name": self.scene.file.stem, "scene_sha256": self.store.digest, **self.facts,
            "processes": self.comm.size,
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
            "peak_memory_mb": {name: round(v) for name, v in self.peak_memory_mb.items()},
            "process_memory_mb": {name: round(v) for name, v in self.process_memory_mb.items()},
            "seeds": seeds, "versions": versions(), "settings": self.scene.table,
            "in_effect": in_effect(self.scene),
        }  # fmt: skip
        self.store.save_json("summary.json", summary)
