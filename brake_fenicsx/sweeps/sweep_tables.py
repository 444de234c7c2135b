"""Tables of a sweep.

sweep.csv           every followed mode at every value
lock_in.csv         where modes merge, split, jump, begin and end to squeal
chart.csv           over two parameters: number of unstable modes, worst damping
critical.csv        value at which each family begins to squeal, over the samples
critical_curve.csv  share of samples in which it squeals by each value
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Complex
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.results.families import Onsets, known_numbers
from brake_fenicsx.results.run import SWEEP, save_tables
from brake_fenicsx.results.squeal import squeals
from brake_fenicsx.results.tables import Row, RowTable
from brake_fenicsx.scene.scalars import si_unit

from .events import FROM_FIRST, MERGING, ONSET, Critical, critical_values
from .sweep_study import StoredLine, SweepStudy, cut_branches

# A mode that begins to squeal takes the number of a family that squeals in the samples, unless it
# is so much likelier another one, as the decaying mode of the same pair.
PREFERRED = 1.2


@dataclass(frozen=True, slots=True)
class LineRow(Row):
    """The line that a row is of; the sample is empty of the scene's own brake.

    The second value is that of a chart.
    """

    approach: str
    sample: int | None
    value_2: float | None


@dataclass(frozen=True, slots=True)
class SweepRow(LineRow):
    """A row of sweep.csv: a followed mode at a value."""

    value: float
    point: int
    branch: int
    frequency_hz: float
    real_1_s: float
    damping: float
    error_estimate: float
    verdict: str


@dataclass(frozen=True, slots=True)
class EventRow(LineRow):
    """A row of lock_in.csv: an event of a branch."""

    kind: str
    value: float
    accuracy: float
    frequency_hz: float | None
    real_1_s: float | None
    branch: int | None
    with_branch: int | None
    family: int | None


@dataclass(frozen=True, slots=True)
class ChartRow(Row):
    """A row of chart.csv: counts at a point of two parameters."""

    approach: str
    value: float
    value_2: float | None
    unstable_modes: int
    squeal_modes: int
    worst_damping: float | None


@dataclass(frozen=True, slots=True)
class CriticalRow(Row):
    """A row of critical.csv: quantiles of the critical value of a family."""

    approach: str
    parameter: str
    family: int | None
    frequency_hz: float
    samples: int
    squeal_samples: int
    at_first_value: int
    value_5: float | None
    value_50: float | None
    value_50_low: float | None
    value_50_high: float | None
    value_95: float | None


@dataclass(frozen=True, slots=True)
class CurveRow(Row):
    """A row of critical_curve.csv: share of samples of a family by a value."""

    approach: str
    family: int | None
    value: float
    samples: int
    share: float | None
    low: float | None
    high: float | None


class SweepTables:
    """Tables of a sweep from its stored lines, on one process."""

    def __init__(
        self, sweep: SweepStudy, families: Complex | None = None, squealing: Sequence[int] = ()
    ):
        """Read the lines.

        Args:
            sweep: the sweep.
            families: vectors of the families of the scene's samples, by which those of the sweep
                are numbered, shape (m, families); numbered anew if None.
            squealing: those of them that squeal.
        """
        self._sweep = sweep
        self._own = {t: sweep.line("own", t) for t in sweep.nominal}
        self._samples = {t: sweep.line("sample", t) for t in sweep.samples}
        self._family = self._families(families, list(squealing))

    def write(self) -> dict[str, Any]:
        """Write the tables; returns figures for the summary."""
        store, chart = self._sweep.study.store, bool(self._sweep.second)
        without = () if chart else ("value_2",)
        tables = {
            "sweep": RowTable.of(SweepRow, self._mode_rows(), without),
            "lock_in": RowTable.of(EventRow, self._event_rows(), without),
        }
        if chart:
            tables["chart"] = RowTable.of(ChartRow, self._chart_rows())
        critical: list[Critical] = []
        if any(line is not None for _, line in self._samples.values()):
            critical = critical_values(self._onsets(), self._rising)
            tables["critical"] = RowTable.of(CriticalRow, self._critical_rows(critical))
            tables["critical_curve"] = RowTable.of(CurveRow, self._curve_rows(critical))
        for name, table in tables.items():
            table.write(store.path(f"{name}.csv"))
        save_tables(store, SWEEP, {name: table.columns for name, table in tables.items()})
        return {"sweep": self._facts(critical)}

    @property
    def _rising(self) -> bool:
        return self._sweep.values[-1] > self._sweep.values[0]

    def _lines(self) -> Iterator[tuple[list[Any], Task, str, StoredLine]]:
        """First cells, task and kind of every line that is there."""
        for kind, lines in (("own", self._own), ("sample", self._samples)):
            for task, (_, line) in lines.items():
                if line is None:
                    continue
                sample = task[1] if kind == "sample" else None
                second = self._sweep.second[task[1]] if self._sweep.second else None
                yield [task[0], sample, second], task, kind, line

    def _mode_rows(self) -> Iterator[SweepRow]:
        for first, _, kind, line in self._lines():
            values = self._sweep.values if kind == "own" else self._sweep.coarse
            wanted = {x: i for i, x in enumerate(values)}
            for state, branch, s, error, verdict in line.rows():
                x = float(line.x[state])
                if x in wanted:
                    numbers = s.imag / (2 * np.pi), s.real, -2 * s.real / s.imag + 0.0
                    yield SweepRow.of(*first, x, wanted[x], branch, *numbers, error, verdict)

    def _event_rows(self) -> Iterator[EventRow]:
        for first, task, kind, line in self._lines():
            for i, e in enumerate(line.events):
                there = np.isfinite(e.s)
                pair = [n if n >= 0 else None for n in e.branches]
                s = (float(e.s.imag / (2 * np.pi)), float(e.s.real)) if there else (None, None)
                family = self._family.get((kind, task, i))
                yield EventRow.of(*first, e.kind, e.x, e.error, *s, *pair, family)

    def _families(
        self, known: Complex | None, squealing: list[int]
    ) -> dict[tuple[str, Task, int], int]:
        """Family of the mode of every event that has a vector."""
        events = [
            ((kind, task, i), e)
            for _, task, kind, line in self._lines()
            for i, e in enumerate(line.events)
            if np.any(e.vector)
        ]
        if not events:
            return {}
        modes = Onsets(np.array([e.vector for _, e in events], complex).T)
        own, first = modes.families(np.array([e.s.imag / (2 * np.pi) for _, e in events]))
        # A mode that begins to squeal resembles both of the pair that merged: such modes are
        # gathered first, and each family of them then takes the number of the nearest known one.
        before = Onsets(modes.vectors[:, :0] if known is None else known)
        likeness = modes.like(first, before).T
        likeness[squealing] *= PREFERRED
        number = known_numbers(likeness)
        return {key: number[n] for (key, _), n in zip(events, own, strict=True)}

    def _onsets(self) -> list[list[tuple[int, float, float]]]:
        """Of each sample that was followed, the modes that begin to squeal."""
        found = []
        for task, (_, line) in self._samples.items():
            if line is None:
                continue
            before = -np.inf if self._rising else np.inf
            own = [
                (
                    self._family[("sample", task, i)],
                    e.x if e.kind == ONSET else before,
                    e.s.imag / (2 * np.pi),
                )
                for i, e in enumerate(line.events)
                if e.kind in (ONSET, FROM_FIRST)
            ]
            found.append(own)
        return found

    def _chart_rows(self) -> Iterator[ChartRow]:
        for first, _, _, line in self._lines():
            modes = {"damping": -2 * line.s.real / line.s.imag, "verdict": line.verdict}
            unstable, squeal = modes["verdict"] == "unstable", squeals(modes, self._sweep.threshold)
            for x in self._sweep.values:
                here = np.flatnonzero(line.x[line.state] == x)
                worst = float(modes["damping"][here].min()) if here.size else None
                counts = int(unstable[here].sum()), int(squeal[here].sum())
                yield ChartRow.of(first[0], x, first[2], *counts, worst)

    def _critical_rows(self, critical: Sequence[Critical]) -> Iterator[CriticalRow]:
        for c in critical:
            low, middle, high = (c.quantile(p) for p in (0.05, 0.5, 0.95))
            cells = [low[0], *middle, high[0]]
            at_first = int(np.sum(c.values == -np.inf))
            yield CriticalRow.of(
                self._sweep.samples[0][0], self._sweep.key, c.family if c.family >= 0 else None,
                c.frequency, c.values.size, c.reached, at_first,
                *(float(v) if np.isfinite(v) else None for v in cells),
            )  # fmt: skip

    def _curve_rows(self, critical: Sequence[Critical]) -> Iterator[CurveRow]:
        values = self._sweep.values
        for c in critical:
            # The share steps where a sample begins to squeal.
            onsets = (c.sign * c.values[np.isfinite(c.values)]).tolist()
            for x in sorted({*values, *onsets}, reverse=values[0] > values[-1]):
                share = c.by(x)
                number = c.family if c.family >= 0 else None
                yield CurveRow.of(self._sweep.samples[0][0], number, x, share.n, *share.cells)

    def _facts(self, critical: Sequence[Critical]) -> dict[str, Any]:
        """Figures for the summary."""
        statuses = [status for lines in (self._own, self._samples) for status, _ in lines.values()]
        lines = [line for _, _, _, line in self._lines()]
        scene = self._sweep.study.scene
        facts: dict[str, Any] = {
            "parameters": {key: si_unit(scene, key) for key in self._sweep.keys},
            "lines": len(statuses),
            "failed_lines": sum(status != "ok" for status in statuses),
            "points": int(sum(line.x.size for line in lines)),
            "mergings": sum(e.kind == MERGING for line in lines for e in line.events),
            "lines_without_equilibrium": sum(bool(line.stopped) for line in lines),
            "cut_branches": sum(
                cut_branches(line, self._sweep.threshold if kind == "sample" else None)
                for _, _, kind, line in self._lines()
            ),
        }
        if critical:
            # JSON has no infinity, the value of a median beyond the sweep.
            median, low, high = (v if np.isfinite(v) else None for v in critical[0].quantile(0.5))
            about = {"median": median, "low": low, "high": high}
            counts = {"samples": critical[0].values.size, "squeal_samples": critical[0].reached}
            facts["critical_value_any_family"] = {**about, **counts}
        return facts
