"""Files that appear whole or not at all, whatever ends the program."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import StorageError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A file beside ``path`` to be written, which takes its place at the end of the block.

    Raises:
        StorageError: the system refuses it; what was at ``path`` is still there.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, path)
    except OSError as error:
        raise StorageError(
            f"{path}: cannot be written ({error.strerror or error}); the same command resumes the"
            " run once it can"
        ) from error
    finally:
        part.unlink(missing_ok=True)


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


def arrays_of_bytes(content: bytes) -> dict[str, np.ndarray[Any, Any]]:
    """The arrays of ``bytes_of_arrays``, which cannot be written to."""
    start = content.index(b"\n") + 1
    out = {}
    for name, kind, shape in json.loads(content[:start]):
        dtype, size = np.dtype(kind), math.prod(shape)
        out[name] = np.frombuffer(content, dtype, size, start).reshape(shape)
        start += size * dtype.itemsize
    return out
