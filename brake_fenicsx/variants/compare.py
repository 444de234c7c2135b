"""The command `compare`: two runs in one table and one page."""

from __future__ import annotations

from pathlib import Path

from brake_fenicsx.report.blocks import Table, Text
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.tables import Value, text_table, write_rows

from .comparison import COLUMNS, Row, compare_runs
from .page import Line, change_of, interval_of, kilohertz, page_of_changes, picture_of, share_of

HEADS = (
    "approach", "family", "frequency in A [kHz]", "in B [kHz]", "samples that squeal in A",
    "in B", "change (95 % interval)", "median damping in A", "in B", "MAC",
)  # fmt: skip


def write_comparison(a: str | Path, b: str | Path, directory: str | Path) -> Path:
    """Compare two runs; compare.csv and compare.html in a folder.

    Args:
        a: results folder of the first run.
        b: of the second one.
        directory: where the comparison is written, made if it is not there.

    Returns:
        The page.

    Raises:
        SceneError: a folder holds no modes, or the runs have no approach in common.
    """
    one, two = read_run(a), read_run(b)
    rows = compare_runs(one, two)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    write_rows(folder / "compare.csv", COLUMNS, rows)
    paired = any(row["paired"] == "yes" for row in rows)
    how = (
        "Samples of the same number have the same random numbers in both runs: the interval is that"
        " of paired shares." if paired else "The intervals are those of independent samples."
    )  # fmt: skip
    lines = [
        Line(
            f"{row['approach']}, {_name(row)}", float(row["probability_a"] or 0),
            float(row["probability_b"] or 0), change=interval_of(row),
        ) for row in rows
    ]  # fmt: skip
    text = "Share of samples in which a family squeals, with the 95 % interval of its change."
    return page_of_changes(
        folder / "compare.html", "Two runs compared",
        [f"{name}: {run.directory.resolve()} ({run.criterion})"
         for name, run in (("A", one), ("B", two))]
        + [f"Warning: {text}." for text in _two_limits(one, two)],
        picture_of(lines, ("A", "B"), text),
        [
            Text(
                "Families are matched by shape (modal assurance criterion at the nodes); a family"
                f" without a match does not squeal in the other run. {how}"
            ),
            Table(HEADS, list(map(_shown, rows))),
        ],
    )  # fmt: skip


def comparison_text(a: str | Path | RunData, b: str | Path | RunData) -> str:
    """The comparison of two runs for the terminal, see `write_comparison`."""
    one, two = read_run(a), read_run(b)
    rows = list(map(_shown, compare_runs(one, two)))
    return "\n".join([text_table(HEADS, rows), *_two_limits(one, two)])


def _two_limits(one: RunData, two: RunData) -> list[str]:
    """A warning where the runs do not count the same modes as squeal."""
    if one.threshold == two.threshold:
        return []
    a, b = (f"{-run.threshold if run.threshold else 0:g}" for run in (one, two))
    return [
        f"A counts squeal below {a}, B below {b}; set one stability.threshold and run both again"
        " (no sample is computed again)"
    ]


def _all(row: Row) -> bool:
    """Whether a row is that of all modes together."""
    return row["family_a"] is None and row["family_b"] is None


def _name(row: Row) -> str:
    f = row["frequency_a_hz"] if row["frequency_a_hz"] is not None else row["frequency_b_hz"]
    return "any" if _all(row) else f"{kilohertz(f)} kHz"


def _shown(row: Row) -> list[Value]:
    family = row["family_a"] if row["family_a"] is not None else row["family_b"]
    return [
        row["approach"], "any" if _all(row) else family,
        *("-" if _all(row) else kilohertz(row[f"frequency_{r}_hz"]) for r in "ab"),
        *(share_of(row[f"probability_{r}"], row[f"samples_{r}"]) for r in "ab"),
        change_of(row),
        *("-" if (d := row[f"median_damping_{r}"]) is None else f"{float(d):.3g}" for r in "ab"),
        "-" if row["mac"] is None else f"{float(row['mac']):.2f}",
    ]  # fmt: skip
