"""What goes with squeal: rank correlation of the random inputs with the number of squeal modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.statistics import Correlation, rank_correlation
from brake_fenicsx.results.tables import SAMPLES

from .style import BLACK, label, light_grid, look, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_INPUT = (*SAMPLES, "rejected", "tolerance_missed")  # columns of samples.csv
FEWEST = 10  # samples below which a correlation says nothing


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
