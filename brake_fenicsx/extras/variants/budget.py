"""The error budget: a scene, and its variants in the order of what they tell per second.

Of equal refinements nothing is known before: the cheapest is run first, and every setting is varied
once before any is varied twice. Costs are those that ``check`` estimates.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from mpi4py import MPI

from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.checks import check, with_patch, with_pixels
from brake_fenicsx.description import calibrated_seconds, work_of_a_second
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.results.run import read_run
from brake_fenicsx.results.tables import write_rows
from brake_fenicsx.samples.sampling import sample_count
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.scene.digest import laws_key

from .budget_page import sentence, write_budget_page
from .entries import COLUMNS, blank, entries, extrapolate, statistical
from .knobs import RESOLUTION, Knob, Variant, knobs
from .page import Row
from .runs import Runs, or_note

REFERENCE = "reference"


@dataclass(frozen=True, slots=True)
class Planned:
    """A variant: its folder's name, the knob, its estimated cost [s], and why it is refused.

    ``changes`` are the replacements "key=value" of its run. Its samples are ``paired`` with the
    scene's, number by number.
    """

    name: str
    knob: Knob
    variant: Variant
    changes: tuple[str, ...]
    seconds: float
    refused: str = ""
    paired: bool = False


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
        minutes: time for all of it [min]; variants that do not fit are left out, and one that is
            not done by then is stopped. The scene itself is always run.

    Returns:
        The page.

    Raises:
        SceneError: the scene is wrong, or cannot have a budget.
        BrakeError: the run of the scene itself failed; that of a variant is a row that says so.
    """
    start = time.perf_counter()
    if minutes is not None and not minutes > 0:
        raise SceneError(f"--minutes {minutes:g}: write a positive number")
    folder = Path(directory or f"{Path(scene).stem}-budget")
    runs = Runs(scene, comm, folder, [*overrides, *_lean(scene, overrides)], cache)
    runs.run(REFERENCE)
    varied, planned = plan(runs)
    why = {p.name: p.refused for p in planned if p.refused}
    for p in planned:
        if p.refused or runs.is_done(p.name, p.changes):
            continue
        left = None
        if minutes is not None:
            left = comm.bcast(60.0 * minutes - (time.perf_counter() - start), root=0)
            if p.seconds > left:
                why[p.name] = f"no time is left for about {p.seconds:.0f} s"
                continue
        _, note = or_note(partial(runs.run, p.name, p.changes, left))
        if note:
            why[p.name] = " ".join(note.split())
        on_first(lambda: _write(runs, varied, planned, why), comm)
    rows = on_first(lambda: _write(runs, varied, planned, why), comm)
    logger.info("%s", sentence(rows))
    return on_first(lambda: write_budget_page(folder, rows, Path(scene).stem), comm)


def _lean(file: str | Path, overrides: Sequence[str]) -> list[str]:
    """Replacements that leave out what costs time and changes no result of a sample.

    Raises:
        SceneError: the scene cannot have a budget.
    """
    scene = read_scene(file, overrides)
    if not {"equilibrium", "stability"} <= set(scene.stages):
        raise SceneError(f"{file}: stages: a budget needs 'equilibrium' and 'stability'")
    if scene.sweep is not None:
        raise SceneError(f"{file}: sweep: a budget has none; remove [sweep]")
    stages = json.dumps([name for name in scene.stages if name != "report"])
    return [f"stages={stages}", "stability.verify=0", "stability.drivers=false"]


def plan(runs: Runs) -> tuple[list[Knob], list[Planned]]:
    """All knobs of the scene, and its variants in the order in which they are run; collective.

    Args:
        runs: those of a folder in which the scene itself was run.
    """
    comm, scene = runs.comm, runs.read()
    path = runs.folder / REFERENCE / "summary.json"
    sizes, work = on_first(lambda: (json.loads(path.read_text()), work_of_a_second()), comm)
    stats = check(scene, comm).get("surface")
    patch = 1e-3 * float(sizes["mean_patch_mm"])
    own = with_pixels(with_patch(scene, patch), stats)
    pixels = int(own.micro.pixels) if own.micro and stats and "micro" in own.stages else None
    # A variant that falls back to full order is no variant of the scene's computation.
    falls_back = scene.stability is not None and scene.stability.on_tolerance == "full order"
    no_fall_back = ('stability.on_tolerance="warn"',) if falls_back else ()
    found, planned = knobs(scene, pixels), []
    for i, knob in enumerate(found):
        for n, variant in enumerate(knob.variants, 1):
            about = f"{knob.name}-{n}", knob, variant, (*variant.overrides, *no_fall_back)
            try:
                other = runs.read(variant.overrides)
                read = stats if other.surface == scene.surface else read_surface(other)
                other = with_pixels(with_patch(other, patch / variant.elements**0.5), read)
            except SceneError as error:
                planned.append((n, Planned(*about, 0.0, str(error))))
                continue
            samples = _samples(other)
            if not knob.perfect and max(samples.values()) < max(_samples(scene).values()):
                found[i] = replace(knob, variants=(), reason="nothing is random without it")
                break
            size = sizes["dofs"] * variant.dofs, sizes["contact_elements"] * variant.elements
            stages = calibrated_seconds(other, samples, *size, work)
            if laws_key(other) == laws_key(own):
                stages.pop("micro", None)
            # Random heights are drawn for each point of a law.
            paired = knob.paired and (
                own.micro is None or other.micro is None or other.micro.pixels == own.micro.pixels
            )
            planned.append((n, Planned(*about, sum(stages.values()), paired=paired)))
    return found, [p for _, p in sorted(planned, key=lambda item: (item[0], item[1].seconds))]


def _samples(scene: Scene) -> dict[str, int]:
    return {name: sample_count(scene, name) for name in scene.samples.approaches}


def _write(
    runs: Runs, varied: list[Knob], planned: list[Planned], why: dict[str, str]
) -> list[Row]:
    """The table of what has been run so far."""
    scene = read_run(runs.folder / REFERENCE)
    rows = statistical(scene)
    for p in planned:
        about = _about(p.knob) | {"variant": p.name, "change_made": p.variant.says}
        if p.name in why or not runs.is_done(p.name, p.changes):
            rows.append(blank(**about, status="not run", reason=why.get(p.name, "not yet")))
            continue
        took = runs.record[p.name]
        about |= {"seconds": round(took["seconds"], 1), "memory_mb": took["memory_mb"]}
        changed = entries(scene, read_run(runs.folder / p.name), p.paired)
        rows += [r | about for r in changed if not p.knob.perfect or r["approach"] == "classical"]
    for knob in varied:
        if knob.kind == RESOLUTION:
            extrapolate(rows, knob.name, knob.ratio, scene)
        if not knob.variants:
            rows.append(blank(**_about(knob), status="not run", reason=knob.reason))
    write_rows(runs.folder / "budget.csv", COLUMNS, rows)
    return rows


def _about(knob: Knob) -> Row:
    return {"knob": knob.name, "says": knob.says, "kind": knob.kind}
