"""Speed beside error of the run itself: seconds and memory per stage, errors per approach."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Mask

from .run import RunData
from .tables import Row

STAGES = {  # for a reader, by the names in summary.json
    "brake": "mesh and matrices of the brake", "surface": "surface", "micro": "contact laws",
    "offline": "reduced model", "samples": "samples", "sweep": "sweep",
    "results": "tables", "pictures": "verification, pictures and figures",
    "verification": "verification at full order", "report": "page",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class ErrorRow(Row):
    """A row of eigenvalue_errors.csv: an approach, its modes, and figures over these."""

    approach: str
    modes: int
    residual_median: float | None
    residual_max: float | None
    error_median: float | None
    error_95: float | None
    error_max: float | None
    condition_max: float | None


@dataclass(frozen=True, slots=True)
class StageRow(Row):
    """A row of stages.csv: time [s] and peak memory [MB] of a stage."""

    stage: str
    seconds: float | None
    peak_memory_mb: float | None


@dataclass(frozen=True, slots=True)
class SpeedRow(Row):
    """A row of speed_and_error.csv: cost of a sample of an approach, and errors of its modes."""

    approach: str
    samples: int | None
    seconds_per_equilibrium: float | None
    seconds_per_stability: float | None
    error_median: float | None
    error_max: float | None
    counted_by: str | None


def error_rows(run: RunData) -> list[ErrorRow]:
    """Residuals and relative error estimates of the eigenvalues, one row per approach.

    Args:
        run: the results.

    Returns:
        The rows; a figure that no mode has is None.
    """
    rows, modes = list[ErrorRow](), run.modes
    if modes is None:
        return rows
    for approach in run.approaches:
        mine = np.asarray(modes["approach"] == approach)
        rows.append(ErrorRow.of(
            approach, int(mine.sum()), *_quantiles(modes["residual"], mine, 0.5, 1.0),
            *_quantiles(run.errors, mine, 0.5, 0.95, 1.0),
            *_quantiles(modes["condition"], mine, 1.0),
        ))  # fmt: skip
    return rows


def speed_rows(run: RunData) -> list[SpeedRow]:
    """What one sample cost and how exact it was.

    Args:
        run: the results; ``samples`` and ``verification`` of its summary are read.

    Returns:
        One row per approach with the solver's error estimates, and one with the true errors of the
        samples that were solved at full order as well.
    """
    samples = run.summary.get("samples")
    if not isinstance(samples, Mapping):
        return []
    errors, rows = {row.approach: row for row in error_rows(run)}, list[SpeedRow]()
    for name in run.approaches:
        about, own = samples.get(name, {}), errors.get(name)
        known = [about.get(k) for k in ("good", *SpeedRow.names()[2:4])]
        error = (None, None) if own is None else (own.error_median, own.error_max)
        rows.append(SpeedRow.of(name, *known, *error, about.get("counted_by")))
    checked = run.summary.get("verification")
    if isinstance(checked, Mapping) and (compared := checked.get("samples_compared")):
        verdicts = (
            f"{checked.get('wrong_verdicts')} wrong of {checked.get('eigenvalues')} verdicts,"
            f" {checked.get('errors_beyond_estimates')} errors beyond their estimates"
        )
        true = [checked.get(f"{kind}_relative_error") for kind in ("median", "largest")]
        rows.append(SpeedRow.of("against full order", compared, None, None, *true, verdicts))
    return rows


def stage_rows(summary: Mapping[str, Any]) -> list[StageRow]:
    """Seconds [s] and peak memory [MB] per stage, in the order of the run.

    Args:
        summary: content of ``summary.json``; the tables ``seconds`` and ``peak_memory_mb`` are
            read, from stage to number.
    """
    seconds, memory = (_numbers(summary.get(key)) for key in ("seconds", "peak_memory_mb"))
    names = [*seconds, *(name for name in memory if name not in seconds)]
    return [StageRow(name, seconds.get(name), memory.get(name)) for name in names]


def _quantiles(values: AnyArray, mine: Mask, *shares: float) -> list[float | None]:
    """Quantiles of the finite values of some rows; None without any."""
    known = values[mine & np.isfinite(values)]
    if known.size == 0:
        return [None] * len(shares)
    return [float(v) for v in np.quantile(known, shares, overwrite_input=True)]


def _numbers(table: object) -> dict[str, float]:
    if not isinstance(table, Mapping):
        return {}
    return {str(k): float(v) for k, v in table.items() if isinstance(v, int | float)}
