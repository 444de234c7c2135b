"""Templates of the pages: every text escaped, pictures inside the page, files written at once."""

from __future__ import annotations

import base64
import io
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.results.tables import Value, show

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
