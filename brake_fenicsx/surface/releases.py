"""What releases of SurfaceTopography read differently, and what this program does about it.

Seen on files of the instruments with the releases 1.18.2 and 1.27.1 side by side. A release outside
the range is not installed: the same file would give other numbers.
"""

from __future__ import annotations

from typing import NamedTuple

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
