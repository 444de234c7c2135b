"""The answer in tables: per approach, per family of modes, per frequency band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from .accuracy import ErrorRow, SpeedRow, StageRow, error_rows, speed_rows, stage_rows
from .ensemble_statistics import wilson
from .limits import LimitRow, limit_rows, share_cells
from .run import RunData, read_run
from .squeal import Family
from .tables import Row, RowTable


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


def approach_rows(run: RunData, most: int = 3) -> list[ApproachRow]:
    """One row per approach.

    Args:
        run: the results.
        most: number of families named in the last column.
    """
    rows = list[ApproachRow]()
    for approach in run.approaches:
        c = run.squeal.count(approach)
        families = "; ".join(map(_family_text, run.squeal.families(approach)[:most]))
        rows.append(ApproachRow.of(
            approach, c.samples, c.failed, c.modes, c.unstable, c.neutral, run.threshold, c.squeal,
            c.squeal_samples, *share_cells(wilson(c.squeal_samples, c.samples)),
            families or "none",
        ))  # fmt: skip
    return rows


def family_rows(run: RunData, most: int | None = None) -> list[FamilyRow]:
    """One row per family of squeal modes, the most severe first.

    Args:
        run: the results.
        most: rows of each approach, the most severe ones; all if not given.
    """
    return [
        FamilyRow.of(
            f.approach, f.number, f.frequency, f.spread, run.threshold, f.share.hits,
            *share_cells(f.share), f.median, f.worst, f.severity,
        )
        for approach in run.approaches for f in run.squeal.families(approach)[:most]
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
    tables: dict[str, tuple[type[Row], Sequence[Row]]] = {
        "approaches": (ApproachRow, approach_rows(run)),
        "limits": (LimitRow, limit_rows(run)),
        "families": (FamilyRow, family_rows(run)),
        "probability_per_band": (BandRow, band_rows(run)),
        "eigenvalue_errors": (ErrorRow, error_rows(run)),
        "stages": (StageRow, stage_rows(run.summary)),
        "speed_and_error": (SpeedRow, speed_rows(run)),
    }
    folder = run.directory / "tables"
    folder.mkdir(exist_ok=True)
    return [
        RowTable.of(kind, rows).write(folder / f"{name}.csv")
        for name, (kind, rows) in tables.items()
        if rows
    ]


def _family_text(f: Family) -> str:
    often = f"{f.share.hits}/{f.share.n}, " if f.share.n > 1 else ""
    return f"{f.kilohertz} kHz ({often}{f.median:.2g})"
