"""The page of a comparison of two runs: one table, one figure."""

from __future__ import annotations

import base64
import io
import os
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from brake_fenicsx.tables import Value, text_table, write_rows

from .comparison import COLUMNS, compare_runs
from .html_parts import table
from .page_style import CSS
from .rundata import RunData, read_run
from .style import BLUE, GREY, VERMILION, house_style, light_grid, new_figure

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
    path = folder / "compare.html"
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_text(_page(one, two, rows), encoding="utf-8")
    os.replace(part, path)
    return path


def comparison_text(rows: list[list[Value]]) -> str:
    """The comparison for the terminal."""
    return text_table(HEADS, [_shown(dict(zip(COLUMNS, row, strict=True))) for row in rows])


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


def _page(one: RunData, two: RunData, rows: list[list[Value]]) -> str:
    named = [dict(zip(COLUMNS, row, strict=True)) for row in rows]
    body = table(HEADS, [_shown(row) for row in named])
    paired = any(row["paired"] == "yes" for row in named)
    how = (
        "Samples of the same number have the same random numbers in both runs: the interval is that"
        " of paired shares." if paired else "The intervals are those of independent samples."
    )  # fmt: skip
    with house_style():
        figure = _figure(named)
        data = io.BytesIO()
        figure.savefig(data, format="png", dpi=200, facecolor="white")
    picture = base64.b64encode(data.getvalue()).decode("ascii")
    text = "Share of samples in which a family squeals, with the 95 % interval of its change."
    return (
        '<!DOCTYPE html>\n<html xmlns="http://www.w3.org/1999/xhtml" lang="en">\n<head>\n'
        '<meta charset="utf-8"/>\n<title>Two runs compared</title>\n'
        f"<style>\n{CSS}</style>\n</head>\n<body>\n<header>\n<h1>Two runs compared</h1>\n"
        f"<p>A: {escape(str(one.directory.resolve()))} ({one.criterion})</p>\n"
        f"<p>B: {escape(str(two.directory.resolve()))} ({two.criterion})</p>\n</header>\n<main>\n"
        f"<p>Families are matched by shape (modal assurance criterion at the nodes); a family "
        f"without a match does not squeal in the other run. {how}</p>\n"
        f'<figure class="plot"><img alt="{text}" src="data:image/png;base64,{picture}"/>'
        f"<figcaption>{text}</figcaption></figure>\n{body}\n</main>\n</body>\n</html>\n"
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
    left.invert_yaxis()
    left.set_xlim(-0.03, 1.03)
    left.set_xlabel("share of samples that squeal [-]")
    right.set_xlabel("change from A to B [-]")
    right.axvline(0.0, color="black", lw=0.6)
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
    for axis in (left, right):
        light_grid(axis, axis="x")
    return figure
