"""The error budget: a scene, its variants in the order of what they tell per second, their entries.

Of equal refinements nothing is known before: the cheapest is run first, and every setting is varied
once before any is varied twice. Costs are those that ``check`` estimates.

Of matched samples the bias is the median of their differences and the scatter their standard
deviation. Where the refinements of a resolution behave, the observed order, Richardson's value and
the Grid Convergence Index follow (P. J. Roache, J. Fluids Eng. 116 (1994) 405,
doi:10.1115/1.2910291; ASME V&V 20-2009, section 2).
"""

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pandas as pd

from brake_fenicsx.arguments import Array
from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.checks import check, with_patch, with_pixels
from brake_fenicsx.description import calibrated_seconds, work_of_a_second
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.results import ensemble_statistics, squeal, tables
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.samples.sampling import sample_count
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.scene.digest import laws_key

from . import budget_page, comparison, page
from .knobs import RESOLUTION, Knob, Variant, knobs
from .runs import Runs, or_note

REFERENCE = "reference"


# Of a family's least damped mode: column of modes.csv, its name in columns of the budget, unit.
VALUES = (("frequency_hz", "frequency", "_hz"), ("damping", "damping", ""))
SAFETY = 1.25  # of the index, for three grids
BOOTSTRAP = 400  # resamples
WHAT = "knob", "says", "kind", "variant", "change_made", "status", "reason", "approach", "family"
COUNTED = "family_variant", "frequency_hz", "samples", "samples_variant", "probability"
CHANGE = "probability_variant", "change", "change_low", "change_high", "paired"
MOVED = "frequency_bias_hz", "frequency_scatter_hz", "damping_bias", "damping_scatter"
LIMITS = "frequency_order", "frequency_limit_hz", "frequency_gci_hz", "damping_order"
LAST = "damping_limit", "damping_gci", "seconds", "memory_mb"
COLUMNS = *WHAT, *COUNTED, *CHANGE, *MOVED, *LIMITS, *LAST


@dataclass(frozen=True, slots=True)
class Limit:
    """Observed order [-], Richardson's value, and the index as an error of the finest value."""

    order: float
    value: float
    index: float


def richardson(coarse: float, middle: float, fine: float, ratio: float) -> Limit | None:
    """What three values of one ratio of refinement tend to; None where they do not settle.

    Args:
        coarse: value of the coarsest resolution.
        middle: of one ``ratio`` times as fine.
        fine: of one ``ratio**2`` times as fine.
        ratio: of two resolutions, larger than 1.
    """
    first, second = middle - coarse, fine - middle
    if first == 0.0 or not 0.0 < second / first < 1.0:
        return None
    order = float(np.log(first / second) / np.log(ratio))
    rest = second / (ratio**order - 1.0)
    return Limit(order, fine + rest, SAFETY * abs(rest))


def bias_and_scatter(a: Array, b: Array, paired: bool) -> tuple[float | None, float | None]:
    """Bias and scatter of b - a; the scatter only of paired values, at least two.

    Args:
        a: values of the scene's samples, shape (n,).
        b: of the variant's; of the same samples where they are paired.
        paired: whether they belong together one by one.
    """
    if not (a.size and b.size):
        return None, None
    if not paired:
        return float(np.median(b) - np.median(a)), None
    change = b - a
    return float(np.median(change)), float(change.std(ddof=1)) if change.size > 1 else None


def entries(scene: RunData, variant: RunData, may_pair: bool) -> list[page.Row]:
    """One row for all modes of an approach together and for each family of either run.

    Args:
        scene: results of the scene.
        variant: results of the variant.
        may_pair: whether the variant draws the same samples where its contact elements are the
            scene's.

    Raises:
        SceneError: a run holds no modes, or they have no approach in common.
    """
    rows = []
    for c in comparison.compare_runs(scene, variant, may_pair and _same_elements(scene, variant)):
        a, b, paired = c["family_a"], c["family_b"], c["paired"] == "yes"
        whole = a is None and b is None
        row = blank(
            status="run", approach=c["approach"], family="any" if whole else a, family_variant=b,
            samples=c["samples_a"], samples_variant=c["samples_b"],
            probability=c["probability_a"], probability_variant=c["probability_b"],
            **{name: c[name] for name in ("change", "change_low", "change_high", "paired")},
        )  # fmt: skip
        if not whole:
            row["frequency_hz"] = c["frequency_b_hz" if a is None else "frequency_a_hz"]
        if whole or None not in (a, b):
            sides = (scene, a), (variant, b)
            one, two = (family_values(run, c["approach"], family) for run, family in sides)
            if paired:
                one, two = one.align(two, join="inner", axis=0)
            # Of all modes together the least damped one may be another one.
            for column, name, unit in VALUES[1:] if whole else VALUES:
                x, y = one[column].to_numpy(), two[column].to_numpy()
                bias, scatter = bias_and_scatter(x, y, paired)
                row[f"{name}_bias{unit}"], row[f"{name}_scatter{unit}"] = bias, scatter
        rows.append(row)
    return rows


def statistical(scene: RunData) -> list[page.Row]:
    """The scene's own uncertainty: Wilson's interval, and a bootstrap of the medians."""
    rows = []
    for c in comparison.compare_runs(scene, scene):
        n, p, family = c["samples_a"], c["probability_a"], c["family_a"]
        row = blank(
            knob="samples", says="the number of samples", kind="statistics", status="run",
            variant="samples", change_made="one sample" if n == 1 else f"{n} samples",
            approach=c["approach"], family="any" if family is None else family,
            frequency_hz=c["frequency_a_hz"], samples=n, probability=p, change=0.0,
        )  # fmt: skip
        if n > 1:
            share = ensemble_statistics.wilson(round(p * n), n)
            row["change_low"], row["change_high"] = share.low - p, share.high - p
        if family is not None and n > 1:
            values = family_values(scene, c["approach"], family).to_numpy()
            drawn = np.random.default_rng(0).integers(0, len(values), (BOOTSTRAP, len(values)))
            scatter = np.median(values[drawn], axis=1).std(axis=0)
            row["frequency_scatter_hz"], row["damping_scatter"] = map(float, scatter)
        rows.append(row)
    return rows


def extrapolate(rows: list[page.Row], knob: str, ratio: float, scene: RunData) -> None:
    """Fill in order, limit and index of the second variant of a resolution, where it settles."""
    first, second = ([r for r in rows if r["variant"] == f"{knob}-{n}"] for n in (1, 2))
    before = {(r["approach"], r["family"]): r for r in first}
    for row in second:
        key = row["approach"], row["family"]
        if key not in before or key[1] in (None, "any"):
            continue
        values = family_values(scene, *key)
        for column, name, unit in VALUES:
            coarse, fine = before[key][f"{name}_bias{unit}"], row[f"{name}_bias{unit}"]
            if coarse is None or fine is None:
                continue
            start = float(values[column].median())
            limit = richardson(start, start + coarse, start + fine, ratio)
            if limit is None:
                reason = f"{name} does not settle: no order"
                row["reason"] = f"{row['reason']}; {reason}" if row["reason"] else reason
            else:
                row[f"{name}_order"], row[f"{name}_limit{unit}"] = limit.order, limit.value
                row[f"{name}_gci{unit}"] = limit.index


def blank(**cells: tables.Value) -> page.Row:
    """A row with some cells filled."""
    return dict.fromkeys(COLUMNS) | cells


def family_values(run: RunData, approach: str, family: int | None) -> pd.DataFrame:
    """Frequency [Hz] and damping [-] of a family's least damped mode, by number of the sample.

    Args:
        run: the results.
        approach: name of the approach.
        family: number of the family; None: all modes.
    """
    modes = run.squeal.modes(approach)
    own = squeal.least_damped(modes if family is None else modes[modes.family == family])
    return own[[column for column, *_ in VALUES]]


def _same_elements(one: RunData, two: RunData) -> bool:
    """Whether two runs have the same contact elements, so that element i draws the same."""
    if one.contact is None or two.contact is None:
        return True
    places = []
    for c in (one.contact, two.contact):
        first = (c["sample"] == c["sample"][0]) & (c["approach"] == c["approach"][0])
        places.append(np.column_stack([c[x][first] for x in "xyz"]))
    a, b = places
    # Gmsh's vertices agree to its tolerance of geometry.
    return a.shape == b.shape and bool(np.allclose(a, b, atol=1e-6, rtol=0.0))


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
    logger.info("%s", budget_page.sentence(rows))
    return on_first(lambda: budget_page.write_budget_page(folder, rows, Path(scene).stem), comm)


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
) -> list[page.Row]:
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
    tables.write_rows(runs.folder / "budget.csv", COLUMNS, rows)
    return rows


def _about(knob: Knob) -> page.Row:
    return {"knob": knob.name, "says": knob.says, "kind": knob.kind}
