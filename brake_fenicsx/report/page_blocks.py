"""What a page is made of: paragraphs, tables, pictures, folded parts; the templates lay it out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from brake_fenicsx.results.tables import Value

LONGEST = 60  # values of a list shown in full


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    text: str
    kind: ClassVar[str] = "text"


@dataclass(frozen=True, slots=True)
class Table:
    """A table; on a narrow screen each row becomes a card that repeats the headings."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Value]]
    kind: ClassVar[str] = "table"

    @classmethod
    def without_empty(cls, heads: Sequence[str], rows: Sequence[Sequence[Value]]) -> Table:
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
class Preformatted:
    """Text with its own line ends."""

    text: str
    kind: ClassVar[str] = "preformatted"


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading inside a section."""

    text: str
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True, slots=True)
class Special:
    """What the page has a macro of its own for: ``kind`` is its name, ``content`` its argument."""

    kind: str
    content: Any


Block = Text | Table | Picture | Preformatted | Heading | Special


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a page: its anchor, its title and what it shows."""

    key: str
    title: str
    blocks: list[Block] = field(default_factory=list)


def pairs(what: str, content: Mapping[str, Any], digits: int = 12) -> Table:
    """A nested mapping as a table of dotted names and values.

    Args:
        what: heading of the names.
        content: the mapping.
        digits: significant digits of numbers.
    """
    return Table([what, "value"], [[name, value] for name, value in _flatten(content, digits)])


def _flatten(content: Mapping[str, Any], digits: int, above: str = "") -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, value in content.items():
        name = f"{above}.{key}" if above else str(key)
        if isinstance(value, Mapping):
            found += _flatten(value, digits, name)
        else:
            found.append((name, _rounded(value, digits)))
    return found


def _rounded(value: Any, digits: int) -> str:
    """A value as text; of a long list the first values and their number."""
    if isinstance(value, list):
        text = ", ".join(_rounded(v, digits) for v in value[:LONGEST]) or "none"
        return f"{text}, ... ({len(value)} values)" if len(value) > LONGEST else text
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)
