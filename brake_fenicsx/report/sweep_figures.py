"""Figures over a parameter: branches, critical values, the worst mode, the chart over two."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz, squeals
from brake_fenicsx.results.tables import Columns, rows_of

from .style import (
    BLACK,
    CYCLE,
    DAMPING_LABEL,
    KHZ,
    MARKERS,
    damping_axis,
    finish,
    label,
    look,
    new_figure,
    panel,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Kinds of lock_in.csv, as in sweeps.events, which the report does not import: it needs the solver.
MERGING, SPLITTING = "merging", "splitting"
ONSET, END, FROM_FIRST = "onset of squeal", "end of squeal", "squeals from the first value"
NO_EVENTS = {  # columns of lock_in.csv that are read, where there is none
    "approach": str, "sample": float, "kind": str, "value": float, "frequency_hz": float,
    "real_1_s": float, "branch": int, "with_branch": float,
}  # fmt: skip
MAX_WINDOWS = 3  # windows of one branch that are named
Curve = tuple[NDArray, NDArray, NDArray]
# Branches and families with a colour of their own.
MOST = 7
# How values that are stored in SI units are shown.
SHOWN = {"Pa": (1e-6, "MPa"), "Pa/m": (1e-9, "N/mm³"), "m": (1e3, "mm")}


class SweepEvents:
    """Events of the scene's own brake in one approach.

    Attributes:
        threshold: a mode squeals where its damping lies below minus this.
    """

    def __init__(self, run: RunData, approach: str):
        """Choose the events of ``lock_in.csv``; none where the table is missing.

        Args:
            run: the results.
            approach: its name.
        """
        table = run.sweep.get("lock_in") or {n: np.empty(0, t) for n, t in NO_EVENTS.items()}
        nominal = np.isnan(table["sample"]) & (table["approach"] == approach)
        self._table: Columns = rows_of(table, nominal)
        self.threshold = run.threshold

    def of(self, kind: str) -> Curve:
        """Values, frequencies [Hz] and branches of all events of a kind, shape (n,) each."""
        events = rows_of(self._table, self._table["kind"] == kind)
        return events["value"], events["frequency_hz"], events["branch"]

    def curve(self, rows: Columns, branch: int) -> Curve:
        """Values, frequencies [Hz] and dampings of a branch, with those at its events.

        A branch passes minus the threshold where it begins or ends to squeal, and has the damping
        of its partner where both merge or split.

        Args:
            rows: of ``sweep.csv``, of one approach.
            branch: its number.

        Returns:
            Arrays of shape (n,), in the order of the sweep.
        """
        rows_of_branch = rows["branch"] == branch
        columns = [rows[name][rows_of_branch] for name in ("value", "frequency_hz", "damping")]
        falling = columns[0][-1] < columns[0][0]
        events, kind = self._table, self._table["kind"]
        of_branch = events["branch"] == branch
        crossing = of_branch & np.isin(kind, (ONSET, END))
        merging = of_branch | (events["with_branch"] == branch)
        new = crossing | merging & np.isin(kind, (MERGING, SPLITTING))
        mean = -2 * events["real_1_s"] / (2 * np.pi * events["frequency_hz"])
        damping = np.where(crossing, -self.threshold, mean)
        added = (events["value"][new], events["frequency_hz"][new], damping[new])
        columns = [np.append(a, b) for a, b in zip(columns, added, strict=True)]
        order = np.argsort(-columns[0] if falling else columns[0], kind="stable")
        x, f, damping = (column[order] for column in columns)
        return x, f, damping

    def windows(self, branch: int, factor: float = 1.0) -> str:
        """Where a branch squeals, such as "14.88 kHz from 0.44 to 0.61"; empty without an event.

        Args:
            branch: its number.
            factor: of the values that are shown.

        Returns:
            The frequency at the first event, and the windows of values.
        """
        kinds = np.isin(self._table["kind"], (ONSET, END, FROM_FIRST))
        events = rows_of(self._table, (self._table["branch"] == branch) & kinds)
        windows: list[list[float]] = []
        for kind, x in zip(events["kind"], events["value"], strict=True):
            if kind != END:
                windows.append([factor * x])
            elif windows:
                windows[-1].append(factor * x)
            else:  # the branch entered the band with squeal
                windows.append([np.nan, factor * x])
        if not windows:
            return ""
        text = ", ".join(map(_window, windows[:MAX_WINDOWS]))
        more = f" and {len(windows) - MAX_WINDOWS} more" if len(windows) > MAX_WINDOWS else ""
        return f"{events['frequency_hz'][0] / 1e3:.3f} kHz {text}{more}"


def _window(ends: list[float]) -> str:
    """One window, with as many digits as tell its ends apart."""
    digits = next(d for d in (3, 5, 7) if d == 7 or len({f"{x:.{d}g}" for x in ends}) == len(ends))
    words = ("from", "to")[: len(ends)]
    told = zip(words, ends, strict=True)
    return " ".join(f"{word} {x:.{digits}g}" for word, x in told if np.isfinite(x))


def axis_of(run: RunData, number: int = 0) -> tuple[float, str]:
    """Factor and label of a parameter of the sweep.

    Args:
        run: the results.
        number: of the parameter.
    """
    units = run.summary.get("sweep", {}).get("parameters", {})
    if number >= len(units):
        return 1.0, "parameter"
    name, unit = list(units.items())[number]
    factor, shown = SHOWN.get(unit, (1.0, unit))
    return factor, f"{name} [{shown or '-'}]"


def draw_branches(run: RunData) -> Figure | None:
    """Frequency and damping of every branch of the scene's own brake, lock-in marked."""
    table = run.sweep.get("sweep")
    if table is None or "value_2" in table or not np.any(nominal := np.isnan(table["sample"])):
        return None
    approaches = [a for a in run.approaches if np.any(nominal & (table["approach"] == a))]
    figure, axes = new_figure(2, len(approaches), height=5.6, sharex=True, sharey="row")
    factor, name = axis_of(run)
    for column, approach in enumerate(approaches):
        rows = rows_of(table, nominal & (table["approach"] == approach))
        top, bottom = axes[0, column], axes[1, column]
        events = SweepEvents(run, approach)
        colours = _loud(rows, run.threshold, events)
        for number in np.unique(rows["branch"]):
            colour = colours.get(int(number))
            style: dict[str, Any] = {"color": colour or "#bbbbbb", "lw": 1.6 if colour else 0.6}
            style["zorder"] = 3 if colour else 2
            x, f, damping = events.curve(rows, int(number))
            text = events.windows(int(number), factor) or f"{f[-1] / 1e3:.3f} kHz"
            top.plot(factor * x, f / 1e3, **style)
            bottom.plot(factor * x, damping, label=text if colour else None, **style)
        _mark_mergings(top, events, factor)
        _mark_onsets(bottom, events, factor, colours)
        panel(top, "ab"[column], label(run, approach))
        bottom.axhline(-run.threshold, color=BLACK, lw=0.6, ls=":")
        damping_axis(bottom)
        finish(top)
        finish(bottom, xlabel=name)
        if colours:
            bottom.legend(title="squeals (frequency at the onset)", fontsize=7,
                          title_fontsize=8, loc="best")  # fmt: skip
    axes[0, 0].set_ylabel(KHZ)
    axes[1, 0].set_ylabel(DAMPING_LABEL)
    return figure


def _loud(rows: Columns, threshold: float, events: SweepEvents) -> dict[int, str]:
    """Colour of the branches that squeal, the worst ones of them."""
    worst = {}
    for number in np.unique(rows["branch"]):
        one = (rows["branch"] == number) & (rows["verdict"] == "unstable")
        lowest = rows["damping"][one].min(initial=0.0)
        if lowest < -threshold or events.windows(int(number)):
            worst[int(number)] = lowest
    chosen = sorted(worst, key=lambda n: float(worst[n]))[:MOST]
    return {n: CYCLE[i % len(CYCLE)] for i, n in enumerate(sorted(chosen))}


def _mark_mergings(axes: Axes, events: SweepEvents, factor: float) -> None:
    """Where modes merge and split."""
    looks = {MERGING: (MARKERS[0], BLACK), SPLITTING: (MARKERS[1], "white")}
    for kind, (marker, colour) in looks.items():
        x, f, _ = events.of(kind)
        if x.size:
            axes.scatter(
                factor * x, f / 1e3, s=13,
                marker=marker, facecolor=colour, edgecolor=BLACK, lw=0.6, zorder=4, label=kind,
            )  # fmt: skip
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncol=3, fontsize=7)


def _mark_onsets(axes: Axes, events: SweepEvents, factor: float, colours: dict[int, str]) -> None:
    """Where branches begin and end to squeal: filled and hollow."""
    for kind in (ONSET, END):
        x, _, branch = events.of(kind)
        for at, number in zip(factor * x, branch, strict=True):
            colour = colours.get(int(number), "#bbbbbb")
            face = colour if kind == ONSET else "white"
            axes.scatter(at, -events.threshold, s=22, marker=MARKERS[2], facecolor=face,
                         edgecolor=colour, lw=1.0, zorder=5)  # fmt: skip


QUANTILES = (0.05, 0.5, 0.95)


def draw_critical(run: RunData) -> Figure | None:
    """Share of samples in which each family squeals by a value, with intervals."""
    curve, families = run.sweep.get("critical_curve"), run.sweep.get("critical")
    if curve is None or families is None or not families["family"].size:
        return None
    factor, name = axis_of(run)
    figure, axes = new_figure(1, 1, height=3.4)
    axis = axes[0, 0]
    texts = kilohertz(families["frequency_hz"].tolist())
    for i, family in enumerate(families["family"][: MOST + 1]):
        any_ = np.isnan(family)
        rows = np.isnan(curve["family"]) if any_ else curve["family"] == family
        x, colour = factor * curve["value"][rows], BLACK if any_ else CYCLE[(i - 1) % len(CYCLE)]
        hits, n = int(families["squeal_samples"][i]), int(families["samples"][i])
        text = "any family" if any_ else f"{texts[i]} kHz"
        axis.plot(x, curve["share"][rows], color=colour, lw=2.0 if any_ else 1.3,
                  ls="--" if any_ else "-", drawstyle="steps-post",
                  label=f"{text} ({hits} of {n})")  # fmt: skip
        # Bands of families that all squeal, or none, would lie upon one another.
        open_ = (curve["share"][rows] > 0) & (curve["share"][rows] < 1)
        open_[1:] |= open_[:-1]
        axis.fill_between(x, curve["low"][rows], curve["high"][rows], where=open_, color=colour,
                          step="post", alpha=0.12, lw=0)  # fmt: skip
    share = "share of samples that squeal by then [-]"
    finish(axis, xlabel=name, ylabel=share, ylim=(0, 1.02))
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
    return figure


def draw_worst(run: RunData) -> Figure | None:
    """Band over the samples: lowest damping of any mode, and number of squeal modes."""
    table = run.sweep.get("sweep")
    if table is None or not np.any(rows := ~np.isnan(table["sample"])):
        return None
    rough = rows_of(table, rows)
    values, samples = np.unique(rough["value"]), np.unique(rough["sample"])
    lowest, number = np.zeros((2, samples.size, values.size))
    at = np.searchsorted(values, rough["value"])
    place = np.searchsorted(samples, rough["sample"])
    damping = np.where(rough["verdict"] == "unstable", rough["damping"], 0.0)
    np.minimum.at(lowest, (place, at), damping)
    np.add.at(number, (place, at), squeals(rough, run.threshold))
    factor, name = axis_of(run)
    colour, _ = look(str(rough["approach"][0]))
    figure, axes = new_figure(1, 2, height=2.8)
    for axis, data, text in (
        (axes[0, 0], lowest, "lowest damping of a sample [-]"),
        (axes[0, 1], number, "squeal modes of a sample [-]"),
    ):
        low, middle, high = np.quantile(data, QUANTILES, axis=0)
        axis.fill_between(factor * values, low, high, color=colour, alpha=0.25, lw=0,
                          label="5 to 95 %")  # fmt: skip
        axis.plot(factor * values, middle, color=colour, label="median")
        finish(axis, xlabel=name, ylabel=text)
    damping_axis(axes[0, 0])
    axes[0, 0].axhline(-run.threshold, color=BLACK, lw=0.6, ls=":")
    axes[0, 1].legend(loc="upper left")
    return figure


def draw_chart(run: RunData) -> Figure | None:
    """Stability chart over two parameters: number of squeal modes, and lowest damping."""
    chart = run.sweep.get("chart")
    if chart is None:
        return None
    approaches = [a for a in run.approaches if np.any(chart["approach"] == a)]
    figure, axes = new_figure(len(approaches), 2, height=2.9 * len(approaches), sharex=True,
                              sharey=True)  # fmt: skip
    (fx, x_name), (fy, y_name) = axis_of(run), axis_of(run, 1)
    for row, approach in zip(axes, approaches, strict=True):
        cells = rows_of(chart, chart["approach"] == approach)
        x, i = np.unique(cells["value"], return_inverse=True)
        y, j = np.unique(cells["value_2"], return_inverse=True)
        for axis, data, text in (
            (row[0], cells["squeal_modes"], "squeal modes"),
            (row[1], np.maximum(-cells["worst_damping"], 0.0), "largest negative damping [-]"),
        ):
            grid = np.full((y.size, x.size), np.nan)
            grid[j, i] = data
            mesh = axis.pcolormesh(fx * x, fy * y, grid, shading="nearest", cmap="viridis")
            figure.colorbar(mesh, ax=axis, label=text)
            if grid.min() <= 0.0 < grid.max():  # a chart without an onset has no contour
                axis.contour(fx * x, fy * y, grid, levels=[1e-9], colors="white", linewidths=0.8)
        row[0].set_ylabel(y_name)
        panel(row[0], "ab"[approaches.index(approach)], label(run, approach))
    for axis in axes[-1]:
        axis.set_xlabel(x_name)
    return figure
