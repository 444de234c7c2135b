"""Speed beside error of the run itself: seconds and memory per stage, errors per approach."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.tables import Columns, Value

from .rundata import RunData
from .style import BLACK, label, light_grid, look, new_figure, stroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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
SPEED_COLUMNS = (
    "approach",
    "samples",
    "seconds_per_equilibrium",
    "seconds_per_stability",
    "error_median",
    "error_max",
    "counted_by",
)


def error_rows(run: RunData) -> list[list[Value]]:
    """Residuals and relative error estimates of the eigenvalues, one row per approach.

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
        residual = _finite(run.modes["residual"][mine])
        error = _finite(relative_errors(run.modes)[mine])
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


def speed_rows(run: RunData) -> list[list[Value]]:
    """What one sample cost and how exact it was, in the order of `SPEED_COLUMNS`.

    Args:
        run: the results; ``samples`` and ``verification`` of its summary are read.

    Returns:
        One row per approach with the solver's error estimates, and one with the true errors of the
        samples that were solved at full order as well.
    """
    samples = run.summary.get("samples")
    if not isinstance(samples, Mapping):
        return []
    errors = {str(row[0]): row for row in error_rows(run)}
    rows: list[list[Value]] = []
    for name in run.approaches:
        about = samples.get(name, {})
        known = [about.get(key) for key in ("good", *SPEED_COLUMNS[2:4])]
        error = errors.get(name, [None] * len(ERROR_COLUMNS))
        rows.append([name, *known, error[4], error[6], about.get("counted_by")])
    checked = run.summary.get("verification")
    if isinstance(checked, Mapping) and checked.get("samples_compared"):
        verdicts = f"{checked.get('wrong_verdicts')} wrong of {checked.get('eigenvalues')} verdicts"
        true = (checked.get(f"{kind}_relative_error") for kind in ("median", "largest"))
        rows.append(
            ["against full order", checked["samples_compared"], None, None, *true, verdicts]
        )
    return rows


def relative_errors(modes: Columns) -> NDArray:
    """Error estimates [1/s] over the size of the eigenvalue [1/s]; nan for a zero one."""
    size = np.hypot(modes["real_1_s"], 2 * np.pi * modes["frequency_hz"])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(size > 0, modes["error_estimate"] / size, np.nan)


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
    """Error estimates of the eigenvalues: against frequency, and how many exceed a given error."""
    if run.modes is None:
        return None
    figure, axes = new_figure(1, 2, height=3.1)
    drawn = False
    for approach in run.approaches:
        every = relative_errors(run.modes)
        own = (run.modes["approach"] == approach) & (every > 0) & np.isfinite(every)
        if own.any():
            drawn = True
            f, error = run.modes["frequency_hz"][own] / 1e3, every[own]
            _draw_bands(axes[0, 0], f, error, approach)
            _draw_excess(axes[0, 1], error, approach, label(run, approach))
    if not drawn:
        return None
    unit = "relative error estimate of the eigenvalue [-]"
    axes[0, 0].set(yscale="log", xlabel="frequency [kHz]")
    axes[0, 0].set_ylabel("relative error estimate\nof the eigenvalue [-]")
    axes[0, 0].set_title("(a) largest (line) and median (dots) per band")
    axes[0, 1].set(xscale="log", yscale="log", xlabel=unit, ylabel="share of modes above [-]")
    axes[0, 1].set_title("(b) modes whose error exceeds a value")
    axes[0, 1].legend(loc="lower left")
    for axis in axes.flat:
        light_grid(axis)
    return figure


def _draw_bands(axes: Axes, f: NDArray, error: NDArray, approach: str, bands: int = 24) -> None:
    """Largest and median error in equal bands of frequency [kHz]."""
    colour, marker = look(approach)
    edges = np.linspace(0.0, f.max() * (1 + 1e-12), bands + 1)
    place = np.digitize(f, edges) - 1
    full = [j for j in range(bands) if np.any(place == j)]
    middle = 0.5 * (edges[1:] + edges[:-1])[full]
    axes.plot(middle, [error[place == j].max() for j in full], color=colour, lw=1.2)
    medians = [np.median(error[place == j]) for j in full]
    axes.plot(middle, medians, marker, color=colour, ms=3.5)


def _draw_excess(axes: Axes, error: NDArray, approach: str, name: str) -> None:
    """Share of modes with a larger error, at up to 400 of the values."""
    ordered = np.sort(error)
    chosen = np.unique(np.linspace(0, error.size - 1, 400).astype(int))
    share = 1.0 - chosen / error.size
    colour, _ = look(approach)
    axes.step(ordered[chosen], share, where="post", color=colour, ls=stroke(approach), label=name)


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
