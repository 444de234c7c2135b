"""Sections of the page: those for who decides on the brake, and the appendix for specialists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from brake_fenicsx.extensions import load, shown
from brake_fenicsx.results.accuracy import ErrorRow, SpeedRow, error_rows, speed_rows, stage_rows
from brake_fenicsx.results.answer import approach_rows
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import Family
from brake_fenicsx.results.tables import Row, RowTable, Value

from .figures import figures
from .mode_cards import (
    Card,
    ModePictures,
    family_card,
    family_table_cells,
    heading_of,
    often_text,
    other_cards,
)
from .overview import share_text
from .page_blocks import Block, Heading, Picture, Preformatted, Section, Special, Table, Text, pairs
from .parameter_sections import forces_blocks, input_blocks, rows_of_each, sweep_blocks
from .squeal_map import squeal_map
from .surface_page import law_blocks, of_surface, surface_blocks

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
        *(
            Section(extra.page[0], extra.page[1], [
                *load(extra.page[2])(run), *figures(run, *extra.figures),
            ])
            for extra in shown(run) if extra.page[0]
        ),
        Section("own", "Own figures", _own(run)),
        Section("drivers", "What drives a mode", figures(run, "drivers", look="tall")),
        Section("pressure", "Contact pressure and forces", [
            *figures(run, "contact_pressure", look="tall"), *forces_blocks(run),
        ]),
    ]  # fmt: skip
    return [section for section in sections if section.blocks]


def _own(run: RunData) -> list[Block]:
    """Figures of the scene's section [extensions]."""
    names = run.summary.get("settings", {}).get("extensions", {}).get("figures", {})
    paths = {name: run.directory / "figures" / f"own_{name}.png" for name in names}
    return [Picture(path, name) for name, path in paths.items() if path.is_file()]


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
    rows: list[list[Value]] = [
        [run.label(r.approach), r.samples, r.failed, r.modes, r.unstable_modes, r.neutral_modes,
         r.squeal_modes, r.squeal_samples, share_text(r.share, r.share_low, r.share_high)]
        for r in approach_rows(run)
    ]  # fmt: skip
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
    run: RunData, families: Mapping[str, list[Family]], pictures: ModePictures, shown: set[str]
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


SPEED_HEADS = {
    "seconds_per_equilibrium": "equilibrium [s per sample]",
    "seconds_per_stability": "modes [s per sample]",
}
SHOWN = {  # of the summary, elsewhere on the page
    "settings", "in_effect", "versions", "seeds", "seconds", "peak_memory_mb", "process_memory_mb",
    "name", "warnings", "friction", "contact_forces", "finished", "scene_sha256",
}  # fmt: skip


def appendix_sections(run: RunData, cards: Sequence[Card] = ()) -> list[Section]:
    """Sections for specialists; those without content are left out.

    Args:
        run: the results; pictures are read from its ``figures`` folder.
        cards: mode shapes that are not shown before the appendix.
    """
    meshes = sorted((run.directory / "figures").glob("mesh*.png"))
    own = [] if of_surface(run) else [
        Section("laws", "Contact laws", law_blocks(run)),
        Section("surface", "Surface", surface_blocks(run)),
    ]  # fmt: skip
    sections = [
        Section("more-shapes", "Mode shapes of less severe families", [
            *([Special("shapes", cards)] if cards else []),
        ]),
        Section("driver-maps", "Drivers over the pads", figures(run, "driver_maps")),
        *own,
        Section("samples", "Families and convergence over the samples",
                figures(run, "squeal_families", "convergence")),
        Section("mesh", "Mesh", [Picture(path, heading_of(path)) for path in meshes]),
        Section("accuracy", "Accuracy and computing time", _accuracy(run)),
        Section("settings", "Settings, seeds and versions", _settings(run)),
    ]  # fmt: skip
    return [section for section in sections if section.blocks]


def _accuracy(run: RunData) -> list[Block]:
    blocks: list[Block] = []
    if stages := stage_rows(run.summary):
        rows: list[list[Value]] = [[r.stage, r.seconds, r.peak_memory_mb] for r in stages]
        rows.append(["sum", sum(r.seconds for r in stages if r.seconds is not None), None])
        blocks.append(Table(["stage", "time [s]", "peak memory [MB]"], rows))
        blocks.append(Text(
            "Times of the last run only; stages reused from earlier runs count as zero. Times per"
            " sample are medians over all samples."
        ))  # fmt: skip
    if speed := speed_rows(run):
        blocks.append(_table(run, SpeedRow, speed))
    if errors := error_rows(run):
        blocks.append(_table(run, ErrorRow, errors))
        blocks.append(Text(
            "Errors are relative error estimates of the eigenvalues; the condition number of an"
            " eigenvalue relates them to the backward error: error = backward error x condition."
        ))  # fmt: skip
    rest = {key: value for key, value in run.summary.items() if key not in SHOWN}
    facts: list[Block] = [pairs("quantity", rest, digits=6)] if rest else []
    return [*blocks, *figures(run, "eigenvalue_errors"), *facts]


def _table(run: RunData, kind: type[Row], rows: Sequence[Row]) -> Table:
    """Rows by approach, under the names of their columns."""
    heads = [SPEED_HEADS.get(name, name.replace("_", " ")) for name in kind.names()]
    cells = RowTable.of(kind, rows).cells
    return Table(heads, [[run.label(str(row[0])), *row[1:]] for row in cells])


def _settings(run: RunData) -> list[Block]:
    """Settings once: those in effect, or as the scene writes them where no others are known."""
    blocks: list[Block] = []
    if isinstance(run.summary.get("in_effect"), Mapping):
        blocks += [
            Text("All settings in SI units, with defaults and changes by --set."),
            pairs("setting", run.summary["in_effect"]),
        ]
    elif run.scene is not None:
        blocks.append(Preformatted(run.scene))
    for key in ("seeds", "versions"):
        if isinstance(run.summary.get(key), Mapping):
            blocks += [Heading(key.capitalize()), pairs(key.rstrip("s"), run.summary[key])]
    return blocks
