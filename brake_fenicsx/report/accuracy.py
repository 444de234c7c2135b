"""Speed beside error of the run itself: seconds and memory per stage, errors per approach."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .rundata import RunData
from .style import BLACK, label, light_grid, look, new_figure
from .tables import Value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERROR_COLUMNS = (
    "approach",
    "modes",
    "residual_median",
    "residual_max",
    "error_median",
    "error_95",
    "error_max",
    "condition_max",
)
STAGE_COLUMNS = ("stage", "seconds", "peak_memory_mb")


def error_rows(run: RunData) -> list[list[Value]]:
    """Residuals and error estimates of the eigenvalues, one row per approach.

    Args:
        run: the results.

    Returns:
        Rows in the order of `ERROR_COLUMNS`; a figure that no mode has is None.
    """
    if run.modes is None:
        return []
    rows: list[list[Value]] = []
    for approach in run.approaches:
        mine = run.modes["approach"] == approach
        residual, error = (_finite(run.modes[c][mine]) for c in ("residual", "error_estimate"))
        condition = _finite(run.modes["condition"][mine])
        rows.append(
            [
                approach,
                int(mine.sum()),
                _quantile(residual, 0.5),
                _quantile(residual, 1.0),
                _quantile(error, 0.5),
                _quantile(error, 0.95),
                _quantile(error, 1.0),
                _quantile(condition, 1.0),
            ]
        )
    return rows


def stage_rows(summary: Mapping[str, Any]) -> list[list[Value]]:
    """Seconds [s] and peak memory [MB] per stage, in the order of the run.

    Args:
        summary: content of ``summary.json``; the tables ``seconds`` and ``peak_memory_mb`` are
            read, from stage to number.

    Returns:
        Rows in the order of `STAGE_COLUMNS`.
    """
    seconds, memory = (_numbers(summary.get(key)) for key in ("seconds", "peak_memory_mb"))
    names = [*seconds, *(name for name in memory if name not in seconds)]
    return [[name, seconds.get(name), memory.get(name)] for name in names]


def draw_errors(run: RunData) -> Figure | None:
    """Relative error estimate and residual of every mode against frequency, per approach."""
    if run.modes is None or run.modes["mode"].size == 0:
        return None
    figure, axes = new_figure(1, 2, height=3.0, sharex=True)
    drawn = False
    for axis, column, name in zip(
        axes.flat,
        ("error_estimate", "residual"),
        ("error estimate of the eigenvalue [-]", "relative residual [-]"),
        strict=True,
    ):
        for approach in run.approaches:
            mine = (run.modes["approach"] == approach) & (run.modes[column] > 0)
            mine &= np.isfinite(run.modes[column])
            if not mine.any():
                continue
            drawn = True
            colour, marker = look(approach)
            f, value = run.modes["frequency_hz"][mine] / 1e3, run.modes[column][mine]
            many = int(mine.sum()) > 2000
            axis.plot(
                f,
                value,
                marker,
                color=colour,
                ms=2.5,
                mew=0,
                alpha=0.25 if many else 0.7,
                rasterized=many,
                label=label(approach),
            )
        axis.set(yscale="log", xlabel="frequency [kHz]", ylabel=name)
        light_grid(axis)
    if not drawn:
        return None
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(0, 1), ncol=4, markerscale=2)
    return figure


def draw_stages(run: RunData) -> Figure | None:
    """Seconds and peak memory of each stage of the run."""
    rows = stage_rows(run.summary)
    if not rows:
        return None
    figure, axes = new_figure(1, 2, height=0.9 + 0.28 * len(rows), sharey=True)
    position = np.arange(len(rows))[::-1]
    for axis, column, name in zip(axes.flat, (1, 2), ("time [s]", "peak memory [MB]"), strict=True):
        values = np.array([np.nan if row[column] is None else row[column] for row in rows], float)
        axis.barh(position, values, color="#9fc3da", height=0.7)
        for y, value in zip(position, values, strict=True):
            if np.isfinite(value):
                text = f" {value:.0f}" if value >= 100 else f" {value:.3g}"
                axis.text(value, y, text, va="center", fontsize=8, color=BLACK)
        axis.set(xlabel=name)
        axis.set_xlim(0, 1.2 * max(np.nanmax(values, initial=0.0), 1e-9))
        light_grid(axis, axis="x")
    axes[0, 0].set_yticks(position, [str(row[0]) for row in rows])
    return figure


def _finite(values: NDArray) -> NDArray:
    return values[np.isfinite(values)]


def _quantile(values: NDArray, share: float) -> float | None:
    return float(np.quantile(values, share)) if values.size else None


def _numbers(table: object) -> dict[str, float]:
    if not isinstance(table, Mapping):
        return {}
    return {str(k): float(v) for k, v in table.items() if isinstance(v, int | float)}
