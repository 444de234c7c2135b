"""Tables of a run: fixed columns, exact floats, the same bytes for the same numbers.

A table is made of rows of one dataclass, whose fields are its columns; it writes its CSV file and
gives its columns as arrays and its cells for the page and the terminal. A float is written as
``repr`` writes it, so that reading gives the same number back; an integer has no point and no
exponent; ``None`` is an empty cell. Lines end with a line feed on every system.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .columns import csv_rows

Value = str | int | float | None
Columns = Mapping[str, Any]

MODES = (
    "approach", "sample", "mode", "frequency_hz", "real_1_s", "damping", "residual",
    "error_estimate", "condition", "verdict", "family",
)  # fmt: skip
SAMPLES = ("approach", "sample", "status", "seed")
TEXTS = ("approach", "status", "complete", "verdict")  # columns of texts of these two

_PLAIN = {str, int, float, type(None)}


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table; the fields of a subclass are its columns."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(f.name for f in fields(cls))

    @classmethod
    def of(cls, *cells: Any) -> Self:
        """A row of the values of its columns."""
        return cls(*cells)  # type: ignore[call-arg, unused-ignore]


class RowTable:
    """Rows of one kind.

    Attributes:
        names: names of the columns.
        cells: values of each row, in the order of the columns.
    """

    def __init__(
        self, names: Sequence[str], cells: Iterable[Sequence[Value]], texts: Iterable[str] = ()
    ):
        """Collect the rows of a table whose columns depend on the scene.

        Args:
            names: names of the columns.
            cells: values of each row.
            texts: columns of texts, which an empty table does not tell.
        """
        self.names, self.cells = tuple(names), [[*row] for row in cells]
        self._texts = frozenset(texts)

    @classmethod
    def of(cls, kind: type[Row], rows: Iterable[Row], without: Sequence[str] = ()) -> RowTable:
        """A table of rows of one class.

        Args:
            kind: their class.
            rows: the rows.
            without: columns that this table does not have.
        """
        names = [name for name in kind.names() if name not in without]
        cells = ([getattr(row, name) for name in names] for row in rows)
        return cls(names, cells, (f.name for f in fields(kind) if str(f.type).startswith("str")))

    @property
    def columns(self) -> dict[str, NDArray]:
        """Arrays by name, shape (rows,); an empty cell is nan, or "" among texts."""
        values = zip(*self.cells, strict=True) if self.cells else [()] * len(self.names)
        pairs = zip(self.names, values, strict=True)
        return {name: as_array(own, name in self._texts) for name, own in pairs}

    def write(self, path: str | Path) -> Path:
        """Write the CSV file; returns its path."""
        return write_rows(path, self.names, self.cells)


def as_array(values: Sequence[Value], text: bool = False) -> NDArray:
    """Values of a column as an array, shape (rows,).

    Args:
        values: of the rows; None of an empty cell becomes nan, or "" among texts.
        text: whether the column is one of texts, which its values do not tell if there are none.
    """
    if text or any(isinstance(v, str) for v in values):
        return np.array(["" if v is None else str(v) for v in values], dtype=str)
    whole = bool(values) and all(isinstance(v, int) for v in values)
    kind = np.uint64 if whole and max(values) >= 2**63 else None  # type: ignore[type-var, operator]
    return np.array([np.nan if v is None else v for v in values], kind)


def write_rows(
    path: str | Path, columns: Sequence[str], rows: Iterable[Sequence[Value] | Mapping[str, Value]]
) -> Path:
    """Write a table at once: the file appears complete or not at all.

    Args:
        path: the CSV file; replaced if it exists.
        columns: names of the columns, in order.
        rows: one sequence per row in the order of the columns, or one mapping with just these keys.

    Returns:
        The path written.
    """
    path = Path(path)
    with csv_rows(path, columns) as write:
        write(_cells(path, columns, row, number) for number, row in enumerate(rows, start=1))
    return path


def rows_of(table: Columns, which: Any) -> Columns:
    """Some rows of a table.

    Args:
        table: its columns.
        which: mask, numbers or slice of the rows.
    """
    return {name: column[which] for name, column in table.items()}


def text_table(columns: Sequence[str], rows: Iterable[Sequence[Value]]) -> str:
    """Lay a table out for the terminal: text to the left, numbers to the right.

    Args:
        columns: headings.
        rows: cells in the order of the columns; floats are shown with four digits, those in Hz
            with one behind the point.

    Returns:
        Lines joined by line feeds, without one at the end.
    """
    body = [list(row) for row in rows]
    shown = [
        [f"{cell:.1f}" if name.endswith("_hz") and isinstance(cell, float) else show(cell)
         for cell, name in zip(row, columns, strict=True)]
        for row in body
    ]  # fmt: skip
    widths = [max([len(c), *(len(r[j]) for r in shown)]) for j, c in enumerate(columns)]
    numeric = [all(isinstance(r[j], int | float | None) for r in body) for j in range(len(columns))]

    def line(cells: Sequence[str]) -> str:
        pairs = zip(cells, widths, numeric, strict=True)
        return "  ".join(c.rjust(w) if right else c.ljust(w) for c, w, right in pairs).rstrip()

    return "\n".join([line(columns), line(["-" * w for w in widths]), *map(line, shown)])


def show(value: object, digits: int = 4) -> str:
    """Write one value for a person: floats with ``digits`` significant digits, None as a dash."""
    if value is None:
        return "-"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return f"{float(value):.{digits}g}"
    return str(value)


def _cells(
    path: Path, columns: Sequence[str], row: Sequence[Value] | Mapping[str, Value], number: int
) -> Sequence[Value]:
    if isinstance(row, Mapping):
        if set(row) != set(columns):
            odd = sorted(set(row) ^ set(columns))
            raise ValueError(f"{path}: row {number}: column {', '.join(odd)} is missing or unknown")
        row = [row[name] for name in columns]
    if len(row) != len(columns):
        raise ValueError(f"{path}: row {number}: {len(row)} values for {len(columns)} columns")
    # The writer itself prints these as `_format` does.
    return row if _PLAIN.issuperset(map(type, row)) else [_format(value) for value in row]


def _format(value: Value | np.generic) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return str(value)
    if isinstance(value, bool | np.bool_):
        raise TypeError("a truth value has no place in a table: write 0 or 1")
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return repr(float(value))
    raise TypeError(f"a table contains text, int, float or None, not {type(value).__name__}")
