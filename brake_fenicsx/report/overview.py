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
from .counts import FamilyCount, Share, band_edges, count, families, probability_per_band, wilson
from .rundata import RunData, read_run
from .tables import Value, read_rows, text_table, write_rows

APPROACH_COLUMNS = (
    "approach",
    "samples",
    "failed",
    "modes",
    "unstable_modes",
    "neutral_modes",
    "unstable_samples",
    "share",
    "share_low",
    "share_high",
    "most_frequent",
)
FAMILY_COLUMNS = (
    "approach",
    "family",
    "frequency_hz",
    "spread_hz",
    "unstable_samples",
    "share",
    "share_low",
    "share_high",
    "worst_damping",
)
BAND_COLUMNS = (
    "approach",
    "from_hz",
    "to_hz",
    "unstable_samples",
    "samples",
    "share",
    "share_low",
    "share_high",
)

CAUSE_COLUMNS = (
    "probability",
    "low",
    "high",
    "above_limit",
    "mover",
    "mover_rho",
    "mover_low",
    "mover_high",
)


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
        c = count(run, approach)
        rows.append(
            [
                approach,
                c.samples,
                c.failed,
                c.modes,
                c.unstable,
                c.neutral,
                c.unstable_samples,
                *_share_cells(wilson(c.unstable_samples, c.samples)),
                ", ".join(map(_family_text, families(run, approach)[:most])) or "none",
            ]
        )
    return rows


def family_rows(run: RunData, most: int | None = None) -> list[list[Value]]:
    """One row per family of unstable modes, in the order of `FAMILY_COLUMNS`.

    Args:
        run: the results.
        most: rows of each approach, the most frequent ones; all if not given.
    """
    return [
        [
            f.approach,
            f.family,
            f.frequency,
            f.spread,
            f.share.hits,
            *_share_cells(f.share),
            f.worst,
        ]
        for approach in run.approaches
        for f in families(run, approach)[:most]
    ]


def band_rows(run: RunData) -> list[list[Value]]:
    """One row per approach and frequency band, in the order of `BAND_COLUMNS`."""
    edges = band_edges(run)
    rows: list[list[Value]] = []
    for approach in run.approaches:
        for j, s in enumerate(probability_per_band(run, approach, edges)):
            band = float(edges[j]), float(edges[j + 1])
            rows.append([approach, *band, s.hits, s.n, *_share_cells(s)])
    return rows


def cause_rows(run: RunData, most: int = 12) -> list[list[Value]]:
    """What robustness.csv says of the whole band and of the families, the most probable first.

    Args:
        run: the results.
        most: rows of each approach.

    Returns:
        Approach, where, probability with its interval, whether it is above the limit, the input
        that moves it most, its rank correlation with interval, shares of the variance of growth by
        friction, materials, loads and the rest.
    """
    path = run.directory / "robustness.csv"
    if not path.is_file():
        return []
    found = [row for row in read_rows(path) if row["scope"] in ("band", "family")]
    rows: list[list[Value]] = []
    for approach in run.approaches:
        own = [row for row in found if row["approach"] == approach]
        whole = [row for row in own if row["scope"] == "band"][:1]
        families = [row for row in own if row["scope"] == "family" and row["unstable"]]
        families.sort(key=lambda row: -_number(row["probability"]))
        for row in [*whole, *families[: most - 1]]:
            kilo = _number(row["frequency_hz"]) / 1e3
            where = "whole band"
            if row["scope"] == "family":
                where = f"{kilo:.2f} kHz, family {row['where']}"
            chosen = (*CAUSE_COLUMNS, *(name for name in row if name.startswith("share_")))
            rows.append([approach, where, *(row[name] for name in chosen)])
    return rows


def _number(value: Value) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def summary_table(run: RunData | str | Path) -> str:
    """The answer of a run as text for the terminal.

    Args:
        run: the results, or the run directory.

    Returns:
        A table with one line per approach.
    """
    run = read_run(run)
    heads = (
        "approach",
        "samples",
        "failed",
        "modes",
        "unstable",
        "neutral",
        "unstable samples",
        "share",
        "most often unstable",
    )
    rows = [[*row[:7], share_text(row[7:10]), row[10]] for row in approach_rows(run)]
    return text_table(heads, rows)


def share_text(interval: Sequence[Value]) -> str:
    """A share with its interval in per cent, or a dash where there is none."""
    numbers = [float(v) for v in interval if isinstance(v, float)]
    if len(numbers) < 3:
        return "-"
    return f"{100 * numbers[0]:.0f} % ({100 * numbers[1]:.0f} to {100 * numbers[2]:.0f} %)"


def write_tables(directory: str | Path | RunData) -> list[Path]:
    """Write the tables of a run as CSV into ``directory/tables``.

    Args:
        directory: the run directory, or its results already read.

    Returns:
        Paths written: ``approaches.csv``, ``families.csv``, ``probability_per_band.csv``,
        ``eigenvalue_errors.csv``, ``stages.csv``, ``speed_and_error.csv``; an empty table is left
        out.
    """
    run = read_run(directory)
    tables: list[tuple[str, Sequence[str], list[list[Value]]]] = [
        ("approaches", APPROACH_COLUMNS, approach_rows(run)),
        ("families", FAMILY_COLUMNS, family_rows(run)),
        ("probability_per_band", BAND_COLUMNS, band_rows(run) if run.modes else []),
        ("eigenvalue_errors", ERROR_COLUMNS, error_rows(run)),
        ("stages", STAGE_COLUMNS, stage_rows(run.summary)),
        ("speed_and_error", SPEED_COLUMNS, speed_rows(run)),
    ]
    folder = run.directory / "tables"
    folder.mkdir(exist_ok=True)
    return [write_rows(folder / f"{name}.csv", heads, rows) for name, heads, rows in tables if rows]


def _share_cells(share: Share) -> list[Value]:
    """A share and its interval; a single sample has a verdict, no share."""
    return [share.value, share.low, share.high] if share.n > 1 else [None, None, None]


def _family_text(f: FamilyCount) -> str:
    often = f" ({f.share.hits}/{f.share.n})" if f.share.n > 1 else ""
    return f"{f.frequency / 1e3:.2f} kHz{often}"
