"""The runs of a budget: the scene, and its variants in the order of what they tell per second.

Of equal refinements nothing is known before: the cheapest is run first, and every knob is turned
once before any is turned twice. Costs are those of ``costs.py``, scaled to what the scene took.
"""

from __future__ import annotations

import gc
import json
import resource
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

from brake_fenicsx import pipeline
from brake_fenicsx.checks import check, read_surface, with_patch, with_pixels
from brake_fenicsx.costs import count_solves, estimate
from brake_fenicsx.errors import BrakeError, SceneError, StorageError
from brake_fenicsx.folder.cache import laws_key
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.store import result_digest
from brake_fenicsx.report.budget_page import sentence, write_budget_page
from brake_fenicsx.results.run import read_run
from brake_fenicsx.results.tables import write_rows
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.uncertainty.sampling import sample_count

from .entries import COLUMNS, Row, blank, entries, extrapolate, statistical
from .knobs import RESOLUTION, Knob, Variant, knobs

REFERENCE, RECORD = "reference", "runs.json"


@dataclass(frozen=True, slots=True)
class Planned:
    """A variant: its folder's name, the knob, its estimated cost [s], and why it is refused.

    Its samples are ``paired`` with the scene's, number by number.
    """

    name: str
    knob: Knob
    variant: Variant
    seconds: float
    refused: str = ""
    paired: bool = False


class Budget:
    """The runs of one folder, collective; process 0 keeps the record of those that are done."""

    def __init__(
        self, scene: str | Path, comm: MPI.Comm, directory: Path, overrides: Sequence[str],
        cache: Path,
    ):  # fmt: skip
        self.file, self.comm, self.directory, self.cache = scene, comm, directory, cache
        parsed = read_scene(scene, overrides)
        if not {"equilibrium", "stability"} <= set(parsed.stages):
            raise SceneError(f"{scene}: stages: a budget needs 'equilibrium' and 'stability'")
        if parsed.sweep is not None:
            raise SceneError(f"{scene}: sweep: a budget has none; remove [sweep]")
        stages = [name for name in parsed.stages if name != "report"]
        # What costs time and changes no result of a sample.
        lean = [f"stages={json.dumps(stages)}", "stability.verify=0", "stability.drivers=false"]
        self.overrides = [*overrides, *lean]
        self.scene = read_scene(scene, self.overrides)
        self.record: dict[str, Any] = {}
        self.held = comm.allreduce(_resident())
        if comm.rank == 0:
            with suppress(FileNotFoundError, ValueError):
                self.record = json.loads((directory / RECORD).read_text())
        self.record = comm.bcast(self.record, root=0)

    def is_done(self, name: str, overrides: Sequence[str] = ()) -> bool:
        """Whether a run is finished, of the scene as it is now."""
        return (
            self.record.get(name, {}).get("asked") == self._asked(overrides)
            and "error" not in self.record[name]
        )

    def run(self, name: str, overrides: Sequence[str] = ()) -> None:
        """Run the scene with some keys replaced, and record what it took; collective.

        Raises:
            BrakeError: the run failed.
        """
        logger.info("budget: %s ...", name)
        left = self.comm.allreduce(_resident()) - self.held
        start = time.perf_counter()
        entry: dict[str, Any] = {"asked": self._asked(overrides)}
        try:
            done = pipeline.run(
                self.file, self.comm, self.directory / name, [*self.overrides, *overrides],
                cache=self.cache,
            )  # fmt: skip
        except BrakeError as error:
            self._keep(name, entry | {"error": " ".join(str(error).split())})
            raise
        entry["memory_mb"] = round(max(done.peak_memory_mb.values()) - max(left, 0.0))
        entry["seconds"] = self.comm.bcast(time.perf_counter() - start, root=0)
        self._keep(name, entry)

    def _keep(self, name: str, entry: dict[str, Any]) -> None:
        self.record[name] = entry
        if self.comm.rank == 0 and self.directory.is_dir():
            part = self.directory / f".{RECORD}.part"
            part.write_text(json.dumps(self.record, indent=1))
            part.replace(self.directory / RECORD)

    def _asked(self, overrides: Sequence[str]) -> str:
        scene = read_scene(self.file, [*self.overrides, *overrides])
        samples = scene.table.get("samples", {})
        return scene.hash([result_digest(scene), {**samples, "random": None}])


def run_budget(
    scene: str | Path,
    comm: MPI.Comm,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    cache: str | Path | None = None,
    minutes: float | None = None,
) -> Path:
    """Run a scene and its variants, and write budget.csv and budget.html; collective.

    Args:
        scene: path of the scene.
        comm: processes of the runs.
        directory: folder of the budget; SCENE-budget in the working directory if not given.
        overrides: "key=value" replacements in the scene.
        cache: folder of laws and reduced models that the runs share; DIR/cache if not given.
        minutes: time for all of it [min]; variants that do not fit are left out. The scene itself
            is always run.

    Returns:
        The page.

    Raises:
        SceneError: the scene is wrong, or cannot have a budget.
        BrakeError: the run of the scene itself failed; that of a variant is a row that says so.
    """
    start = time.perf_counter()
    if minutes is not None and not minutes > 0:
        raise SceneError(f"--minutes {minutes:g}: write a positive number")
    folder = Path(directory) if directory else Path.cwd() / f"{Path(scene).stem}-budget"
    budget = Budget(scene, comm, folder, overrides, Path(cache) if cache else folder / "cache")
    if not budget.is_done(REFERENCE):
        budget.run(REFERENCE)
    found, planned = plan(budget)
    why = {p.name: p.refused for p in planned if p.refused}
    for p in planned:
        if p.refused or budget.is_done(p.name, p.variant.overrides):
            continue
        spent = comm.bcast(time.perf_counter() - start, root=0)
        if minutes is not None and spent + p.seconds > 60.0 * minutes:
            why[p.name] = f"time: about {p.seconds:.0f} s"
            continue
        try:
            budget.run(p.name, p.variant.overrides)
        except StorageError:
            raise
        except BrakeError as error:
            logger.warning("budget: %s failed: %s", p.name, error)
            why[p.name] = " ".join(str(error).split())
        if comm.rank == 0:
            _write(budget, found, planned, why)
    if comm.rank == 0:
        logger.info("%s", sentence(_write(budget, found, planned, why)))
    comm.Barrier()
    return folder / "budget.html"


def plan(budget: Budget) -> tuple[list[Knob], list[Planned]]:
    """All knobs of the scene, and its variants in the order in which they are run; collective.

    Args:
        budget: one whose scene was run.
    """
    comm, scene = budget.comm, budget.scene
    text = None
    if comm.rank == 0:
        text = (budget.directory / REFERENCE / "summary.json").read_text()
    sizes = json.loads(comm.bcast(text, root=0))
    stats = check(scene, comm)
    patch = 1e-3 * float(sizes["mean_patch_mm"])
    own = with_pixels(with_patch(scene, patch), stats)
    pixels = int(own.micro.pixels) if own.micro and stats and "micro" in own.stages else None
    found = knobs(scene, pixels)
    total = sum(_seconds(own, sizes, Variant((), "")).values())
    scale = budget.record[REFERENCE]["seconds"] / max(total, 1.0)
    planned = []
    for i, knob in enumerate(found):
        for n, variant in enumerate(knob.variants, 1):
            name = f"{knob.name}-{n}"
            try:
                other = read_scene(budget.file, [*budget.overrides, *variant.overrides])
                read = stats if other.surface == scene.surface else read_surface(other)
                other = with_pixels(with_patch(other, patch / variant.elements**0.5), read)
            except SceneError as error:
                planned.append((n, Planned(name, knob, variant, 0.0, str(error))))
                continue
            if not knob.perfect and _most(other) < _most(scene):
                found[i] = replace(knob, variants=(), reason="nothing is random without it")
                break
            stages = _seconds(other, sizes, variant)
            if laws_key(other) == laws_key(own):
                stages.pop("micro", None)
            # Random heights are drawn for each point of a law.
            paired = knob.paired and (
                own.micro is None or other.micro is None or other.micro.pixels == own.micro.pixels
            )
            cost = scale * sum(stages.values())
            planned.append((n, Planned(name, knob, variant, cost, paired=paired)))
    return found, [p for _, p in sorted(planned, key=lambda item: (item[0], item[1].seconds))]


def _seconds(scene: Scene, sizes: dict[str, Any], variant: Variant) -> dict[str, float]:
    """Estimated seconds of the stages of a scene with the sizes of a mesh, refined."""
    samples = {name: sample_count(scene, name) for name in scene.samples.approaches}
    counts = replace(
        count_solves(scene, samples), dofs=int(sizes["dofs"] * variant.dofs),
        elements=int(sizes["contact_elements"] * variant.elements),
    )  # fmt: skip
    return {cost.stage: cost.seconds for cost in estimate(scene, counts)}


def _most(scene: Scene) -> int:
    """Samples of the approach that has most."""
    return max(sample_count(scene, name) for name in scene.samples.approaches)


def _write(
    budget: Budget, found: list[Knob], planned: list[Planned], why: dict[str, str]
) -> list[Row]:
    """Table and page of what has been run so far."""
    scene = read_run(budget.directory / REFERENCE)
    rows = statistical(scene)
    for p in planned:
        about: Row = {
            "knob": p.knob.name, "says": p.knob.says, "kind": p.knob.kind, "variant": p.name,
            "change_made": p.variant.says,
        }  # fmt: skip
        if p.name in why or not budget.is_done(p.name, p.variant.overrides):
            rows.append(blank(**about, status="not run", reason=why.get(p.name, "not yet")))
            continue
        took = budget.record[p.name]
        about |= {"seconds": round(took["seconds"], 1), "memory_mb": took["memory_mb"]}
        changed = entries(scene, read_run(budget.directory / p.name), p.paired)
        own = [r for r in changed if not p.knob.perfect or r["approach"] == "classical"]
        rows += [r | about for r in own]
    for knob in found:
        if knob.kind == RESOLUTION and knob.variants:
            extrapolate(rows, knob.name, knob.ratio, scene)
        if not knob.variants:
            rows.append(blank(knob=knob.name, says=knob.says, kind=knob.kind, status="not run",
                              reason=knob.reason))  # fmt: skip
    write_rows(budget.directory / "budget.csv", COLUMNS, rows)
    write_budget_page(budget.directory, rows, budget.scene.file.stem)
    return rows


def _resident() -> float:
    """Memory that this process holds between two runs [MB]; its peak begins anew from here.

    Matrices of a run may outlive it; what is held when a run begins is no part of its peak.
    """
    gc.collect()
    release_memory()
    with suppress(OSError):  # Where the system is no Linux, nothing is taken off.
        Path("/proc/self/clear_refs").write_text("5")
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * resource.getpagesize() / 2**20
    return 0.0
