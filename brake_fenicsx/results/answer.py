"""The answer in tables: per approach, per family of modes, per frequency band."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .accuracy import (
    ERROR_COLUMNS,
    SPEED_COLUMNS,
    STAGE_COLUMNS,
    error_rows,
    speed_rows,
    stage_rows,
)
from .limits import LIMIT_COLUMNS, limit_rows
from .run import RunData, read_run
from .squeal import Family
from .statistics import Proportion, wilson
from .tables import Value, write_rows

APPROACH_COLUMNS = (
    "approach", "samples", "failed", "modes", "unstable_modes", "neutral_modes", "threshold",
    "squeal_modes", "squeal_samples", "share", "share_low", "share_high", "most_severe",
)  # fmt: skip
FAMILY_COLUMNS = (
    "approach", "family", "frequency_hz", "spread_hz", "threshold", "squeal_samples", "share",
    "share_low", "share_high", "median_damping", "worst_damping", "severity",
)  # fmt: skip
BAND_COLUMNS = (
    "approach", "from_hz", "to_hz", "threshold", "squeal_samples", "samples", "share",
    "share_low", "share_high",
)  # fmt: skip


def approach_rows(run: RunData, most: int = 3) -> list[list[Value]]:
    """One row per approach, in the order of `APPROACH_COLUMNS`.

    Args:
        run: the results.
        most: number of families named in the last column.

    Returns:
        The rows; shares are of samples, with 95 % Wilson intervals, and None where there is one
        sample only, whose verdict is no share.
    """
    rows: list[list[Value]] = []
    for approach in run.approaches:
        c = run.squeal.count(approach)
        rows.append(
            [
                approach,
                c.samples,
                c.failed,
                c.modes,
                c.unstable,
                c.neutral,
                run.threshold,
                c.squeal,
                c.squeal_samples,
                *_share_cells(wilson(c.squeal_samples, c.samples)),
                "; ".join(map(_family_text, run.squeal.families(approach)[:most])) or "none",
            ]
        )
    return rows


def family_rows(run: RunData, most: int | None = None) -> list[list[Value]]:
    """One row per family of squeal modes, the most severe first, in the order of `FAMILY_COLUMNS`.

    Args:
        run: the results.
        most: rows of each approach, the most severe ones; all if not given.
    """
    return [
        [
            f.approach,
            f.number,
            f.frequency,
            f.spread,
            run.threshold,
            f.share.hits,
            *_share_cells(f.share),
            f.median,
            f.worst,
            f.severity,
        ]
        for approach in run.approaches
        for f in run.squeal.families(approach)[:most]
    ]


def band_rows(run: RunData) -> list[list[Value]]:
    """One row per approach and frequency band, in the order of `BAND_COLUMNS`."""
    edges = run.squeal.edges
    rows: list[list[Value]] = []
    for approach in run.approaches:
        for j, s in enumerate(run.squeal.share_per_band(approach)):
            band = float(edges[j]), float(edges[j + 1])
            rows.append([approach, *band, run.threshold, s.hits, s.n, *_share_cells(s)])
    return rows


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
    tables: list[tuple[str, Sequence[str], list[list[Value]]]] = [
        ("approaches", APPROACH_COLUMNS, approach_rows(run)),
        ("limits", LIMIT_COLUMNS, limit_rows(run)),
        ("families", FAMILY_COLUMNS, family_rows(run)),
        ("probability_per_band", BAND_COLUMNS, band_rows(run) if run.modes else []),
        ("eigenvalue_errors", ERROR_COLUMNS, error_rows(run)),
        ("stages", STAGE_COLUMNS, stage_rows(run.summary)),
        ("speed_and_error", SPEED_COLUMNS, speed_rows(run)),
    ]
    folder = run.directory / "tables"
    folder.mkdir(exist_ok=True)
    return [write_rows(folder / f"{name}.csv", heads, rows) for name, heads, rows in tables if rows]


def _share_cells(share: Proportion) -> list[Value]:
    """A share and its interval; a single sample has a verdict, no share."""
    return [*share.cells] if share.n > 1 else [None, None, None]


def _family_text(f: Family) -> str:
    often = f"{f.share.hits}/{f.share.n}, " if f.share.n > 1 else ""
    return f"{f.kilohertz} kHz ({often}{f.median:.2g})"
