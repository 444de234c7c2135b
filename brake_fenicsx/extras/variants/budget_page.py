"""The page of an error budget: sentences, one picture, the scene's own numbers and the changes."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from brake_fenicsx.report.page_blocks import Block, Table, Text
from brake_fenicsx.results.tables import Value

from . import page

Key = tuple[str, int | None]  # approach and number of a family

SCATTER = "scatter of the frequency [Hz]", "scatter of the damping"
OWN = "approach", "family", "samples that squeal", "95 % interval", *SCATTER
HEADS = (
    "setting", "variant", "time [s]", "memory [MB]", "approach", "family",
    "change of the probability (95 % interval)", "samples", "frequency: bias (scatter) [Hz]",
    "damping: bias (scatter)", "order", "limit and its uncertainty", "remark",
)  # fmt: skip
CAPTION = (
    "Change of the probability of the family that changes most, by size. Hollow: independent"
    " samples."
)


def write_budget_page(directory: Path, rows: Sequence[page.Row], name: str) -> Path:
    """Write budget.html.

    Args:
        directory: existing folder.
        rows: the budget, with the columns of ``budget.csv``.
        name: of the scene.

    Returns:
        The page.
    """
    scene, varied = _parts(rows)
    blocks: list[Block] = [
        Text("The scene itself: how far its number of samples leaves the probabilities open."),
        Table.without_empty(OWN, [_of_scene(r, scene) for r in _telling(scene)]),
        Text("What each change of a setting does to them."),
        Table.without_empty(HEADS, _of_variants(varied)),
    ]
    key = worst_family(rows)
    if key is not None and (changes := _of(varied, *key)):
        lines = [
            page.ShareChange(
                f"{r['says'].removeprefix('the ')}:\n{r['change_made']}", r["probability"],
                r["probability_variant"], None, page.interval_of(r), r["paired"] == "no",
            ) for r in sorted(changes, key=lambda r: -abs(r["change"]))
        ]  # fmt: skip
        own = page.interval_of(_of(scene, *key)[0])
        blocks.insert(0, page.picture_of(lines, ("the scene", "the variant"), CAPTION, own))
    intro = sentence(rows), not_run(rows)
    return page.page_of_changes(directory / "budget.html", f"Error budget of {name}", intro, blocks)


def _parts(rows: Sequence[page.Row]) -> tuple[list[page.Row], list[page.Row]]:
    """Rows of the scene itself, and of the variants that were run."""
    run = [r for r in rows if r["status"] == "run"]
    scene = [r for r in run if r["knob"] == "samples"]
    return scene, [r for r in run if r["knob"] != "samples"]


def _of(rows: Sequence[page.Row], approach: str, family: int | None) -> list[page.Row]:
    return [r for r in rows if (r["approach"], r["family"]) == (approach, family)]


def worst_family(rows: Sequence[page.Row]) -> Key | None:
    """Approach and number of the scene's family whose probability changes most.

    Of approaches with several samples, if there are any; None where no family squeals.
    """
    scene, varied = _parts(rows)
    own = [r for r in scene if r["family"] != "any"]
    own = [r for r in own if r["samples"] > 1] or own

    def size(r: page.Row) -> tuple[float, float]:
        changes = _of(varied, r["approach"], r["family"])
        return max((abs(c["change"]) for c in changes), default=0.0), r["probability"]

    worst = max(own, key=size, default=None)
    return None if worst is None else (worst["approach"], worst["family"])


def sentence(rows: Sequence[page.Row]) -> str:
    """The budget in plain words."""
    (scene, varied), key = _parts(rows), worst_family(rows)
    if key is None and any(r["probability"] for r in scene):
        return (
            "Modes squeal, but a single sample has no families to compare; give the scene random"
            " inputs or rough contact."
        )
    if key is None:
        return "No mode squeals in any sample of the scene."
    (family,), changes = _of(scene, *key), _of(varied, *key)
    p, n, name = family["probability"], family["samples"], f"{_kilohertz(family, rows)} kHz family"
    if n == 1:
        text = f"The {name} {'squeals' if p else 'does not squeal'} in the one sample; "
    else:
        ends = f"{p + family['change_low']:.2f}, {p + family['change_high']:.2f}"
        text = f"The probability of the {name} is {p:.2f} [{ends}] from {n} samples; "
    if not changes:
        return text + "no other uncertainty was computed."
    largest = max(changes, key=lambda r: abs(r["change"]))
    if largest["change"] == 0.0:
        text += "no variant that was run changes it"
    else:
        change, of_it = "" if n == 1 else f": {largest['change']:+.2f}", page.interval_of(largest)
        made = f"{largest['says']} ({largest['change_made']}{change})"
        text += f"the largest other uncertainty is {made}"
        if of_it is not None and of_it[0] <= 0.0 <= of_it[1]:
            text += f", not significant with {n} samples"
    # Families that only variants have.
    arisen = max(_of(varied, key[0], None), key=lambda r: r["change"], default=None)
    if arisen is None or arisen["change" if n == 1 else "change_low"] <= 0.0:
        return f"{text}."
    share = page.share_of(arisen["probability_variant"], arisen["samples_variant"])
    return (
        f"{text}. A family at {_kilohertz(arisen, rows)} kHz squeals in no sample of the scene and"
        f" in {share} samples after a change of {arisen['says']} ({arisen['change_made']})."
    )


def not_run(rows: Sequence[page.Row]) -> str:
    """What was not varied, and why, in one sentence; empty where all was."""
    reasons: dict[str, list[str]] = {}
    for r in rows:
        if r["status"] == "not run":
            name = r["says"] + (f" ({r['change_made']})" if r["change_made"] else "")
            reasons.setdefault(r["reason"], []).append(name)
    said = "; ".join(f"{', '.join(names)}: {why}" for why, names in reasons.items())
    return f"Not varied: {said}." if said else "Every setting was varied."


def _of_scene(row: page.Row, rows: Sequence[page.Row]) -> list[Value]:
    p, ends = row["probability"], page.interval_of(row)
    return [
        row["approach"], _family(row, rows), page.share_of(p, row["samples"]),
        None if ends is None else f"{100 * (p + ends[0]):.0f} to {100 * (p + ends[1]):.0f} %",
        _spread(row, "frequency", "_hz"), _spread(row, "damping", ""),
    ]  # fmt: skip


def _of_variants(rows: Sequence[page.Row]) -> list[list[Value]]:
    """Each variant once, with a line for each family."""
    shown: list[list[Value]] = []
    for name in dict.fromkeys(r["variant"] for r in rows):
        own = _telling([r for r in rows if r["variant"] == name])
        about = [own[0][n] for n in ("says", "change_made", "seconds", "memory_mb")]
        for i, row in enumerate(own):
            cells = [row["approach"], *_change_cells(row, rows)]
            shown.append([*(about if i == 0 else [""] * len(about)), *cells])
    return shown


def _telling(rows: Sequence[page.Row]) -> list[page.Row]:
    """Rows without those of all modes together that say what an approach's only family says."""
    families = Counter(r["approach"] for r in rows if r["family"] != "any")
    return [r for r in rows if r["family"] != "any" or families[r["approach"]] != 1]


def _change_cells(row: page.Row, rows: Sequence[page.Row]) -> list[Value]:
    order = [
        f"{row[f'{name}_order']:.2f} ({name})"
        for name in ("frequency", "damping")
        if row[f"{name}_order"] is not None
    ]
    limits = [
        f"{row[f'{name}_limit{unit}']:.5g} +- {row[f'{name}_gci{unit}']:.2g}{said}"
        for name, unit, said in (("frequency", "_hz", " Hz"), ("damping", "", ""))
        if row[f"{name}_limit{unit}"] is not None
    ]
    paired = "the same" if row["paired"] == "yes" else "independent"
    return [
        _family(row, rows), page.change_of(row), None if row["samples"] == 1 else paired,
        _spread(row, "frequency", "_hz"), _spread(row, "damping", ""), ", ".join(order) or None,
        ", ".join(limits) or None, row["reason"],
    ]  # fmt: skip


def _kilohertz(row: page.Row, rows: Sequence[page.Row]) -> str:
    """Frequency of a family, with the digits that tell it from others of its approach."""
    own = (r["frequency_hz"] for r in rows if r["approach"] == row["approach"])
    return page.frequency_text(row["frequency_hz"], own)


def _family(row: page.Row, rows: Sequence[page.Row]) -> str:
    if row["family"] == "any":
        return "any"
    return f"{_kilohertz(row, rows)} kHz" + (" (not in the scene)" if row["family"] is None else "")


def _spread(row: page.Row, name: str, unit: str) -> str | None:
    bias, scatter = row[f"{name}_bias{unit}"], row[f"{name}_scatter{unit}"]
    if bias is None:
        return None if scatter is None else f"{scatter:.2g}"
    return f"{bias:+.2g}" if scatter is None else f"{bias:+.2g} ({scatter:.2g})"
