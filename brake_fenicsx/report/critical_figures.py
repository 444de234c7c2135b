"""Figures of samples over a parameter: critical values, the worst mode, and the chart over two."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import rows_of

from .squeal_figures import LINEAR_DAMPING
from .style import (
    BLACK,
    CYCLE,
    label,
    light_grid,
    look,
    new_figure,
    panel,
)
from .sweep_figures import MOST, axis_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        own = np.isnan(curve["family"]) if any_ else curve["family"] == family
        x, colour = factor * curve["value"][own], BLACK if any_ else CYCLE[(i - 1) % len(CYCLE)]
        hits, n = int(families["squeal_samples"][i]), int(families["samples"][i])
        text = "any family" if any_ else f"{texts[i]} kHz"
        axis.plot(x, curve["share"][own], color=colour, lw=2.0 if any_ else 1.3,
                  ls="--" if any_ else "-", drawstyle="steps-post",
                  label=f"{text} ({hits} of {n})")  # fmt: skip
        # Bands of families that all squeal, or none, would lie upon one another.
        open_ = (curve["share"][own] > 0) & (curve["share"][own] < 1)
        open_[1:] |= open_[:-1]
        axis.fill_between(x, curve["low"][own], curve["high"][own], where=open_, color=colour,
                          step="post", alpha=0.12, lw=0)  # fmt: skip
    axis.set_xlabel(name)
    axis.set_ylabel("share of samples that squeal by then [-]")
    axis.set_ylim(0, 1.02)
    light_grid(axis)
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))
    return figure


def draw_worst(run: RunData) -> Figure | None:
    """Band over the samples: lowest damping of any mode, and number of squeal modes."""
    table = run.sweep.get("sweep")
    if table is None or not np.any(rows := ~np.isnan(table["sample"])):
        return None
    own = rows_of(table, rows)
    values = np.unique(own["value"])
    samples = np.unique(own["sample"])
    lowest, number = np.zeros((2, samples.size, values.size))
    at, place = (
        np.asarray(np.searchsorted(known, own[name]))
        for known, name in ((values, "value"), (samples, "sample"))
    )
    np.minimum.at(lowest, (place, at), np.where(own["verdict"] == "unstable", own["damping"], 0.0))
    squeal = (own["verdict"] == "unstable") & (own["damping"] < -run.threshold)
    np.add.at(number, (place[squeal], at[squeal]), 1)
    factor, name = axis_of(run)
    colour, _ = look(str(own["approach"][0]))
    figure, axes = new_figure(1, 2, height=2.8)
    for axis, data, text in (
        (axes[0, 0], lowest, "lowest damping of a sample [-]"),
        (axes[0, 1], number, "squeal modes of a sample [-]"),
    ):
        low, middle, high = np.quantile(data, QUANTILES, axis=0)
        axis.fill_between(factor * values, low, high, color=colour, alpha=0.25, lw=0,
                          label="5 to 95 %")  # fmt: skip
        axis.plot(factor * values, middle, color=colour, label="median")
        axis.set_xlabel(name)
        axis.set_ylabel(text)
        light_grid(axis)
    axes[0, 0].set_yscale("symlog", linthresh=LINEAR_DAMPING, linscale=0.6)
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
        own = rows_of(chart, chart["approach"] == approach)
        x, i = np.unique(own["value"], return_inverse=True)
        y, j = np.unique(own["value_2"], return_inverse=True)
        for axis, data, text in (
            (row[0], own["squeal_modes"], "squeal modes"),
            (row[1], np.maximum(-own["worst_damping"], 0.0), "largest negative damping [-]"),
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
