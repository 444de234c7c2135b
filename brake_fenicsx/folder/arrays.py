"""The one opener of files of numbers, our own and foreign ones: archives of arrays, and tables.

A file is parsed and never executed: no pickled objects, no links of HDF5 to other files. It is not
believed about its size: what an array declares is compared with the bytes that are there before
memory is taken, and may be larger than these, where they are compressed, by ``RATIO`` at most.

A table has a heading; its cells are separated by commas, or by semicolons or tabs, beside which
decimals may have commas. Empty lines, and those that begin with #, are left out; what a row lacks
at its end is empty.
"""

from __future__ import annotations

import csv
import io
import math
import mmap
import os
import struct
import zipfile
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import BrakeError, SceneError

from . import log, processes

Arrays = dict[str, np.ndarray[Any, Any]]
Source = Path | IO[bytes]

# Bytes that an array may take whatever is there, and for each byte that is there: measured heights
# are compressed three to twenty times.
SPARE, RATIO = 2**26, 200
CHUNK = 2**20  # bytes read at once
MAPPED = 2**20  # arrays from this size on are mapped [bytes]
HEADER = 2**16  # bytes in which the header of a npy file ends
COPY = "copy it again, or export it once more"
# NumPy gives its own file format no types.
npy: Any = np.lib.format


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
                raise SceneError(f"""{file}: line {line}: more cells than the heading has; write
                    decimals with a point, or semicolons between the cells""")
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


@contextmanager
def reading(
    file: Path | None,
    how: str,
    remedy: str = COPY,
    kind: type[SceneError] = SceneError,
    at: str | None = None,
) -> Iterator[None]:
    """A block that reads a file; whatever it raises becomes one line with file, reader and remedy.

    Args:
        file: the file, which must be one; None where it is open already.
        how: format or reader, "as an npz file" or "by meshio".
        remedy: what to do about a damaged file.
        kind: class of what is raised.
        at: how the line begins; with the file if not given.

    Raises:
        SceneError: of that class: there is no such file, or it cannot be read.
    """
    at = f"{file}: " if at is None else at
    if file is not None and not file.is_file():
        what = "a folder, no file" if file.is_dir() else "a device or pipe, no file"
        raise kind(f"{at}{what if file.exists() else 'no such file'}; give the path of a file")
    try:
        yield
    except BrakeError:
        raise
    # SystemExit: meshio ends the program.
    except (Exception, SystemExit) as error:
        raise kind(f"{at}cannot be read {how} ({why(error)}); {remedy}") from error


def why(error: BaseException) -> str:
    """What an exception of any package says, in one short line."""
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = log.short_line(str(error))
    plain = isinstance(error, ValueError | OSError) and text
    return text if plain else f"{type(error).__name__}{text and ': '}{text}"


def check_size(declared: int, there: int, what: str) -> None:
    """Refuse sizes that a file cannot hold, before memory is taken.

    Args:
        declared: bytes that the file says it needs.
        there: bytes that are there.
        what: what needs them, for the message.

    Raises:
        ValueError: there are too few.
    """
    if declared > max(SPARE, RATIO * there):
        raise ValueError(f"{what} declares {declared} bytes, and {there} are there")


def read_npz(source: Source, keys: Collection[str] | None = None, mapped: bool = False) -> Arrays:
    """Arrays of an npz file; called in a block of ``reading``.

    Args:
        source: the file, or it opened.
        keys: names of the arrays wanted, those that are there; all if None.
        mapped: whether large arrays that are not compressed are mapped into memory and read-only,
            so that the processes of a machine hold them once; ``check_mapped`` looks at their
            checksums.
    """
    out: Arrays = {}
    with zipfile.ZipFile(source) as archive:
        content = _content(archive) if mapped else None
        for entry in archive.infolist():
            name = entry.filename.removesuffix(".npy")
            if keys is not None and name not in keys:
                continue
            check_size(entry.file_size, entry.compress_size, f"array {name!r}")
            if content is not None and _is_mapped(entry):
                start = _start(content, entry)
                stream = io.BytesIO(content[start : start + HEADER])
                shape, turned, dtype = _header(stream, entry.file_size)
                start += stream.tell()
                if start % dtype.alignment == 0:
                    order: Any = "F" if turned else "C"
                    out[name] = np.ndarray(shape, dtype, content, start, order=order)
                    continue
            with archive.open(entry) as member:
                out[name] = _array(member, entry.file_size)
    return out


def npz_names(source: Source) -> list[str]:
    """Names of the arrays of an npz file; called in a block of ``reading``."""
    with zipfile.ZipFile(source) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist()]


def check_mapped(file: Path) -> None:
    """Compare the large arrays of an npz file with their checksums.

    Raises:
        ValueError: an array is not the one that was written.
    """
    with zipfile.ZipFile(file) as archive:
        for entry in filter(_is_mapped, archive.infolist()):
            mapped_member(archive, entry.filename, check=True)


def mapped_member(archive: zipfile.ZipFile, name: str, check: bool) -> memoryview:
    """Bytes of a member of an archive that is not compressed, mapped into memory.

    Args:
        archive: the archive, of a file.
        name: of the member.
        check: whether they are compared with their checksum.

    Raises:
        ValueError: they are not those that were written.
    """
    entry, content = archive.getinfo(name), _content(archive)
    start = _start(content, entry)
    member = memoryview(content)[start : start + entry.file_size]
    if check and zlib.crc32(member) != entry.CRC:
        raise ValueError(f"{name!r} has another checksum")
    return member


def read_npy(file: Path) -> np.ndarray[Any, Any]:
    """The array of a npy file; called in a block of ``reading``."""
    with file.open("rb") as stream:
        return _array(stream, os.fstat(stream.fileno()).st_size)


def read_hdf5(file: Path, names: Sequence[str]) -> Arrays:
    """Data sets of an HDF5 file, those that are there; called in a block of ``reading``."""
    import h5py

    out: Arrays = {}
    with h5py.File(file, "r") as data:
        for name in filter(data.__contains__, names):
            if not isinstance(data.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"{name!r} is a link; store the data set itself")
            numbers = data[name]
            if not isinstance(numbers, h5py.Dataset) or numbers.dtype.kind not in "biufc":
                raise ValueError(f"{name!r} is no data set of numbers")
            if numbers.is_virtual or numbers.external:
                raise ValueError(f"{name!r} lies in other files; store the data set itself")
            check_size(numbers.nbytes, numbers.id.get_storage_size(), f"data set {name!r}")
            out[name] = numbers[()]
    return out


def _array(stream: Any, size: int) -> np.ndarray[Any, Any]:
    """The array of a npy stream of so many bytes."""
    shape, turned, dtype = _header(stream, size)
    flat = np.empty(math.prod(shape), dtype)
    left = flat.view(np.uint8).data if flat.nbytes else memoryview(b"")
    while left:
        if not (part := stream.read(min(CHUNK, len(left)))):
            raise ValueError("cut short")
        left[: len(part)] = part
        left = left[len(part) :]
    stream.read(1)  # at the end of a member of an archive its checksum is looked at
    return flat.reshape(shape, order="F" if turned else "C")


def _header(stream: Any, size: int) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, order and type of the array of a npy stream, all of whose bytes must follow."""
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of the npy format is not known")
    length = stream.read(2 * version[0])
    rest = stream.read(min(int.from_bytes(length, "little"), HEADER))
    shape, turned, dtype = _parsed(version, length + rest)
    if dtype.hasobject:
        raise ValueError("Python objects are not read")
    declared, there = math.prod(shape) * dtype.itemsize, size - stream.tell()
    if declared != there or min(shape, default=0) < 0:
        raise ValueError(f"its header declares {declared} bytes, and {there} follow")
    return shape, turned, dtype


@lru_cache(1024)
def _parsed(version: tuple[int, int], header: bytes) -> tuple[tuple[int, ...], bool, Any]:
    """The same of the header alone: those of samples repeat, and take longer than their arrays."""
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, turned, dtype = read(io.BytesIO(header))
    return shape, turned, dtype


def _content(archive: zipfile.ZipFile) -> mmap.mmap:
    """An archive mapped into memory."""
    content = mmap.mmap(archive.fp.fileno(), 0, access=mmap.ACCESS_READ)  # type: ignore[union-attr]
    processes.mapped_files.add(content)
    return content


def _is_mapped(entry: zipfile.ZipInfo) -> bool:
    return entry.file_size >= MAPPED and entry.compress_type == zipfile.ZIP_STORED


def _start(content: Any, entry: zipfile.ZipInfo) -> int:
    """Where a member of an archive begins, behind its own header, name and extra field."""
    names = struct.unpack_from("<HH", content, entry.header_offset + 26)
    return int(entry.header_offset + 30 + sum(names))
