"""Points without a height in instrument files whose reader returns a number there.

What marks them is read from the file itself, so that it does not depend on the reader's release:
Wyko OPD: the two largest 16-bit integers; Digital Surf SUR: two steps below the smallest height of
the header; Keyence ZON: a map of bytes.
"""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np

from brake_fenicsx.arguments import Array, Mask


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
