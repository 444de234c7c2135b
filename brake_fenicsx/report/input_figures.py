"""Which input moves squeal: sensitivity indices, rank correlations, derivatives of modes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from brake_fenicsx.results.ensemble_statistics import Correlation, rank_correlation
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import Family
from brake_fenicsx.results.tables import SAMPLES, rows_of

from . import style
from .contact_figures import PadMap, draw_pads, sliding_rows

HATCHES = ("", "///", "...", "xxx", "\\\\\\")  # told apart without colours
NO_INPUT = (*SAMPLES, "rejected", "tolerance_missed")  # columns of samples.csv
FEWEST = 10  # samples below which a correlation says nothing


def draw_sensitivity(run: RunData, most: int = 6) -> style.Figure | None:
    """Bars of the indices of growth: the whole band, then the most severe families.

    Args:
        run: the results.
        most: groups of bars for each approach.

    Returns:
        One panel per approach; None where no index is known.
    """
    table = pd.DataFrame(run.causes.get("sensitivity", {"outcome": [], "first": []}))
    table = table[table.outcome == "growth"].dropna(subset="first")
    names = [a for a in run.approaches if len(table) and (table.approach == a).any()]
    if not names:
        return None
    figure, axes = style.new_figure(len(names), 1, height=0.9 + 2.4 * len(names), sharey=True)
    for axis, name in zip(axes.flat, names, strict=True):
        own = table[table.approach == name]
        _draw_indices(axis, own, most)
        known = f"{own.method.iloc[0]}, {own.samples.iloc[0]} samples"
        axis.set_title(f"{style.label(run, name)}: {known}")
    axes[0, 0].legend(fontsize=7.5, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.1))
    return figure


def _draw_indices(axis: style.Axes, table: pd.DataFrame, most: int) -> None:
    """First-order indices as bars, total ones as diamonds, both with their intervals.

    The whole band first, then families in the order of the table; no single bands. Without an
    interval an index is a guess: an empty bar.
    """
    bands, families = (table[table.scope == scope] for scope in ("band", "family"))
    shown = pd.concat([bands[bands["where"].isin(bands["where"].head(1))], families])
    group = shown.groupby(["scope", "where"], sort=False).ngroup()
    shown = shown.assign(group=group)[group < most]
    width = 0.8 / shown.input.nunique()
    for i, (name, own) in enumerate(shown.groupby("input", sort=False)):
        x, colour = own.group - 0.4 + (i + 0.5) * width, style.CYCLE[i % len(style.CYCLE)]
        looks = {"hatch": HATCHES[i % len(HATCHES)], "lw": 0.4, "alpha": 0.75, "label": name}
        bars = axis.bar(x, own["first"], 0.9 * width, color=colour, edgecolor="white", **looks)
        for bar, low in zip(bars, own.first_low, strict=True):
            if not np.isfinite(low):
                bar.set(facecolor="none", edgecolor=colour, linewidth=1.0, hatch="")
        axis.plot(x + 0.25 * width, own.total, "D", color=style.BLACK, ms=3)
        for kind, at in (("first", x), ("total", x + 0.25 * width)):
            known = own[own[f"{kind}_low"].notna()]
            reach = known[kind] - known[f"{kind}_low"], known[f"{kind}_high"] - known[kind]
            looks = {"fmt": "none", "ecolor": style.BLACK, "elinewidth": 1, "capsize": 2}
            axis.errorbar(at[known.index], known[kind], reach, **looks)
    axis.axhline(0.0, color=style.BLACK, lw=0.7)
    rows = shown.drop_duplicates("group")
    families = (rows.frequency_hz / 1e3).map("{:.3f} kHz\n(family ".format) + rows["where"] + ")"
    marks = families.where(rows.scope != "band", rows["where"] + " Hz").tolist()
    axis.set_xticks(range(len(marks)), marks)
    style.finish(axis, "y", ylabel="share of the variance\nof the growth rate [-]")


def correlations(run: RunData, approach: str) -> list[tuple[str, Correlation]]:
    """Rank correlation of every input that varies, the strongest first.

    A correlation is a first look, blind to inputs that act in opposite ways in different modes.

    Args:
        run: the results.
        approach: name of the approach.

    Returns:
        Names and correlations; none where there are few samples or the count never changes.
    """
    per_sample = run.squeal.count(approach).per_sample
    if run.samples is None or per_sample.size < FEWEST or np.ptp(per_sample) == 0:
        return []
    table = pd.DataFrame(run.samples)
    good = table[(table.approach == approach) & (table.status == "ok")]
    inputs = good.sort_values("sample", kind="stable").drop(columns=[*NO_INPUT], errors="ignore")
    inputs = inputs.select_dtypes("number").astype(float)
    inputs = inputs.loc[:, np.isfinite(inputs).all() & (inputs.nunique() > 1)]
    # The mean friction says nothing beside the friction of the one interface it is the mean of.
    if sum(name.startswith("contact.") for name in inputs) == 1:
        inputs = inputs.drop(columns="mu", errors="ignore")
    found = [(name, rank_correlation(inputs[name].to_numpy(), per_sample)) for name in inputs]
    return sorted(found, key=lambda pair: -abs(pair[1].rho))


def draw_correlations(run: RunData, most: int = 12) -> style.Figure | None:
    """Bars of the rank correlations with their intervals, one panel per approach."""
    shown = {a: found[:most] for a in run.approaches if (found := correlations(run, a))}
    if not shown:
        return None
    rows = [len(inputs) for inputs in shown.values()]
    height, ratios = 0.7 + 0.5 * len(rows) + 0.26 * sum(rows), [n + 1 for n in rows]
    grid: dict[str, Any] = {"sharex": True, "gridspec_kw": {"height_ratios": ratios}}
    figure, axes = style.new_figure(len(rows), 1, height, **grid)
    for axis, (approach, inputs) in zip(axes.flat, shown.items(), strict=True):
        y = np.arange(len(inputs))[::-1]
        rho, low, high = np.array([(c.rho, c.low, c.high) for _, c in inputs]).T
        axis.barh(y, rho, 0.7, color=style.look(approach)[0], alpha=0.75)
        looks = {"fmt": "none", "ecolor": style.BLACK, "elinewidth": 1, "capsize": 2}
        axis.errorbar(rho, y, xerr=[rho - low, high - rho], **looks)
        axis.axvline(0.0, color=style.BLACK, lw=0.7)
        axis.set_yticks(y, [name for name, _ in inputs])
        title = f"{style.label(run, approach)}: {run.squeal.count(approach).samples} samples"
        style.finish(axis, "x", title=title, xlim=(-1, 1), ylim=(-0.6, len(inputs) - 0.4))
    what = f"the number of squeal modes ({run.criterion})"
    axes[-1, 0].set_xlabel(f"rank correlation with {what} [-]")
    return figure


MEDIAN = "median"
MOST = 4  # families of an approach, the most severe first
SIGNED = "RdBu_r"
COLOURS = {
    "friction": style.VERMILION, "load": style.PURPLE, "contact stiffness": style.SKY,
    "stiffness": style.BLUE, "mass": style.GREEN, "length": style.BLACK,
    "loss factor": style.ORANGE,
}  # fmt: skip
# What each bar changes: friction coefficient by 0.01, loss factor by 0.001, all others by 1 %.
STEPS = {"loss factor": 1e-3}
# Columns of drivers_contact.csv per area, their names, and factors: of 1/s and shares per m^2.
MAPS = (
    ("dalpha_dlnk_1_s", "d alpha / d ln k\n[1/(s cm²)]", 1e-4),
    ("friction_work", "work of friction\n[% of energy / cm²]", 1e-2),
)


def draw_drivers(run: RunData) -> style.Figure | None:
    """Change of the growth rate by small changes of every parameter; one panel per family.

    Bars: the first sample. Diamonds: median over the samples where the family squeals. Hollow bars
    are not trusted.
    """
    if run.drivers is None:
        return None
    table = pd.DataFrame(run.drivers)
    each = {name: table[table.approach == name] for name in run.approaches}
    rows = {
        name: families[:MOST]
        for name, own in each.items()
        if (families := [f for f in run.squeal.families(name) if (own.family == f.number).any()])
    }
    if not rows:
        return None
    # The simplest approach, and that of the most random inputs: a page has no room for more.
    approaches = [*rows][:: max(len(rows) - 1, 1)]
    pairs = table[["kind", "parameter"]].drop_duplicates()
    pairs = pairs.sort_values("kind", key=lambda kinds: kinds.map([*COLOURS].index), kind="stable")
    names = [
        kind if parameter == "all" and kind != "load" else f"{kind}, {parameter}"
        for kind, parameter in pairs.to_numpy()
    ]
    table = table.merge(pairs.assign(y=range(len(pairs))))
    height = (0.165 * len(names) + 0.75) * len(approaches) + 0.55
    columns = max(len(rows[name]) for name in approaches)
    figure, axes = style.new_figure(len(approaches), columns, height=height, sharey=True)
    for row, approach in zip(axes, approaches, strict=True):
        own = table[table.approach == approach]
        for axis, family in zip(row, rows[approach], strict=False):
            _draw_bars(axis, own[own.family == family.number], family)
        for axis in row[len(rows[approach]) :]:
            axis.set_visible(False)
        row[0].set_ylabel(style.label(run, approach))
    axes[0, 0].set_yticks(range(len(names)), names, fontsize=7.5)
    axes[0, 0].set_ylim(len(names) - 0.4, -0.6)
    text = "change of alpha [1/s] by +0.01 of a friction coefficient, +0.001 of a loss factor, "
    figure.supxlabel(f"{text}+1 % of any other", fontsize=8.5)
    return figure


def _draw_bars(axis: style.Axes, table: pd.DataFrame, family: Family) -> None:
    """Bars of one family; of several modes of it in the first sample the most unstable one."""
    table = table.assign(change=table.dalpha_dp_1_s * table.kind.map(STEPS).fillna(0.01))
    of_median = table["sample"].astype(str) == MEDIAN
    median, first = table[of_median], table[~of_median]
    for row in first[first.alpha == first.alpha.max()].sort_values("y").itertuples():
        colour = COLOURS[row.kind]
        face = colour if row.trusted == "yes" else "none"
        axis.barh(row.y, row.change, 0.7, edgecolor=colour, linewidth=0.8, facecolor=face)
    axis.plot(median.change, median.y, "D", color=style.BLACK, ms=3)
    axis.axvline(0.0, color=style.BLACK, lw=0.7)
    style.finish(axis, "x")
    alpha = (median if len(median) else first).alpha.iloc[0]
    axis.set_title(f"{family.kilohertz} kHz\nalpha {alpha:.4g} 1/s", fontsize=8)
    axis.tick_params(axis="x", labelsize=7)
    axis.locator_params(axis="x", nbins=4)


def draw_driver_maps(run: RunData) -> style.Figure | None:
    """Where contact stiffness and friction act on the most unstable mode of each first sample."""
    if run.driver_maps is None or run.contact is None:
        return None
    maps, contact = pd.DataFrame(run.driver_maps), sliding_rows(run, run.contact)
    if maps.empty or not contact["element"].size:
        return None
    drawn = []
    for name in (name for name in run.approaches if (maps.approach == name).any()):
        own, modes = maps[maps.approach == name], run.squeal.modes(name)
        known = modes[(modes["sample"] == own["sample"].iloc[0]) & modes["mode"].isin(own["mode"])]
        worst = known.loc[known.damping.idxmin()]
        rows = (contact["approach"] == name) & (contact["sample"] == worst["sample"])
        table = rows_of(contact, rows)
        chosen = own[own["mode"] == worst["mode"]].set_index("element")
        for column, text, factor in MAPS:
            values = chosen[column].reindex(table["element"], fill_value=0.0).to_numpy()
            values = values / table["area"] * factor
            top = float(np.quantile(np.abs(values[values != 0]), 0.98)) if values.any() else 1.0
            place = f"{style.label(run, name)}, {worst.frequency_hz / 1e3:.3f} kHz"
            drawn.append(PadMap(place, table, values, (-top, top), text))
    return draw_pads(run, drawn, SIGNED)
