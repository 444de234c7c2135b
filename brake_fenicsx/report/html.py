"""One self-contained HTML page of a run: opens offline, prints well.

The first screen is in ``verdict``; the sections for who decides on the brake stand here, those on
single parameters and the appendix for specialists in ``sections``.
"""

from pathlib import Path

from brake_fenicsx.extensions import load, shown
from brake_fenicsx.results import answer, tables
from brake_fenicsx.results.run import RunData, read_run

from .figures import figures, make_figures
from .mode_cards import Card, ModePictures, family_card, family_table_cells, often_text, other_cards
from .page_blocks import Block, Picture, Section, Special, Table, Text, note, render, write_page
from .sections import appendix_sections, forces_blocks, input_blocks, rows_of_each, sweep_blocks
from .squeal_figures import squeal_map
from .surface_page import of_surface, surface_sections, surface_verdict
from .verdict import make_verdict

CARDS = 6  # mode shapes before the appendix, beside those of the first screen

FIRST = (
    "verification, pictures and figures are being made: until this page is loaded again they are"
    " missing, or those of an earlier run"
)


def write_report(directory: str | Path | RunData, redraw: bool = True, first: bool = False) -> Path:
    """Write ``directory/report.html`` with all figures and tables of a run inside.

    Args:
        directory: the run directory, or its results already read.
        redraw: draw the figures anew; False takes those in ``directory/figures``.
        first: whether verification, pictures and figures are still to come.

    Returns:
        The path of the page.

    Raises:
        SceneError: the directory holds no result, or a file of it cannot be read.
    """
    run = read_run(directory)
    if redraw:
        make_figures(run)
    return write_page(run.directory / "report.html", render_page(run, first))


def render_page(run: RunData, first: bool = False) -> str:
    """The page as text.

    Args:
        run: the results; pictures are read from its ``figures`` folder.
        first: see ``write_report``.

    Returns:
        HTML that is well-formed XML too; sections without content are left out.
    """
    if of_surface(run):
        what, verdict, cards = "Surface and contact laws", surface_verdict(run), list[Card]()
        sections = surface_sections(run)
    else:
        what, pictures = "Brake squeal study", ModePictures(run)
        verdict = make_verdict(run, pictures)
        cards = _more_cards(run, pictures, {card.key for card in verdict.cards if card.key})
        sections = _main_sections(run, pictures, cards)
    return render(
        "page.html.j2",
        title=f"{what}: {run.summary.get('name') or run.directory.resolve().name}",
        meta=[*_meta(run), *[FIRST] * first],
        verdict=verdict,
        sections=[section for section in sections if section.blocks],
        appendix=[s for s in appendix_sections(run, cards[CARDS:]) if s.blocks],
    )


def _meta(run: RunData) -> list[str]:
    """Date, hash of the scene and version, as the run has recorded them."""
    digest = run.summary.get("scene_sha256")
    version = run.summary.get("versions", {}).get("brake_fenicsx")
    said = [
        str(run.summary.get("finished", "")),
        f"scene {str(digest)[:12]}" if digest else "",
        f"brake_fenicsx {version}" if version else "",
    ]
    return [text for text in said if text]


def _main_sections(run: RunData, pictures: ModePictures, cards: list[Card]) -> list[Section]:
    """All sections before the appendix.

    Args:
        run: the results; figures are read from its ``figures`` folder.
        pictures: pictures of mode shapes.
        cards: those that the first screen does not show.
    """
    # Figures of the scene's section [extensions].
    names = run.summary.get("settings", {}).get("extensions", {}).get("figures", {})
    own = {name: run.directory / "figures" / f"own_{name}.png" for name in names}
    return [
        Section("squeal", "Squeal map", _squeal(run, pictures)),
        Section("shapes", "More mode shapes", _shapes(run, pictures, cards)),
        Section("probability", "Probability of squeal",
                figures(run, "probability_per_band", "unstable_per_sample", look="half")),
        Section("sweep", "Lock-in over the parameter", sweep_blocks(run)),
        Section("inputs", "Which inputs cause it", input_blocks(run)),
        *(
            Section(key, title, [*load(blocks)(run), *figures(run, *extra.figures)])
            for extra in shown(run) for key, title, blocks in (extra.page,) if key
        ),
        Section("own", "Own figures",
                [Picture(path, name) for name, path in own.items() if path.is_file()]),
        Section("drivers", "What drives a mode", figures(run, "drivers", look="tall")),
        Section("pressure", "Contact pressure and forces",
                [*figures(run, "contact_pressure", look="tall"), *forces_blocks(run)]),
    ]  # fmt: skip


def _squeal(run: RunData, pictures: ModePictures) -> list[Block]:
    """The map of all modes, counts of the approaches, the most severe families."""
    found = squeal_map(run, pictures)
    if found is None:
        return []
    rows, named = answer.approach_rows(run), f"squeal modes ({run.criterion})"
    heads = {"squeal_modes": named, "share": "share of squeal samples"}
    table = answer.for_reading(run, rows, "threshold", "most_severe", **heads)
    return [
        note("map", criterion=run.criterion),
        Special("map", found),
        Table(*table),
        note("neutral"),
        *_families(run, pictures),
        *figures(run, "figure9_squeal_map", look="still"),
    ]


def _families(run: RunData, pictures: ModePictures) -> list[Block]:
    """The most severe families of each approach."""
    most = rows_of_each(run)
    rows: list[list[tables.Value]] = [
        [
            run.label(f.approach), "by frequency" if f.key < 0 else f.key, f.kilohertz,
            often_text(f), f.median, f.worst, *family_table_cells(run, f, pictures),
        ]
        for found in run.families.values() for f in found[:most]
    ]  # fmt: skip
    if not rows:
        return []
    heads = Table.headings("families", criterion=run.criterion)
    left = sum(map(len, run.families.values())) - len(rows)
    rest = "family" if left == 1 else "families"
    more = f" {left} less severe {rest}: tables/families.csv." if left else ""
    return [note("families", more=more), Table.without_empty(heads, rows)]


def _more_cards(run: RunData, pictures: ModePictures, shown: set[str]) -> list[Card]:
    """Cards of all pictures that the first screen does not show, the most severe families first."""
    # Of every approach the first, then of every approach the second, ...
    ranked = [(rank, f) for found in run.families.values() for rank, f in enumerate(found)]
    cards = [
        family_card(run, f, pictures)
        for _, f in sorted(ranked, key=lambda place: place[0])
        if (key := pictures.of_family(f)) and key not in shown
    ]
    return cards + other_cards(pictures, shown | {card.key for card in cards})


def _shapes(run: RunData, pictures: ModePictures, cards: list[Card]) -> list[Block]:
    """The first of the cards that the first screen does not show."""
    blocks: list[Block] = []
    if cards:
        left = len(cards) - CARDS
        more = f" {left} more: appendix." if left > 0 else ""
        blocks = [note("shapes", more=more), Special("shapes", cards[:CARDS])]
    calm = [run.label(name) for name, found in run.families.items() if not found]
    if calm and pictures.paths:
        blocks.append(Text(f"No mode of any sample squeals: {', '.join(calm)}."))
    return blocks
