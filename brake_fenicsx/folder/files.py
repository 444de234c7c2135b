"""Files that appear whole or not at all, whatever ends the program: a folder's, and a cache's."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import struct
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from brake_fenicsx.errors import SceneError, StorageError

from .arrays import check_mapped, npy, read_npz, reading
from .lock import has_ended, process_name
from .log import logger

if TYPE_CHECKING:
    from mpi4py import MPI

# End of the names of files that are being written, and when one of another machine is left [s].
PART, OLD = ".part", 86400.0


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
        raise StorageError(f"""{path}: cannot be written ({why}); the same command resumes the run
            once it can""") from error
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


# Arrays begin at multiples of so many bytes in a file; the number of the zip field that pads them
# (any reader skips it) [bytes].
ALIGNED, PADDING = 64, 0xD935


class ResultFiles:
    """Files of one results folder.

    Attributes:
        directory: the folder.
        digest: hash of the scene whose results it holds.
    """

    def __init__(self, directory: Path):
        self.directory, self.digest = directory, ""

    def path(self, *names: str) -> Path:
        """A path in the folder."""
        return self.directory.joinpath(*names)

    def save(self, name: str, **arrays: Any) -> None:
        """Write arrays under a name relative to the folder."""
        size = sum(np.asarray(a).nbytes + 1024 for a in arrays.values()) + 1024
        self.write(name, size, lambda file: _write_arrays(file, arrays))

    def write(self, name: str, size: int, content: Callable[[BinaryIO], None]) -> None:
        """Write a file whole or not at all.

        Args:
            name: relative to the folder.
            size: number of bytes, or a little more.
            content: writes them.

        Raises:
            StorageError: the file cannot be written.
        """
        with whole_file(self.path(name), durable=True) as part, part.open("wb") as file:
            # A full disc is noticed here; a zip file would raise once more at its end.
            os.posix_fallocate(file.fileno(), 0, size)
            content(file)
            file.truncate()

    def load(
        self, name: str, keys: Sequence[str] | None = None, mapped: bool = False
    ) -> dict[str, np.ndarray[Any, Any]] | None:
        """Arrays under a name, all or those of some keys; None where there is no such file.

        Args:
            name: relative to the folder.
            keys: of the arrays wanted; all if None.
            mapped: whether large arrays are mapped into memory and read-only, so that the processes
                of a machine hold them once.

        Raises:
            SceneError: the file is damaged.
        """
        path = self.path(name)
        try:
            stream = path.open("rb")
        except FileNotFoundError:
            return None
        with stream, damaged(path):
            return read_npz(stream, keys, mapped)

    def check_mapped(self, name: str) -> None:
        """Compare what ``load`` maps of a file with its checksums; once a run.

        Raises:
            SceneError: the file is there, and damaged.
        """
        path = self.path(name)
        if path.is_file():
            with damaged(path):
                check_mapped(path)

    def save_json(self, name: str, content: Mapping[str, Any] | list[str]) -> None:
        """Write a JSON file; infinity and nan, which JSON does not have, become null."""
        text = json.dumps(content, default=_plain)
        strict = json.loads(text, parse_constant=lambda _: None)
        self.write_text(name, json.dumps(strict, indent=1) + "\n")

    def write_text(self, name: str, text: str) -> None:
        """Write a text file."""
        with whole_file(self.path(name), durable=True) as part:
            part.write_text(text, "utf-8")


def damaged(path: Path) -> AbstractContextManager[None]:
    """A block that reads a file of the folder that is open, or may have been packed meanwhile."""
    remedy = "remove this file, and the same command makes it again"
    return reading(None, "as an npz file", f"damaged or cut short: {remedy}", at=f"{path}: ")


def _write_arrays(file: BinaryIO, arrays: Mapping[str, Any]) -> None:
    """An npz file, as ``numpy.savez`` writes it, whose arrays lie so that they can be mapped.

    Each array begins at a multiple of ALIGNED bytes: an extra field pads the header before it.
    """
    with zipfile.ZipFile(file, "w") as archive:
        for name, values in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            # Fixed part, name, the field that pads, and that of the sizes in 64 bits.
            start = file.tell() + 30 + len(entry.filename.encode()) + 4 + 20
            gap = -start % ALIGNED
            entry.extra = struct.pack("<HH", PADDING, gap) + bytes(gap)
            with archive.open(entry, "w", force_zip64=True) as out:
                npy.write_array(out, np.asanyarray(values), allow_pickle=False)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


class SharedCache:
    """Files that results folders share, each under a hash of what it depends on.

    Laws, the order of the dofs and the reduced models depend on a part of a scene alone. Of scenes
    that differ elsewhere (seed, friction, its distribution, a load) the first makes them, the
    others link to them.
    """

    def __init__(self, store: ResultFiles, directory: Path | None = None):
        """Look at the directory.

        Args:
            store: the results folder.
            directory: the shared folder, made if it is not there; None: nothing is shared.

        Raises:
            SceneError: it is no folder, or cannot be written to.
        """
        self.store, self.directory = store, directory
        if directory is None:
            return
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SceneError(f"--cache {directory}: {error.strerror}; name a folder") from None
        if not os.access(directory, os.W_OK):
            raise SceneError(f"--cache {directory}: cannot be written to; name another folder")

    @contextmanager
    def shared(self, name: str, depends: Callable[[], Any], comm: MPI.Comm) -> Iterator[None]:
        """Take a file before it is asked for, and leave it after it was made; collective.

        Args:
            name: the file's name in the results folder.
            depends: gives all that its content depends on, plain values; called by process 0, and
                only where there is a shared folder.
            comm: processes of the run.
        """
        if self.directory is None:
            yield
            return
        if comm.rank > 0:
            comm.Barrier()
            yield
            return
        stem, suffix = os.path.splitext(os.path.basename(name))
        there = self.directory / f"{stem}-{digest(depends())[:16]}{suffix}"
        own = self.store.path(name)
        if there.exists() and not own.exists():
            logger.info("%s: from %s", name, there)
            _link(there, own)
        comm.Barrier()
        yield
        if own.exists() and not there.exists():
            try:
                _link(own, there)
            except StorageError as error:
                text = "%s: cannot be written (%s); the run continues without it"
                logger.warning(text, there, error.__cause__)


def _link(source: Path, target: Path) -> None:
    """The same file where the file system allows it, else a copy; whole or not at all."""
    with whole_file(target) as part:
        try:
            os.link(source, part)
        except OSError:
            shutil.copyfile(source, part)
