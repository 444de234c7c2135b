"""Table and page of countermeasures: one table, one figure, links to the comparisons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brake_fenicsx.results.squeal import Family
from brake_fenicsx.results.tables import Value, text_table, write_rows
from brake_fenicsx.scene.units import quantity_text
from brake_fenicsx.sweeps.smallest_change import MOST

from .blocks import Picture, Table, Text
from .style import BLUE, GREY, VERMILION, drawn, light_grid, new_figure
from .template import render, write_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = (
    "rank", "key", "value_scene", "value_to", "unit", "first_order", "smallest_value",
    "share_before", "share_after", "share_after_low", "share_after_high", "any_before",
    "any_after", "verified", "note",
)  # fmt: skip

HEADS = (
    "rank", "number of the scene", "scene", "farthest", "first-order change of damping",
    "smallest change that is enough", "samples that squeal before", "after (95 % interval)",
    "any family before", "after", "verified", "note",
)  # fmt: skip

Row = Mapping[str, Value]


def write_countermeasures(folder: Path, worst: Family, rows: Sequence[Sequence[Value]]) -> Path:
    """Write countermeasures.csv and countermeasures.html.

    Args:
        folder: where they are written.
        worst: the family that is to be stopped.
        rows: in the order of COLUMNS, SI.

    Returns:
        The page.
    """
    write_rows(folder / "countermeasures.csv", COLUMNS, rows)
    named: list[Row] = [dict(zip(COLUMNS, r, strict=True)) for r in rows]
    return write_page(folder / "countermeasures.html", _page(worst, named))


def countermeasures_text(rows: Sequence[Row]) -> str:
    """The table for the terminal.

    Args:
        rows: of countermeasures.csv.
    """
    return text_table(HEADS, [_shown(row) for row in rows])


def _shown(row: Row) -> list[Value]:
    scene, to, smallest = (_quantity(row, n) for n in ("value_scene", "value_to", "smallest_value"))
    first = row["first_order"]
    after = "-"
    if row["share_after"] is not None:
        low, high = _percent(row["share_after_low"]), _percent(row["share_after_high"])
        after = f"{_percent(row['share_after'])} ({low} to {high})"
    return [
        row["rank"], row["key"], scene, to, "-" if first is None else f"{float(first):+.3g}",
        smallest, _percent(row["share_before"]), after, _percent(row["any_before"]),
        _percent(row["any_after"]), row["verified"], row["note"] or "",
    ]  # fmt: skip


def _quantity(row: Row, name: str) -> str:
    value = row[name]
    return "none" if value is None else quantity_text(float(value), str(row["unit"] or ""))


def _percent(value: Value) -> str:
    return "-" if value is None else f"{100 * float(value):.0f} %"


def _page(worst: Family, rows: list[Row]) -> str:
    text = (
        "Share of samples that squeal before and after each change, with its 95 % interval: the"
        " worst family, and any family (small marks)."
    )
    return render(
        "plain.html.j2",
        title="Countermeasures",
        intro=[
            Text(
                f"Worst family: {worst.frequency / 1e3:.3f} kHz, squeals in {worst.share.hits} of"
                f" {worst.share.n} samples of {worst.approach}."
            )
        ],
        blocks=[
            Text(
                "For each number the smallest change after which the worst family squeals in at"
                f" most {_percent(MOST)} of the samples, ranked by first-order effect. Verified: a"
                " whole run with the change has been compared with that of the scene."
            ),
            Picture(drawn(partial(draw_shares, rows)), text),
            Table(HEADS, [_shown(row) for row in rows]),
        ],
        links=[
            (
                f"after-{row['rank']}/compare.html",
                f"{row['rank']}: {row['key']}: the scene before and after",
            )
            for row in rows
            if row["any_after"] is not None
        ],
    )


def draw_shares(rows: Sequence[Row]) -> Figure:
    """Shares before and after, one line for each number.

    Args:
        rows: of countermeasures.csv.
    """
    figure, axes = new_figure(height=max(1.8, 0.5 * len(rows) + 1.2))
    ax = axes[0, 0]
    for y, row in enumerate(rows):
        first = y == 0
        for shift, names, size in ((0.0, "share", 50), (0.22, "any", 20)):
            what = "worst family" if names == "share" else "any family"
            before, after = row[f"{names}_before"], row[f"{names}_after"]
            ax.scatter(
                [float(before or 0)], [y + shift], size, facecolor="none", edgecolor=BLUE, lw=1.4,
                zorder=3, label=f"{what}, before" if first else None,
            )  # fmt: skip
            ax.scatter(
                [np.nan if after is None else float(after)], [y + shift], 0.6 * size,
                color=VERMILION, marker="D", zorder=4, label=f"{what}, after" if first else None,
            )  # fmt: skip
        if row["share_after"] is not None:
            ends = [float(row[f"share_after_{end}"] or 0) for end in ("low", "high")]
            ax.plot(ends, [y, y], color=GREY, lw=1.5, zorder=2)
    ax.set_yticks(range(len(rows)), [_name(row) for row in rows])
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xlim(-0.03, 1.03)
    ax.axvline(MOST, color="black", lw=0.6, ls=":")
    ax.set_xlabel("share of samples that squeal [-]")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
    light_grid(ax, axis="x")
    return figure


def _name(row: Row) -> str:
    """Number and change, as the figure names them."""
    key = str(row["key"]).replace("$", r"\$")
    enough = row["smallest_value"] is not None
    reached = _quantity(row, "smallest_value" if enough else "value_to")
    return f"{key}\n{_quantity(row, 'value_scene')} to {reached}{'' if enough else ' (not enough)'}"
