"""First-order and total indices with their intervals: which input moves the growth of what."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import Columns, read_columns

from .style import BLACK, CYCLE, label, light_grid, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HATCHES = ("", "///", "...", "xxx", "\\\\\\")  # told apart without colours

NEEDED = ("approach", "scope", "where", "frequency_hz", "outcome", "input", "first", "total")


def draw_sensitivity(run: RunData, most: int = 6) -> Figure | None:
    """Bars of the indices of growth: the whole band, then the most severe families.

    Args:
        run: the results; ``sensitivity.csv`` of its folder is read.
        most: groups of bars for each approach.

    Returns:
        One panel per approach; None where no index is known.
    """
    path = run.directory / "sensitivity.csv"
    if not path.is_file():
        return None
    table = read_columns(path, NEEDED)
    if not table["approach"].size:
        return None
    known = (table["outcome"] == "growth") & np.isfinite(table["first"].astype(float))
    table = {name: values[known] for name, values in table.items()}
    names = [a for a in run.approaches if np.any(table["approach"] == a)]
    if not names:
        return None
    figure, axes = new_figure(len(names), 1, height=0.9 + 2.4 * len(names), sharey=True)
    for axis, name in zip(axes.flat, names, strict=True):
        own = table["approach"] == name
        _draw(axis, {key: values[own] for key, values in table.items()}, most)
        samples = f", {table['samples'][own][0]} samples" if "samples" in table else ""
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
