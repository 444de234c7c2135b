"""Files of instruments: X3P here, others through SurfaceTopography, whose releases differ.

What marks points that were not measured is read from the file itself, so that it does not depend on
the release: Wyko OPD: the two largest 16-bit integers; Digital Surf SUR: two steps below the
smallest height of the header; Keyence ZON: a map of bytes.

The table of formats was seen on files of the instruments with the releases 1.18.2 and 1.27.1 side
by side. A release outside the range is not installed: the same file would give other numbers.

X3P is the container of ISO 25178-72 (ISO 5436-2), with heights as numbers of four types. Releases
of SurfaceTopography before 1.27 take the integer types for unsigned and leave out the offset of the
heights, so the format is read here.
"""

import struct
import zipfile
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Mask, real
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.surface.table import ACCEPTED

Read = tuple[AnyArray, Any]
METRES = {
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6,
    "nm": 1e-9, "A": 1e-10, "\u00c5": 1e-10, "pm": 1e-12,
}  # fmt: skip
LOWEST, BELOW = (1, 18), (1, 22)  # releases of SurfaceTopography that this program works with


class Format(NamedTuple):
    """A format that two releases read differently.

    Attributes:
        now: what 1.18.2 makes of it.
        later: what 1.27.1 makes of it.
        here: what this program does.
        refused: why it is not read without further keys; empty if it is.
    """

    now: str
    later: str
    here: str
    refused: str = ""


_NOT_READ = "is read from release 1.27 on of SurfaceTopography; export it as text or X3P"
FORMATS = {
    ".mi": Format(
        "sides 10^6 too small", "sides as the instrument has them", "asks for the sides",
        "sides that SurfaceTopography may read 10^6 too small; give 'size'",
    ),
    ".mnt": Format("not read", "read", "refuses it", _NOT_READ),
    ".nms": Format("not read", "read", "refuses it", _NOT_READ),
    ".sdf": Format("not read", "read", "reads its text kind itself", _NOT_READ),
    ".x3p": Format("integer heights as unsigned, without offset", "right", "reads it itself"),
    ".frt": Format("rows from the top", "rows from the bottom", "as 1.18.2, mirrored or not"),
    ".stp": Format("rows from the top", "rows from the bottom", "as 1.18.2, mirrored or not"),
    ".tiff": Format("rows from the top", "rows from the bottom", "as 1.18.2, mirrored or not"),
    ".opd": Format("missing points as heights", "missing points marked", "marks them itself"),
    ".sur": Format("missing points as heights", "missing points marked", "marks them itself"),
}  # fmt: skip


def read_instrument(
    file: Path, unit: float | None, size: tuple[float, float] | None, channel: int | None
) -> Read:
    """Everything SurfaceTopography reads."""
    import SurfaceTopography
    from SurfaceTopography.Exceptions import CannotDetectFileFormat

    if refused := _refused(file):
        raise SurfaceError(f"{file}: {refused}")
    if (known := FORMATS.get(file.suffix.lower())) and known.refused and size is None:
        raise SurfaceError(f"{file}: {known.refused}")
    remedy = f"copy it again, or export it as text: {ACCEPTED}"
    trial = partial(reading, file, "by SurfaceTopography", remedy, SurfaceError)
    with trial():
        try:
            reader = SurfaceTopography.open_topography(str(file))
        except CannotDetectFileFormat:
            raise SurfaceError(f"""{file}: no reader knows this format; export it as text:
                {ACCEPTED}""") from None
        channels = reader.channels
        index = reader.default_channel.index if channel is None else channel
    if index not in range(len(channels)):
        raise SurfaceError(f"{file}: channel = {channel!r}, the file has {len(channels)}, from 0")
    info = channels[index]
    if info.dim != 2:
        raise SurfaceError(f"{file}: channel {index} is a line scan; a map is needed")
    settings: dict[str, Any] = {}
    if info.physical_sizes is None:
        if size is None:
            raise SurfaceError(f"{file}: the file names no lateral size; give it as 'size'")
        settings["physical_sizes"] = tuple(size)
    with trial():
        topo = reader.topography(channel_index=index, **settings)
        heights = real("heights", topo.heights())  # A masked array where points are missing.
        scale = info.height_scale_factor or 1.0
        heights[missing_points(file, heights / scale)] = np.nan
    length = METRES.get(topo.unit or "")
    if length is None and (size is None or unit is None):
        named = f"its unit {topo.unit!r} is unknown" if topo.unit else "the file names no unit"
        needed = [n for n, v in (("size", size), ("height_unit", unit)) if v is None]
        raise SurfaceError(f"{file}: {named}; give {' and '.join(map(repr, needed))}")
    if unit is not None:
        heights = heights / scale * unit
    elif length is not None:
        heights = heights * length
    return heights, None if length is None else np.array(topo.physical_sizes) * length


def _refused(file: Path) -> str | None:
    """Why a file of a known format is not read, whatever its reader makes of it."""
    with file.open("rb") as stream:
        head = stream.read(64)
    if head.startswith(b"DIGITAL SURF"):
        # Number of objects and kind of study; 5 is a series of surfaces.
        count, _, kind = struct.unpack_from("<3h", head, 14)
        if count > 1 or kind == 5:
            return f"holds {count} surfaces, of kind {kind}; export one of them"
    return None


def missing_points(file: Path, counts: Array) -> Mask:
    """Points of an instrument file that were not measured.

    Args:
        file: the file.
        counts: heights in the file's own numbers, shape (nx, ny).

    Returns:
        True where there is no height, shape (nx, ny); nowhere for other formats.
    """
    with file.open("rb") as stream:
        head = stream.read(128)
    if head[2:].startswith(b"Directory\0"):
        whole = np.abs(counts - np.rint(counts)) < 1e-2
        return np.asarray(counts > 32765.5) & bool(whole.all())
    if head.startswith(b"DIGITAL SURF"):
        return np.asarray(np.rint(counts) == struct.unpack_from("<i", head, 100)[0] - 2)
    found = None
    if head.startswith((b"PK", b"KPK")):
        with zipfile.ZipFile(file) as archive:
            found = _bytes_of_zon(archive, counts.shape)
    return np.zeros(counts.shape, dtype=bool) if found is None else found


def _bytes_of_zon(archive: zipfile.ZipFile, shape: tuple[int, ...]) -> Mask | None:
    """The first file of one byte per point; it is not zero where there is no height."""
    for name in archive.namelist():
        content = archive.read(name)
        if len(content) < 16:
            continue
        nx, ny, size, row = struct.unpack_from("<4i", content)
        if (nx, ny) == shape and size == 1 and len(content) >= 16 + ny * row:
            flags = np.frombuffer(content, np.uint8, ny * row, 16).reshape(ny, row)
            return np.asarray(flags[:, :nx].T > 0)
    return None


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
        raise SurfaceError(f"""{file}: an X3P of type {kind!r}; a surface on a grid, 'SUR', is
            needed""")
    for axis in ("CX", "CY"):
        if (kind := _text(main, f"Record1/Axes/{axis}/AxisType")) != "I":
            raise SurfaceError(f"""{file}: axis {axis} of type {kind!r}: its points have no constant
                distance, which type 'I' has; export the scan on a regular grid""")
    pixel = np.array([_number(main, f"Record1/Axes/{axis}/Increment") for axis in ("CX", "CY")])
    nx, ny, layers = (int(_number(main, f"Record3/MatrixDimension/Size{a}")) for a in "XYZ")
    if layers != 1 or min(nx, ny) < 1:
        raise SurfaceError(f"{file}: {nx} x {ny} x {layers} points; one layer of heights is needed")
    kind, link = _text(main, "Record1/Axes/CZ/DataType"), _text(main, ".//PointDataLink")
    if kind not in TYPES or link is None:
        raise SurfaceError(f"""{file}: heights of type {kind!r}, or as text: types
            {", ".join(TYPES)} in a binary file are read; export the scan so""")
    content = _part(archive, link, nx * ny * np.dtype(TYPES[kind]).itemsize)
    numbers = np.frombuffer(content, TYPES[kind], nx * ny).astype(float)
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
