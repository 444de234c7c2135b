"""Pictures and tables as HTML: every text escaped, pictures inside the page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from brake_fenicsx.tables import Value, show

LONGEST = 60  # values of a list shown in full
SHORT = 28  # characters that are not broken into lines


def image(path: Path, caption: str, kind: str = "plot") -> str:
    """A picture, embedded, with its caption; ``kind`` is its class in the style sheet.

    What is wider than the screen scrolls in a box of its own, not the page.
    """
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    text = escape(caption, quote=True)
    return (
        f'<figure class="{kind}">\n<div class="wide" tabindex="0">'
        f'<img alt="{text}" src="data:image/png;base64,{data}"/></div>\n'
        f"<figcaption>{text}</figcaption>\n</figure>"
    )


def table(heads: Sequence[str], rows: Sequence[Sequence[Value]]) -> str:
    """A table; floats are shown with four digits."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "\n".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return (
        f'<div class="wide" tabindex="0">\n<table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table>\n</div>\n"
    )


def _cell(value: Value) -> str:
    kind = ' class="number"' if isinstance(value, int | float) else ""
    if isinstance(value, str) and value.endswith(" %)"):
        kind = ' class="share"'
    elif isinstance(value, str) and len(value) <= SHORT:
        kind = ' class="short"'
    return f"<td{kind}>{escape(show(value))}</td>"


def pairs(what: str, content: Mapping[str, Any], digits: int | None = None) -> str:
    """A nested mapping as a table of dotted names and values, with every digit if none is given."""
    rows = [[name, value] for name, value in _flatten(content, digits)]
    return table([what, "value"], rows)


def _flatten(
    content: Mapping[str, Any], digits: int | None, above: str = ""
) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, value in content.items():
        name = f"{above}.{key}" if above else str(key)
        if isinstance(value, Mapping):
            found += _flatten(value, digits, name)
        else:
            found.append((name, _exact(value) if digits is None else _rounded(value, digits)))
    return found


def _exact(value: Any) -> str:
    """A value as text, every digit; of a long list the first values and their number."""
    if isinstance(value, list) and len(value) > LONGEST:
        return f"{repr(value[:5])[:-1]}, ...] ({len(value)} values)"
    return value if isinstance(value, str) else repr(value)


def _rounded(value: Any, digits: int) -> str:
    """A value as text; of a long list the first values and their number."""
    if isinstance(value, list):
        text = ", ".join(_rounded(v, digits) for v in value[:LONGEST]) or "none"
        return f"{text}, ... ({len(value)} values)" if len(value) > LONGEST else text
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)
