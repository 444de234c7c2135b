"""Tables of a run from its stored samples: samples.csv, modes.csv, contact.csv and what follows.

Rows stand in the order of the tasks: no order of work shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.build.shapes import FILE as SHAPES
from brake_fenicsx.build.shapes import family_shapes
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.contact import Contact
from brake_fenicsx.samples.forces import contact_of, force_statistics
from brake_fenicsx.samples.numbering import dof_points
from brake_fenicsx.samples.study import Study

from .blocks import SampleBlock, Tabulation, blocks_of, tabulation_of
from .columns import column_writer, ma
from .counts import PROVEN, Counts
from .families import ModeFamilies
from .run import RunData
from .tables import CONTACT, MODES, SAMPLES, Columns, read_columns, write_rows

if TYPE_CHECKING:
    from .probabilities import Ensemble

Array = NDArray[np.float64]
Data = dict[str, Any]
# Names of the arrays that tables of drivers and of limit cycles are made of begin so.
MORE = ("driver_", "cycle_", "branch_")
# What rows of samples.csv are made of, beside the random inputs.
ROW = ("status", "seed", "mean_mu", "rejected", "tolerance_missed", "count_kind")


class Results:
    """Stored samples of a study, read once, block by block.

    Attributes:
        first: approach and number of the first good sample of each approach, and its arrays.
        members: vectors and frequencies of the first mode of each family.
        more: samples with derivatives or limit cycles: their task, arrays by name with "s",
            "damping", "verdict" and "condition", and the family of each mode.
    """

    def __init__(
        self,
        store: Store,
        tasks: Sequence[Task],
        verify: Sequence[Task] = (),
        verified: str = "multi-scale",
        tabulate: Tabulation | None = None,
        modes: Callable[[Columns], None] | None = None,
    ):
        """Read the samples.

        Args:
            store: the results folder.
            tasks: approach and number of each sample.
            verify: samples of the verification.
            verified: approach that they verify.
            tabulate: how samples become columns; with what all scenes have in common if None.
            modes: is given the columns of modes.csv of each block, in order.
        """
        tabulate = tabulate or Tabulation()
        self.first: dict[Task, Data] = {}
        self.members = ModeFamilies(known=tabulate.founders)
        self.more: list[tuple[Task, Data, NDArray[np.int32]]] = []
        self._verify = {task: store.samples.load(task) or {} for task in verify}
        self._reduced: dict[int, Data] = {}
        self._lost: list[tuple[str, str]] = []
        self._verified = verified
        self._squealing: dict[int, NDArray[np.complex64]] = {}
        self._beyond = ModeFamilies()
        self._rows: list[SampleBlock] = []
        self._layers: list[str] = []
        self._counts = {name: Counts() for name in dict.fromkeys(name for name, _ in tasks)}
        for block in blocks_of(store, tasks, tabulate):
            for task, status in zip(block.tasks, block.scalars("status", ""), strict=True):
                if status == "ok" and all(task[0] != name for name, _ in self.first):
                    self.first[task] = store.samples.load(task) or {}
            family = self._families(block, len(tabulate.founders.vectors))
            self._rows.append(block.part((*ROW, "random_names", "random")))
            self._count(block)
            self._more(block, family)
            self._compare(block)
            if modes is not None and "s" in block:
                layers = (names for names in block.each("layers") if names is not None)
                self._layers = self._layers or [str(name) for name in next(layers, ())]
                modes(_modes(block, family, self._layers))

    def good(self, approach: str) -> int:
        """Number of the samples that were computed without error."""
        return self._counts[approach].good

    @property
    def forces(self) -> dict[str, Array]:
        """Forces on the pads of each approach, shape (good samples, pads, numbers)."""
        return {name: np.array(c.forces) for name, c in self._counts.items() if c.forces}

    def _families(self, block: SampleBlock, known: int) -> NDArray[np.int32]:
        """Family of every mode of a block, shape (modes,).

        Families of the block are matched to those of earlier ones, not to the ones that it knew:
        their modes did not match these, or another mode of the sample did.
        """
        new = block.beside["vectors"]
        numbers = np.arange(known + len(new))
        if len(new):
            numbers[known:] = known + self._beyond.add(new.T, block.beside["frequencies"])
            founded = slice(len(self.members.vectors) - known, None)
            self.members.vectors += self._beyond.vectors[founded]
            self.members.frequencies += self._beyond.frequencies[founded]
        squealing = zip(block.beside["squealing"], block.beside["squealing_vectors"], strict=True)
        for n, vector in squealing:
            self._squealing.setdefault(int(numbers[n]), vector)
        if "family" not in block:
            return np.zeros(0, dtype=np.int32)
        # Modes of no family have the number -1, that of the last one.
        return np.append(numbers, -1).astype(np.int32)[block.column("family")]

    def samples(self) -> tuple[list[str], Iterator[list[Any]]]:
        """Columns of samples.csv, and its rows.

        There is a column for each random input, one of rejected draws where materials are random,
        and, where there are modes, two of what they leave open: tolerance_missed, the modes whose
        estimated error exceeds stability.tolerance, and complete, whether it is proven that no mode
        is missing.
        """
        names = sorted({str(n) for block in self._rows for n in block.words("random_names")})
        drawn = any(name.startswith("materials.") for name in names)
        modes = any("count_kind" in block for block in self._rows)
        heads = [*SAMPLES, "mu", *names]
        heads += ["rejected"] * drawn + ["tolerance_missed", "complete"] * modes

        def rows() -> Iterator[list[Any]]:
            for block in self._rows:
                known, values = block.each("random_names"), block.each("random")
                columns = (block.scalars(name, None) for name in ROW)
                for task, x, v, *row, rejected, missed, kind in zip(
                    block.tasks, known, values, *columns, strict=True
                ):
                    inputs = {} if x is None or v is None else dict(zip(x, v, strict=True))
                    proven = None if kind is None else "yes" if kind == PROVEN else "no"
                    more = [rejected] * drawn + [missed, proven] * modes
                    drawn_values = (float(inputs[n]) if n in inputs else None for n in names)
                    yield [*task, *row, *drawn_values, *more]

        return heads, rows()

    def _count(self, block: SampleBlock) -> None:
        """Sums for the summary."""
        names = np.array([name for name, _ in block.tasks])
        good = np.array(block.scalars("status", "")) == "ok"
        lost = zip(block.tasks, block.scalars("lost", None), strict=True)
        self._lost += [(f"{approach} {k}", text) for (approach, k), text in lost if text]
        for name in dict.fromkeys(names.tolist()):
            own = np.flatnonzero((names == name) & good)
            self._counts[name].add_samples(block, own)
            self._counts[name].failed += int(((names == name) & ~good).sum())
        if "s" in block:
            approach = np.repeat(names, block.sizes("s"))
            for name in dict.fromkeys(approach.tolist()):
                self._counts[name].add_modes(block, approach == name)

    def _compare(self, block: SampleBlock) -> None:
        """Keep what the verification compares."""
        names = ("s", "verdict", "error")
        for (approach, number), *values in zip(block.tasks, *map(block.each, names), strict=True):
            if approach == self._verified and number < len(self._verify) and values[0] is not None:
                self._reduced[number] = dict(zip(names, values, strict=True))

    def _more(self, block: SampleBlock, family: NDArray[np.int32]) -> None:
        """Samples with derivatives or limit cycles."""
        names = [name for name in block.names if name.startswith(MORE)]
        if not names:
            return
        names += ["s", "damping", "verdict", "condition"]
        each = [block.each(name) for name in names]
        ends = np.cumsum(block.sizes("s"))
        families = [family[i:j] for i, j in zip([0, *ends[:-1]], ends, strict=True)]
        for task, own, *arrays in zip(block.tasks, families, *each, strict=True):
            data = {name: a for name, a in zip(names, arrays, strict=True) if a is not None}
            if any(name.startswith(MORE) for name in data):
                self.more.append((task, data, own))

    def contact(self, contact: Contact) -> Iterator[list[Any]]:
        """Rows of contact.csv: the first good sample of each approach."""
        for task, d in self.first.items():
            own_contact = contact_of(contact, d)
            for i, (x, y, z) in enumerate(own_contact.points):
                own = (d[name][i] for name in ("g", "g_cr", "p", "k", "k_vibration"))
                values = (x, y, z, own_contact.w[i], *own)
                yield [*task, i, *map(float, values), int(d["law"][i])]

    def facts(self) -> dict[str, Any]:
        """Figures for the summary."""
        facts: dict[str, Any] = {
            "samples": {}, "failed_samples": sum(c.failed for c in self._counts.values())
        }  # fmt: skip
        for name, counts in self._counts.items():
            facts["samples"][name] = counts.facts()
        if self._verify:
            facts["verification"] = self._verification()
        if self._lost:
            (where, text), more = self._lost[0], len(self._lost) - 1
            others = f", and in {more} more samples" if more else ""
            facts["lost_extras"] = [f"{text} (sample {where}{others})"]
        return facts

    def _verification(self) -> dict[str, Any]:
        """Reduced samples against full order."""
        errors, wrong, beyond, compared = [np.zeros(0)], 0, 0, 0
        for (_, number), full in self._verify.items():
            mine = self._reduced.get(number, {})
            if "s" not in full or "s" not in mine or mine["s"].size != full["s"].size:
                continue
            compared += 1
            error = np.abs(mine["s"] - full["s"])
            beyond += int(np.sum(~(error <= mine["error"] + full["error"])))
            errors.append(error / np.abs(full["s"]))
            pairs = zip(mine["verdict"], full["verdict"], strict=True)
            wrong += sum({str(a), str(b)} == {"stable", "unstable"} for a, b in pairs)
        error = np.concatenate(errors)
        return {
            "samples_asked": len(self._verify), "samples_compared": compared,
            "eigenvalues": int(error.size), "wrong_verdicts": wrong,
            "errors_beyond_estimates": beyond,
            "largest_relative_error": float(error.max()) if error.size else None,
            "median_relative_error": float(np.median(error)) if error.size else None,
        }  # fmt: skip

    def squealing_members(self) -> dict[int, NDArray[np.complex128]]:
        """Vector of the first mode that squeals of each family, by its number."""
        return {n: self._squealing[n].astype(complex) for n in sorted(self._squealing)}


def _modes(block: SampleBlock, family: NDArray[np.int32], layers: Sequence[str]) -> Columns:
    """Columns of modes.csv: the fixed ones, the flutter partner, and one share per layer."""
    sizes, s = block.sizes("s"), block.column("s")
    approaches, samples = (np.array(values) for values in zip(*block.tasks, strict=True))
    start = np.repeat(np.cumsum(sizes) - sizes, sizes)
    fixed = (
        np.repeat(approaches, sizes), np.repeat(samples.astype(np.int32), sizes),
        (np.arange(s.size) - start).astype(np.int16), np.abs(s.imag) / (2 * np.pi), s.real.copy(),
        *(block.column(name) for name in ("damping", "residual", "error", "condition", "verdict")),
        family,
    )  # fmt: skip
    none = [np.full((len(layers), size), np.nan) for size in sizes]
    shares, partners = block.each("shares"), block.each("partner")
    share = np.concatenate(
        [n if a is None else a for a, n in zip(shares, none, strict=True)], axis=1
    )
    partner = np.concatenate(
        [np.full(n, -1) if a is None else a for a, n in zip(partners, sizes, strict=True)]
    )
    return {
        **dict(zip(MODES, fixed, strict=True)),
        "partner": ma.masked_less(partner.astype(np.int32), 0),
        **{f"share_{name}": ma.masked_invalid(share[i]) for i, name in enumerate(layers)},
    }


def write_results(study: Study) -> dict[Task, dict[str, Any]]:
    """Write the tables, count, and keep figures for the summary in the study; collective.

    Returns:
        What was stored of the first good sample of each approach.
    """
    points = dof_points(study.brake)
    first, facts, found = on_first(lambda: _tables(study, points), study.comm)
    release_memory()
    study.facts |= facts
    if found is not None:
        from .probabilities import find_causes, write_causes

        samples = study.scene.samples
        find_causes(samples, found, study.comm)
        study.facts["probabilities"] = on_first(
            lambda: write_causes(study.store.path(), samples, found), study.comm
        )
    if study.brake.stuck:
        from brake_fenicsx.samples.forces import stuck_states

        study.facts["stuck_contact"] = on_first(
            lambda: stuck_states(study.scene, study.brake, first, study.displacements(first)),
            study.comm,
        )
    return first


def _tables(
    study: Study, points: NDArray[np.float64]
) -> tuple[dict[Task, dict[str, Any]], dict[str, Any], list[Ensemble] | None]:
    """The same on one process, but for the causes of squeal, which all share."""
    scene, path, stability = study.scene, study.store.path, study.scene.stability
    table = (
        column_writer(path("modes.csv"), MODES) if "stability" in scene.stages else nullcontext()
    )
    with table as write:
        results = Results(
            study.store, study.tasks, study.verify, study.verified, tabulation_of(study), write
        )
    facts = results.facts()
    first = {task[0]: data for task, data in results.first.items()}
    facts["contact_forces"] = {
        name: force_statistics(scene, study.brake, first[name], values)
        for name, values in results.forces.items()
    }
    write_rows(path("samples.csv"), *results.samples())
    if "stability" in scene.stages:
        if results.members.vectors:
            study.families = np.array(results.members.vectors).T
            # A sweep compares modes that begin to squeal with the squealing mode of each family.
            squealing = results.squealing_members()
            study.squealing = [*squealing]
            for n, vector in squealing.items():
                study.families[:, n] = vector
        _write_shapes(study, points, results)
    write_rows(path("contact.csv"), CONTACT, results.contact(study.brake.contact))
    if stability is not None and study.drivers is not None:
        from .driver_tables import write_drivers

        write_drivers(path(), results, stability.threshold)
    if study.cycles is not None:
        from brake_fenicsx.extras.limit_cycle.cycle_tables import write_cycles

        write_cycles(path(), results)
    found = None
    if stability is not None and {"stability", "uncertainty"} <= {*scene.stages}:
        from .probabilities import ensembles

        modes, samples = (read_columns(path(f"{name}.csv")) for name in ("modes", "samples"))
        settings = {"in_effect": {"stability": {"threshold": stability.threshold}}}
        found = ensembles(RunData(path(), modes, samples, summary=settings), stability.band)
    return results.first, facts, found


def _write_shapes(study: Study, points: NDArray[np.float64], results: Results) -> None:
    """Shapes of the families that squeal, for comparisons with other runs."""
    if known := results.squealing_members():
        u = study.models.coordinates.displacements(np.array([*known.values()]).T)
        body = study.models.numbering.body
        study.store.save(SHAPES, **family_shapes(points, body, u, np.array([*known])))
