"""Tables of many rows, written block by block.

They are CSV, and beyond 10^5 rows Parquet where pyarrow is there.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.files import whole_file

MANY = 10**5  # rows of the largest table that is always CSV
GROUP = 2**16  # rows that are written together

# NumPy gives masked arrays no types.
ma: Any = np.ma

Write = Callable[[Mapping[str, NDArray]], None]


def parquet_of(path: Path) -> Path:
    """Where the rows of a CSV table stand if it has many."""
    return path.with_suffix(".parquet")


@contextmanager
def column_writer(path: Path, columns: Sequence[str] = ()) -> Iterator[Write]:
    """A table whose rows are given in parts; it appears whole at the end, or not at all.

    Args:
        path: the CSV file; beside it ``.parquet`` takes its place beyond MANY rows.
        columns: heading of a table without rows.

    Returns:
        What takes columns by name, arrays of equal length, shape (rows,); masked values are empty
        cells. All parts have the same names.
    """
    held: list[Mapping[str, NDArray]] = []
    write: Write | None = None
    with ExitStack() as files:

        def flush() -> None:
            nonlocal write
            rows = sum(map(_rows, held))
            if write is None:
                pyarrow = _pyarrow() if rows > MANY else None
                heading = [*held[0]] if held else [*columns]
                write = files.enter_context(
                    _csv(path, heading) if pyarrow is None else _parquet(path, pyarrow)
                )
            if held:
                write(_together(held))
                held.clear()

        def take(part: Mapping[str, NDArray]) -> None:
            held.append(part)
            if sum(map(_rows, held)) > (MANY if write is None else GROUP):
                flush()

        yield take
        flush()


def write_csv(path: Path) -> Path | None:
    """Write the CSV file of a table that stands in a Parquet file; None where there is none.

    Raises:
        SceneError: pyarrow is not installed, or the file is damaged.
    """
    if not (source := parquet_of(path)).is_file():
        return None
    if (pyarrow := _pyarrow()) is None:
        raise SceneError(f"{source}: needs pyarrow: pip install pyarrow")
    try:
        file = pyarrow.parquet.ParquetFile(source)
        with _csv(path, file.schema_arrow.names) as write:
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


def _rows(part: Mapping[str, NDArray]) -> int:
    return len(next(iter(part.values())))


def _together(parts: Sequence[Mapping[str, NDArray]]) -> Mapping[str, NDArray]:
    return {name: ma.concatenate([p[name] for p in parts]) if _masked(parts[0][name])
            else np.concatenate([p[name] for p in parts]) for name in parts[0]}  # fmt: skip


def _masked(values: Any) -> bool:
    return isinstance(values, ma.MaskedArray)


@contextmanager
def csv_rows(path: Path, heading: Sequence[str]) -> Iterator[Callable[[Iterable[Any]], None]]:
    """What writes rows of a CSV file, which appears whole at the end.

    A float is printed as ``repr`` does, None as an empty cell.
    """
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(heading)
        yield writer.writerows
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def _csv(path: Path, heading: Sequence[str]) -> Iterator[Write]:
    with csv_rows(path, heading) as write:
        yield lambda table: write(zip(*(column.tolist() for column in table.values()), strict=True))


@contextmanager
def _parquet(path: Path, pyarrow: ModuleType) -> Iterator[Write]:
    target: Any = None

    def table(columns: Mapping[str, NDArray]) -> Any:
        arrays = {}
        for name, values in columns.items():
            mask = ma.getmaskarray(values) if _masked(values) else None
            array = pyarrow.array(ma.getdata(values), mask=mask)
            arrays[name] = array.dictionary_encode() if values.dtype.kind == "U" else array
        return pyarrow.table(arrays)

    with whole_file(parquet_of(path)) as part, ExitStack() as files:

        def write(columns: Mapping[str, NDArray]) -> None:
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
