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


def is_parquet(path: Path) -> bool:
    """Whether the rows of a CSV table are read from a Parquet file."""
    return parquet_of(path).is_file() and (_pyarrow() is not None or not path.is_file())


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


def read_parquet(path: Path) -> ParquetColumns:
    """Columns of a Parquet file.

    Raises:
        SceneError: pyarrow is not installed, or the file is damaged.
    """
    pyarrow = _pyarrow()
    if pyarrow is None:
        raise SceneError(f"{path}: needs pyarrow: pip install pyarrow")
    try:
        return ParquetColumns(path, pyarrow)
    except (pyarrow.lib.ArrowException, OSError) as error:
        raise SceneError(f"{path}: cannot be read ({error}); run the scene again") from None


def write_csv(path: Path) -> Path | None:
    """Write the CSV file of a table that stands in a Parquet file; None where there is none."""
    if not (source := parquet_of(path)).is_file():
        return None
    file = read_parquet(source).file
    with _csv(path, file.schema_arrow.names) as write:
        for part in file.iter_batches(GROUP):
            write({name: part.column(name) for name in part.schema.names})
    return path


class ParquetColumns(Mapping[str, Any]):
    """Columns that are read from the file each time they are asked for: a study has 10^8 cells.

    Texts are pandas categories, whole numbers with empty cells are floats.
    """

    def __init__(self, path: Path, pyarrow: ModuleType):
        self.file = pyarrow.parquet.ParquetFile(path)
        self._pool = pyarrow.default_memory_pool()

    def __getitem__(self, name: str) -> Any:
        if name not in self.file.schema_arrow.names:
            raise KeyError(name)
        kind, about = self.file.schema_arrow.field(name).type, self.file.metadata
        if "dictionary" in str(kind):
            return self.file.read([name]).column(0).to_pandas().array
        place = self.file.schema_arrow.get_field_index(name)
        groups = (about.row_group(i).column(place) for i in range(about.num_row_groups))
        empty = any(group.statistics.null_count for group in groups)
        # Part by part, else there are two copies of it.
        out, start = np.empty(about.num_rows, float if empty else kind.to_pandas_dtype()), 0
        for part in self.file.iter_batches(GROUP, columns=[name]):
            out[start : start + len(part)] = part.column(0).to_numpy(zero_copy_only=False)
            start += len(part)
        self._pool.release_unused()
        return out

    def __iter__(self) -> Iterator[str]:
        return iter(self.file.schema_arrow.names)

    def __len__(self) -> int:
        return len(self.file.schema_arrow.names)


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
