"""Table and page of countermeasures."""

from collections.abc import Sequence
from pathlib import Path

from brake_fenicsx.report.page_blocks import Table, Text
from brake_fenicsx.results import answer, ensemble_statistics, tables
from brake_fenicsx.scene.units import quantity_text

from .page import Row, ShareChange, page_of_changes, picture_of
from .trial import MOST, SURE, Worst, allowed, limits

AFTER = ("share_after", "share_after_low", "share_after_high")
COLUMNS = (
    "rank", "key", "value_scene", "value_to", "unit", "first_order", "smallest_value",
    "share_before", *AFTER, "any_before", "any_after", "verified", "samples_needed", "note",
)  # fmt: skip
HEADS = (
    "rank", "key of the scene", "value now", "acceptable limit",
    "change of damping up to the limit, first order", "smallest sufficient value",
    "worst family: samples that squeal now", "after the change (exact 90 % interval)",
    "any family: now", "after the change", "verified by a run", "note",
)  # fmt: skip


def write_countermeasures(folder: Path, worst: Worst, rows: Sequence[Row]) -> Path:
    """Write countermeasures.csv and countermeasures.html.

    Args:
        folder: where they are written.
        worst: the family that is to be stopped.
        rows: with the columns COLUMNS, SI.

    Returns:
        The page.
    """
    tables.write_rows(folder / "countermeasures.csv", COLUMNS, rows)
    caption = (
        "Share of samples that squeal now and after each change, with its 90 % interval. Dotted:"
        f" {100 * MOST:.0f} %."
    )
    lines = [line for row in rows for line in _lines(row)]
    return page_of_changes(
        folder / "countermeasures.html",
        "Countermeasures",
        what_is_wanted(worst, "Searched"),
        [
            picture_of(lines, ("now", "after the change"), caption, limit=MOST),
            Text(
                "For each number of the scene the smallest change that the search found, ranked by"
                " first-order effect. Verified: in a whole run with the change the interval of the"
                f" worst family lies below {100 * MOST:.0f} %; its upper end is exceeded with a"
                f" probability of {100 * (1 - SURE):.0f} % at most."
            ),
            Table(HEADS, list(map(_shown, rows))),
        ],
        [
            (f"after-{row['rank']}/compare.html",
             f"{row['rank']}: {row['key']}: the scene before and after")
            for row in rows if row["any_after"] is not None
        ],
    )  # fmt: skip


def what_is_wanted(worst: Worst, how: str) -> list[str]:
    """The family that is to be stopped, and in how many samples it may squeal.

    Args:
        worst: the family.
        how: what such a change is called.
    """
    family, n, most = worst.count, len(worst.samples), allowed(len(worst.samples))
    return [
        f"Worst family: {family.kilohertz} kHz, squeals in {family.share.hits} of"
        f" {family.share.n} samples of {family.approach}.",
        f"{how}: at most {most} of {n} samples squeal; of all, with a confidence of"
        f" {100 * SURE:.0f} %, at most {100 * limits(most, n)[1]:.1f} %.",
    ]


def countermeasures_text(rows: Sequence[Row]) -> str:
    """The table for the terminal.

    Args:
        rows: of countermeasures.csv.
    """
    return tables.text_table(HEADS, [_shown(row) for row in rows])


def _shown(row: Row) -> list[tables.Value]:
    first, after = row["first_order"], [row[name] for name in AFTER]
    return [
        row["rank"], row["key"], _quantity(row, "value_scene"), _quantity(row, "value_to"),
        "-" if first is None else f"{first:+.3g}", _quantity(row, "smallest_value"),
        percent_text(row["share_before"]), percent_text(after[0]) if after[1] is None else
        answer.share_text(*after), percent_text(row["any_before"]), percent_text(row["any_after"]),
        verified_text(row), row["note"],
    ]  # fmt: skip


def share_cells(share: ensemble_statistics.Proportion) -> Row:
    """Cells of a share after a change, with the ends that the search itself goes by."""
    ends = limits(share.hits, share.n) if share.n > 1 else (None, None)
    return dict(zip(AFTER, (share.value, *ends), strict=True))


def verified_text(row: Row) -> str:
    """Whether a run verifies a change, or how many samples would."""
    more = row.get("samples_needed")
    return str(row["verified"]) + (f": {more} samples would show it" if more else "")


def percent_text(share: float | None) -> str:
    """A share in per cent, a dash without one."""
    return "-" if share is None else f"{100 * share:.0f} %"


def _quantity(row: Row, name: str) -> str:
    """A value of a row with its unit, in as many digits as the search has."""
    return "none" if row[name] is None else short_quantity(row[name], row["unit"])


def short_quantity(value: float, unit: str) -> str:
    """A quantity in as many digits as the search has."""
    return quantity_text(float(f"{value:.4g}"), unit)


def _lines(row: Row) -> list[ShareChange]:
    """The worst family, and any family where a run tells."""
    enough = row["smallest_value"] is not None
    reached = _quantity(row, "smallest_value" if enough else "value_to")
    change = f"{_quantity(row, 'value_scene')} to {reached}{'' if enough else ' (not sufficient)'}"
    after, *ends = (row[name] for name in AFTER)
    known = None if None in ends else (ends[0], ends[1])
    after = float("nan") if after is None else after
    lines = [ShareChange(f"{row['key']}\n{change}", row["share_before"], after, known)]
    if row["any_after"] is not None:
        lines.append(ShareChange("any family", row["any_before"], row["any_after"]))
    return lines
