"""Tables of objects in notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

MOST = 30  # rows that are shown


def html_table(title: str, heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A small table for a notebook; every text is escaped.

    Args:
        title: stands above it.
        heads: headings of the columns.
        rows: cells; numbers are shown with five digits, of many rows the first 30.
    """

    def line(cells: Sequence[Any], tag: str) -> str:
        shown = (f"{cell:.5g}" if isinstance(cell, float) else str(cell) for cell in cells)
        return "<tr>" + "".join(f"<{tag}>{escape(text)}</{tag}>" for text in shown) + "</tr>"

    left = len(rows) - MOST
    more = f"<p>and {left} more</p>" if left > 0 else ""
    body = "".join(line(row, "td") for row in rows[:MOST])
    return f"<p>{escape(title)}</p><table>{line(heads, 'th')}{body}</table>{more}"
