"""The page of an error budget: one sentence, one picture, one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brake_fenicsx.results.tables import Value

from .blocks import Block, Picture, Table, Text
from .style import BLACK, BLUE, GREY, drawn, light_grid, new_figure
from .template import render, write_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Value]

HEADS = (
    "knob", "variant", "approach", "family", "probability", "in the variant",
    "change (95 % interval)", "samples", "frequency: bias (scatter) [Hz]",
    "damping: bias (scatter)", "order", "limit and its uncertainty", "time [s]", "memory [MB]",
    "remark",
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
    key = worst_family(rows)
    blocks: list[Block] = [Text(sentence(rows))]
    if key is not None:
        text = (
            "Change of the probability of the family that changes most, with its 95 % interval, by"
            " size; the band is the interval of the scene's own samples. Hollow: independent"
            " samples."
        )
        blocks.append(Picture(drawn(partial(_figure, rows, key)), text))
    blocks.append(Table(HEADS, [_shown(row) for row in rows]))
    page = render(
        "plain.html.j2", title=f"Error budget of {name}", intro=[], blocks=blocks, links=[]
    )
    return write_page(directory / "budget.html", page)


def worst_family(rows: Sequence[Row]) -> tuple[Value, Value] | None:
    """Approach and number of the scene's family whose probability changes most.

    Of approaches with several samples, if there are any; None where no family squeals.
    """
    own = [r for r in rows if r["knob"] == "samples" and r["family"] != "any"]
    own = [r for r in own if _number(r["samples"]) > 1] or own
    if not own:
        return None
    most = {
        (r["approach"], r["family"]): max(
            [abs(_number(c["change"])) for c in _changes(rows, (r["approach"], r["family"]))],
            default=0.0,
        ) for r in own
    }  # fmt: skip
    likely = {(r["approach"], r["family"]): _number(r["probability"]) for r in own}
    return max(most, key=lambda k: (most[k], likely[k]))


def sentence(rows: Sequence[Row]) -> str:
    """The budget in plain words."""
    key = worst_family(rows)
    if key is None:
        squeals = any(r["knob"] == "samples" and _number(r["probability"]) > 0.0 for r in rows)
        if squeals:
            return (
                "Modes squeal, but a single sample has no families to compare; give the scene"
                " random inputs or rough contact."
            )
        return "No mode squeals in any sample of the scene."
    own = _own(rows, key)
    p = _number(own["probability"])
    changes = _changes(rows, key)
    share = f"{p:.2f}"
    if own["change_low"] is not None:
        low, high = (p + _number(own[n]) for n in ("change_low", "change_high"))
        share += f" [{low:.2f}, {high:.2f}]"
    number = f"{own['samples']} samples" if own["samples"] != 1 else "one sample"
    said = (
        f"The probability of the {_number(own['frequency_hz']) / 1e3:.2f} kHz family is {share}"
        f" from {number}; "
    )
    if not changes:
        return said + "no other uncertainty was computed."
    largest = max(changes, key=lambda r: abs(_number(r["change"])))
    change = _number(largest["change"])
    if change == 0.0:
        said += "no variant that was run changes it"
    else:
        said += (
            f"the largest other uncertainty is {largest['says']} ({largest['change_made']}:"
            f" {change:+.2f})"
        )
        if _number(largest["change_low"]) <= 0.0 <= _number(largest["change_high"]):
            said += ", which these samples cannot tell from zero"
    said += "."
    arisen = max(
        (r for r in _changes(rows, (key[0], None)) if _number(r["change_low"]) > 0.0),
        key=lambda r: _number(r["change"]), default=None,
    )  # fmt: skip
    if arisen is not None:
        said += (
            f" A family at {_number(arisen['frequency_hz']) / 1e3:.2f} kHz squeals in no sample of"
            f" the scene and in a share of {_number(arisen['probability_variant']):.2f} after a"
            f" change of {arisen['says']} ({arisen['change_made']})."
        )
    left = len({r["knob"] for r in rows if r["status"] == "not run"})
    return said + (f" {left} knobs have variants that were not run." if left else "")


def _own(rows: Sequence[Row], key: tuple[Value, Value]) -> Row:
    return next(r for r in rows if r["knob"] == "samples" and (r["approach"], r["family"]) == key)


def _changes(rows: Sequence[Row], key: tuple[Value, Value]) -> list[Row]:
    """Rows of the variants for one family."""
    return [
        r for r in rows
        if r["status"] == "run" and r["knob"] != "samples" and (r["approach"], r["family"]) == key
    ]  # fmt: skip


def _shown(row: Row) -> list[Value]:
    if row["status"] != "run":
        left: list[Value] = [row["says"], row["change_made"]]
        return [*left, *[None] * 12, f"not run: {row['reason']}"]
    family, frequency = row["family"], row["frequency_hz"]
    named = "any" if family == "any" else f"{_number(frequency) / 1e3:.2f} kHz"
    if family is None:
        named += " (not in the scene)"
    change = f"{_number(row['change']):+.3f}"
    if row["change_low"] is not None:
        low, high = (_number(row[f"change_{n}"]) for n in ("low", "high"))
        change += f" ({low:+.3f} to {high:+.3f})"
    samples = {"yes": "the same", "no": "independent"}.get(str(row["paired"]))
    order = [f"{_number(row[f'{n}_order']):.2f} ({n})" for n in ("frequency", "damping")
             if row[f"{n}_order"] is not None]  # fmt: skip
    limits = [
        f"{_number(row[f'{n}_limit{u}']):.5g} +- {_number(row[f'{n}_gci{u}']):.2g}{s}"
        for n, u, s in (("frequency", "_hz", " Hz"), ("damping", "", ""))
        if row[f"{n}_limit{u}"] is not None
    ]
    return [
        row["says"], row["change_made"], row["approach"], named,
        *(None if row[n] is None else f"{_number(row[n]):.3f}"
          for n in ("probability", "probability_variant")),
        change, samples,
        _spread(row, "frequency", "_hz"), _spread(row, "damping", ""),
        ", ".join(order) or None, ", ".join(limits) or None, row["seconds"], row["memory_mb"],
        row["reason"],
    ]  # fmt: skip


def _spread(row: Row, name: str, unit: str) -> str | None:
    bias, scatter = row[f"{name}_bias{unit}"], row[f"{name}_scatter{unit}"]
    if bias is None and scatter is None:
        return None
    said = "-" if bias is None else f"{_number(bias):+.2g}"
    return said if scatter is None else f"{said} ({_number(scatter):.2g})"


def _figure(rows: Sequence[Row], key: tuple[Value, Value]) -> Figure:
    """Bars of the changes, the largest on top, over the interval of the samples."""
    changes = sorted(_changes(rows, key), key=lambda r: -abs(_number(r["change"])))
    own = _own(rows, key)
    figure, axes = new_figure(1, 1, height=max(1.8, 0.27 * len(changes) + 1.1))
    axis = axes[0][0]
    axis.axvspan(
        _number(own["change_low"]), _number(own["change_high"]), color=GREY, alpha=0.25, lw=0,
        label=f"95 % interval of {own['samples']} samples",
    )  # fmt: skip
    axis.axvline(0.0, color="black", lw=0.6)
    for y, row in enumerate(changes):
        change = _number(row["change"])
        look: dict[str, Any] = {"color": BLUE}
        if row["paired"] != "yes":
            look = {"facecolor": "white", "edgecolor": BLUE}
        axis.barh(y, change, 0.55, lw=1.0, **look)
        axis.plot(
            [_number(row["change_low"]), _number(row["change_high"])], [y, y], color=BLACK, lw=0.9
        )
    names = [f"{str(r['says']).removeprefix('the ')}: {r['change_made']}" for r in changes]
    axis.set_yticks(range(len(changes)), names)
    axis.invert_yaxis()
    axis.set_xlabel(
        "change of the probability [-]\n"
        f"{_number(own['frequency_hz']) / 1e3:.2f} kHz: {_number(own['probability']):.2f}"
    )
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    light_grid(axis, axis="x")
    return figure


def _number(value: Value) -> float:
    return float("nan") if value is None else float(value)
