"""The page of an error budget: sentences, one picture, the scene's own numbers and the changes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from brake_fenicsx.report.page_blocks import Table, Text
from brake_fenicsx.results.tables import Value

from .page import (
    Row,
    ShareChange,
    change_of,
    frequency_text,
    interval_of,
    number,
    page_of_changes,
    picture_of,
    share_of,
)

Key = tuple[Value, Value]  # approach and number of a family

OWN = (
    "approach", "family", "samples that squeal", "95 % interval",
    "scatter of the frequency [Hz]", "scatter of the damping",
)  # fmt: skip
HEADS = (
    "setting", "variant", "time [s]", "memory [MB]", "approach", "family",
    "change of the probability (95 % interval)", "samples", "frequency: bias (scatter) [Hz]",
    "damping: bias (scatter)", "order", "limit and its uncertainty", "remark",
)  # fmt: skip


def write_budget_page(directory: Path, rows: Sequence[Row], name: str) -> Path:
    """Write budget.html.

    Args:
        directory: existing folder.
        rows: the budget, with the columns of ``budget.csv``.
        name: of the scene.

    Returns:
        The page.
    """
    scene = [r for r in rows if r["knob"] == "samples"]
    text = (
        "Change of the probability of the family that changes most, by size. Hollow: independent"
        " samples."
    )
    picture, key = None, worst_family(rows)
    if key is not None and (changes := _changes(rows, key)):
        own = _own(rows, key)
        changes.sort(key=lambda r: -abs(number(r["change"])))
        lines = [
            ShareChange(
                f"{str(r['says']).removeprefix('the ')}:\n{r['change_made']}",
                number(r["probability"]), number(r["probability_variant"]), None, interval_of(r),
                r["paired"] == "no",
            ) for r in changes
        ]  # fmt: skip
        picture = picture_of(lines, ("the scene", "the variant"), text, interval_of(own))
    return page_of_changes(
        directory / "budget.html", f"Error budget of {name}", [sentence(rows), not_run(rows)],
        picture,
        [
            Text("The scene itself: how far its number of samples leaves the probabilities open."),
            Table.without_empty(OWN, [_of_scene(r, scene) for r in _telling(scene)]),
            Text("What each change of a setting does to them."),
            Table.without_empty(HEADS, _of_variants(rows)),
        ],
    )  # fmt: skip


def worst_family(rows: Sequence[Row]) -> Key | None:
    """Approach and number of the scene's family whose probability changes most.

    Of approaches with several samples, if there are any; None where no family squeals.
    """
    own = [r for r in rows if r["knob"] == "samples" and r["family"] != "any"]
    own = [r for r in own if number(r["samples"]) > 1] or own

    def size(r: Row) -> tuple[float, float]:
        changes = _changes(rows, (r["approach"], r["family"]))
        most = max((abs(number(c["change"])) for c in changes), default=0.0)
        return most, number(r["probability"])

    worst = max(own, key=size, default=None)
    return None if worst is None else (worst["approach"], worst["family"])


def sentence(rows: Sequence[Row]) -> str:
    """The budget in plain words."""
    key = worst_family(rows)
    if key is None:
        if any(r["knob"] == "samples" and number(r["probability"]) > 0.0 for r in rows):
            return (
                "Modes squeal, but a single sample has no families to compare; give the scene"
                " random inputs or rough contact."
            )
        return "No mode squeals in any sample of the scene."
    family = _own(rows, key)
    p, changes, one = number(family["probability"]), _changes(rows, key), family["samples"] == 1
    hertz = _kilohertz(family, rows)
    if one:
        text = f"The {hertz} kHz family {'squeals' if p else 'does not squeal'} in the one sample; "
    else:
        low, high = (p + number(family[n]) for n in ("change_low", "change_high"))
        text = (
            f"The probability of the {hertz} kHz family is {p:.2f} [{low:.2f}, {high:.2f}] from"
            f" {family['samples']} samples; "
        )
    if not changes:
        return text + "no other uncertainty was computed."
    largest = max(changes, key=lambda r: abs(number(r["change"])))
    if number(largest["change"]) == 0.0:
        text += "no variant that was run changes it"
    else:
        change = "" if one else f": {number(largest['change']):+.2f}"
        text += (
            f"the largest other uncertainty is {largest['says']} ({largest['change_made']}{change})"
        )
        ends = interval_of(largest)
        if ends is not None and ends[0] <= 0.0 <= ends[1]:
            text += f", not significant with {family['samples']} samples"
    text += "."
    arisen = max(
        (r for r in _changes(rows, (key[0], None)) if number(r["change"]) > 0.0),
        key=lambda r: number(r["change"]), default=None,
    )  # fmt: skip
    ends = None if arisen is None else interval_of(arisen)
    if arisen is not None and (one or (ends is not None and ends[0] > 0.0)):
        text += (
            f" A family at {_kilohertz(arisen, rows)} kHz squeals in no sample of the"
            f" scene and in {share_of(arisen['probability_variant'], arisen['samples_variant'])}"
            f" samples after a change of {arisen['says']} ({arisen['change_made']})."
        )
    return text


def not_run(rows: Sequence[Row]) -> str:
    """What was not varied, and why, in one sentence; empty where all was."""
    reasons: dict[str, list[str]] = {}
    for r in rows:
        if r["status"] == "not run":
            name = str(r["says"]) + (f" ({r['change_made']})" if r["change_made"] else "")
            reasons.setdefault(str(r["reason"]), []).append(name)
    said = "; ".join(f"{', '.join(names)}: {why}" for why, names in reasons.items())
    return f"Not varied: {said}." if said else "Every setting was varied."


def _own(rows: Sequence[Row], key: Key) -> Row:
    return next(r for r in rows if r["knob"] == "samples" and (r["approach"], r["family"]) == key)


def _changes(rows: Sequence[Row], key: Key) -> list[Row]:
    """Rows of the variants for one family."""
    return [
        r for r in rows
        if r["status"] == "run" and r["knob"] != "samples" and (r["approach"], r["family"]) == key
    ]  # fmt: skip


def _of_scene(row: Row, rows: Sequence[Row]) -> list[Value]:
    p, ends = number(row["probability"]), interval_of(row)
    return [
        row["approach"], _family(row, rows), share_of(p, row["samples"]),
        None if ends is None else f"{100 * (p + ends[0]):.0f} to {100 * (p + ends[1]):.0f} %",
        _spread(row, "frequency", "_hz"), _spread(row, "damping", ""),
    ]  # fmt: skip


def _of_variants(rows: Sequence[Row]) -> list[list[Value]]:
    """Each variant once, with a line for each family."""
    shown: list[list[Value]] = []
    run = [r for r in rows if r["status"] == "run" and r["knob"] != "samples"]
    for name in dict.fromkeys(r["variant"] for r in run):
        own = _telling([r for r in run if r["variant"] == name])
        about = [own[0][n] for n in ("says", "change_made", "seconds", "memory_mb")]
        for row in own:
            shown.append([*about, row["approach"], *_change_cells(row, run)])
            about = [""] * len(about)
    return shown


def _telling(rows: Sequence[Row]) -> list[Row]:
    """Rows without those of all modes together that say what an approach's only family says."""
    families = [r for r in rows if r["family"] != "any"]
    same = ("approach", "probability", "change", "change_low", "change_high")
    alone = {
        tuple(r[n] for n in same) for r in families
        if sum(f["approach"] == r["approach"] for f in families) == 1
    }  # fmt: skip
    return [r for r in rows if r["family"] != "any" or tuple(r[n] for n in same) not in alone]


def _change_cells(row: Row, rows: Sequence[Row]) -> list[Value]:
    order = [f"{number(row[f'{n}_order']):.2f} ({n})" for n in ("frequency", "damping")
             if row[f"{n}_order"] is not None]  # fmt: skip
    limits = [
        f"{number(row[f'{n}_limit{u}']):.5g} +- {number(row[f'{n}_gci{u}']):.2g}{s}"
        for n, u, s in (("frequency", "_hz", " Hz"), ("damping", "", ""))
        if row[f"{n}_limit{u}"] is not None
    ]
    return [
        _family(row, rows), change_of(row),
        None if row["samples"] == 1 else "the same" if row["paired"] == "yes" else "independent",
        _spread(row, "frequency", "_hz"),
        _spread(row, "damping", ""), ", ".join(order) or None, ", ".join(limits) or None,
        row["reason"],
    ]  # fmt: skip


def _kilohertz(row: Row, rows: Sequence[Row]) -> str:
    """Frequency of a family, with the digits that tell it from others of its approach."""
    own = (r["frequency_hz"] for r in rows if r["approach"] == row["approach"])
    return frequency_text(row["frequency_hz"], own)


def _family(row: Row, rows: Sequence[Row]) -> str:
    if row["family"] == "any":
        return "any"
    return f"{_kilohertz(row, rows)} kHz" + (" (not in the scene)" if row["family"] is None else "")


def _spread(row: Row, name: str, unit: str) -> str | None:
    bias, scatter = row[f"{name}_bias{unit}"], row[f"{name}_scatter{unit}"]
    if bias is None:
        return None if scatter is None else f"{number(scatter):.2g}"
    said = f"{number(bias):+.2g}"
    return said if scatter is None else f"{said} ({number(scatter):.2g})"
