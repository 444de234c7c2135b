"""The CSV tables of a run: fixed columns, exact floats, the same bytes for the same numbers.

A float is written as ``repr`` writes it, so that reading gives the same number back; an integer has
no point and no exponent; ``None`` is an empty cell. Lines end with a line feed on every system.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError

from .columns import csv_rows, is_parquet, parquet_of, read_parquet

Value = str | int | float | None
Columns = Mapping[str, Any]

MODES = (
    "approach",
    "sample",
    "mode",
    "frequency_hz",
    "real_1_s",
    "damping",
    "residual",
    "error_estimate",
    "condition",
    "verdict",
    "family",
)
SAMPLES = ("approach", "sample", "status", "seed")
CONTACT = (
    "approach",
    "sample",
    "element",
    "x",
    "y",
    "z",
    "area",
    "g",
    "g_cr",
    "p",
    "k",
    "k_vibration",
    "law",
)
TEXT = frozenset(
    {
        "approach",
        "status",
        "verdict",
        "stage",
        "quantity",
        "most_severe",
        "counted_by",
        "complete",
        "kind",
        "parameter",
        "outcome",
    }
)

_PLAIN = {str, int, float, type(None)}
_INTEGER = re.compile(r"[+-]?\d+")


def write_rows(
    path: str | Path,
    columns: Sequence[str],
    rows: Iterable[Sequence[Value] | Mapping[str, Value]],
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


def read_rows(path: str | Path) -> list[dict[str, Value]]:
    """Read a table written by `write_rows`.

    Args:
        path: the CSV file.

    Returns:
        One mapping per row, with text in the columns of names and int, float or None in the others.

    Raises:
        SceneError: the file is missing, has no heading or has a row of another length.
    """
    lines = _lines(Path(path))
    heading = next(lines)
    return [
        {name: _parse(name, cell) for name, cell in zip(heading, row, strict=True)} for row in lines
    ]


def read_columns(path: str | Path, required: Sequence[str] = ()) -> Columns:
    """Read a table as one array per column.

    Args:
        path: the CSV file; a Parquet file beside it is read instead where pyarrow is there.
        required: columns that must be there.

    Returns:
        Arrays of shape (n_rows,) by name, of whole numbers, float64 (None becomes nan) or str; of a
        Parquet file read when they are asked for.

    Raises:
        SceneError: the file or a required column is missing.
    """
    import pandas as pd

    path = Path(path)
    if is_parquet(path):
        table = read_parquet(parquet_of(path))
        _require(parquet_of(path), [*table], required)
        return table
    lines = _lines(path)
    heading = next(lines)
    _require(path, heading, required)
    if not sum(1 for _ in lines):
        return {name: np.empty(0, str if name in TEXT else int) for name in heading}
    numbers = [name for name in heading if name not in TEXT]
    table = pd.read_csv(
        path, dtype=dict.fromkeys(TEXT.intersection(heading), str), keep_default_na=False,
        na_values={name: ["", "nan"] for name in numbers}, float_precision="round_trip",
        low_memory=False,
    )  # fmt: skip
    return {
        name: column.fillna("").to_numpy(str) if column.dtype.kind == "O" else column.to_numpy()
        for name, column in table.items()
    }


def _require(path: Path, heading: Sequence[str], required: Sequence[str]) -> None:
    """Refuse a table that lacks a column."""
    if missing := [name for name in required if name not in heading]:
        raise SceneError(
            f"{path}: column {', '.join(missing)} is missing; the heading is"
            f" {','.join(heading)}: run the scene again to write it"
        )


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


def _lines(path: Path) -> Iterator[list[str]]:
    """The heading, then every row that is not empty, each of the same length."""
    if not path.is_file():
        raise SceneError(f"{path}: no such table; run the scene first")
    if path.stat().st_size:
        with path.open("rb") as raw:
            raw.seek(-1, os.SEEK_END)
            if raw.read() != b"\n":
                raise SceneError(
                    f"{path}: the last line has no end; the file was cut or edited: run the scene"
                    " again"
                )
    with path.open(newline="", encoding="utf-8") as file:
        lines = (row for row in csv.reader(file) if row)
        heading = next(lines, None)
        if heading is None:
            raise SceneError(f"{path}: the table is empty, not even a heading; run the scene again")
        yield heading
        for number, row in enumerate(lines, start=2):
            if len(row) != len(heading):
                raise SceneError(
                    f"{path}: line {number}: {len(row)} cells under {len(heading)} headings; "
                    "the file was cut or edited: run the scene again"
                )
            yield row


def _parse(name: str, cell: str) -> Value:
    if name in TEXT:
        return cell
    if cell == "":
        return None
    if _INTEGER.fullmatch(cell):
        return int(cell)
    try:
        return float(cell)
    except ValueError:
        return cell
