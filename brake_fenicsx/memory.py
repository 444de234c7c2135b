"""Memory that was freed goes back to the system, so that other processes can have it.

SuperLU_DIST, which PETSc loads, tells the C library to keep whatever is freed (mallopt: no mmap, no
trimming). A process then holds its peak to its end, and peaks of several processes add up although
they come at different times.
"""

from __future__ import annotations

import ctypes

_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)


def release_memory() -> None:
    """Return free pages to the system; nothing happens where the C library cannot."""
    if _trim is not None:
        _trim(ctypes.c_size_t(0))
