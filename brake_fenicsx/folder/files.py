"""Files that appear whole or not at all, whatever ends the program."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
