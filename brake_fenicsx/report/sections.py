"""Sections of the page before its appendix, for who decides on the brake."""

from __future__ import annotations

from collections.abc import Mapping

from brake_fenicsx.extras.limit_cycle.cycle_figures import cycle_blocks
from brake_fenicsx.results.answer import approach_rows
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import Family
from brake_fenicsx.results.tables import Value

from .blocks import Block, Section, Special, Table, Text
from .figure_blocks import figures
from .forces_section import forces_blocks
from .mode_cards import Card, ModePictures, family_card, family_table_cells, often_text, other_cards
from .overview import share_text
from .parameter_sections import input_blocks, rows_of_each, sweep_blocks
from .squeal_map import squeal_map

CARDS = 6  # mode shapes before the appendix, beside those of the first screen


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
        Section("sweep", "Lock-in over the parameter", sweep_blocks(run)),
        Section("inputs", "Which inputs cause it", input_blocks(run)),
        Section("loudness", "How loud", [
            *cycle_blocks(run), *figures(run, "limit_cycle_growth", "limit_cycle_loudness"),
        ]),
        Section("drivers", "What drives a mode", figures(run, "drivers", look="tall")),
        Section("pressure", "Contact pressure and forces", [
            *figures(run, "contact_pressure", look="tall"), *forces_blocks(run),
        ]),
    ]  # fmt: skip
    return [section for section in sections if section.blocks]


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
