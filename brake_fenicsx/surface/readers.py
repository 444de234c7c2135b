"""Read a scan: own readers of npz, HDF5, TrueMap and tables; the rest through SurfaceTopography.

What a file says of its size and unit is checked for plausibility; what looks wrong is logged with
the remedy (``size``, ``height_unit``), never corrected silently. Known traps: NMS files come out
with a lateral size 1e9 too large, and readers of TrueMap files disagree by 1e3 on the heights
(the format stores millimetres).

Points without a height in instrument files whose reader returns a number there.

What marks them is read from the file itself, so that it does not depend on the reader's release:
Wyko OPD: the two largest 16-bit integers; Digital Surf SUR: two steps below the smallest height of
the header; X3P: a file of bits; Keyence ZON: a map of bytes.
"""

from __future__ import annotations

import logging
import struct
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.arguments import number, one_of, real
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.table import ACCEPTED, ENDINGS, delimiter_of, read_npy, read_table
from brake_fenicsx.surface.topography import Topography, make_topography

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# A value this often at the end of the heights, and so much more often than the next, is no height.
MANY, TIMES = 10, 10
logger = logging.getLogger("brake_fenicsx")
METRES = {
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6,
    "nm": 1e-9, "A": 1e-10, "\u00c5": 1e-10, "pm": 1e-12,
}  # fmt: skip
MISSING = np.iinfo(np.int16).min  # value of a missing point in our int16 npz


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
            of = _bits_of_x3p if "main.xml" in archive.namelist() else _bytes_of_zon
            found = of(archive, counts.shape)
    return np.zeros(counts.shape, dtype=bool) if found is None else found


def _bits_of_x3p(archive: zipfile.ZipFile, shape: tuple[int, ...]) -> Mask | None:
    """The bits of the points, the lowest of a byte first; a bit that is set is a height."""
    link = ElementTree.fromstring(archive.read("main.xml")).find(".//ValidPointsLink")
    if link is None or not link.text or link.text not in archive.namelist():
        return None
    bits = np.frombuffer(archive.read(link.text), np.uint8)
    valid = np.unpackbits(bits, count=int(np.prod(shape)), bitorder="little")
    return np.asarray(valid.reshape(shape[::-1]).T == 0)


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


def pile_at_an_end(heights: Array) -> tuple[int, float] | None:
    """Many points at exactly one height that is the highest or the lowest of all.

    Args:
        heights: heights [m], shape (nx, ny); nan where missing.

    Returns:
        How many points, and their height [m]; None if there is no such pile.
    """
    values, many = np.unique(heights[np.isfinite(heights)], return_counts=True)
    if values.size < 3:
        return None
    ends: Any = ((many[0], many[1], values[0]), (many[-1], many[-2], values[-1]))
    for count, beside, value in ends:
        if count >= MANY and count > TIMES * beside:
            return int(count), float(value)
    return None


def read_topography(
    path: str | Path,
    size: tuple[float, float] | None = None,
    height_unit: str | float | None = None,
    channel: int | None = None,
    rows: str = "x",
) -> Topography:
    """Read the scan of a surface.

    Args:
        path: ``.npz`` or ``.h5`` with ``heights`` and ``size``, ``.tmd``, ``.npy``, text (see
            ``table``), or any format that SurfaceTopography reads (Keyence, Olympus, Sensofar,
            Zygo, Wyko, SUR, X3P, ...).
        size: lengths of the scan [m]; replaces what the file says, but for coordinates x and y,
            which must fit it in some unit. Without it they have the unit of the heights.
        height_unit: unit of the numbers in the file, a name (``"um"``) or its length [m];
            replaces what the file says.
        channel: which channel of the file, the file's default if not given.
        rows: what changes from one row of a table to the next: "x", or "y" as in an image. In text
            whose header gives the sides x is the width, along a row.

    Raises:
        SurfaceError: no such file, unknown format, no valid point, or no size.
    """
    file = Path(path)
    if not file.is_file():
        raise SurfaceError(f"{file}: no such file; give the path of a scan")
    if height_unit is not None:
        height_unit = _metres(height_unit, str(file))
    one_of(f"{file}: rows", rows, ("x", "y"))
    readers = {".npz": _read_npz, ".h5": _read_hdf5, ".hdf5": _read_hdf5, ".tmd": _read_truemap}
    read, table = readers.get(file.suffix.lower()), None
    by_rows = read is None and (_is_text(file) or file.suffix.lower() == ".npy")
    if read is not None:
        heights, sides = read(file, height_unit)
    elif (table := _read_numbers(file, height_unit)) is not None:
        heights, sides = table
    else:
        heights, sides = _read_instrument(file, height_unit, size, channel)
        by_rows = by_rows and sides is None
        if by_rows:  # SurfaceTopography takes the columns of text for x
            heights = heights.T
    if channel is not None and (read is not None or table is not None):
        raise SurfaceError(f"{file}: channel = {channel} has no meaning: the file has no channels")
    if rows == "y":
        if not by_rows:
            raise SurfaceError(f"{file}: rows = 'y' has no meaning: the file itself says it")
        heights, sides = heights.T, None if sides is None else sides[::-1]
    if table is not None and sides is not None and size is not None:
        _check_coordinates(file, sides / float(height_unit or 1.0), size, heights.shape)
    lengths = sides if size is None else size
    if lengths is None:
        raise SurfaceError(f"{file}: the file names no lateral size; give it as 'size'")
    topo = make_topography(heights, lengths, source=str(file))
    warnings = implausible(topo)
    for text in warnings:
        logger.warning("%s", text)
    return Topography(topo.heights, topo.size, source=str(file), warnings=warnings)


def _check_coordinates(file: Path, spans: NDArray[Any], size: Any, shape: tuple[int, ...]) -> None:
    """Refuse a size that no unit of the coordinates in a file explains."""
    ratio = real("size", size) / spans
    room = 0.01 + 1.0 / min(shape)  # a size may be that from the first to the last point
    fits = [np.allclose(ratio, unit, rtol=room, atol=0.0) for unit in METRES.values()]
    if not any(fits):
        raise SurfaceError(
            f"{file}: x and y of the file span {spans[0]:.6g} x {spans[1]:.6g}, which no unit makes"
            f" {size[0]:.6g} x {size[1]:.6g} m; correct 'size' or leave it out"
        )


def _is_text(file: Path) -> bool:
    """Whether a file is a table of text: some instruments give binary files such an ending."""
    return file.suffix.lower() in ENDINGS and b"\0" not in file.read_bytes()


def implausible(topo: Topography) -> tuple[str, ...]:
    """What no instrument would deliver of a surface, as one line each with its remedy."""
    doubts = []
    if topo.size.max() > 0.5 or topo.size.min() < 1e-7:
        doubts.append(f"lateral size {topo.size[0]:.3g} x {topo.size[1]:.3g} m; give 'size'")
    ratio = topo.pixel.max() / topo.pixel.min()
    if ratio > 5.0:
        doubts.append(f"pixels {ratio:.3g} times longer than wide; give 'size'")
    low, high = np.nanpercentile(topo.heights, [0.5, 99.5])
    if doubts:  # heights cannot be judged against a size that is wrong
        pass
    elif high - low > topo.size.max():
        doubts.append(f"heights span {high - low:.3g} m, more than the scan; give 'height_unit'")
    elif 0.0 < high - low < 1e-7 * topo.size.min():
        doubts.append(f"heights span {high - low:.3g} m only; give 'height_unit'")
    if (pile := pile_at_an_end(topo.heights)) is not None:
        doubts.append(
            f"{pile[0]} points at exactly {1e6 * pile[1]:.6g} um, an end of the heights: missing"
            " points or a detector at its limit; export the scan with its missing points marked"
        )
    share = float(topo.valid.mean())
    if share < 0.7:
        doubts.append(f"only {share:.0%} of the points are valid")
    return tuple(f"{topo.source}: implausible: {text}" for text in doubts)


def _metres(unit: str | float, source: str) -> float:
    """Length of a height unit [m]."""
    if not isinstance(unit, str):
        return number(f"{source}: height_unit", unit, least=0.0)
    one_of(f"{source}: height_unit", unit, tuple(METRES))
    return METRES[unit]


Read = tuple[NDArray[Any], Any]


def _read_npz(file: Path, unit: float | None) -> Read:
    """Own format: ``heights`` (times ``scale`` [m] if there is one, 1 m if not), ``size`` [m]."""
    try:
        with np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    except (ValueError, OSError) as error:
        raise SurfaceError(f"{file}: not a readable npz file ({error})") from error
    return _from_arrays(file, arrays, unit)


def _read_hdf5(file: Path, unit: float | None) -> Read:
    """Own format in HDF5: data sets ``heights``, ``size`` and ``scale`` as in npz."""
    import h5py

    try:
        with h5py.File(file, "r") as data:
            names = ("heights", "size", "scale")
            arrays = {name: np.asarray(data[name]) for name in names if name in data}
    except OSError as error:
        raise SurfaceError(f"{file}: not a readable HDF5 file ({error})") from error
    if "heights" not in arrays:
        return _read_instrument(file, unit, None, None)
    return _from_arrays(file, arrays, unit)


def _from_arrays(file: Path, arrays: dict[str, NDArray[Any]], unit: float | None) -> Read:
    """Heights [m] and size [m] of the arrays of an npz or HDF5 file."""
    if "heights" not in arrays:
        raise SurfaceError(f"{file}: no array 'heights' (found: {', '.join(arrays) or 'nothing'})")
    raw = arrays["heights"]
    heights = real(f"{file}: heights", raw)
    if raw.dtype == np.int16:
        heights[raw == MISSING] = np.nan
    scale = number(f"{file}: scale", arrays.get("scale", 1.0), least=0.0)
    return heights * (scale if unit is None else unit), arrays.get("size")


def _read_truemap(file: Path, unit: float | None) -> Read:
    """TrueMap: text header, two zero-ended strings, then 2 int32, 4 float32, float32 heights [mm].

    The scan's lengths come first among the four numbers [mm]; rows are y.
    """
    data = file.read_bytes()
    first = data.find(b"\0")
    second = data.find(b"\0", first + 1)
    if not data.startswith(b"Binary TrueMap") or second < 0 or len(data) < second + 25:
        raise SurfaceError(f"{file}: not a TrueMap file")
    nx, ny = (int(n) for n in np.frombuffer(data, "<i4", 2, second + 1))
    lengths = np.frombuffer(data, "<f4", 2, second + 9).astype(float) * 1e-3
    start = second + 25
    if nx < 1 or ny < 1 or len(data) < start + 4 * nx * ny:
        raise SurfaceError(f"{file}: TrueMap file of {nx} x {ny} points is cut short")
    heights = np.frombuffer(data, "<f4", nx * ny, start).reshape(ny, nx).T.astype(float)
    return heights * (1e-3 if unit is None else unit), lengths


def _read_numbers(file: Path, unit: float | None) -> Read | None:
    """Heights [m] of .npy, of text that is not separated by blanks, and of columns x, y, z.

    Returns:
        With the lengths of columns x, y, z [m]. None for a matrix in text with blanks, whose header
        may say its size, and for other files.
    """
    lengths = None
    if file.suffix.lower() == ".npy":
        heights = read_npy(file)
    elif _is_text(file):
        heights, lengths = read_table(file)
        if lengths is None and delimiter_of(file) is None:
            return None
    else:
        return None
    if unit is None:
        raise SurfaceError(
            f"{file}: a table of numbers names no unit of its heights; give 'height_unit', such as"
            ' "um"'
        )
    return heights * unit, None if lengths is None else lengths * unit


def _failed(file: Path, error: Exception) -> SurfaceError:
    """What a reader of SurfaceTopography stumbled over, in one line."""
    text = " ".join(str(error).split())[:80] or type(error).__name__
    return SurfaceError(
        f"{file}: cannot be read ({text}): cut short or damaged, or of a kind that the reader does"
        f" not know; copy it again, or export it as text: {ACCEPTED}"
    )


def _read_instrument(
    file: Path, unit: float | None, size: tuple[float, float] | None, channel: int | None
) -> Read:
    """Everything SurfaceTopography reads."""
    import SurfaceTopography
    from SurfaceTopography.Exceptions import CannotDetectFileFormat

    try:
        reader = SurfaceTopography.open_topography(str(file))
    except CannotDetectFileFormat:
        raise SurfaceError(
            f"{file}: no reader knows this format; export it as text: {ACCEPTED}"
        ) from None
    except Exception as error:
        raise _failed(file, error) from error
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
    try:
        topo = reader.topography(channel_index=index, **settings)
        heights = real("heights", topo.heights())  # A masked array where points are missing.
        heights[missing_points(file, heights / (info.height_scale_factor or 1.0))] = np.nan
    except Exception as error:
        raise _failed(file, error) from error
    length = METRES.get(topo.unit or "")
    if length is None and (size is None or unit is None):
        named = f"its unit {topo.unit!r} is unknown" if topo.unit else "the file names no unit"
        needed = [n for n, v in (("size", size), ("height_unit", unit)) if v is None]
        raise SurfaceError(f"{file}: {named}; give {' and '.join(map(repr, needed))}")
    if unit is not None:
        scale = info.height_scale_factor
        heights = heights / (1.0 if scale is None else scale) * unit
    elif length is not None:
        heights = heights * length
    return heights, None if length is None else np.array(topo.physical_sizes) * length
