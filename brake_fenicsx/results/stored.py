"""Tables of a run from its stored samples: samples.csv, modes.csv, contact.csv and what follows.

Rows stand in the order of the tasks: no order of work shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.contact import Contact
from brake_fenicsx.uncertainty.forces import forces_of_sample, forces_of_samples
from brake_fenicsx.uncertainty.numbering import dof_points
from brake_fenicsx.uncertainty.shapes import FILE as SHAPES
from brake_fenicsx.uncertainty.shapes import family_shapes
from brake_fenicsx.uncertainty.study import Study

from .families import ModeFamilies
from .run import RunData
from .squeal import squeals
from .tables import CONTACT, MODES, SAMPLES, read_columns, write_rows

Array = NDArray[np.float64]
Data = dict[str, Any]
# Of every contact element or coordinate: kept of the first good sample of an approach alone, so
# that 10^5 samples need some hundred bytes for each of their modes.
LARGE = frozenset(
    {
        "g", "g_cr", "p", "k", "k_vibration", "law", "mu", "mu_equilibrium", "coordinates",
        "driver_map", "driver_work",
    }
)  # fmt: skip


class Results:
    """Stored samples of a study, each read once.

    Attributes:
        tasks: the samples wanted.
        stored: arrays of each one that is there, LARGE ones of the first good ones alone.
        families: family of every mode of the good samples that have modes; -1 where samples have no
            common basis to be compared in.
        members: vectors and frequencies of the first mode of each family.
        derived: what ``derive`` made of each good sample.
    """

    def __init__(
        self,
        store: Store,
        tasks: Sequence[Task],
        verify: Sequence[Task] = (),
        verified: str = "multi-scale",
        threshold: float = 0.0,
        sliding: NDArray[np.bool_] | None = None,
        derive: Callable[[Data], Any] | None = None,
    ):
        """Read the samples.

        Args:
            store: the results folder.
            tasks: approach and number of each sample.
            verify: samples of the verification.
            verified: approach that they verify.
            threshold: a mode squeals where its damping lies below minus this.
            sliding: elements over which friction is averaged, shape (elements,); all if None.
            derive: what else is made of the arrays of a good sample.
        """
        self.tasks, self.verify, self.verified = list(tasks), list(verify), verified
        self.stored: dict[Task, Data] = {}
        self.families: dict[Task, NDArray[np.int32]] = {}
        self.members = ModeFamilies()
        self.derived: dict[Task, Any] = {}
        self._threshold, self._sliding = threshold, sliding
        self._first: dict[str, Task] = {}
        self._squealing: dict[int, NDArray[np.complex64]] = {}
        self._texts: dict[str, NDArray] = {}
        for task in [*self.tasks, *self.verify]:
            data = store.samples.load(task)
            if data is None:
                continue
            if str(data["status"]) == "ok" and task not in self.verify:
                self._good(task, data)
                if derive is not None:
                    self.derived[task] = derive(data)
            self.stored[task] = self._kept(task, data)

    def _good(self, task: Task, data: Data) -> None:
        """Families of the modes of a good sample."""
        self._first.setdefault(task[0], task)
        if "s" not in data:
            return
        if "coordinates" not in data:
            self.families[task] = np.full(data["s"].size, -1, dtype=np.int32)
            return
        shapes = data["coordinates"]
        family = self.members.add(shapes.astype(complex), np.abs(data["s"].imag) / 2 / np.pi)
        self.families[task] = family.astype(np.int32)
        for i in np.flatnonzero(squeals(data, self._threshold)):
            self._squealing.setdefault(int(family[i]), shapes[:, i].copy())

    def _kept(self, task: Task, data: Data) -> Data:
        """What is kept of the arrays of a sample, and the mean of its friction."""
        mu = None
        if "mu" in data:
            chosen = data["mu"] if self._sliding is None else data["mu"][self._sliding]
            ends = {float(chosen.min()), float(chosen.max())} if chosen.size else {0.0}
            # The mean of equal numbers is off by round-off.
            mu = float(f"{chosen.mean():.12g}") if len(ends) > 1 else ends.pop()
        large = frozenset() if self._first.get(task[0]) == task else LARGE
        kept = {name: self._small(name, v) for name, v in data.items() if name not in large}
        return {**kept, "mean_mu": mu}

    def _small(self, name: str, values: Any) -> Any:
        """The same values in less memory: names that are the same in all samples are held once."""
        values = np.asarray(values)
        if values.ndim == 0:
            return values.item()
        if values.dtype.kind != "U":
            return values
        known = self._texts.setdefault(name, values)
        if np.array_equal(known, values):
            return known
        unique, place = np.unique(values, return_inverse=True)
        return unique.astype(object)[place.reshape(values.shape)]

    def good(self) -> list[Task]:
        """Samples that were computed without error."""
        return [t for t in self.tasks if t in self.stored and self.stored[t]["status"] == "ok"]

    def first(self) -> list[Task]:
        """The first good sample of each approach."""
        return list(self._first.values())

    def squealing_members(self) -> tuple[list[int], NDArray[np.complex128]]:
        """Numbers of the families that squeal, and the vector of the first such mode of each."""
        numbers = sorted(self._squealing)
        vectors = [self._squealing[n].astype(complex) for n in numbers]
        return numbers, np.array(vectors).T if vectors else np.zeros((0, 0), complex)

    def sample_columns(self, first: Sequence[str]) -> list[str]:
        """Columns of samples.csv: the fixed ones, friction, and one per random input."""
        return [*first, "mu", *self._inputs(), *self._rejected(), *self._proofs()]

    def _rejected(self) -> list[str]:
        """The column of rejected draws, where materials are random and some may be."""
        return ["rejected"] if any(n.startswith("materials.") for n in self._inputs()) else []

    def _proofs(self) -> list[str]:
        """Columns of what modes leave open, where there are modes.

        tolerance_missed: modes whose estimated error exceeds stability.tolerance; complete: whether
        it is proven that no mode is missing.
        """
        found = any("counted" in self.stored[t] for t in self.good())
        return ["tolerance_missed", "complete"] if found else []

    def _inputs(self) -> list[str]:
        names = {str(n) for t in self.good() for n in self.stored[t]["random_names"]}
        return sorted(names)

    def samples(self) -> Iterator[list[Any]]:
        """Rows of samples.csv."""
        # Each of these looks at all samples.
        names, counts, proofs = self._inputs(), self._rejected(), self._proofs()
        for task in self.tasks:
            data = self.stored.get(task)
            if data is None:
                continue
            drawn = dict(
                zip(map(str, data.get("random_names", ())), data.get("random", ()), strict=True)
            )
            seed = int(data["seed"]) if "seed" in data else None
            values = [float(drawn[n]) if n in drawn else None for n in names]
            rejected = int(data["rejected"]) if "rejected" in data else None
            left: dict[str, Any] = {"tolerance_missed": None, "complete": None}
            if "counted" in data:
                proven = "yes" if _complete(data) else "no"
                left = {"tolerance_missed": int(data["tolerance_missed"]), "complete": proven}
            yield [
                *task, data["status"], seed, data["mean_mu"], *values,
                *(rejected for _ in counts), *(left[name] for name in proofs),
            ]  # fmt: skip

    def mode_columns(self, first: Sequence[str]) -> list[str]:
        """Columns of modes.csv: the fixed ones, the flutter partner, and one share per layer."""
        return [*first, "partner", *(f"share_{name}" for name in self._layers())]

    def _layers(self) -> list[str]:
        """Layers whose shares of the kinetic energy are stored."""
        found = (d["layers"] for d in self.stored.values() if "layers" in d)
        return [str(name) for name in next(found, ())]

    def modes(self) -> Iterator[list[Any]]:
        """Rows of modes.csv."""
        layers = len(self._layers())
        for task, family in self.families.items():
            d = self.stored[task]
            shares = d.get("shares", np.full((layers, d["s"].size), np.nan))
            partner = d.get("partner", np.full(d["s"].size, -1))
            for i, s in enumerate(d["s"]):
                yield [
                    *task, i, float(abs(s.imag) / (2 * np.pi)), float(s.real),
                    float(d["damping"][i]), float(d["residual"][i]), float(d["error"][i]),
                    float(d["condition"][i]), str(d["verdict"][i]), int(family[i]),
                    int(partner[i]) if partner[i] >= 0 else None,
                    *(None if np.isnan(value) else float(value) for value in shares[:, i]),
                ]  # fmt: skip

    def contact(self, contact: Contact) -> Iterator[list[Any]]:
        """Rows of contact.csv: the first good sample of each approach."""
        for task in self.first():
            d = self.stored[task]
            for i, (x, y, z) in enumerate(contact.points):
                own = (d[name][i] for name in ("g", "g_cr", "p", "k", "k_vibration"))
                values = (x, y, z, contact.w[i], *own)
                yield [*task, i, *map(float, values), int(d["law"][i])]

    def facts(self) -> dict[str, Any]:
        """Figures for the summary."""
        known = [self.stored[t]["status"] for t in self.tasks if t in self.stored]
        facts: dict[str, Any] = {
            "samples": {}, "failed_samples": sum(status != "ok" for status in known)
        }  # fmt: skip
        for name in dict.fromkeys(t[0] for t in self.tasks):
            own = [self.stored[t] for t in self.good() if t[0] == name]
            about: dict[str, Any] = {"good": len(own)}
            if own and "s" in own[0]:
                from brake_fenicsx.stability.modes import relative_errors

                about |= {
                    "modes": int(sum(d["s"].size for d in own)),
                    "counted_by": str(own[0]["counted"]),
                    "not_complete": sum(not _complete(d) for d in own),
                    "tolerance_missed": int(sum(d["tolerance_missed"] for d in own)),
                    "largest_error": max(
                        float(np.fmax.reduce(relative_errors(d["s"], d["error"]), initial=0.0))
                        for d in own
                    ),
                    "unstable": int(sum((d["verdict"] == "unstable").sum() for d in own)),
                    "neutral": int(sum((d["verdict"] == "neutral").sum() for d in own)),
                    "seconds_per_stability": _median(own, "stability_seconds"),
                }
            if any("rejected" in d for d in own):
                about["rejected_draws"] = int(sum(int(d["rejected"]) for d in own))
            if own:
                about["seconds_per_equilibrium"] = _median(own, "equilibrium_seconds")
                about["newton_iterations"] = _median(own, "equilibrium_iterations")
            facts["samples"][name] = about
        if self.verify:
            facts["verification"] = self._verification()
        return facts

    def _verification(self) -> dict[str, Any]:
        """Reduced samples against full order."""
        errors, wrong, compared = [np.zeros(0)], 0, 0
        for task in self.verify:
            full = self.stored.get(task)
            mine = [d for t, d in self.stored.items() if t[1] == task[1] and t[0] == self.verified]
            if full is None or "s" not in full or not mine or mine[0]["s"].size != full["s"].size:
                continue
            compared += 1
            errors.append(np.abs(mine[0]["s"] - full["s"]) / np.abs(full["s"]))
            pairs = zip(mine[0]["verdict"], full["verdict"], strict=True)
            wrong += sum({str(a), str(b)} == {"stable", "unstable"} for a, b in pairs)
        error = np.concatenate(errors)
        return {
            "samples_asked": len(self.verify), "samples_compared": compared,
            "eigenvalues": int(error.size), "wrong_verdicts": wrong,
            "largest_relative_error": float(error.max()) if error.size else None,
            "median_relative_error": float(np.median(error)) if error.size else None,
        }  # fmt: skip


def _complete(data: dict[str, Any]) -> bool:
    """Whether it is proven that a sample misses no mode."""
    how = str(data["counted"])
    return not how.startswith("not counted") and "not proven" not in how


def _median(rows: Sequence[dict[str, Any]], name: str) -> float:
    return float(np.median([float(d[name]) for d in rows]))


def write_results(study: Study) -> dict[Task, dict[str, Any]]:
    """Write the tables, count, and keep figures for the summary in the study; collective.

    Returns:
        What was stored of the first good sample of each approach.
    """
    points = dof_points(study.brake)
    first, facts = on_first(lambda: _tables(study, points), study.comm)
    study.facts |= facts
    if study.brake.stuck:
        from brake_fenicsx.uncertainty.forces import stuck_states

        study.facts["stuck_contact"] = on_first(
            lambda: stuck_states(study.scene, study.brake, first, study.displacement), study.comm
        )
    return first


def _tables(
    study: Study, points: NDArray[np.float64]
) -> tuple[dict[Task, dict[str, Any]], dict[str, Any]]:
    """The same on one process: all samples are read."""
    scene, path, stability = study.scene, study.store.path, study.scene.stability
    results = Results(
        study.store, study.tasks, study.verify, study.verified,
        stability.threshold if stability else 0.0, study.brake.contact.speed > 0,
        forces_of_sample(scene, study.brake),
    )  # fmt: skip
    facts = results.facts()
    facts["contact_forces"] = forces_of_samples(scene, results.derived)
    write_rows(path("samples.csv"), results.sample_columns(SAMPLES), results.samples())
    if "stability" in scene.stages:
        write_rows(path("modes.csv"), results.mode_columns(MODES), results.modes())
        if results.members.vectors:
            study.families = np.array(results.members.vectors).T
        _write_shapes(study, points, results)
    write_rows(path("contact.csv"), CONTACT, results.contact(study.brake.contact))
    if stability is not None and study.drivers is not None:
        from .driver_tables import write_drivers

        write_drivers(path(), results, stability.threshold)
    if study.cycles is not None:
        from .cycle_tables import write_cycles

        write_cycles(path(), results)
    if stability is not None and {"stability", "uncertainty"} <= {*scene.stages}:
        from .probabilities import ensembles, write_causes

        modes, table = (read_columns(path(f"{name}.csv")) for name in ("modes", "samples"))
        settings = {"in_effect": {"stability": {"threshold": stability.threshold}}}
        found = ensembles(RunData(path(), modes, table, summary=settings), stability.band)
        facts["probabilities"] = write_causes(path(), scene.samples, found)
    return {task: results.stored[task] for task in results.first()}, facts


def _write_shapes(study: Study, points: NDArray[np.float64], results: Results) -> None:
    """Shapes of the families that squeal, for comparisons with other runs."""
    numbers, vectors = results.squealing_members()
    if numbers:
        u, body = study.models.shapes(vectors), study.models.numbering.body
        study.store.save(SHAPES, **family_shapes(points, body, u, np.array(numbers)))
