"""Files that appear whole or not at all, whatever ends the program."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import StorageError
from brake_fenicsx.folder.lock import has_ended, process_name

# End of the names of files that are being written, and when one of another machine is left [s].
PART, OLD = ".part", 86400.0
HEADS = 2**18  # bytes in which the line of ``bytes_of_arrays`` ends


@contextmanager
def whole_file(path: Path, durable: bool = False) -> Iterator[Path]:
    """A file beside ``path`` to be written, which takes its place at the end of the block.

    Args:
        path: the file.
        durable: whether it outlives a power cut from then on.

    Raises:
        StorageError: the system refuses it; what was at ``path`` is still there.
    """
    part = path.with_name(f".{path.name}~{process_name()}{PART}")
    try:
        yield part
        if durable:
            _sync(part)
        os.replace(part, path)
        if durable:
            _sync(path.parent)
    except OSError as error:
        why = str(error.strerror or error).replace(str(part), str(path))
        raise StorageError(
            f"{path}: cannot be written ({why}); the same command resumes the run once it can"
        ) from error
    finally:
        part.unlink(missing_ok=True)


def remove_remains(folder: Path) -> None:
    """Remove what processes that ended were writing in a folder; what is written now stays."""
    for part in folder.rglob(f".*{PART}"):
        name = part.name.removesuffix(PART).rpartition("~")[2]
        with suppress(OSError):
            if has_ended(name) or time.time() - part.stat().st_mtime > OLD:
                part.unlink()


def emptied(path: Path) -> None:
    """Remove a file or a folder; of a folder that is a link the link stays, to what is empty then.

    Raises:
        OSError: something cannot be removed.
    """
    if path.is_dir() and path.is_symlink():
        for inner in path.iterdir():
            emptied(inner)
    elif path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disc."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def digest(content: Any) -> str:
    """Hash of plain values: numbers, texts, lists and dictionaries of them."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def bytes_of_arrays(arrays: Mapping[str, np.ndarray[Any, Any]]) -> bytes:
    """Arrays as one line of JSON, which tells their names, types and shapes, and their bytes.

    To read an ``npz`` file of as many small arrays takes ten times as long.
    """
    # So that all of them are aligned.
    order = sorted(arrays, key=lambda name: -arrays[name].dtype.alignment)
    heads = [[name, arrays[name].dtype.str, arrays[name].shape] for name in order]
    line = json.dumps(heads) + "\n"
    # The line is filled up to a multiple of 64 bytes.
    line = line[:-1] + " " * (-len(line) % 64) + "\n"
    return line.encode() + b"".join(arrays[name].tobytes() for name in order)


def arrays_of_bytes(content: bytes | memoryview) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays of ``bytes_of_arrays``, which cannot be written to."""
    line = bytes(content[:HEADS]).partition(b"\n")[0]
    start, out = len(line) + 1, {}
    for name, kind, shape in json.loads(line):
        dtype, size = np.dtype(kind), math.prod(shape)
        out[name] = np.frombuffer(content, dtype, size, start).reshape(shape)
        start += size * dtype.itemsize
    return out
