"""Tables of a run: fixed columns, exact floats, the same bytes for the same numbers.

A table is made of rows of one dataclass, whose fields are its columns; it writes its CSV file and
gives its columns as arrays and its cells for the page and the terminal. A float is written as
``repr`` writes it, so that reading gives the same number back; an integer has no point and no
exponent; ``None`` is an empty cell. Lines end with a line feed on every system. Tables of many rows
are written block by block, beyond 10^5 rows as Parquet where pyarrow is there.
"""

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Self

import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.display import Shown
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.files import whole_file

Value = str | int | float | None
Columns = Mapping[str, Any]
Write = Callable[[Mapping[str, AnyArray]], None]

JUDGED = "residual", "error_estimate", "condition", "verdict"
MODES = "approach", "sample", "mode", "frequency_hz", "real_1_s", "damping", *JUDGED, "family"
SAMPLES = ("approach", "sample", "status", "seed")
TEXTS = ("approach", "status", "complete", "verdict")  # columns of texts of these two
MANY = 10**5  # rows of the largest table that is always CSV
GROUP = 2**16  # rows that are read together

ma: Any = np.ma  # NumPy gives masked arrays no types


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


class RowTable(Shown):
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
    def of(cls, kind: type[Row], rows: Iterable[Row], without: Sequence[str] = ()) -> "RowTable":
        """A table of rows of one class.

        Args:
            kind: their class.
            rows: the rows.
            without: columns that this table does not have.
        """
        names = [name for name in kind.names() if name not in without]
        cells = ([getattr(row, name) for name in names] for row in rows)
        texts = (f.name for f in fields(kind) if f.type in (str, str | None, "str", "str | None"))
        return cls(names, cells, texts)

    @property
    def columns(self) -> dict[str, AnyArray]:
        """Arrays by name, shape (rows,); an empty cell is nan, or "" among texts."""
        values = zip(*self.cells, strict=True) if self.cells else [()] * len(self.names)
        pairs = zip(self.names, values, strict=True)
        return {name: as_array(column, name in self._texts) for name, column in pairs}

    def _columns(self) -> dict[str, AnyArray]:
        return self.columns

    def write(self, path: str | Path) -> Path:
        """Write the CSV file; returns its path."""
        return write_rows(path, self.names, self.cells)


def as_array(values: Sequence[Value], text: bool = False) -> AnyArray:
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


def rows_of(table: Columns, which: Any) -> Columns:
    """Some rows of a table.

    Args:
        table: its columns.
        which: mask, numbers or slice of the rows; ascending numbers of a table of stored modes.
    """
    stored = getattr(table, "rows_of", None)
    return stored(which) if stored else {name: column[which] for name, column in table.items()}


def text_table(columns: Sequence[str], rows: Iterable[Sequence[Value]]) -> str:
    """Lay a table out for the terminal: text to the left, numbers to the right.

    Args:
        columns: headings.
        rows: cells in the order of the columns; floats are shown with four digits, those in Hz
            with one behind the point.

    Returns:
        Lines joined by line feeds, without one at the end.
    """
    lines, numeric = [[*columns], [""] * len(columns)], [True] * len(columns)
    for row in rows:
        lines.append([""] * len(columns))
        for j, (name, value) in enumerate(zip(columns, row, strict=True)):
            hertz = name.endswith("_hz") and isinstance(value, float)
            lines[-1][j] = f"{value:.1f}" if hertz else show(value)
            numeric[j] &= isinstance(value, int | float | None)
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    lines[1] = ["-" * width for width in widths]
    return "\n".join(
        "  ".join(
            cell.rjust(w) if right else cell.ljust(w)
            for cell, w, right in zip(line, widths, numeric, strict=True)
        ).rstrip()
        for line in lines
    )


def show(value: object, digits: int = 4) -> str:
    """Write one value for a person: floats with ``digits`` significant digits, None as a dash."""
    if value is None:
        return "-"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return f"{float(value):.{digits}g}"
    return str(value)


@contextmanager
def _csv(path: Path, heading: Sequence[str]) -> Iterator[Callable[[Iterable[Any]], None]]:
    """What writes rows of a CSV file, which appears whole at the end.

    A float is printed as ``repr`` does, None as an empty cell.
    """
    with (
        whole_file(path, durable=True) as part,
        part.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(heading)
        yield writer.writerows


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
    with _csv(path, columns) as write:
        write(_cells(f"{path}: row {number}", columns, row) for number, row in enumerate(rows, 1))
    return path


def _cells(
    where: str, columns: Sequence[str], row: Sequence[Value] | Mapping[str, Value]
) -> list[Value]:
    """Values of a row, in the order of the columns, as the writer takes them."""
    if isinstance(row, Mapping):
        if odd := {*row} ^ {*columns}:
            raise ValueError(f"{where}: column {', '.join(sorted(odd))} is missing or unknown")
        row = [row[name] for name in columns]
    if len(row) != len(columns):
        raise ValueError(f"{where}: {len(row)} values for {len(columns)} columns")
    cells = [v.item() if isinstance(v, np.generic) else v for v in row]
    if odd := {type(v).__name__ for v in cells} - {"str", "int", "float", "NoneType"}:
        raise TypeError(f"{where}: a table contains text, int, float or None, not {odd.pop()}")
    return cells


def column_writer(path: Path, columns: Sequence[str], rows: int) -> AbstractContextManager[Write]:
    """A table whose rows are given in parts; it appears whole at the end, or not at all.

    Args:
        path: the CSV file; beside it ``.parquet`` takes its place beyond MANY rows.
        columns: names of the columns.
        rows: number of rows of all parts.

    Returns:
        What takes columns by name, arrays of equal length, shape (rows,); masked values are empty
        cells. All parts have the same names.
    """
    pyarrow = _pyarrow() if rows > MANY else None
    return _csv_columns(path, columns) if pyarrow is None else _parquet(path, pyarrow)


def write_csv(path: Path) -> Path | None:
    """Write the CSV file of a table that stands in a Parquet file; None where there is none.

    Raises:
        SceneError: pyarrow is not installed, or the file is damaged.
    """
    if not (source := path.with_suffix(".parquet")).is_file():
        return None
    if (pyarrow := _pyarrow()) is None:
        raise SceneError(f"{source}: needs pyarrow: pip install pyarrow")
    try:
        file = pyarrow.parquet.ParquetFile(source)
        with _csv_columns(path, file.schema_arrow.names) as write:
            for part in file.iter_batches(GROUP):
                write({name: part.column(name) for name in part.schema.names})
    except pyarrow.lib.ArrowException as error:
        raise SceneError(f"{source}: cannot be read ({error}); run the scene again") from None
    return path


def _pyarrow() -> ModuleType | None:
    try:
        import_module("pyarrow.parquet")
    except ImportError:
        return None
    return import_module("pyarrow")


@contextmanager
def _csv_columns(path: Path, heading: Sequence[str]) -> Iterator[Write]:
    with _csv(path, heading) as write:
        yield lambda table: write(zip(*(column.tolist() for column in table.values()), strict=True))


@contextmanager
def _parquet(path: Path, pyarrow: ModuleType) -> Iterator[Write]:
    def table(columns: Mapping[str, AnyArray]) -> Any:
        arrays = {}
        for name, values in columns.items():
            mask = ma.getmaskarray(values) if isinstance(values, ma.MaskedArray) else None
            array = pyarrow.array(ma.getdata(values), mask=mask)
            arrays[name] = array.dictionary_encode() if values.dtype.kind == "U" else array
        return pyarrow.table(arrays)

    target: Any = None
    with whole_file(path.with_suffix(".parquet")) as part, ExitStack() as files:

        def write(columns: Mapping[str, AnyArray]) -> None:
            nonlocal target
            rows = table(columns)
            if target is None:
                texts = [name for name, v in columns.items() if v.dtype.kind == "U"]
                target = files.enter_context(
                    pyarrow.parquet.ParquetWriter(part, rows.schema, use_dictionary=texts)
                )
            target.write_table(rows)

        yield write
        files.close()
