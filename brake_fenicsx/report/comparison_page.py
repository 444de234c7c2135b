"""The page of a comparison of two runs: one table, one figure."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.tables import Value, text_table, write_rows
from brake_fenicsx.variants.comparison import COLUMNS, compare_runs

from .blocks import Picture, Table, Text
from .style import BLUE, GREY, VERMILION, drawn, light_grid, new_figure
from .template import render, write_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    return write_page(folder / "compare.html", _page(one, two, rows))


def comparison_text(a: str | Path | RunData, b: str | Path | RunData) -> str:
    """The comparison of two runs for the terminal, see `write_comparison`."""
    one, two = read_run(a), read_run(b)
    rows = [_shown(row) for row in compare_runs(one, two)]
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


def _shown(row: dict[str, Value]) -> list[Value]:
    family = row["family_a"] if row["family_a"] is not None else row["family_b"]
    whole = row["mac"] is None and family is None
    change = f"{row['change']:+.3f} ({row['change_low']:+.3f} to {row['change_high']:+.3f})"
    return [
        row["approach"], "any" if whole else family,
        *("-" if whole or (f := row[f"frequency_{r}_hz"]) is None else f"{float(f) / 1e3:.3f}"
          for r in "ab"),
        *(f"{100 * float(row[f'probability_{r}'] or 0):.0f} % of {row[f'samples_{r}']}"
          for r in "ab"),
        change,
        *("-" if (d := row[f"median_damping_{r}"]) is None else f"{float(d):.3g}" for r in "ab"),
        "-" if row["mac"] is None else f"{float(row['mac']):.2f}",
    ]  # fmt: skip


def _page(one: RunData, two: RunData, rows: list[dict[str, Value]]) -> str:
    named = rows
    paired = any(row["paired"] == "yes" for row in named)
    how = (
        "Samples of the same number have the same random numbers in both runs: the interval is that"
        " of paired shares." if paired else "The intervals are those of independent samples."
    )  # fmt: skip
    text = "Share of samples in which a family squeals, with the 95 % interval of its change."
    return render(
        "plain.html.j2",
        title="Two runs compared",
        intro=[
            Text(f"{name}: {run.directory.resolve()} ({run.criterion})")
            for name, run in (("A", one), ("B", two))
        ]
        + [Text(f"Warning: {text}.") for text in _two_limits(one, two)],
        blocks=[
            Text(
                "Families are matched by shape (modal assurance criterion at the nodes); a family"
                f" without a match does not squeal in the other run. {how}"
            ),
            Picture(drawn(partial(_figure, named)), text),
            Table(HEADS, [_shown(row) for row in named]),
        ],
        links=[],
    )


def _figure(rows: list[dict[str, Value]]) -> Figure:
    """Shares in both runs, one line for each family."""
    figure, axes = new_figure(1, 2, height=max(1.6, 0.32 * len(rows) + 1.0), sharey=True)
    left, right = axes[0]
    names = []
    for y, row in enumerate(rows):
        p, q = float(row["probability_a"] or 0), float(row["probability_b"] or 0)
        left.plot([p, q], [y, y], color=GREY, lw=1.5, zorder=2)
        a, b = ("A", "B") if y == 0 else (None, None)
        left.scatter([p], [y], 55, facecolor="none", edgecolor=BLUE, lw=1.6, zorder=4, label=a)
        left.scatter([q], [y], 22, color=VERMILION, marker="D", zorder=3, label=b)
        low, middle, high = (float(row[n] or 0) for n in ("change_low", "change", "change_high"))
        right.plot([low, high], [y, y], color=GREY, lw=1.5)
        right.scatter([middle], [y], color="black", s=14, zorder=3)
        f = row["frequency_a_hz"] if row["frequency_a_hz"] is not None else row["frequency_b_hz"]
        whole = row["mac"] is None and row["family_a"] is None and row["family_b"] is None
        names.append(
            f"{row['approach']}, " + ("any" if whole else f"{float(f or 0) / 1e3:.2f} kHz")
        )
    left.set_yticks(range(len(rows)), names)
    left.set_ylim(len(rows) - 0.5, -0.5)
    left.set_xlim(-0.03, 1.03)
    left.set_xlabel("share of samples that squeal [-]")
    right.set_xlabel("change from A to B [-]")
    right.axvline(0.0, color="black", lw=0.6)
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
    for axis in (left, right):
        light_grid(axis, axis="x")
    return figure
