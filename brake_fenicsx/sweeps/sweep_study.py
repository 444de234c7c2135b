"""Modes followed over a scalar: for Python, and as the sweep of a scene computes and stores them.

The scene's own brake is followed in rough and in perfect contact, at every value; rough samples
from a quarter of the values, and between them where modes meet, since what is asked of them is
where each family begins to squeal.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.build.material_table import nominal_value
from brake_fenicsx.display import Shown, html_table
from brake_fenicsx.folder.files import digest
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.samples import ensemble, sampling
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene.samples_section import ROUGH
from brake_fenicsx.scene.units import several

from .branches import CUT, Followed, follow
from .events import Event, find_events
from .matching import Points

# Accuracy of an event relative to the range.
FINE = 1e-4

# Samples are followed from every so many of the values at most, and from so many values at least.
EVERY, FEWEST = 4, 11


@dataclass(repr=False, eq=False)
class Branches(Shown):
    """Modes followed over a scalar of the scene; ``plot`` takes two axes.

    Attributes:
        values: of the scalar, SI, shape (values,).
        frequency: of every branch at every value [Hz], nan where it is not in the band, shape
            (branches, values).
        damping: -2 alpha / |omega| [-], likewise.
        events: where modes merge, split, begin and end to squeal; ``kind``, ``x``, ``s`` and
            ``branches`` of each.
        ends: why each branch ends.
        name: of the scalar, with its SI unit.
        threshold: a mode squeals where its damping lies below minus this.
    """

    values: Array
    frequency: Array
    damping: Array
    events: list[Event]
    ends: list[str]
    name: str = ""
    threshold: float = 0.0
    PANELS: ClassVar[int] = 2

    def __repr__(self) -> str:
        """One line."""
        merge = sum(e.kind == "merging" for e in self.events)
        return (
            f"Branches({len(self.frequency)} over {self.values.size} values from"
            f" {self.values[0]:g} to {self.values[-1]:g}, {merge} mergings)"
        )

    def _repr_html_(self) -> str:
        """Events as a table of a notebook."""
        rows = [[e.kind, e.x, abs(e.s.imag) / (2 * np.pi), e.s.real] for e in self.events]
        heads = ("event", self.name or "value", "frequency [Hz]", "alpha [1/s]")
        return html_table(repr(self), heads, rows)

    def _columns(self) -> dict[str, AnyArray]:
        """One row for each branch at each value where it is in the band."""
        branch, at = np.nonzero(np.isfinite(self.frequency))
        f, damping = self.frequency[branch, at], self.damping[branch, at]
        place = {"branch": branch, "value": self.values[at]}
        return {**place, "frequency_hz": f, "damping": damping, "real_1_s": -np.pi * f * damping}

    def _draw(self, *axes: Any) -> None:
        """Frequency and damping over the scalar; branches that squeal are coloured."""
        for f, damping in zip(self.frequency, self.damping, strict=True):
            loud = bool(np.any(damping < -self.threshold))
            style: dict[str, Any] = {} if loud else {"color": "0.75", "lw": 0.8, "zorder": 1}
            (line,) = axes[0].plot(self.values, f / 1e3, **style)
            text = f"{np.nanmean(f) / 1e3:.3f} kHz" if loud else None
            axes[1].plot(self.values, damping, **{**style, "color": line.get_color()}, label=text)
        axes[0].set_ylabel("frequency [kHz]")
        axes[1].axhline(-self.threshold, color="0.3", lw=0.6, ls=":")
        axes[1].set(xlabel=self.name, ylabel=r"damping $-2\,\alpha/|\omega|$ [-]")
        if axes[1].get_legend_handles_labels()[1]:
            axes[1].legend()


@dataclass(frozen=True, slots=True)
class StoredLine:
    """What is stored of one sample over one parameter, one array for each attribute.

    Attributes:
        x: values of the parameter that were computed, shape (states,).
        branch: number of the branch of each row.
        state: number of the state of each row.
        s: eigenvalue of each row [1/s].
        error: its estimated error [1/s].
        verdict: its verdict.
        begin: why each branch begins, shape (branches,).
        end: why it ends.
        kind: which event each one is, shape (events,).
        at: value of the parameter there.
        accuracy: of the value.
        event_s: eigenvalue there [1/s].
        pair: the two branches, -1 for none, shape (events, 2).
        vector: right vectors there, shape (events, m).
        stopped: why there are no modes beyond the last value; empty if there are all.
    """

    x: Array
    branch: Index
    state: Index
    s: Complex
    error: Array
    verdict: NDArray[np.str_]
    begin: NDArray[np.str_]
    end: NDArray[np.str_]
    kind: NDArray[np.str_]
    at: Array
    accuracy: Array
    event_s: Complex
    pair: Index
    vector: NDArray[np.complex64]
    stopped: str

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> "StoredLine":
        """From what ``line_arrays`` made."""
        arrays = {f.name: data[f.name] for f in fields(cls)}
        return cls(**arrays | {"stopped": str(data["stopped"])})

    @property
    def events(self) -> Iterator[Event]:
        """The events."""
        every = (self.kind, self.at, self.accuracy, self.event_s, self.pair, self.vector)
        for kind, x, error, s, pair, vector in zip(*every, strict=True):
            one, two = pair.tolist()
            yield Event(str(kind), float(x), float(error), complex(s), (one, two), vector)

    def rows(self) -> Iterator[tuple[int, int, complex, float, str]]:
        """State, branch, lambda [1/s], its error and verdict of every row."""
        every = (self.state, self.branch, self.s, self.error, self.verdict)
        return zip(*(column.tolist() for column in every), strict=True)


def line_arrays(followed: Followed, events: Sequence[Event]) -> dict[str, Any]:
    """Arrays to store of some branches and their events."""
    branches, states = followed.branches, followed.states

    def of(items: Sequence[Any], name: str, kind: type) -> AnyArray:
        return np.array([getattr(item, name) for item in items], dtype=kind)

    def of_modes(name: str, kind: type) -> AnyArray:
        places = ((i, m) for b in branches for i, m in zip(b.states, b.modes, strict=True))
        return np.array([getattr(states[i], name)[m] for i, m in places], dtype=kind)

    size = len(states[0].right)
    return {
        "x": of(states, "x", float),
        "branch": np.repeat(np.arange(len(branches)), [len(b.states) for b in branches]),
        "state": np.array([i for b in branches for i in b.states], dtype=np.intp),
        "s": of_modes("s", complex),
        "error": of_modes("error", float),
        "verdict": of_modes("verdict", str),
        "begin": of(branches, "begin", str),
        "end": of(branches, "end", str),
        "kind": of(events, "kind", str),
        "at": of(events, "x", float),
        "accuracy": of(events, "error", float),
        "event_s": of(events, "s", complex),
        "pair": of(events, "branches", np.intp).reshape(-1, 2),
        "vector": of(events, "vector", np.complex64).reshape(-1, size),
        "stopped": followed.stopped,
    }


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
        chosen = [next((a for a in kind if a in named), None) for kind in (ROUGH, sampling.PERFECT)]
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
        ensemble.run_ensemble(samples, self.work, self.study.store, self.study.comm, own, "lines")

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
