"""The one reader of tables with a heading: CSV files, and what spreadsheets write in their place.

Cells are separated by commas, or by semicolons or tabs, beside which decimals may have commas.
Empty lines, and those that begin with #, are left out; what a row lacks at its end is empty.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError

from .arrays import reading


@dataclass(frozen=True, slots=True)
class TextTable:
    """Cells of a table, as texts.

    Attributes:
        source: the file, or what else stands in messages.
        heading: names of the columns.
        rows: cells below it, as many in each row.
        lines: number of each row in the file, as editors count.
        decimal: sign between whole numbers and decimals.
    """

    source: Path
    heading: Sequence[str]
    rows: Sequence[Sequence[str]]
    lines: Sequence[int]
    decimal: str = "."

    @classmethod
    def read(cls, file: Path) -> TextTable:
        """Read a file.

        Raises:
            SceneError: file, line and remedy: no text, no row, a heading twice, or a row with more
                cells than the heading has.
        """
        with reading(file, "as a table"):
            text = file.read_text("utf-8-sig").splitlines()
        lines = [i for i, line in enumerate(text, 1) if line.strip() and line.lstrip()[0] != "#"]
        shown = [text[i - 1] for i in lines]
        delimiter = next((c for c in ";\t" if shown and c in shown[0]), ",")
        heading, *rows = [
            [cell.strip() for cell in row] for row in csv.reader(shown, delimiter=delimiter)
        ] or [[]]
        if not rows or len({*heading}) < len(heading):
            what = "has a heading twice" if rows else "contains no line of values below a heading"
            raise SceneError(f"{file}: {what}; write one heading, and a line for each row below it")
        for line, row in zip(lines[1:], rows, strict=True):
            if len(row) > len(heading):
                raise SceneError(
                    f"{file}: line {line}: more cells than the heading has; write decimals with a"
                    " point, or semicolons between the cells"
                )
            row += [""] * (len(heading) - len(row))
        return cls(file, heading, rows, lines[1:], "." if delimiter == "," else ",")

    def texts(self, name: str) -> list[str]:
        """Cells of the column ``name``; empty ones where there is none."""
        k = self.heading.index(name) if name in self.heading else None
        return ["" if k is None else row[k] for row in self.rows]

    def numbers(self, name: str, optional: bool = False, positive: bool = False) -> Array:
        """Finite numbers of a column, shape (rows,).

        Args:
            name: its heading.
            optional: whether cells may be empty, which makes nan.
            positive: whether other numbers are refused.

        Raises:
            SceneError: file, line, heading and cell of what is no such number.
        """
        out = np.full(len(self.rows), np.nan)
        for i, cell in enumerate(self.texts(name)):
            if cell or not optional:
                with suppress(ValueError):
                    out[i] = float(cell.replace(self.decimal, "."))
                if not np.isfinite(out[i]) or (positive and out[i] <= 0):
                    where = f"{self.source}: line {self.lines[i]}: {name} = {cell!r}"
                    raise SceneError(f"{where}: write a {'positive ' * positive}number")
        return out
