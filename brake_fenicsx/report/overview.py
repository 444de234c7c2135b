"""The answer in tables: per approach, per family of modes, per frequency band.

Families are ranked by severity: the share of samples in which the family squeals, times the median
of its damping there. Both numbers stand in the tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from brake_fenicsx.squeal import Share, wilson
from brake_fenicsx.tables import Value, read_columns, read_rows, text_table, write_rows

from .accuracy import (
    ERROR_COLUMNS,
    SPEED_COLUMNS,
    STAGE_COLUMNS,
    error_rows,
    speed_rows,
    stage_rows,
)
from .counts import FamilyCount, band_edges, count, families, probability_per_band
from .rundata import RunData, read_run

APPROACH_COLUMNS = (
    "approach",
    "samples",
    "failed",
    "modes",
    "unstable_modes",
    "neutral_modes",
    "threshold",
    "squeal_modes",
    "squeal_samples",
    "share",
    "share_low",
    "share_high",
    "most_severe",
)
FAMILY_COLUMNS = (
    "approach",
    "family",
    "frequency_hz",
    "spread_hz",
    "threshold",
    "squeal_samples",
    "share",
    "share_low",
    "share_high",
    "median_damping",
    "worst_damping",
    "severity",
)
BAND_COLUMNS = (
    "approach",
    "from_hz",
    "to_hz",
    "threshold",
    "squeal_samples",
    "samples",
    "share",
    "share_low",
    "share_high",
)

CAUSE_COLUMNS = (
    "probability",
    "low",
    "high",
    "median_damping",
    "above_limit",
    "dominant_input",
    "correlation",
    "correlation_low",
    "correlation_high",
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
                run.threshold,
                c.squeal,
                c.squeal_samples,
                *_share_cells(wilson(c.squeal_samples, c.samples)),
                "; ".join(map(_family_text, families(run, approach)[:most])) or "none",
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
            f.family,
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
        for f in families(run, approach)[:most]
    ]


def band_rows(run: RunData) -> list[list[Value]]:
    """One row per approach and frequency band, in the order of `BAND_COLUMNS`."""
    edges = band_edges(run)
    rows: list[list[Value]] = []
    for approach in run.approaches:
        for j, s in enumerate(probability_per_band(run, approach, edges)):
            band = float(edges[j]), float(edges[j + 1])
            rows.append([approach, *band, run.threshold, s.hits, s.n, *_share_cells(s)])
    return rows


def cause_rows(run: RunData, most: int = 12) -> list[list[Value]]:
    """What probabilities.csv says of the whole band and of the families, the most severe first.

    Args:
        run: the results.
        most: rows of each approach.

    Returns:
        Approach, where, probability with its interval, median damping of the samples that squeal,
        whether the probability is above the limit, the input that moves it most, its rank
        correlation with interval, shares of the variance of growth by friction, materials, loads
        and the rest.

    Raises:
        SceneError: a column is missing.
    """
    path = run.directory / "probabilities.csv"
    if not path.is_file():
        return []
    read_columns(path, (*CAUSE_COLUMNS, "squeal_samples", "severity"))
    found = [row for row in read_rows(path) if row["scope"] in ("band", "family")]
    rows: list[list[Value]] = []
    for approach in run.approaches:
        own = [row for row in found if row["approach"] == approach]
        whole = [row for row in own if row["scope"] == "band"][:1]
        families = [row for row in own if row["scope"] == "family" and row["squeal_samples"]]
        families.sort(key=lambda row: -_number(row["severity"]))
        for row in [*whole, *families[: most - 1]]:
            kilo = _number(row["frequency_hz"]) / 1e3
            where = "whole band"
            if row["scope"] == "family":
                where = f"{kilo:.3f} kHz, family {row['where']}"
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
        What counts as squeal, and a table with one line per approach.
    """
    run = read_run(run)
    said = f"squeal: unstable modes with {run.criterion} (stability.threshold)"
    heads = (
        "approach",
        "samples",
        "failed",
        "modes",
        "unstable",
        "neutral",
        "squeal modes",
        "squeal samples",
        "share",
        "most severe (squeal samples, median damping)",
    )
    rows = [
        [run.label(str(row[0])), *row[1:6], *row[7:9], share_text(row[9:12]), row[12]]
        for row in approach_rows(run)
    ]
    return f"{said}\n{text_table(heads, rows)}"


def open_points(run: RunData) -> str:
    """What the computation itself leaves open, in one line; empty where it leaves nothing.

    Args:
        run: the results; ``samples`` of its summary is read, see ``uncertainty.results``.
    """
    facts = run.summary.get("samples")
    found = []
    for name, about in facts.items() if isinstance(facts, Mapping) else ():
        said = []
        if missed := about.get("tolerance_missed"):
            said.append(
                f"tolerance not reached: {missed} of {about['modes']} modes have an error estimate"
                f" above stability.tolerance, the largest {about['largest_error']:.1e} of |lambda|"
            )
        if unproven := about.get("not_complete"):
            said.append(
                f"in {unproven} of {about['good']} samples the number of modes is not proven, one"
                " may be missing"
            )
        if said:
            found.append(f"{run.label(name)}: {', '.join(said)}")
    return "; ".join(found) + " (samples.csv)" if found else ""


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
    often = f"{f.share.hits}/{f.share.n}, " if f.share.n > 1 else ""
    return f"{f.frequency / 1e3:.3f} kHz ({often}{f.median:.2g})"
