"""Which input moves squeal: sensitivity indices of the growth, rank correlations with the count."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.statistics import Correlation, rank_correlation
from brake_fenicsx.results.tables import SAMPLES, Columns, rows_of

from .style import BLACK, CYCLE, label, light_grid, look, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HATCHES = ("", "///", "...", "xxx", "\\\\\\")  # told apart without colours
NO_INPUT = (*SAMPLES, "rejected", "tolerance_missed")  # columns of samples.csv
FEWEST = 10  # samples below which a correlation says nothing


def draw_sensitivity(run: RunData, most: int = 6) -> Figure | None:
    """Bars of the indices of growth: the whole band, then the most severe families.

    Args:
        run: the results.
        most: groups of bars for each approach.

    Returns:
        One panel per approach; None where no index is known.
    """
    table = run.causes.get("sensitivity")
    if table is None or not table["approach"].size:
        return None
    known = (table["outcome"] == "growth") & np.isfinite(table["first"].astype(float))
    table = rows_of(table, known)
    names = [a for a in run.approaches if np.any(table["approach"] == a)]
    if not names:
        return None
    figure, axes = new_figure(len(names), 1, height=0.9 + 2.4 * len(names), sharey=True)
    for axis, name in zip(axes.flat, names, strict=True):
        own = table["approach"] == name
        _draw(axis, rows_of(table, own), most)
        samples = f", {table['samples'][own][0]} samples"
        axis.set_title(f"{label(run, name)}: {table['method'][own][0]}{samples}")
    axes[0, 0].legend(fontsize=7.5, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.1))
    return figure


def _groups(table: Columns) -> list[tuple[str, str]]:
    """The whole band first, then families in the order of the table; no single bands."""
    pairs = list(zip(map(str, table["scope"]), map(str, table["where"]), strict=True))
    first = [p for p in pairs if p[0] == "band"][:1]
    return list(dict.fromkeys([*first, *(p for p in pairs if p[0] == "family")]))


def _draw(axis: Axes, table: Columns, most: int) -> None:
    groups, inputs = _groups(table)[:most], list(dict.fromkeys(map(str, table["input"])))
    width = 0.8 / len(inputs)
    marks = []
    for j, (scope, where) in enumerate(groups):
        own = (table["scope"] == scope) & (table["where"].astype(str) == where)
        hertz = float(table["frequency_hz"][own][0])
        family = f"{hertz / 1e3:.3f} kHz\n(family {where})"
        marks.append(f"{where} Hz" if scope == "band" else family)
        for i, key in enumerate(inputs):
            x = j - 0.4 + (i + 0.5) * width
            name = key if j == 0 else None
            look = CYCLE[i % len(CYCLE)], HATCHES[i % len(HATCHES)]
            _bar(axis, table, own & (table["input"] == key), x, width, look, name)
    axis.axhline(0.0, color=BLACK, lw=0.7)
    axis.set_xticks(range(len(groups)), marks)
    axis.set_ylabel("share of the variance\nof the growth rate [-]")
    light_grid(axis, axis="y")


def _bar(
    axis: Axes,
    table: Columns,
    row: np.ndarray,
    x: float,
    width: float,
    look: tuple[str, str],
    name: str | None,
) -> None:
    """First-order index as a bar, the total one as a diamond, both with their intervals."""
    if not row.any():
        return
    colour, hatch = look
    for kind, shift in (("first", 0.0), ("total", 0.25 * width)):
        value, low, high = (float(table[f"{kind}{end}"][row][0]) for end in ("", "_low", "_high"))
        if not np.isfinite(value):
            continue
        if kind == "first":
            # Without an interval it is a guess: an empty bar.
            known = bool(np.isfinite(low))
            axis.bar(x, value, 0.9 * width, color=colour if known else "none",
                     edgecolor="white" if known else colour, linewidth=0.4 if known else 1.0,
                     hatch=hatch if known else "", alpha=0.75, label=name)  # fmt: skip
        else:
            axis.plot(x + shift, value, "D", color=BLACK, ms=3)
        if np.isfinite(low):
            reach = [[value - low], [high - value]]
            axis.errorbar(
                x + shift, value, reach, fmt="none", ecolor=BLACK, elinewidth=1, capsize=2
            )


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
    good = (run.samples["approach"] == approach) & (run.samples["status"] == "ok")
    order = np.argsort(run.samples["sample"][good], kind="stable")
    found = []
    for name, column in run.samples.items():
        if name in NO_INPUT or not np.issubdtype(column.dtype, np.number):
            continue
        values = column[good][order].astype(float)
        if np.all(np.isfinite(values)) and np.ptp(values) > 0:
            found.append((name, rank_correlation(values, per_sample)))
    # The mean friction says nothing beside the friction of the one interface it is the mean of.
    frictions = [name for name, _ in found if name.startswith("contact.")]
    found = [d for d in found if d[0] != "mu" or len(frictions) != 1]
    return sorted(found, key=lambda d: -abs(d[1].rho))


def draw_correlations(run: RunData, most: int = 12) -> Figure | None:
    """Bars of the rank correlations with their intervals, one panel per approach."""
    shown = [(a, correlations(run, a)[:most]) for a in run.approaches]
    shown = [(a, found) for a, found in shown if found]
    if not shown:
        return None
    rows = sum(len(found) for _, found in shown)
    heights = [len(found) + 1 for _, found in shown]
    figure, axes = new_figure(
        len(shown),
        1,
        height=0.7 + 0.5 * len(shown) + 0.26 * rows,
        sharex=True,
        gridspec_kw={"height_ratios": heights},
    )
    for axis, (approach, found) in zip(axes.flat, shown, strict=True):
        y = np.arange(len(found))[::-1]
        rho = np.array([c.rho for _, c in found])
        reach = np.array([[c.rho - c.low, c.high - c.rho] for _, c in found]).T
        axis.barh(y, rho, 0.7, color=look(approach)[0], alpha=0.75)
        axis.errorbar(rho, y, xerr=reach, fmt="none", ecolor=BLACK, elinewidth=1, capsize=2)
        axis.axvline(0.0, color=BLACK, lw=0.7)
        axis.set_yticks(y, [name for name, _ in found])
        axis.set(xlim=(-1, 1), ylim=(-0.6, len(found) - 0.4))
        axis.set_title(f"{label(run, approach)}: {run.squeal.count(approach).samples} samples")
        light_grid(axis, axis="x")
    what = f"the number of squeal modes ({run.criterion})"
    axes[-1, 0].set_xlabel(f"rank correlation with {what} [-]")
    return figure
