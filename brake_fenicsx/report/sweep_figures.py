"""Figures over a parameter: branches, critical values, the worst mode, the chart over two."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz, squeals

from . import style

# Kinds of lock_in.csv, as in sweeps.events, which the report does not import: it needs the solver.
MERGING, SPLITTING = "merging", "splitting"
ONSET, END, FROM_FIRST = "onset of squeal", "end of squeal", "squeals from the first value"
# Columns of lock_in.csv that are read.
EVENT = ["approach", "sample", "kind", "value", "frequency_hz", "real_1_s", "branch", "with_branch"]
MAX_WINDOWS = 3  # windows of one branch that are named
MOST = 7  # branches and families with a colour of their own
QUANTILES = (0.05, 0.5, 0.95)
# How values that are stored in SI units are shown.
SHOWN = {"Pa": (1e-6, "MPa"), "Pa/m": (1e-9, "N/mm³"), "m": (1e3, "mm")}


def _nominal_events(run: RunData, approach: str) -> pd.DataFrame:
    """Events of the scene's own brake in an approach; no row where the table is missing."""
    table = pd.DataFrame(run.sweep.get("lock_in", {}), columns=EVENT)
    return table[table["sample"].isna() & (table.approach == approach)]


def _curve(
    branches: pd.DataFrame, events: pd.DataFrame, branch: int, threshold: float
) -> pd.DataFrame:
    """Columns value, frequency_hz and damping of a branch in the order of the sweep, with events.

    A branch passes minus the threshold where it begins or ends to squeal, and has the damping of
    its partner where both merge or split.
    """
    own = branches.loc[branches.branch == branch, ["value", "frequency_hz", "damping"]]
    mine = events.branch == branch
    crossing = events[mine & events.kind.isin([ONSET, END])].assign(damping=-threshold)
    met = (mine | (events.with_branch == branch)) & events.kind.isin([MERGING, SPLITTING])
    merging = events[met].assign(damping=-events.real_1_s / (np.pi * events.frequency_hz))
    rising = bool(own.value.iloc[-1] >= own.value.iloc[0])
    whole = pd.concat([part[own.columns] for part in (own, crossing, merging) if len(part)])
    return whole.sort_values("value", ascending=rising, kind="stable")


def _windows(events: pd.DataFrame, branch: int, factor: float = 1.0) -> str:
    """Where a branch squeals, such as "14.88 kHz from 0.44 to 0.61"; empty without an event.

    Args:
        events: of the approach.
        branch: its number.
        factor: of the values that are shown.
    """
    own = events[(events.branch == branch) & events.kind.isin([ONSET, END, FROM_FIRST])]
    windows: list[list[float]] = []
    for kind, x in zip(own.kind, factor * own.value, strict=True):
        if kind != END:
            windows.append([x])
        elif windows:
            windows[-1].append(x)
        else:  # the branch entered the band with squeal
            windows.append([np.nan, x])
    if not windows:
        return ""
    text = ", ".join(map(_window, windows[:MAX_WINDOWS]))
    more = f" and {len(windows) - MAX_WINDOWS} more" if len(windows) > MAX_WINDOWS else ""
    return f"{own.frequency_hz.iloc[0] / 1e3:.3f} kHz {text}{more}"


def _window(ends: list[float]) -> str:
    """One window, with as many digits as tell its ends apart."""
    digits = next(d for d in (3, 5, 7) if d == 7 or len({f"{x:.{d}g}" for x in ends}) == len(ends))
    told = zip(("from", "to"), ends, strict=False)
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


def draw_branches(run: RunData) -> style.Figure | None:
    """Frequency and damping of every branch of the scene's own brake, lock-in marked."""
    table = pd.DataFrame(run.sweep.get("sweep", {"sample": []}))
    nominal = table[table["sample"].isna()]
    if nominal.empty or "value_2" in table:
        return None
    approaches = [a for a in run.approaches if (nominal.approach == a).any()]
    figure, axes = style.new_figure(2, len(approaches), height=5.6, sharex=True, sharey="row")
    factor, name = axis_of(run)
    for letter, approach, (top, bottom) in zip("abcd", approaches, axes.T, strict=False):
        rows, events = nominal[nominal.approach == approach], _nominal_events(run, approach)
        colours = _loud(rows, run.threshold, events)
        for number in rows.branch.unique():
            colour = colours.get(number)
            looks: dict[str, Any] = {"color": colour or "#bbbbbb", "lw": 1.6 if colour else 0.6}
            looks["zorder"] = 3 if colour else 2
            curve = _curve(rows, events, number, run.threshold)
            last = f"{curve.frequency_hz.iloc[-1] / 1e3:.3f} kHz"
            text = (_windows(events, number, factor) or last) if colour else None
            top.plot(factor * curve.value, curve.frequency_hz / 1e3, **looks)
            bottom.plot(factor * curve.value, curve.damping, label=text, **looks)
        _mark_events(top, bottom, events.assign(value=factor * events.value), colours, run)
        style.panel(top, letter, style.label(run, approach))
        bottom.axhline(-run.threshold, color=style.BLACK, lw=0.6, ls=":")
        style.damping_axis(bottom)
        style.finish(top)
        style.finish(bottom, xlabel=name)
        if colours:
            title = "squeals (frequency at the onset)"
            bottom.legend(title=title, fontsize=7, title_fontsize=8, loc="best")
    axes[0, 0].set_ylabel(style.KHZ)
    axes[1, 0].set_ylabel(style.DAMPING_LABEL)
    return figure


def _loud(rows: pd.DataFrame, threshold: float, events: pd.DataFrame) -> dict[int, str]:
    """Colour of the branches that squeal, the worst ones of them."""
    growing = rows.damping.where(rows.verdict == "unstable", 0.0).clip(upper=0.0)
    lowest = growing.groupby(rows.branch).min()
    loud = [n for n, damping in lowest.items() if damping < -threshold or _windows(events, n)]
    chosen = lowest[loud].sort_values(kind="stable").index[:MOST]
    return {n: style.CYCLE[i % len(style.CYCLE)] for i, n in enumerate(sorted(chosen))}


def _mark_events(
    top: style.Axes, bottom: style.Axes, events: pd.DataFrame, colours: dict[int, str], run: RunData
) -> None:
    """Where modes merge and split, and where branches begin and end to squeal: filled, hollow."""
    looks: dict[str, Any] = {"edgecolor": style.BLACK, "lw": 0.6, "zorder": 4}
    for kind, marker, colour in ((MERGING, "o", style.BLACK), (SPLITTING, "s", "white")):
        own = events[events.kind == kind]
        if len(own):
            more = {"s": 13, "c": colour, "marker": marker, "label": kind}
            top.scatter(own.value, own.frequency_hz / 1e3, **looks | more)
    if top.get_legend_handles_labels()[0]:
        top.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncol=3, fontsize=7)
    for kind in (ONSET, END):
        for event in events[events.kind == kind].itertuples():
            colour = colours.get(event.branch, "#bbbbbb")
            face = colour if kind == ONSET else "white"
            looks = {"facecolor": face, "edgecolor": colour, "lw": 1.0, "zorder": 5}
            bottom.scatter(event.value, -run.threshold, 22, marker="^", **looks)


def draw_critical(run: RunData) -> style.Figure | None:
    """Share of samples in which each family squeals by a value, with intervals."""
    curves, families = (pd.DataFrame(run.sweep.get(n, {})) for n in ("critical_curve", "critical"))
    if curves.empty or families.empty:
        return None
    factor, name = axis_of(run)
    figure, ((axis,),) = style.new_figure(1, 1, height=3.4)
    families["text"] = [f"{text} kHz" for text in kilohertz(families.frequency_hz.tolist())]
    for i, family in enumerate(families.head(MOST + 1).itertuples()):
        every = np.isnan(family.family)
        curve = curves[curves.family.isna() if every else curves.family == family.family]
        colour = style.BLACK if every else style.CYCLE[(i - 1) % len(style.CYCLE)]
        text = "any family" if every else family.text
        text = f"{text} ({int(family.squeal_samples)} of {int(family.samples)})"
        looks = {"lw": 2.0, "ls": "--"} if every else {"lw": 1.3}
        x = factor * curve.value
        axis.plot(x, curve.share, color=colour, drawstyle="steps-post", label=text, **looks)
        # Bands of families that all squeal, or none, would lie upon one another.
        open_ = curve.share.between(0, 1, inclusive="neither")
        open_ |= open_.shift(fill_value=False)
        looks = {"where": open_, "step": "post", "alpha": 0.12, "lw": 0}
        axis.fill_between(x, curve.low, curve.high, color=colour, **looks)
    share = "share of samples that squeal by then [-]"
    style.finish(axis, xlabel=name, ylabel=share, ylim=(0, 1.02))
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
    return figure


def draw_worst(run: RunData) -> style.Figure | None:
    """Band over the samples: lowest damping of any mode, and number of squeal modes."""
    table = pd.DataFrame(run.sweep.get("sweep", {"sample": []}))
    rough = table[table["sample"].notna()]
    if rough.empty:
        return None
    growing = rough.damping.where(rough.verdict == "unstable", 0.0).clip(upper=0.0)
    rough = rough.assign(lowest=growing, number=squeals(rough, run.threshold).astype(int))
    each = rough.groupby(["sample", "value"]).agg({"lowest": "min", "number": "sum"})
    factor, name = axis_of(run)
    colour, _ = style.look(rough.approach.iloc[0])
    figure, axes = style.new_figure(1, 2, height=2.8)
    texts = {"lowest": "lowest damping of a sample [-]", "number": "squeal modes of a sample [-]"}
    for axis, (column, text) in zip(axes[0], texts.items(), strict=True):
        bands = each[column].unstack("value", fill_value=0).quantile(QUANTILES)
        values, (low, middle, high) = factor * bands.columns, bands.to_numpy()
        axis.fill_between(values, low, high, color=colour, alpha=0.25, lw=0, label="5 to 95 %")
        axis.plot(values, middle, color=colour, label="median")
        style.finish(axis, xlabel=name, ylabel=text)
    style.damping_axis(axes[0, 0])
    axes[0, 0].axhline(-run.threshold, color=style.BLACK, lw=0.6, ls=":")
    axes[0, 1].legend(loc="upper left")
    return figure


def draw_chart(run: RunData) -> style.Figure | None:
    """Stability chart over two parameters: number of squeal modes, and lowest damping."""
    if (chart := run.sweep.get("chart")) is None:
        return None
    cells = pd.DataFrame(chart).assign(worst=(-chart["worst_damping"]).clip(0.0))
    approaches = [a for a in run.approaches if (cells.approach == a).any()]
    looks: dict[str, Any] = {"height": 2.9 * len(approaches), "sharex": True, "sharey": True}
    figure, axes = style.new_figure(len(approaches), 2, **looks)
    (fx, x_name), (fy, y_name) = axis_of(run), axis_of(run, 1)
    texts = {"squeal_modes": "squeal modes", "worst": "largest negative damping [-]"}
    for letter, row, approach in zip("abcd", axes, approaches, strict=False):
        for axis, (column, text) in zip(row, texts.items(), strict=True):
            own = cells[cells.approach == approach].pivot(
                index="value_2", columns="value", values=column
            )
            x, y, grid = fx * own.columns, fy * own.index, own.to_numpy(float)
            mesh = axis.pcolormesh(x, y, grid, shading="nearest", cmap="viridis")
            figure.colorbar(mesh, ax=axis, label=text)
            if grid.min() <= 0.0 < grid.max():  # a chart without an onset has no contour
                axis.contour(x, y, grid, levels=[1e-9], colors="white", linewidths=0.8)
        row[0].set_ylabel(y_name)
        style.panel(row[0], letter, style.label(run, approach))
    for axis in axes[-1]:
        axis.set_xlabel(x_name)
    return figure
