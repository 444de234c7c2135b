"""What a page is made of, and how it becomes HTML: self-contained, every text escaped."""

import base64
import io
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.results.tables import Value, show

LONGEST = 60  # values of a list shown in full
WIDEST = 1440  # pixels of a picture inside a page
SMALL = 150_000  # bytes up to which a PNG is stored as it is


@dataclass(frozen=True, slots=True)
class Text:
    """A text of its own: a paragraph ("text"), or "preformatted" lines."""

    text: str
    kind: str = "text"


@dataclass(frozen=True, slots=True)
class Table:
    """A table; on a narrow screen each row becomes a card that repeats the headings."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Value]]
    kind: ClassVar[str] = "table"

    @staticmethod
    def headings(name: str, **values: str) -> list[str]:
        """Headings of texts.toml; arguments as those of ``note``."""
        return texts("headings")[name].format(**values).split(" | ")

    @classmethod
    def without_empty(cls, heads: Sequence[str], rows: Sequence[Sequence[Value]]) -> "Table":
        """A table without the columns that no row has a value for."""
        full = [j for j in range(len(heads)) if any(row[j] not in ("-", "", None) for row in rows)]
        return cls([heads[j] for j in full], [[row[j] for j in full] for row in rows])


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture with its caption.

    Attributes:
        source: file of the picture, or its bytes.
        caption: the text below it.
        look: "plot", "tall" (higher in print), "half" (two in a row where there is room) or
            "still" (only in print and without scripts).
    """

    source: Path | bytes
    caption: str
    look: str = "plot"
    kind: ClassVar[str] = "picture"


@dataclass(frozen=True, slots=True)
class Special:
    """What the page has a macro of its own for: ``kind`` is its name, ``content`` its argument."""

    kind: str
    content: Any


Block = Text | Table | Picture | Special


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a page: its anchor, its title and what it shows."""

    key: str
    title: str
    blocks: list[Block] = field(default_factory=list)


@cache
def texts(kind: str) -> dict[str, str]:
    """Texts of templates/texts.toml by name.

    Args:
        kind: "captions" of figures, "notes" of sections, "headings" of tables or "statistics".
    """
    path = Path(__file__).with_name("templates") / "texts.toml"
    found = tomllib.loads(path.read_text("utf-8"))[kind]
    return {name: " ".join(text.split()) for name, text in found.items()}


def note(name: str, **values: str) -> Text:
    """A note of texts.toml.

    Args:
        name: of the note.
        **values: what stands in its braces.
    """
    return Text(" ".join(texts("notes")[name].format(**values).split()))


def pairs(content: Mapping[str, Any]) -> list[Block]:
    """A nested mapping as a list of dotted names and values in columns; nothing if it is empty.

    Args:
        content: the mapping; stiffnesses [Pa/m] are shown in the unit of the figures.
    """
    return [Special("pairs", _flatten(content))] if content else []


def _flatten(content: Mapping[str, Any], above: str = "") -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, value in content.items():
        if isinstance(value, Mapping):
            found += _flatten(value, f"{above}{key}.")
        elif key.endswith("_Pa_per_m"):
            name = f"{above}{key.removesuffix('_Pa_per_m')}_N_per_mm3"
            found.append((name, _rounded(1e-9 * value)))
        else:
            found.append((f"{above}{key}", _rounded(value)))
    return found


def _rounded(value: Any) -> str:
    """A value as text; of a long list the first values and their number."""
    if isinstance(value, list):
        text = ", ".join(_rounded(v) for v in value[:LONGEST]) or "none"
        return f"{text}, ... ({len(value)} values)" if len(value) > LONGEST else text
    return f"{value:.6g}" if isinstance(value, float) else str(value)


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


def render(name: str, **content: Any) -> str:
    """A page as text, from one of the package's templates.

    Args:
        name: file of the template.
        **content: what it shows.

    Returns:
        HTML that is well-formed XML too.
    """
    return _environment().get_template(name).render(**content)


@cache
def _environment() -> Environment:
    found = Environment(
        loader=PackageLoader("brake_fenicsx.report"),
        autoescape=select_autoescape(default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters |= {"show": show, "picture": picture, "raw": _uri}
    return found


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
    still.save(small, "WEBP", quality=86, method=2)
    return _uri(small.getvalue())


def _uri(source: Path | bytes, form: str = "webp") -> str:
    """Address of a picture inside a page, as it is."""
    data = source if isinstance(source, bytes) else source.read_bytes()
    return f"data:image/{form};base64,{base64.b64encode(data).decode('ascii')}"
