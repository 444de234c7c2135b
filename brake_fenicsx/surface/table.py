"""Heights in tables: text with any delimiter and header, columns x y z, and .npy.

The delimiter is found: semicolon, tab, comma or blanks. Lines above the numbers are a header; that
of Gwyddion, SPIP or LynceeTec gives the sides and the unit of the heights, whatever the delimiter.
A cell that is empty or says nan, bad, inf or *** is a missing point. Decimal commas are refused.
The delimiters that pandas 2.3 finds are wrong in 5 of 10 such tables: it splits a single column at
a letter of its heading, and takes decimal commas for text.
"""

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brake_fenicsx.arguments import Array, real
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.folder.arrays import read_npy as read_npy_array
from brake_fenicsx.folder.arrays import reading

ACCEPTED = (
    "text is accepted as a matrix of heights or as columns x, y, z on a regular grid, separated by"
    " blanks, tab, comma or semicolon, with decimal points, below any header lines"
)
ENDINGS = (".txt", ".csv", ".tsv", ".dat", ".asc", ".xyz")
_MISSING = re.compile(r"|[+-]?nan|[+-]?inf(inite)?|bad|\*+|-+|n/?a|---", re.I)
_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
# Lines of a header: "# Width: 0.4 mm" of Gwyddion, "x-length = 400" of SPIP, "pixel size=3e-7 m"
# of LynceeTec.
_NUMBER = r"(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?"
_WIDTH, _HEIGHT = r"width|breite|largeur|x-length", r"height|h\u00f6he|hauteur|y-length"
_UNIT = r"value units?|z-unit|werte?-?einheit(?:en)?|unit\u00e9s? (?:des|de) valeurs?"
# Steps between neighbouring coordinates of a grid differ by less than this, relative to the mean.
_EVEN = 0.2


class HeightTable(NamedTuple):
    """Numbers of a text file.

    Attributes:
        heights: in the file's own numbers, shape (rows, columns), of columns x, y, z shape (nx,
            ny); nan where missing.
        lengths: of columns x, y, z, shape (2,); None of a matrix.
        sides: width along a row and height of a header, each a number and its unit; None without.
        unit: of the heights by the header.
    """

    heights: Array
    lengths: Array | None = None
    sides: tuple[tuple[float, str], ...] | None = None
    unit: str | None = None


def delimiter_of(file: Path) -> str | None:
    """Delimiter of a text file's last line; None: blanks."""
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 65536))
        tail = stream.read().decode("utf-8-sig", "replace").strip().splitlines()
    if not tail:
        return None
    line = tail[-1]
    if ";" in line or "\t" in line.strip():
        return ";" if ";" in line else "\t"
    # Commas within numbers that blanks separate are decimal ones.
    return "," if "," in line and not all(map(_COMMA.fullmatch, line.split())) else None


def read_table(file: Path) -> HeightTable:
    """Heights of a text file in its own numbers, and what its header says of them.

    Args:
        file: the file.

    Raises:
        SurfaceError: decimal commas, rows of different lengths, cells that are no numbers, or
            numbers of rows or columns among the heights.
    """
    delimiter = delimiter_of(file)
    with reading(file, "as text", kind=SurfaceError):
        lines = file.read_text("utf-8-sig", "replace").splitlines()
    # Cells are made line by line: as texts they take ten times the file.
    rows = [i for i, line in enumerate(lines, 1) if line.strip()]
    cells = partial(_cells_of, lines, delimiter)
    width = len(cells(rows[-1])) if rows else 0
    # All that is no row of numbers, down to the first that is, is the header.
    table = (k for k, i in enumerate(rows) if len(cells(i)) == width and _numbers(cells(i)))
    start = next(table, None)
    for number in rows[-1:] if start is None else rows[start : start + 1]:
        row = cells(number)
        comma = next((c for c in row if _COMMA.fullmatch(c)), None)
        mixed = delimiter == "," and re.search(r"\d,\d.*,\s", lines[number - 1])
        if comma is not None or mixed:
            raise SurfaceError(f"""{file}: line {number}: decimal commas, as in
                {comma or lines[number - 1][:20]}; export the numbers with decimal points""")
    if start is None:
        raise SurfaceError(f"{file}: no table of numbers; {ACCEPTED}")
    values = np.array([np.array(_row(file, i, cells(i), width)) for i in rows[start:]])
    if values.shape[1] > 1 and np.isnan(values[:, -1]).all():
        values = values[:, :-1]  # every line ends with its delimiter
    if values.shape[1] == 3 and len(values) > 3:
        return HeightTable(*_grid(file, values))
    for name, edge, beside in (
        ("column", values[:, 0], values[:, 1:2].ravel()),
        ("row", values[0], values[1:2].ravel()),
    ):
        if _counts(edge) and not _counts(beside):
            raise SurfaceError(f"""{file}: the first {name} counts {edge[-3]:g}, {edge[-2]:g},
                {edge[-1]:g}: no heights, but numbers of rows or columns; export the heights alone
                (pandas: index=False, header=False)""")
    return _with_header(values, [lines[i - 1] for i in rows[:start]])


def _with_header(values: Array, lines: Sequence[str]) -> HeightTable:
    """A matrix with the sides, if both are there, and the unit of the heights of its header."""
    text = "\n".join(line.strip(' \t#;"') for line in lines)

    def found(names: str, value: str = rf"({_NUMBER})[ \t]*([^\W\d]*)") -> re.Match[str] | None:
        return re.search(rf"^(?:{names})\s*[:=]\s*{value}", text, re.I | re.M)

    sides = []
    for names, axis, count in ((_WIDTH, "x", values.shape[1]), (_HEIGHT, "y", len(values))):
        side, pixel = found(names), found(r"pixel\s+size")
        if side is not None:
            other = found(f"{axis}-unit", r"([^\W\d]+)")
            sides.append((_number(side[1]), side[2] or (other[1] if other else "")))
        elif pixel is not None:
            sides.append((_number(pixel[1]) * count, pixel[2]))
    unit = found(_UNIT, r"([^\W\d]+)")
    factor = re.search(rf"conversion factor \(->\s*(\w+)\)\s*=\s*({_NUMBER})", text, re.I)
    if factor is not None:
        values, unit = values * _number(factor[2]), factor
    return HeightTable(values, None, tuple(sides) if len(sides) == 2 else None, unit and unit[1])


def _number(word: str) -> float:
    """A number of a header, which may have a decimal comma."""
    return float(word.replace(",", "."))


def read_npy(file: Path) -> Array:
    """Heights of a .npy file in its own numbers, shape (rows, columns)."""
    with reading(file, "as a npy file of numbers", kind=SurfaceError):
        return real(f"{file}: heights", read_npy_array(file))


def _counts(edge: Array) -> bool:
    """Whether numbers are equally spaced to the last digit, but for the first, which may lack."""
    steps = np.diff(edge[np.isnan(edge[:1]).sum() :])
    return steps.size > 4 and steps[0] != 0 and bool(np.all(np.abs(np.diff(steps)) < 1e-9))


def _cells_of(lines: Sequence[str], delimiter: str | None, number: int) -> list[str]:
    """Cells of a line by its number."""
    row = lines[number - 1].strip(" \r\n").split(delimiter)
    return [cell.strip().strip('"') for cell in row]


def _numbers(row: Sequence[str]) -> bool:
    """Whether a row holds numbers, missing ones among them."""
    found = False
    for cell in row:
        try:
            float(cell)
            found = True
        except ValueError:
            if not _MISSING.fullmatch(cell):
                return False
    return found


def _row(file: Path, number: int, row: Sequence[str], width: int) -> list[float]:
    if len(row) != width:
        raise SurfaceError(f"{file}: line {number}: {len(row)} numbers, the last line has {width}")
    try:
        return [float(cell) for cell in row]
    except ValueError:
        pass
    for cell in row:
        if not _MISSING.fullmatch(cell) and not _numbers([cell]):
            raise SurfaceError(f"{file}: line {number}: {cell!r} is no number; {ACCEPTED}")
    return [np.nan if _MISSING.fullmatch(cell) else float(cell) for cell in row]


def _grid(file: Path, values: Array) -> tuple[Array, Array]:
    """Heights of columns x, y, z on their grid, whose unlisted points are missing; its lengths."""
    places, lengths = [], []
    for name, column in zip("xy", values[:, :2].T, strict=True):
        unique, place = np.unique(column, return_inverse=True)
        steps = np.diff(unique)
        if unique.size < 2 or steps.max() > (1 + _EVEN) * steps.mean():
            raise SurfaceError(f"""{file}: three columns, and {unique.size} different {name} in the
                first two that lie on no regular grid; {ACCEPTED}""")
        places.append(place)
        lengths.append(float(steps.mean()) * unique.size)
    shape = int(places[0].max()) + 1, int(places[1].max()) + 1
    if shape[0] * shape[1] > 10 * len(values):
        raise SurfaceError(f"{file}: columns x, y, z that fill no grid; {ACCEPTED}")
    heights = np.full(shape, np.nan)
    heights[places[0], places[1]] = values[:, 2]
    return heights, np.array(lengths)
