"""Speed beside error of the run itself: seconds and memory per stage, errors per approach."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .run import RunData
from .tables import Columns, Value

ERROR_COLUMNS = (
    "approach", "modes", "residual_median", "residual_max", "error_median", "error_95",
    "error_max", "condition_max",
)  # fmt: skip
STAGE_COLUMNS = ("stage", "seconds", "peak_memory_mb")
SPEED_COLUMNS = (
    "approach", "samples", "seconds_per_equilibrium", "seconds_per_stability", "error_median",
    "error_max", "counted_by",
)  # fmt: skip


PART = 2**18  # modes whose errors are computed together


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
        mine = np.asarray(run.modes["approach"] == approach)
        figures = [
            *_quantiles(run.modes["residual"], mine, 0.5, 1.0),
            *_quantiles(run.errors, mine, 0.5, 0.95, 1.0),
            *_quantiles(run.modes["condition"], mine, 1.0),
        ]
        rows.append([approach, int(mine.sum()), *figures])
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
        verdicts = (
            f"{checked.get('wrong_verdicts')} wrong of {checked.get('eigenvalues')} verdicts,"
            f" {checked.get('errors_beyond_estimates')} errors beyond their estimates"
        )
        true = (checked.get(f"{kind}_relative_error") for kind in ("median", "largest"))
        rows.append(
            ["against full order", checked["samples_compared"], None, None, *true, verdicts]
        )
    return rows


def eigenvalue_errors(modes: Columns) -> NDArray[np.float64]:
    """Error estimates of the eigenvalues of a table over |lambda|; nan of rigid modes."""
    from brake_fenicsx.stability.modes import relative_errors

    real, f, error = (modes[name] for name in ("real_1_s", "frequency_hz", "error_estimate"))
    out = np.empty(len(f))
    for i in range(0, len(f), PART):
        own = slice(i, i + PART)
        out[own] = relative_errors(real[own] + 2j * np.pi * f[own], error[own])
    return out


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


def _quantiles(values: NDArray, mine: NDArray[np.bool_], *shares: float) -> list[Value]:
    """Quantiles of the finite values of some rows; None without any."""
    known = values[mine & np.isfinite(values)]
    if known.size == 0:
        return [None] * len(shares)
    return [float(v) for v in np.quantile(known, shares, overwrite_input=True)]


def _numbers(table: object) -> dict[str, float]:
    if not isinstance(table, Mapping):
        return {}
    return {str(k): float(v) for k, v in table.items() if isinstance(v, int | float)}
