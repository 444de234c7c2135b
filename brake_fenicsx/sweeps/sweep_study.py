"""The sweep of a scene: which samples are followed over which values, and what is stored of each.

The scene's own brake is followed in rough and in perfect contact, at every value; rough samples
from a quarter of the values, and between them where modes meet, since what is asked of them is
where each family begins to squeal.
"""

from typing import Any

import numpy as np

from brake_fenicsx.build.material_table import nominal_value
from brake_fenicsx.folder.files import digest
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.samples.ensemble import run_ensemble
from brake_fenicsx.samples.random_inputs import PERFECT
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene.samples_section import ROUGH
from brake_fenicsx.scene.units import several

from .branches import CUT, follow
from .events import find_events
from .followed import StoredLine, line_arrays
from .state import Points

# Accuracy of an event relative to the range.
FINE = 1e-4

# Samples are followed from every so many of the values at most, and from so many values at least.
EVERY, FEWEST = 4, 11


class SweepStudy:
    """Branches of the scene's own brake, and critical values of its samples.

    Attributes:
        study: the samples of the scene, prepared.
        keys: dotted keys of the parameters.
        key: that of the parameter that modes are followed over.
        values: its values, SI.
        coarse: those at which samples are followed.
        second: values of the second parameter, of a chart.
        threshold: a mode squeals where -2 alpha / |omega| lies below minus this.
        nominal: approach and line of each line of the scene's own brake.
        samples: approach and number of each sample that is followed.
    """

    def __init__(self, study: Study):
        """Plan the lines."""
        sweep, stability = study.scene.sweep, study.scene.stability
        if sweep is None or stability is None:
            raise ValueError("the scene names no sweep")
        self.study, self.threshold = study, stability.threshold
        self.keys, self.key, self._second = [*sweep.parameters], sweep.first, sweep.second
        self.values: tuple[float, ...] = sweep.parameters[self.key].points
        every = max(1, min(EVERY, (len(self.values) - 1) // (FEWEST - 1)))
        self.coarse = (*self.values[:-1:every], self.values[-1])
        self.second: tuple[float, ...] = ()
        if self._second is not None:
            self.second = sweep.parameters[self._second].points
        self._band = stability.band[0], stability.band[1]
        named = study.scene.samples.approaches
        chosen = [next((a for a in kind if a in named), None) for kind in (ROUGH, PERFECT)]
        lines = range(max(1, len(self.second)))
        self.nominal: list[Task] = [(a, k) for a in chosen if a is not None for k in lines]
        rough = chosen[0] or ""
        most = min(sweep.samples, sum(task[0] == rough for task in study.tasks))
        self.samples: list[Task] = [(rough, k) for k in range(most)]
        # Lines of another sweep in the same folder are other files.
        mark = digest([study.scene.table.get("sweep"), stability.threshold])[:8]
        self._name = {"own": f"sweep-{mark}-own", "sample": f"sweep-{mark}"}

    def run(self) -> None:
        """Follow every line that is not stored yet; collective."""
        own = [self._task("own", task) for task in self.nominal]
        samples = [self._task("sample", task) for task in self.samples]
        run_ensemble(samples, self.work, self.study.store, self.study.comm, own, "lines")

    def write(self) -> dict[str, Any]:
        """Tables of the lines; collective. Returns figures for the summary."""
        from .sweep_tables import SweepTables

        known = self.study.families, self.study.squealing
        facts = on_first(lambda: SweepTables(self, *known).write(), self.study.comm)
        self._say(facts["sweep"])
        return facts

    def _say(self, facts: dict[str, Any]) -> None:
        """What came out, and what is left open."""
        counts = {"lines": "line", "points": "value", "mergings": "merging"}
        done = (several(facts[name], word) for name, word in counts.items())
        logger.info("sweep: %s, modes at %s, %s (coalescence, lock-in)", *done)
        if critical := facts.get("critical_value_any_family"):
            ends = (critical[name] for name in ("median", "low", "high"))
            numbers = ["beyond the sweep" if v is None else f"{v:.4g}" for v in ends]
            said = "median {}, 95 % interval from {} to {}".format(*numbers)
            said = said if critical["samples"] > 1 else f"value {numbers[0]}"
            text = "%s at which a sample begins to squeal (SI): %d of %d samples do; %s"
            logger.info(text, self.key, critical["squeal_samples"], critical["samples"], said)
        for key, one, more, why in (
            ("failed_lines", "line", "lines", "failed; see the log"),
            ("lines_without_equilibrium", "line ends", "lines end", "without an equilibrium"),
            ("cut_branches", "branch ends", "branches end", "early: mode tracking was ambiguous"),
        ):
            if facts[key]:
                logger.warning("sweep: %s %s", several(facts[key], one, more), why)

    def _task(self, kind: str, task: Task) -> Task:
        return f"{self._name[kind]}-{task[0]}", task[1]

    def line(self, kind: str, task: Task) -> tuple[str, StoredLine | None]:
        """Status and line of the scene's own brake ("own") or of a sample ("sample")."""
        data = self.study.store.samples.load(self._task(kind, task))
        if data is None:
            return "missing", None
        status = str(data["status"])
        return status, StoredLine.of(data) if status == "ok" else None

    def work(self, task: Task) -> dict[str, Any]:
        """One line, as arrays to store."""
        name, k = task
        own = name.startswith(self._name["own"])
        approach = name.removeprefix(self._name["own" if own else "sample"] + "-")
        return self._own_line(approach, k) if own else self._sample_line(approach, k)

    def _sample_line(self, approach: str, k: int) -> dict[str, Any]:
        ends = self.values[0], self.values[-1]
        solve = Points(self.study, (approach, k), self.key, ends=ends)
        followed = follow(solve, self.coarse, self._band)
        events = find_events(followed, solve, self.threshold, FINE, onsets_alone=True)
        return line_arrays(followed, events)

    def _own_line(self, approach: str, line: int) -> dict[str, Any]:
        fixed, ends = self._scene_values(approach), (self.values[0], self.values[-1])
        if self._second is not None:
            fixed[self._second] = self.second[line]
        solve = Points(self.study, (approach, 0), self.key, fixed, ends)
        followed = follow(solve, self.values, self._band)
        return line_arrays(followed, find_events(followed, solve, self.threshold, FINE))

    def _scene_values(self, approach: str) -> dict[str, float]:
        """The scene's own values of what is random in the samples of an approach."""
        scene = self.study.scene
        if not scene.samples.takes_random(approach):
            return {}
        return {name: nominal_value(scene, name) for name in scene.samples.random}


def cut_branches(line: StoredLine, squeal: float | None = None) -> int:
    """Branches that end because nothing continues them with confidence.

    Args:
        line: of the scene's own brake, or of a sample.
        squeal: count only those whose last mode grows by more, -2 alpha / |omega| below minus this:
            what is asked of a sample is where modes begin to squeal.
    """
    cut = line.end == CUT
    if squeal is None:
        return int(np.sum(cut))
    # Rows stand branch by branch.
    s = line.s[np.flatnonzero(np.diff(line.branch, append=-1))]
    return int(np.sum(cut & (2 * s.real > squeal * np.abs(s.imag))))
