"""What would stop the squeal: the smallest change of each countermeasure, verified by a run.

The worst family of the rough samples is the one that squeals in most of them. A change is enough
where it squeals in so few that, with 95 % confidence, it does in at most 5 % of all.
"""

import gc
import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from brake_fenicsx.build.brake import check_brake
from brake_fenicsx.build.values import Values
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder import files, processes, store
from brake_fenicsx.folder.log import logger
from brake_fenicsx.model import Model, prepare
from brake_fenicsx.results.ensemble_statistics import Proportion, wilson
from brake_fenicsx.results.run import read_run
from brake_fenicsx.samples import sampling
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import result_digest
from brake_fenicsx.scene.samples_section import ROUGH, is_constant, split_key
from brake_fenicsx.scene.scalars import changes_bodies

from .comparison import compare_runs, write_comparison
from .countermeasure_keys import Countermeasure
from .countermeasures_page import COLUMNS, countermeasures_text, share_cells, write_countermeasures
from .page import Row
from .runs import Runs, or_note
from .trial import MOST, Trial, Worst, few, limits, needed, smallest_change, worst_family

# Values tried from the scene's one outward, and accuracy of the smallest change relative to the
# whole range.
STEPS, ACCURACY = 8, 0.01
OUTCOMES = "outcomes.json"


class Search:
    """Countermeasures of a scene: its runs and trials, and what is known so far.

    Attributes:
        scene: the scene.
        runs: the runs that verify.
        approach: rough approach whose samples are looked at.
        found: first-order effect and smallest change of each countermeasure, by its key.
    """

    def __init__(
        self, scene: str | Path, comm: MPI.Comm, directory: str | Path | None,
        overrides: Sequence[str], cache: str | Path | None,
    ):  # fmt: skip
        """Read the scene and what an earlier call found; nothing is written.

        Raises:
            SceneError: the scene is wrong or names no countermeasures, or the folder holds others.
        """
        self.scene = read_scene(scene, overrides)
        folder = Path(directory or f"{Path(scene).stem}-countermeasures")
        self.runs = Runs(scene, comm, folder, [*overrides, "countermeasures=[]"], cache)
        self._latest: tuple[dict[str, list[float]], Model] | None = None
        named = self.scene.section("countermeasures")
        if not named:
            raise SceneError(f"""{self.scene.file}: countermeasures: there are none; write
                [[countermeasures]] with key = "contact.NAME.friction" and to = 0.3, for example""")
        for c in named:
            try:
                check_brake(self.runs.read(self.changes({c: c.stop})), comm)
            except SceneError as error:
                raise SceneError(f"{error} (countermeasures.key = {c.key!r}, to)") from None
        samples, stability = self.scene.samples, self.scene.stability
        self.approach = next(a for a in ROUGH if a in samples.approaches)
        n, threshold = samples.plan(self.approach).n, stability.threshold if stability else 0.0
        ends = [[c.key, c.start, c.stop] for c in named]
        self._mark = files.digest([result_digest(self.scene), self.approach, n, threshold, ends])
        self.found: dict[str, dict[str, Any]] = processes.on_first(self._stored, comm)

    def _stored(self) -> dict[str, dict[str, Any]]:
        folder, remedy = self.runs.folder, "choose another folder with -o"
        path = folder / OUTCOMES
        if not path.is_file():
            # A call that ended at its mesh leaves a cache and a log alone.
            there = {p.name for p in folder.glob("[!.]*")} - {"cache", "log.txt"}
            if there and "before" not in there:
                raise SceneError(f"""-o {folder}: contains {min(there)!r} and no countermeasures;
                    {remedy}""")
            return {}
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise SceneError(f"{path}: damaged; remove it, and the search begins again") from None
        if stored["mark"] != self._mark:
            raise SceneError(f"""-o {folder}: contains countermeasures of another scene or others of
                this one; {remedy}""")
        return dict(stored["found"])

    def changes(self, values: Mapping[Countermeasure, float]) -> list[str]:
        """Replacements that give the scene other values; computed laws follow a modulus.

        Raises:
            SceneError: they are those of several materials.
        """
        scene, out = self.scene, [c.override(self.scene, x) for c, x in values.items()]
        out += [change for c, x in values.items() for change in c.distribution(scene, x)]
        constants = {c.key: x for c, x in values.items() if is_constant(c.key)}
        names = sampling.scaled_interfaces(scene) if constants and scene.micro else []
        behind = {sampling.law_material(scene, name) for name in names}
        if not behind.isdisjoint(split_key(key)[1] for key in constants) and scene.micro:
            if len(behind) > 1:
                raise SceneError(f"""{scene.file}: [micro] is of {" and ".join(sorted(behind))}, and
                    follows none of them alone; run both scenes and use brake-fenicsx compare""")
            stiffer = Values(scene, constants)
            sampling.check_values(ROUGH[0], stiffer)
            factor = sampling.law_factor(names[0], stiffer)
            given = {"E": scene.micro.E, "hardness": scene.micro.hardness}
            out += [f'micro.{n}="{v * factor!r} Pa"' for n, v in given.items() if v is not None]
        return out

    def about(self, *levers: Countermeasure) -> list[str]:
        """Notes on numbers that are random."""
        known = self.scene.samples.random
        return [f"{c.key} is random: its distribution moves by the same factor" for c in levers
                if c.key in known]  # fmt: skip

    def trial(self, worst: Worst, *levers: Countermeasure) -> Trial:
        """Samples of a brake that is prepared for all values of some numbers; collective."""
        ranges = {c.key: [c.start, c.stop] for c in levers if changes_bodies(self.scene, c.key)}
        if self._latest is None or self._latest[0] != ranges:
            self.release()
            runs = self.runs
            folder = runs.folder / "models" / files.digest(ranges)[:12]
            model = prepare(runs.file, runs.overrides, folder, runs.cache, ranges, runs.comm)
            self._latest = ranges, model
        return Trial(self._latest[1].study, worst, self.runs.comm, levers[0])

    def release(self) -> None:
        """Let the brake leave the memory, on all processes together as MPI asks for; collective."""
        self._latest = None
        gc.collect()
        self.runs.comm.Barrier()

    def search(self, c: Countermeasure, worst: Worst) -> None:
        """Find the first-order effect and the smallest change of a number; collective."""
        found: dict[str, Any] = dict.fromkeys(("first_order", "value", "share"))

        def search() -> None:
            trial, ends = self.trial(worst, c), (c.start, c.stop)
            found["first_order"] = processes.on_first(partial(trial.slope, *ends), self.runs.comm)
            change = smallest_change(trial.outcomes, ends, len(worst.samples), STEPS, ACCURACY)
            found.update(value=change.value, share=[change.share.hits, change.share.n])

        _, note = or_note(search)
        self.keep(c.key, found | {"note": note})

    def keep(self, name: str, found: dict[str, Any]) -> None:
        """Store what was found, so that it is not looked for again."""
        self.found[name] = found
        if self.runs.comm.rank == 0:
            content = {"mark": self._mark, "found": self.found}
            store.Store(self.runs.folder).save_json(OUTCOMES, content)

    def worst(self) -> Worst | None:
        """Run the scene as it is: its worst family, None where nothing is to stop; collective.

        Raises:
            BrakeError: the run failed.
        """
        before, approach = self.runs.run("before"), self.approach
        worst = processes.on_first(lambda: worst_family(read_run(before), approach), self.runs.comm)
        if worst is None or few(worst.count.share.hits, worst.count.share.n):
            logger.info(
                "%s: no family squeals in more than %.0f %% of the samples; there is nothing to"
                " stop", approach, 100 * MOST,
            )  # fmt: skip
            return None
        share = worst.count.share
        said = "worst family: %.0f Hz, squeals in %d of %d samples"
        logger.info(said, worst.count.frequency, share.hits, share.n)
        return worst

    def verified(
        self, name: str, values: Mapping[Countermeasure, float], worst: Worst
    ) -> tuple[dict[str, Any], list[str]]:
        """Run the scene with other values; collective.

        Returns:
            Cells of a table: the share of samples in which the worst family squeals and its ends,
            that of any family, whether the upper end is small enough, and of how many samples it
            would be; and notes on the run.
        """
        folder, note = or_note(partial(self.runs.run, name, self.changes(values)))
        if folder is None:
            return {"verified": "no"}, [f"the run failed: {note}"]
        before = self.runs.folder / "before"
        after, loud = processes.on_first(lambda: _compared(before, folder, worst), self.runs.comm)
        shown = limits(after.hits, after.n)[1] <= MOST
        notes = ["other modes squeal"] if not few(loud.hits, loud.n) else []
        if not few(after.hits, after.n):
            notes = ["the run does not confirm the search"]
        more = None if shown else needed(after.hits, after.n)
        cells = {"any_after": loud.value, "verified": "yes" if shown else "no"}
        return {**share_cells(after), **cells, "samples_needed": more}, notes


def find_countermeasures(
    scene: str | Path,
    comm: MPI.Comm,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    cache: str | Path | None = None,
) -> Path | None:
    """Find the smallest change of each countermeasure of a scene, and verify it; collective.

    What an earlier call in the folder finished is not done again.

    Args:
        scene: path of the scene.
        comm: processes that share the work.
        directory: folder of the results; SCENE-countermeasures in the working directory if not
            given.
        overrides: "key=value" replacements in the scene.
        cache: folder of laws and reduced models that runs share; one in the folder if not given.

    Returns:
        The page; None where nothing is to be stopped.

    Raises:
        SceneError: the scene is wrong or names none, or the folder holds others.
        BrakeError: the run of the scene as it is failed.
    """
    search = Search(scene, comm, directory, overrides, cache)
    if (worst := search.worst()) is None:
        return None
    named = search.scene.section("countermeasures")
    # All that one brake has come first.
    for c in sorted(named, key=lambda c: changes_bodies(search.scene, c.key)):
        if c.key not in search.found:
            search.search(c, worst)
    search.release()
    known = {c.key: search.found[c.key]["first_order"] for c in named}
    ranked = sorted(named, key=lambda c: np.inf if known[c.key] is None else -known[c.key])
    rows = [_row(search, c, worst, rank) for rank, c in enumerate(ranked, 1)]
    if comm.rank == 0:
        print(countermeasures_text(rows))
    return processes.on_first(lambda: write_countermeasures(search.runs.folder, worst, rows), comm)


def _row(search: Search, c: Countermeasure, worst: Worst, rank: int) -> Row:
    """One row of the table: the smallest change, and what a run with it says."""
    found = search.found[c.key]
    value, notes = found["value"], [found["note"]] * bool(found["note"]) + search.about(c)
    row = dict.fromkeys(COLUMNS) | {
        "rank": rank, "key": c.key, "value_scene": c.start, "value_to": c.stop, "unit": c.unit,
        "first_order": found["first_order"], "smallest_value": value, "verified": "no",
        "share_before": worst.count.share.value, "any_before": worst.any.value,
    }  # fmt: skip
    if found["share"]:
        row |= share_cells(wilson(*found["share"]))
    if value is not None:
        cells, said = search.verified(f"after-{rank}", {c: value}, worst)
        row, notes = row | cells, notes + said
    elif found["share"]:
        notes.append("not sufficient even at the limit; share given for the limit")
    return row | {"note": "; ".join(notes)}


def _compared(before: Path, after: Path, worst: Worst) -> tuple[Proportion, Proportion]:
    """Shares of samples after a change in which the worst family and any family squeal."""
    write_comparison(before, after, after)
    rows = [r for r in compare_runs(before, after) if r["approach"] == worst.count.approach]
    # The first row is that of all families together.
    same = next(row for row in rows if row["family_a"] == worst.count.key)
    n = rows[0]["samples_b"]
    own, loud = (wilson(round(row["probability_b"] * n), n) for row in (same, rows[0]))
    return own, loud
