"""One self-contained HTML page of a run: opens offline, prints well, every text escaped."""

from __future__ import annotations

import base64
import io
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.tables import Value, show

from .figures import make_figures
from .mode_cards import ModePictures
from .sections import CARDS, appendix_sections, main_sections, more_cards
from .surface_page import of_surface, surface_sections, surface_verdict
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


WIDEST = 1440  # pixels of a picture inside a page
SMALL = 150_000  # bytes up to which a PNG is stored as it is
SHORT = 28  # characters that are not broken into lines


@cache
def _environment() -> Environment:
    found = Environment(
        loader=PackageLoader("brake_fenicsx.report"),
        autoescape=select_autoescape(default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters |= {"show": show, "cell": _cell, "picture": picture, "raw": _uri}
    return found


def render(name: str, **content: Any) -> str:
    """A page as text, from one of the package's templates.

    Args:
        name: file of the template.
        **content: what it shows.

    Returns:
        HTML that is well-formed XML too.
    """
    return _environment().get_template(name).render(**content)


def write_page(path: Path, text: str) -> Path:
    """Write a page at once: the file appears complete or not at all.

    Args:
        path: the file; replaced if it exists.
        text: its content.

    Returns:
        The path.
    """
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
    return path


def picture(source: Path | bytes, width: int = WIDEST) -> str:
    """Address of a still picture inside a page: a small file as it is, others as WebP.

    Args:
        source: file of the picture, or its bytes.
        width: pixels of its width at most.
    """
    data = source if isinstance(source, bytes) else source.read_bytes()
    if data.startswith(b"\x89PNG") and len(data) <= SMALL and width == WIDEST:
        return _uri(data, "png")
    pillow: Any = import_module("PIL.Image")  # comes with matplotlib
    with pillow.open(io.BytesIO(data)) as drawn:
        still = drawn.convert("RGB")
    if still.width > width:
        still = still.resize((width, round(width * still.height / still.width)), pillow.LANCZOS)
    small = io.BytesIO()
    still.save(small, "WEBP", quality=85, method=4)
    return _uri(small.getvalue())


def _uri(source: Path | bytes, form: str = "webp") -> str:
    """Address of a picture inside a page, as it is."""
    return f"data:image/{form};base64,{_base64(source)}"


def _base64(source: Path | bytes) -> str:
    data = source if isinstance(source, bytes) else source.read_bytes()
    return base64.b64encode(data).decode("ascii")


def _cell(value: Value) -> str:
    """Class of a cell in the style sheet."""
    if isinstance(value, int | float):
        return "number"
    return "short" if isinstance(value, str) and len(value) <= SHORT else ""
