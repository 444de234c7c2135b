"""Sections of the page before its appendix, for who decides on the brake."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from brake_fenicsx.results.answer import approach_rows
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import Family, kilohertz
from brake_fenicsx.results.tables import Value

from .blocks import Block, Picture, Section, Special, Table, Text
from .cycle_figures import cycle_blocks
from .figures import PLOTS
from .mode_cards import Card, ModePictures, family_card, family_table_cells, often_text, other_cards
from .overview import cause_rows, share_text
from .squeal_map import squeal_map

FAMILIES = 8  # rows of the tables of families, at least 2 of each approach
CARDS = 6  # mode shapes before the appendix, beside those of the first screen
NAMED = {plot.name: plot for plot in PLOTS}
JUDGED = {  # figures of what squeals
    "figure9_squeal_map", "squeal_families", "probability_per_band", "unstable_per_sample",
    "convergence", "input_correlations", "sensitivity", "drivers", "sweep_branches",
    "sweep_critical", "sweep_samples", "sweep_chart",
}  # fmt: skip
ROUND_OFF = 1e-6  # relative scatter that is none
FORCES = ("normal_N", "friction_N", "torque_N_m", "effective_radius_mm")


def main_sections(
    run: RunData,
    families: Mapping[str, list[Family]],
    lead: str,
    pictures: ModePictures,
    cards: list[Card],
) -> list[Section]:
    """All sections before the appendix; those without content are left out.

    Args:
        run: the results; pictures are read from its ``figures`` folder.
        families: of each approach, the most severe first.
        lead: approach that the first screen is about.
        pictures: pictures of mode shapes.
        cards: those that the first screen does not show, see `more_cards`.
    """
    sections = [
        Section("squeal", "Squeal map", _squeal(run, families, lead, pictures)),
        Section("shapes", "More mode shapes", _shapes(run, families, pictures, cards)),
        Section("probability", "Probability of squeal", [
            *figures(run, "probability_per_band", "unstable_per_sample", look="half"),
        ]),
        Section("sweep", "Lock-in over the parameter", _sweep(run)),
        Section("inputs", "Which inputs cause it", _inputs(run)),
        Section("loudness", "How loud", [
            *cycle_blocks(run), *figures(run, "limit_cycle_growth", "limit_cycle_loudness"),
        ]),
        Section("drivers", "What drives a mode", figures(run, "drivers", look="tall")),
        Section("pressure", "Contact pressure and forces", [
            *figures(run, "contact_pressure", look="tall"), *forces_blocks(run),
        ]),
    ]  # fmt: skip
    return [section for section in sections if section.blocks]


def figures(run: RunData, *names: str, look: str = "plot") -> list[Block]:
    """Figures of a run that are there, each with its caption.

    Args:
        run: the results.
        names: of the figures.
        look: see `Picture`.
    """
    said = {name: f" Squeal: {run.criterion}." if name in JUDGED else "" for name in names}
    paths = {name: run.directory / "figures" / f"{name}.png" for name in names}
    return [
        Picture(path, NAMED[name].told(run) + said[name], look)
        for name, path in paths.items() if path.is_file()
    ]  # fmt: skip


def rows_of_each(run: RunData) -> int:
    """Rows of each approach in the tables of families."""
    return max(2, FAMILIES // max(len(run.approaches), 1))


def _squeal(
    run: RunData, families: Mapping[str, list[Family]], lead: str, pictures: ModePictures
) -> list[Block]:
    found = squeal_map(run, families, lead, pictures)
    if found is None:
        return []
    return [
        Text(
            "Every point is a complex mode of a sample with the eigenvalue alpha + i omega; its"
            " damping is -2 alpha / |omega|, twice the damping ratio. Negative damping: the mode"
            f" is unstable. It counts as squeal with {run.criterion} (stability.threshold of the"
            " scene). This linear analysis does not predict the amplitude."
        ),
        Special("map", found),
        _approaches(run),
        Text(
            "Neutral: the sign of the growth rate is uncertain within its numerical error, or the"
            " mode is a rigid-body motion. Shares have 95 % Wilson intervals, which describe the"
            " sampling error and not the error of the model."
        ),
        *_families(run, families, pictures),
        *figures(run, "figure9_squeal_map", look="still"),
    ]


def _approaches(run: RunData) -> Table:
    heads = [
        "approach", "samples", "failed", "modes", "unstable modes", "neutral modes",
        f"squeal modes ({run.criterion})", "squeal samples", "share of squeal samples",
    ]  # fmt: skip
    rows = [
        [run.label(str(row[0])), *row[1:6], *row[7:9], share_text(row[9:12])]
        for row in approach_rows(run)
    ]
    return Table(heads, rows)


def _families(
    run: RunData, families: Mapping[str, list[Family]], pictures: ModePictures
) -> list[Block]:
    """The most severe families of each approach."""
    rows: list[list[Value]] = []
    for approach, found in families.items():
        for f in found[: rows_of_each(run)]:
            rows.append([
                run.label(approach), "by frequency" if f.key < 0 else f.key,
                f.kilohertz, often_text(f), f.median, f.worst,
                *family_table_cells(run, f, pictures),
            ])  # fmt: skip
    if not rows:
        return []
    heads = [
        "approach", "family", "frequency [kHz]", f"squeal samples ({run.criterion})",
        "median damping [-]", "lowest damping [-]",
        "moving parts (kinetic energy)", "nodal diameters",
    ]  # fmt: skip
    left = sum(map(len, families.values())) - len(rows)
    rest = "family" if left == 1 else "families"
    more = f" {left} less severe {rest}: tables/families.csv." if left else ""
    note = (
        "A family is the same mode recognised in many samples. Families are ranked by severity:"
        " the share of samples in which the family squeals, times the median of its damping there."
    )
    return [Text(note + more), Table.without_empty(heads, rows)]


def more_cards(
    run: RunData,
    families: Mapping[str, list[Family]],
    pictures: ModePictures,
    shown: set[str],
) -> list[Card]:
    """Cards of all pictures that the first screen does not show, the most severe families first.

    Args:
        run: the results.
        families: of each approach, the most severe first.
        pictures: pictures of mode shapes.
        shown: keys of the pictures on the first screen.
    """
    # Of every approach the first, then of every approach the second, ...
    ranked = sorted(
        ((rank, name) for name, found in families.items() for rank in range(len(found))),
        key=lambda place: place[0],
    )
    chosen = [families[name][rank] for rank, name in ranked]
    cards = [
        family_card(run, f, pictures)
        for f in chosen if (key := pictures.of_family(f)) and key not in shown
    ]  # fmt: skip
    return cards + other_cards(pictures, shown | {card.key for card in cards})


def _shapes(
    run: RunData, families: Mapping[str, list[Family]], pictures: ModePictures,
    cards: list[Card],
) -> list[Block]:  # fmt: skip
    """The first of the cards that the first screen does not show."""
    blocks: list[Block] = []
    if cards:
        left = len(cards) - CARDS
        more = f" {left} more: appendix." if left > 0 else ""
        blocks = [
            Text(
                "Squeal mode of median damping of each of the most severe families, at the"
                " phase of largest motion. Bodies are side by side, the bottom one on the left."
                " Colour: displacement relative to its maximum. Pictures from both sides: figures/."
                f"{more}"
            ),
            Special("shapes", cards[:CARDS]),
        ]
    calm = [run.label(name) for name, found in families.items() if not found]
    if calm and pictures.paths:
        blocks.append(Text(f"No mode of any sample squeals: {', '.join(calm)}."))
    return blocks


def _sweep(run: RunData) -> list[Block]:
    """Branches over the parameter, and where each family begins to squeal."""
    drawn = figures(run, "sweep_branches", "sweep_critical", "sweep_samples", "sweep_chart")
    critical = run.sweep.get("critical")
    if critical is None or not critical["family"].size:
        return drawn
    rows: list[list[Value]] = []
    texts = kilohertz(critical["frequency_hz"].tolist())
    for i, family in enumerate(critical["family"]):
        low, middle, high = (critical[f"value_{p}"][i] for p in (5, 50, 95))
        interval = [critical[f"value_50_{end}"][i] for end in ("low", "high")]
        rows.append([
            "any" if np.isnan(family) else int(family), texts[i],
            int(critical["samples"][i]), int(critical["squeal_samples"][i]),
            *(_censored(v) for v in (low, middle, *interval, high)),
        ])  # fmt: skip
    heads = [
        "family", "frequency [kHz]", "samples", "squeal samples", "5 % squeal by", "50 % squeal by",
        "lower end of its 95 % interval", "upper end", "95 % squeal by",
    ]  # fmt: skip
    note = (
        f"Value of {critical['parameter'][0]} (SI units) at which a family begins to squeal, over"
        " the rough samples. A dash means a value outside the range of the sweep."
    )
    return [*drawn, Text(note), Table(heads, rows)]


def _inputs(run: RunData) -> list[Block]:
    """Which inputs move the growth rate, and the probabilities of the most severe families."""
    rows: list[list[Value]] = [
        [
            run.label(str(row[0])), row[1], share_text(row[2:5]), *row[5:7], row[7] or None,
            interval_text(row[8:11]), *(percent(v) for v in row[11:]),
        ]
        for row in cause_rows(run, rows_of_each(run))
    ]  # fmt: skip
    heads = [
        "approach", "where", f"probability of squeal ({run.criterion})", "median damping [-]",
        "likely to squeal", "strongest input", "rank correlation", "friction", "materials",
        "loads", "rest",
    ]  # fmt: skip
    limit = run.summary.get("in_effect", {}).get("samples", {}).get("limit")
    limit = f"{100 * limit:g} %" if isinstance(limit, int | float) else "the limit of the scene"
    notes = [
        f"Likely to squeal: yes if the 95 % interval of the probability lies above {limit}, open"
        " if it contains that limit."
    ]
    if any(row[5] is not None for row in rows):
        notes.append(
            "Strongest input: the random input with the strongest rank correlation with squeal;"
            " none where all samples or no sample squeal."
        )
    if any(row[7] is not None for row in rows):
        notes.append(
            "Friction, materials, loads: their shares of the variance of the growth rate (sums of"
            " first-order indices). The rest is interactions, and roughness where contact is"
            " rough. Negative shares are sampling error."
        )
    if rows and all(row[5] is None for row in rows):
        notes.append(
            "The scene has no random input, or too few samples to separate their effects; random"
            " inputs are listed in [samples.random], and stability.drivers gives derivatives."
        )
    told: list[Block] = [Text(" ".join(notes)), Table.without_empty(heads, rows)] if rows else []
    return [*figures(run, "sensitivity", "input_correlations"), *told]


def _censored(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"


def interval_text(values: Sequence[Value]) -> str | None:
    """A number with its interval; None without."""
    numbers = [float(v) for v in values if isinstance(v, float)]
    return "{:.2f} ({:.2f} to {:.2f})".format(*numbers) if len(numbers) == 3 else None


def percent(value: Value) -> str | None:
    """A share in per cent, without "-0 %"."""
    return f"{round(100 * value) + 0} %" if isinstance(value, float) else None


def forces_blocks(run: RunData) -> list[Block]:
    """Forces of the braking equilibrium on each pad, means over the samples of an approach."""
    found = run.summary.get("contact_forces")
    if not isinstance(found, Mapping):
        return []
    rows = []
    for approach, pads in found.items():
        for name, pad in pads.items():
            closed = 100 * pad["contact_area_mm2"] / pad["face_area_mm2"]
            lead = pad["leading_half_share"]
            rows.append(
                [
                    run.label(approach), name,
                    *(_with_std(pad, key) for key in FORCES),
                    f"{closed:.1f} %", _with_std(pad, "largest_pressure_MPa"),
                    _with_std(pad, "centre_towards_leading_edge_mm"),
                    "-" if lead is None else f"{100 * lead:.1f} %",
                ]
            )  # fmt: skip
    if not rows:
        return []
    heads = [
        "approach", "pad", "normal force [N]", "friction force [N]", "brake torque [N m]",
        "effective radius [mm]", "face in contact", "largest pressure [MPa]",
        "centre of pressure towards the leading edge [mm]", "force on the leading half",
    ]  # fmt: skip
    turns = any(pad.get("torque_N_m") for pads in found.values() for pad in pads.values())
    less = (
        " Friction force: its resultant, which is less than the friction coefficient times the"
        " normal force, because the direction of friction turns along the pad."
    )
    return [
        Table(heads, rows),
        Text(
            "Means over the samples, with their standard deviation. The disc enters the pad"
            f" at the leading edge.{less if turns else ''} Torque: torque of this pad against the"
            " rotation; effective radius: torque over friction coefficient times normal force."
        ),
    ]


def _with_std(numbers: Mapping[str, Any], name: str) -> str:
    """A mean with its standard deviation, where the scene has the one and samples the other."""
    value, spread = numbers.get(name), numbers.get(f"{name}_std")
    if value is None:
        return "-"
    if spread is None or spread < ROUND_OFF * abs(value):
        return f"{value:.4g}"
    return f"{value:.4g} +- {spread:.2g}"
