"""Memory that a process gives back to the system.

SuperLU_DIST, which PETSc loads, tells the C library to keep whatever is freed (mallopt: no mmap, no
trimming). A process then holds its peak to its end, and peaks of several processes add up although
they come at different times. Here large blocks get pages of their own again, which go back when
they are freed.
"""

import ctypes
import mmap
from weakref import WeakSet

_trim, _option = (getattr(ctypes.CDLL(None), name, None) for name in ("malloc_trim", "mallopt"))
# Numbers of mallopt's options, and blocks that get pages of their own: those from LARGE bytes on,
# the most that the C library chooses by itself, and so many of them.
MMAP_THRESHOLD, MMAP_MAX, LARGE, BLOCKS = -3, -4, 2**25, 2**16

# Files that are mapped into memory, while anything reads their arrays.
mapped_files: WeakSet[mmap.mmap] = WeakSet()


def release_memory() -> None:
    """Return free pages to the system, and those of mapped files, which are read again on demand.

    Free pages stay where the C library cannot return them.
    """
    for file in mapped_files:
        file.madvise(mmap.MADV_DONTNEED)
    if _trim is not None and _option is not None:
        _option(MMAP_MAX, BLOCKS)
        _option(MMAP_THRESHOLD, LARGE)
        _trim(ctypes.c_size_t(0))
