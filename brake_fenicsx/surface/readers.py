"""Read a scan: npz, HDF5, TrueMap, X3P and tables here; the rest through SurfaceTopography.

What a file says of its size and unit is not corrected: the statistics doubt what looks wrong, with
the remedy (``size``, ``height_unit``; ``topography``). Known traps: NMS files come out
with a lateral size 1e9 too large, and readers of TrueMap files disagree by 1e3 on the heights
(the format stores millimetres).
"""

from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, number, one_of, real
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.folder.arrays import npz_names, read_hdf5, read_npz, reading
from brake_fenicsx.surface.instruments import METRES, Read, read_instrument, read_x3p
from brake_fenicsx.surface.table import ACCEPTED, ENDINGS, HeightTable, read_npy, read_table
from brake_fenicsx.surface.topography import Topography, make_topography

OWN = ("heights", "size", "scale")  # arrays of our own formats
MISSING = np.iinfo(np.int16).min  # value of a missing point in our int16 npz


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
    readers = {
        **dict.fromkeys((".npz", ".h5", ".hdf5"), _read_arrays),
        ".tmd": _read_truemap,
        ".sdf": _read_sdf,
        ".x3p": read_x3p,
    }
    read, kind = readers.get(file.suffix.lower()), ""
    if read is not None:
        heights, sides = read(file, height_unit)
    elif file.suffix.lower() == ".npy" or _is_text(file):
        heights, sides, kind = _read_numbers(file, height_unit, size)
    else:
        heights, sides = read_instrument(file, height_unit, size, channel)
    if channel is not None and (read is not None or kind):
        raise SurfaceError(f"{file}: channel = {channel} has no meaning: the file has no channels")
    if rows == "y":
        if kind not in ("matrix", "columns"):
            raise SurfaceError(f"{file}: rows = 'y' has no meaning: the file itself says it")
        heights, sides = heights.T, None if sides is None else sides[::-1]
    if kind == "columns" and size is not None:
        _check_coordinates(file, sides / float(height_unit or 1.0), size, heights.shape)
    lengths = sides if size is None else size
    if lengths is None:
        raise SurfaceError(f"{file}: the file names no lateral size; give it as 'size'")
    return make_topography(heights, lengths, source=str(file))


def _check_coordinates(file: Path, spans: AnyArray, size: Any, shape: tuple[int, ...]) -> None:
    """Refuse a size that no unit of the coordinates in a file explains."""
    ratio = real("size", size) / spans
    room = 0.01 + 1.0 / min(shape)  # a size may be that from the first to the last point
    fits = [np.allclose(ratio, unit, rtol=room, atol=0.0) for unit in METRES.values()]
    if not any(fits):
        raise SurfaceError(f"""{file}: x and y of the file span {spans[0]:.6g} x {spans[1]:.6g},
            which no unit makes {size[0]:.6g} x {size[1]:.6g} m; correct 'size' or leave it out""")


def _is_text(file: Path) -> bool:
    """Whether a file is a table of text.

    Some instruments give binary files such an ending; Wyko has a format of its own in text.
    """
    if file.suffix.lower() not in ENDINGS:
        return False
    data = file.read_bytes()
    return b"\0" not in data and not data.startswith(b"Wyko ASCII")


def _metres(unit: str | float, source: str) -> float:
    """Length of a height unit [m]."""
    if not isinstance(unit, str):
        return number(f"{source}: height_unit", unit, least=0.0)
    one_of(f"{source}: height_unit", unit, tuple(METRES))
    return METRES[unit]


def _read_arrays(file: Path, unit: float | None) -> Read:
    """Own format, npz or HDF5: ``heights`` (times ``scale`` [m], 1 m if not given), ``size``."""
    npz = file.suffix.lower() == ".npz"
    with reading(file, "as an npz file" if npz else "as an HDF5 file", kind=SurfaceError):
        arrays = (read_npz if npz else read_hdf5)(file, OWN)
    if "heights" not in arrays:
        if not npz:
            return read_instrument(file, unit, None, None)
        found = ", ".join(npz_names(file)) or "nothing"
        raise SurfaceError(f"{file}: no array 'heights' (found: {found})")
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


def _read_numbers(
    file: Path, unit: float | None, size: tuple[float, float] | None
) -> tuple[Array, Any, str]:
    """Heights [m] of .npy and of text, their sides [m] or None, and what gives these.

    Returns:
        "columns" of columns x, y, z, "header" of one that names the sides, x along a row; else
        "matrix".
    """
    table = HeightTable(read_npy(file)) if file.suffix.lower() == ".npy" else read_table(file)
    if unit is None and table.unit is not None:
        unit = _metres(table.unit, f"{file}: the header")
    if unit is None:
        raise SurfaceError(f"""{file}: a table of numbers names no unit of its heights; give
            'height_unit', such as "um" """)
    if table.lengths is not None:
        return table.heights * unit, table.lengths * unit, "columns"
    if table.sides is None:
        return table.heights * unit, None, "matrix"
    unknown = [side for _, side in table.sides if side not in METRES]
    if unknown and size is None:
        raise SurfaceError(f"""{file}: the header names no known unit of the sides ({unknown[0]!r});
            give 'size'""")
    sides = np.array([value * METRES.get(side, np.nan) for value, side in table.sides])
    return table.heights.T * unit, sides, "header"


def _read_sdf(file: Path, unit: float | None) -> Read:
    """Text of ISO 25178-71: a header of NAME = VALUE [m], "*", and heights, x fastest."""
    if file.read_bytes()[:1] != b"a":
        return read_instrument(file, unit, None, None)
    head, _, rest = file.read_text("latin1").partition("*")
    pairs = (line.partition("=") for line in head.splitlines()[1:])
    given = {name.strip().lower(): value.strip() for name, _, value in pairs}
    with reading(file, "as SDF", f"copy it again, or export it as text: {ACCEPTED}", SurfaceError):
        nx, ny = int(given["numpoints"]), int(given["numprofiles"])
        x, y, z = (float(given[f"{axis}scale"]) for axis in "xyz")
        words = rest.partition("*")[0].split()
        heights = np.array([np.nan if word.upper() == "BAD" else float(word) for word in words])
        heights = heights.reshape(ny, nx).T
    return heights * (z if unit is None else unit), np.array([nx * x, ny * y])
