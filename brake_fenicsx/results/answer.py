"""The answer in tables and words: per approach, limit, family and band; its cost beside its errors.

The limits of the damping -2 alpha / |omega| are that of the scene (``stability.threshold``), the
customary one of Abaqus, and zero: every unstable mode, with nothing but the damping that the scene
names. Costs are seconds and memory per stage, errors those of each approach.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Mask

from . import ensemble_statistics, squeal
from .run import RunData, read_run
from .tables import Row, RowTable, Value, text_table

USUAL = 0.01  # of the damping ratio -2 Re / |Im| that Abaqus prints
NAMED = 3  # families in a row of an approach

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
        residual = _quantiles(modes["residual"], mine, 0.5, 1.0)
        error = _quantiles(run.errors, mine, 0.5, 0.95, 1.0)
        condition = _quantiles(modes["condition"], mine, 1.0)
        rows.append(ErrorRow.of(approach, int(mine.sum()), *residual, *error, *condition))
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


@dataclass(frozen=True, slots=True)
class ApproachRow(Row):
    """A row of approaches.csv.

    Shares are of samples, with 95 % Wilson intervals; ``most_severe`` names the first families.
    """

    approach: str
    samples: int
    failed: int
    modes: int
    unstable_modes: int
    neutral_modes: int
    threshold: float
    squeal_modes: int
    squeal_samples: int
    share: float | None
    share_low: float | None
    share_high: float | None
    most_severe: str


@dataclass(frozen=True, slots=True)
class FamilyRow(Row):
    """A row of families.csv: a family of squeal modes of an approach."""

    approach: str
    family: int
    frequency_hz: float
    spread_hz: float
    threshold: float
    squeal_samples: int
    share: float | None
    share_low: float | None
    share_high: float | None
    median_damping: float
    worst_damping: float
    severity: float


@dataclass(frozen=True, slots=True)
class BandRow(Row):
    """A row of probability_per_band.csv: an approach and a band of frequency."""

    approach: str
    from_hz: float
    to_hz: float
    threshold: float
    squeal_samples: int
    samples: int
    share: float | None
    share_low: float | None
    share_high: float | None


@dataclass(frozen=True, slots=True)
class LimitRow(Row):
    """A row of limits.csv: what squeals of an approach at a limit of the damping."""

    approach: str
    limit: str
    damping_below: float
    squeal_modes: int
    squeal_samples: int
    samples: int
    share: float | None
    share_low: float | None
    share_high: float | None


def share_cells(share: ensemble_statistics.Proportion) -> list[float | None]:
    """A share and its interval; a single sample has a verdict, no share."""
    return share.cells if share.n > 1 else [None] * 3


def limits(run: RunData) -> dict[float, str]:
    """Limits of the damping without their minus, and what each one is; equal ones once.

    Args:
        run: the results; its threshold and the damping of the scene are read.
    """
    named = run.damping
    damping = f" (damping of the scene: {named})" if named else " (the model has no damping)"
    texts: dict[float, list[str]] = {}
    for limit, text in (
        (run.threshold, "limit of the scene"),
        (USUAL, "customary limit in Abaqus"),
        (0.0, f"every unstable mode{damping if named is not None else ''}"),
    ):
        texts.setdefault(limit, []).append(text)
    return {limit: "; ".join(said) for limit, said in texts.items()}


def limit_rows(run: RunData, approaches: Sequence[str] | None = None) -> list[LimitRow]:
    """One row for each approach and limit.

    Args:
        run: the results.
        approaches: names; all if None. One without a sample that ended well has no rows.
    """
    rows, modes = list[LimitRow](), run.modes
    for approach in run.approaches if approaches is None else approaches:
        n = run.squeal.good(approach).size
        if n == 0 or modes is None:
            continue
        for limit, text in limits(run).items():
            squealing = run.squeal.of_good(approach) & squeal.squeals(modes, limit)
            hits = np.unique(modes["sample"][squealing]).size
            share = share_cells(ensemble_statistics.wilson(hits, n))
            counts = int(squealing.sum()), hits, n
            rows.append(LimitRow.of(approach, text, -limit or 0.0, *counts, *share))
    return rows


def approach_rows(run: RunData) -> list[ApproachRow]:
    """One row per approach."""
    rows = list[ApproachRow]()
    for approach in run.approaches:
        c = run.squeal.count(approach)
        families = "; ".join(map(_family_text, run.squeal.families(approach)[:NAMED]))
        modes = c.samples, c.failed, c.modes, c.unstable, c.neutral
        squeals = run.threshold, c.squeal, c.squeal_samples
        share = share_cells(ensemble_statistics.wilson(c.squeal_samples, c.samples))
        rows.append(ApproachRow.of(approach, *modes, *squeals, *share, families or "none"))
    return rows


def family_rows(run: RunData) -> list[FamilyRow]:
    """One row per family of squeal modes, the most severe first."""
    return [
        FamilyRow.of(
            f.approach, f.number, f.frequency, f.spread, run.threshold, f.share.hits,
            *share_cells(f.share), f.median, f.worst, f.severity,
        )
        for approach in run.approaches for f in run.squeal.families(approach)
    ]  # fmt: skip


def band_rows(run: RunData) -> list[BandRow]:
    """One row per approach and frequency band; none without modes."""
    bands = list(pairwise(map(float, run.squeal.edges)))
    return [
        BandRow.of(approach, *band, run.threshold, s.hits, s.n, *share_cells(s))
        for approach in (run.approaches if run.modes else ())
        for band, s in zip(bands, run.squeal.share_per_band(approach), strict=True)
    ]


def write_tables(directory: str | Path | RunData) -> list[Path]:
    """Write the tables of a run as CSV into ``directory/tables``.

    Args:
        directory: the run directory, or its results already read.

    Returns:
        Paths written: ``approaches.csv``, ``limits.csv``, ``families.csv``,
        ``probability_per_band.csv``, ``eigenvalue_errors.csv``, ``stages.csv``,
        ``speed_and_error.csv``; an empty table is left out.
    """
    run = read_run(directory)
    tables: dict[str, Sequence[Row]] = {
        "approaches": approach_rows(run), "limits": limit_rows(run), "families": family_rows(run),
        "probability_per_band": band_rows(run), "eigenvalue_errors": error_rows(run),
        "stages": stage_rows(run.summary), "speed_and_error": speed_rows(run),
    }  # fmt: skip
    folder = run.directory / "tables"
    folder.mkdir(exist_ok=True)
    written = {name: RowTable.of(type(rows[0]), rows) for name, rows in tables.items() if rows}
    return [table.write(folder / f"{name}.csv") for name, table in written.items()]


def _family_text(f: squeal.Family) -> str:
    often = f"{f.share.hits}/{f.share.n}, " if f.share.n > 1 else ""
    return f"{f.kilohertz} kHz ({often}{f.median:.2g})"


def for_reading(
    run: RunData, rows: Sequence[Row], *without: str, **heads: str
) -> tuple[list[str], list[list[Value]]]:
    """Headings and cells of a table for a person; a share and its interval are one cell.

    Args:
        run: the results, which name the approaches.
        rows: at least one.
        without: columns that are not shown.
        heads: headings of columns; of the others their names.
    """
    names = [n for n in rows[0].names() if n not in (*without, "share_low", "share_high")]

    def cell(row: Row, name: str) -> Value:
        if name == "share":
            return share_text(*(getattr(row, f"share{end}") for end in ("", "_low", "_high")))
        value: Value = getattr(row, name)
        return run.label(str(value)) if name == "approach" else value

    shown = [[cell(row, name) for name in names] for row in rows]
    return [heads.get(name, name.replace("_", " ")) for name in names], shown


def summary_table(run: RunData | str | Path) -> str:
    """The answer of a run as text for the terminal.

    Args:
        run: the results, or the run directory.

    Returns:
        What counts as squeal, a table with one line per approach, and one with what squeals at
        other limits of the damping.
    """
    run = read_run(run)
    severe = "most severe (squeal samples, median damping)"
    tables = [for_reading(run, approach_rows(run), "threshold", most_severe=severe)]
    tables += [for_reading(run, rows) for rows in (limit_rows(run),) if rows]
    said = f"squeal: unstable modes with {run.criterion} (stability.threshold)"
    return "\n".join([said, "\n\n".join(text_table(*table) for table in tables)])


def open_points(run: RunData) -> str:
    """What the computation itself leaves open, in one line; empty where it leaves nothing.

    Args:
        run: the results; ``samples`` of its summary is read.
    """
    facts = run.summary.get("samples")
    lines = []
    for name, about in facts.items() if isinstance(facts, Mapping) else ():
        said = []
        if missed := about.get("tolerance_missed"):
            said.append(
                f"tolerance not reached: {missed} of {about['modes']} modes have an error estimate"
                f" above stability.tolerance, the largest {about['largest_error']:.1e} of |lambda|;"
                ' stability.on_tolerance = "full order" solves such samples again'
            )
        if unproven := about.get("not_complete"):
            said.append(
                f"in {unproven} of {about['good']} samples the number of modes is not proven, one"
                " may be missing"
            )
        if said:
            lines.append(f"{run.label(name)}: {', '.join(said)}")
    return "; ".join(lines) + " (samples.csv)" if lines else ""


def share_text(*interval: Value) -> str:
    """A share with its interval in per cent, or a dash where there is none."""
    known = [100 * v for v in interval if isinstance(v, float) and np.isfinite(v)]
    return "{:.0f} % ({:.0f} to {:.0f} %)".format(*known) if len(known) == 3 else "-"
