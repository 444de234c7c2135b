"""One self-contained HTML page of a run: opens offline, prints well, every text escaped."""

from __future__ import annotations

from pathlib import Path

from brake_fenicsx.results.run import RunData, read_run

from .appendix import appendix_sections
from .figures import make_figures
from .mode_cards import ModePictures
from .sections import CARDS, main_sections, more_cards
from .surface_section import of_surface, surface_sections, surface_verdict
from .template import render, write_page
from .verdict import leading_approach, make_verdict


def write_report(directory: str | Path | RunData, redraw: bool = True) -> Path:
    """Write ``directory/report.html`` with all figures and tables of a run inside.

    Args:
        directory: the run directory, or its results already read.
        redraw: draw the figures anew; False takes those in ``directory/figures``.

    Returns:
        The path of the page.

    Raises:
        SceneError: the directory holds no result, or a file of it cannot be read.
    """
    run = read_run(directory)
    if redraw:
        make_figures(run)
    return write_page(run.directory / "report.html", render_page(run))


def render_page(run: RunData) -> str:
    """The page as text.

    Args:
        run: the results; pictures are read from its ``figures`` folder.

    Returns:
        HTML that is well-formed XML too; sections without content are left out.
    """
    if of_surface(run):
        return render(
            "page.html.j2",
            title=f"Surface and contact laws: {_name(run)}",
            meta=_meta(run),
            verdict=surface_verdict(run),
            sections=surface_sections(run),
            appendix=appendix_sections(run),
        )
    found = {name: run.squeal.families(name) for name in run.approaches}
    pictures, lead = ModePictures(run), leading_approach(run)
    verdict = make_verdict(run, found, lead, pictures)
    cards = more_cards(run, found, pictures, {card.key for card in verdict.cards if card.key})
    return render(
        "page.html.j2",
        title=f"Brake squeal study: {_name(run)}",
        meta=_meta(run),
        verdict=verdict,
        sections=main_sections(run, found, lead, pictures, cards),
        appendix=appendix_sections(run, cards[CARDS:]),
    )


def _name(run: RunData) -> str:
    return str(run.summary.get("name") or run.directory.resolve().name)


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
