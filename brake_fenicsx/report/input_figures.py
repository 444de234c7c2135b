"""Which input moves squeal: sensitivity indices, rank correlations, derivatives of modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brake_fenicsx.results.ensemble_statistics import Correlation, rank_correlation
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import Family
from brake_fenicsx.results.tables import SAMPLES, Columns, rows_of

from .contact_figures import PadMap, draw_pads, sliding_rows
from .style import (
    BLACK,
    BLUE,
    CYCLE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    finish,
    label,
    look,
    new_figure,
)

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
        rows = table["approach"] == name
        _draw(axis, rows_of(table, rows), most)
        samples = f", {table['samples'][rows][0]} samples"
        axis.set_title(f"{label(run, name)}: {table['method'][rows][0]}{samples}")
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
        rows = (table["scope"] == scope) & (table["where"].astype(str) == where)
        hertz = float(table["frequency_hz"][rows][0])
        family = f"{hertz / 1e3:.3f} kHz\n(family {where})"
        marks.append(f"{where} Hz" if scope == "band" else family)
        for i, key in enumerate(inputs):
            x = j - 0.4 + (i + 0.5) * width
            name = key if j == 0 else None
            look = CYCLE[i % len(CYCLE)], HATCHES[i % len(HATCHES)]
            _bar(axis, table, rows & (table["input"] == key), x, width, look, name)
    axis.axhline(0.0, color=BLACK, lw=0.7)
    axis.set_xticks(range(len(groups)), marks)
    finish(axis, "y", ylabel="share of the variance\nof the growth rate [-]")


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
    inputs = []
    for name, column in run.samples.items():
        if name in NO_INPUT or not np.issubdtype(column.dtype, np.number):
            continue
        values = column[good][order].astype(float)
        if np.all(np.isfinite(values)) and np.ptp(values) > 0:
            inputs.append((name, rank_correlation(values, per_sample)))
    # The mean friction says nothing beside the friction of the one interface it is the mean of.
    frictions = [name for name, _ in inputs if name.startswith("contact.")]
    inputs = [d for d in inputs if d[0] != "mu" or len(frictions) != 1]
    return sorted(inputs, key=lambda d: -abs(d[1].rho))


def draw_correlations(run: RunData, most: int = 12) -> Figure | None:
    """Bars of the rank correlations with their intervals, one panel per approach."""
    shown = [(a, correlations(run, a)[:most]) for a in run.approaches]
    shown = [(a, inputs) for a, inputs in shown if inputs]
    if not shown:
        return None
    rows = sum(len(inputs) for _, inputs in shown)
    heights = [len(inputs) + 1 for _, inputs in shown]
    figure, axes = new_figure(
        len(shown),
        1,
        height=0.7 + 0.5 * len(shown) + 0.26 * rows,
        sharex=True,
        gridspec_kw={"height_ratios": heights},
    )
    for axis, (approach, inputs) in zip(axes.flat, shown, strict=True):
        y = np.arange(len(inputs))[::-1]
        rho = np.array([c.rho for _, c in inputs])
        reach = np.array([[c.rho - c.low, c.high - c.rho] for _, c in inputs]).T
        axis.barh(y, rho, 0.7, color=look(approach)[0], alpha=0.75)
        axis.errorbar(rho, y, xerr=reach, fmt="none", ecolor=BLACK, elinewidth=1, capsize=2)
        axis.axvline(0.0, color=BLACK, lw=0.7)
        axis.set_yticks(y, [name for name, _ in inputs])
        title = f"{label(run, approach)}: {run.squeal.count(approach).samples} samples"
        finish(axis, "x", title=title, xlim=(-1, 1), ylim=(-0.6, len(inputs) - 0.4))
    what = f"the number of squeal modes ({run.criterion})"
    axes[-1, 0].set_xlabel(f"rank correlation with {what} [-]")
    return figure


MEDIAN = "median"
MOST = 4  # families of an approach, the most severe first
SIGNED = "RdBu_r"
COLOURS = {
    "friction": VERMILION, "load": PURPLE, "contact stiffness": SKY, "stiffness": BLUE,
    "mass": GREEN, "length": BLACK, "loss factor": ORANGE,
}  # fmt: skip
# What each bar changes: friction coefficient by 0.01, loss factor by 0.001, all others by 1 %.
STEPS = {"loss factor": 1e-3}
# Columns of drivers_contact.csv per area, their names, and factors: of 1/s and shares per m^2.
MAPS = (
    ("dalpha_dlnk_1_s", "d alpha / d ln k\n[1/(s cm²)]", 1e-4),
    ("friction_work", "work of friction\n[% of energy / cm²]", 1e-2),
)


def draw_drivers(run: RunData) -> Figure | None:
    """Change of the growth rate by small changes of every parameter; one panel per family.

    Bars: the first sample. Diamonds: median over the samples where the family squeals. Hollow bars
    are not trusted.
    """
    rows = [(name, _families(run, name)) for name in run.approaches]
    rows = [(name, families) for name, families in rows if families]
    if len(rows) > 2:
        # The simplest approach, and that of the most random inputs: a page has no room for more.
        rows = [rows[0], rows[-1]]
    if run.drivers is None or not rows:
        return None
    names = _parameters(run.drivers)
    columns = max(len(families) for _, families in rows)
    figure, axes = new_figure(
        len(rows), columns, height=(0.165 * len(names) + 0.75) * len(rows) + 0.55, sharey=True
    )
    for row, (approach, families) in zip(axes, rows, strict=True):
        for axis, family in zip(row, families, strict=False):
            _draw_bars(axis, run.drivers, approach, family, names)
        for axis in row[len(families) :]:
            axis.set_visible(False)
        row[0].set_ylabel(label(run, approach))
    axes[0, 0].set_yticks(range(len(names)), [_text(*name) for name in names], fontsize=7.5)
    axes[0, 0].set_ylim(len(names) - 0.4, -0.6)
    figure.supxlabel(
        "change of alpha [1/s] by +0.01 of a friction coefficient, +0.001 of a loss factor, "
        "+1 % of any other",
        fontsize=8.5,
    )
    return figure


def draw_driver_maps(run: RunData) -> Figure | None:
    """Where contact stiffness and friction act on the most unstable mode of each first sample."""
    maps, contact = run.driver_maps, run.contact
    if maps is None or contact is None or not maps["element"].size:
        return None
    contact = sliding_rows(run, contact)
    if not contact["element"].size:
        return None
    drawn = []
    for name in run.approaches:
        if (mode := _most_unstable(run, name)) is None:
            continue
        sample, number, frequency = mode
        rows = (contact["approach"] == name) & (contact["sample"] == sample)
        table = rows_of(contact, rows)
        chosen = (maps["approach"] == name) & (maps["sample"] == sample) & (maps["mode"] == number)
        for column, text, factor in MAPS:
            every = np.zeros(1 + max(maps["element"].max(), contact["element"].max()))
            every[maps["element"][chosen]] = maps[column][chosen]
            values = every[table["element"]] / table["area"] * factor
            top = float(np.quantile(np.abs(values[values != 0]), 0.98)) if values.any() else 1.0
            place = f"{label(run, name)}, {frequency / 1e3:.3f} kHz"
            drawn.append(PadMap(place, table, values, (-top, top), text))
    return draw_pads(run, drawn, SIGNED)


def _families(run: RunData, approach: str) -> list[Family]:
    """The most severe families of an approach that have derivatives."""
    if run.drivers is None:
        return []
    known = run.drivers["family"][run.drivers["approach"] == approach]
    return [f for f in run.squeal.families(approach) if f.number in known][:MOST]


def _parameters(table: Columns) -> list[tuple[str, str]]:
    """Parameters of all rows, kind by kind, in the order of the table."""
    pairs = zip(map(str, table["parameter"]), map(str, table["kind"]), strict=True)
    return sorted(dict.fromkeys(pairs), key=lambda pair: list(COLOURS).index(pair[1]))


def _text(parameter: str, kind: str) -> str:
    return kind if parameter == "all" and kind != "load" else f"{kind}, {parameter}"


def _draw_bars(
    axis: Axes, table: Columns, approach: str, family: Family, names: list[tuple[str, str]]
) -> None:
    """Bars of one family; of several modes of it in the first sample the most unstable one."""
    rows = (table["approach"] == approach) & (table["family"] == family.number)
    median = rows & (table["sample"].astype(str) == MEDIAN)
    first = rows & ~median
    if first.any():
        first &= table["alpha"] == table["alpha"][first].max()
    for y, (parameter, kind) in enumerate(names):
        named = (table["parameter"] == parameter) & (table["kind"] == kind)
        step = STEPS.get(kind, 0.01)
        for i in np.flatnonzero(first & named):
            trusted = table["trusted"][i] == "yes"
            axis.barh(
                y, step * table["dalpha_dp_1_s"][i], 0.7, edgecolor=COLOURS[kind], linewidth=0.8,
                facecolor=COLOURS[kind] if trusted else "none",
            )  # fmt: skip
        for i in np.flatnonzero(median & named):
            axis.plot(step * table["dalpha_dp_1_s"][i], y, "D", color=BLACK, ms=3)
    axis.axvline(0.0, color=BLACK, lw=0.7)
    finish(axis, "x")
    alpha = table["alpha"][median if median.any() else first][0]
    axis.set_title(f"{family.kilohertz} kHz\nalpha {alpha:.4g} 1/s", fontsize=8)
    axis.tick_params(axis="x", labelsize=7)
    axis.locator_params(axis="x", nbins=4)


def _most_unstable(run: RunData, approach: str) -> tuple[int, int, float] | None:
    """Sample, mode and frequency [Hz] of the squeal mode of lowest damping."""
    maps, modes = run.driver_maps, run.modes
    if maps is None or modes is None or not (rows := maps["approach"] == approach).any():
        return None
    sample = int(maps["sample"][rows][0])
    known = (modes["approach"] == approach) & (modes["sample"] == sample)
    known &= np.isin(modes["mode"], maps["mode"][rows])
    i = np.flatnonzero(known)[np.argmin(modes["damping"][known])]
    return sample, int(modes["mode"][i]), float(modes["frequency_hz"][i])
