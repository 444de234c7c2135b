"""Reader of X3P, the container of ISO 25178-72 (ISO 5436-2): heights as numbers of four types.

Releases of SurfaceTopography before 1.27 take the integer types for unsigned and leave out the
offset of the heights, so the format is read here.
"""

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.folder.arrays import reading

TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}


def read_x3p(file: Path, unit: float | None) -> tuple[Array, Array]:
    """Heights [m], shape (nx, ny), nan where missing, and sides [m] of an X3P file.

    Args:
        file: the file.
        unit: length of one unit of the numbers in the file [m], in place of the file's increment.

    Raises:
        SurfaceError: not such a file, or a layout of it that is not a regular grid.
    """
    with reading(file, "as X3P", kind=SurfaceError), zipfile.ZipFile(file) as archive:
        return _read(file, archive, unit)


def _read(file: Path, archive: zipfile.ZipFile, unit: float | None) -> tuple[Array, Array]:
    main = ElementTree.fromstring(archive.read("main.xml"))
    if (kind := _text(main, "Record1/FeatureType")) not in (None, "SUR"):
        raise SurfaceError(
            f"{file}: an X3P of type {kind!r}; a surface on a grid, 'SUR', is needed"
        )
    for axis in ("CX", "CY"):
        if (kind := _text(main, f"Record1/Axes/{axis}/AxisType")) != "I":
            raise SurfaceError(
                f"{file}: axis {axis} of type {kind!r}: its points have no constant distance, which"
                " type 'I' has; export the scan on a regular grid"
            )
    pixel = np.array([_number(main, f"Record1/Axes/{axis}/Increment") for axis in ("CX", "CY")])
    nx, ny, layers = (int(_number(main, f"Record3/MatrixDimension/Size{a}")) for a in "XYZ")
    if layers != 1 or min(nx, ny) < 1:
        raise SurfaceError(f"{file}: {nx} x {ny} x {layers} points; one layer of heights is needed")
    kind, link = _text(main, "Record1/Axes/CZ/DataType"), _text(main, ".//PointDataLink")
    if kind not in TYPES or link is None:
        raise SurfaceError(
            f"{file}: heights of type {kind!r}, or as text: types {', '.join(TYPES)} in a binary"
            " file are read; export the scan so"
        )
    numbers = np.frombuffer(_part(archive, link, nx * ny * np.dtype(TYPES[kind]).itemsize),
                            TYPES[kind], nx * ny).astype(float)  # fmt: skip
    increment, offset = (
        _number(main, f"Record1/Axes/CZ/{name}", given)
        for name, given in (("Increment", 1.0), ("Offset", 0.0))
    )
    heights = numbers * increment + offset if unit is None else numbers * unit
    heights[~np.isfinite(numbers)] = np.nan
    if (bits := _text(main, ".//ValidPointsLink")) and bits in archive.namelist():
        # A bit that is set is a height, the lowest of a byte first.
        packed = np.frombuffer(_part(archive, bits, -(-nx * ny // 8)), np.uint8)
        heights[np.unpackbits(packed, count=nx * ny, bitorder="little") == 0] = np.nan
    return heights.reshape(ny, nx).T, np.asarray(pixel * (nx, ny), float)


def _part(archive: zipfile.ZipFile, name: str, size: int) -> bytes:
    """The first bytes of a file of the archive, which holds so many at least."""
    with archive.open(name) as stream:
        content = stream.read(size)
    if len(content) < size:
        raise ValueError(f"{name} is cut short: {len(content)} of {size} bytes")
    return content


def _text(main: ElementTree.Element, path: str) -> str | None:
    """Text of an element whose name has no namespace, None if there is none."""
    found = main.find(path)
    return None if found is None or not found.text else found.text.strip()


def _number(main: ElementTree.Element, path: str, otherwise: float | None = None) -> float:
    """A number of the description.

    Raises:
        ValueError: it is missing and has no default, or is no number.
    """
    text = _text(main, path)
    if text is None and otherwise is not None:
        return otherwise
    if text is None:
        raise ValueError(f"{path} is missing")
    return float(text)
