"""Finished samples of a results folder: one file each, and one archive for each full block.

A sample is written as ``samples/APPROACH-00012.npz``. Once all samples of a block of ``BLOCK``
numbers are there, the files are copied as they are into one archive without compression,
``samples/APPROACH-00000-00255.zip``, and removed. Both appear whole or not at all, and both carry
the hash of the scene. Whoever reads while another process packs finds a sample in one of the two.
Who packs also writes what the tables need of the block, as columns, into the archive: the end of a
run then reads no sample.
"""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import mapped_member, read_npz, reading
from brake_fenicsx.folder.files import arrays_of_bytes, bytes_of_arrays

if TYPE_CHECKING:
    from brake_fenicsx.folder.store import Store

Task = tuple[str, int]
Arrays = dict[str, np.ndarray[Any, Any]]
Tabulate = Callable[[Sequence[Task], Callable[[Task], Arrays | None]], Arrays | None]

# Samples of an archive: 10^5 samples are 400 files, and a damaged one costs little.
BLOCK = 256
FOLDER = "samples"
# Columns of a block in its archive; other columns have another number.
COLUMNS = "columns-1"

_SINGLE = re.compile(r"(.+)-(\d{5,})\.npz")
_ARCHIVE = re.compile(r"(.+)-\d{5,}-\d{5,}\.zip")


def damaged(path: Path) -> AbstractContextManager[None]:
    """A block that reads a file of the folder that is open, or may have been packed meanwhile."""
    remedy = "remove this file, and the same command makes it again"
    return reading(None, "as an npz file", f"damaged or cut short: {remedy}", at=f"{path}: ")


class SampleFiles:
    """Samples of one results folder.

    Attributes:
        tabulate: makes the columns of a block from its tasks and a function that reads each of
            them; None of blocks without. No columns are written if it is None.
    """

    def __init__(self, store: Store):
        self._store = store
        self.tabulate: Tabulate | None = None
        # Names of the samples in archives that were looked at, single files likewise, and archives
        # whose columns were compared with their checksum.
        self._archives: dict[str, frozenset[str]] = {}
        self._checked: set[str] = set()
        self._whole: set[str] = set()

    def save(self, task: Task, **arrays: Any) -> None:
        """Write the arrays of a sample with the hash of its scene; pack its block if it is full.

        Args:
            task: approach and number of the sample.
            arrays: arrays by name.
        """
        self._store.save(_path(_single(task)), scene=np.array(self._store.digest), **arrays)
        block = [(task[0], k) for k in _block(task)]
        if set(map(_single, block)) <= set(self._names()):
            self._pack(block)

    def present(self) -> set[Task]:
        """All samples that are stored; their arrays are not read.

        Raises:
            SceneError: a file is damaged, or belongs to another scene.
        """
        names: set[str] = set()
        for name in self._names():
            if _ARCHIVE.fullmatch(name):
                names |= self._content(name)
            elif _SINGLE.fullmatch(name) and self._is_single(name):
                names.add(name)
        found = (_SINGLE.fullmatch(name) for name in names)
        return {(match[1], int(match[2])) for match in found if match}

    def scene(self) -> str:
        """Hash of the scene of the first sample that can be read; "" without any."""
        for name in self._names():
            with suppress(SceneError, OSError):
                if _SINGLE.fullmatch(name):
                    return str((self._store.load(_path(name), ["scene"]) or {}).get("scene", ""))
                if _ARCHIVE.fullmatch(name):
                    path = self._store.path(FOLDER, name)
                    with damaged(path), zipfile.ZipFile(path) as archive:
                        return archive.comment.decode()
        return ""

    def load(self, task: Task) -> dict[str, np.ndarray[Any, Any]] | None:
        """Arrays of a sample; None where it is not computed yet.

        Raises:
            SceneError: its file is damaged, or belongs to another scene.
        """
        name = _single(task)
        # Between the two another process may have packed it.
        data = self._store.load(_path(name))
        if data is None and self._in_archive(task):
            path = self._store.path(FOLDER, _archive(task))
            with damaged(path), zipfile.ZipFile(path) as archive, archive.open(name) as member:
                data = read_npz(member)
        if data is not None and str(data.pop("scene", "")) != self._store.digest:
            raise _foreign(self._store.path(FOLDER, name))
        return data

    def columns(self, task: Task) -> Arrays | None:
        """Columns of the block of a sample; None where it is not packed, or was packed without.

        They are mapped into memory; their checksum is looked at the first time.

        Raises:
            SceneError: the archive is damaged, or belongs to another scene.
        """
        path = self._store.path(FOLDER, _archive(task))
        if not path.exists():
            return None
        with damaged(path), zipfile.ZipFile(path) as file:
            if file.comment.decode() != self._store.digest:
                raise _foreign(path)
            if COLUMNS not in file.NameToInfo:
                return None
            content = mapped_member(file, COLUMNS, check=path.name not in self._whole)
            self._whole.add(path.name)
            return arrays_of_bytes(content)

    def _names(self) -> list[str]:
        """Files there are; none where there is no folder yet."""
        folder = self._store.path(FOLDER)
        return sorted(os.listdir(folder)) if folder.is_dir() else []

    def _is_single(self, name: str) -> bool:
        """Whether there is such a file, of this scene; looked at once where there is."""
        if name not in self._checked:
            data = self._store.load(_path(name), ["scene"])
            if data is None:
                return False
            if str(data.get("scene", "")) != self._store.digest:
                raise _foreign(self._store.path(FOLDER, name))
            self._checked.add(name)
        return self._store.path(FOLDER, name).exists()

    def _in_archive(self, task: Task) -> bool:
        return _single(task) in self._content(_archive(task))

    def _content(self, archive: str) -> frozenset[str]:
        """Samples in an archive; none where there is no such file."""
        if archive not in self._archives:
            path = self._store.path(FOLDER, archive)
            if not path.exists():
                return frozenset()
            with damaged(path), zipfile.ZipFile(path) as file:
                digest, names = file.comment.decode(), frozenset(file.namelist())
            if digest != self._store.digest:
                raise _foreign(path)
            self._archives[archive] = names
        return self._archives[archive]

    def _pack(self, block: Sequence[Task]) -> None:
        """Copy the files of a block into its archive, and remove them."""
        paths = [self._store.path(FOLDER, _single(task)) for task in block]
        with ExitStack() as opened:
            try:
                files = [opened.enter_context(path.open("rb")) for path in paths]
            except FileNotFoundError:
                return  # Another process has packed them.

            columns = self._tabulated(dict(zip(block, files, strict=True)))

            def write(target: BinaryIO) -> None:
                with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
                    archive.comment = self._store.digest.encode()
                    for path, file in zip(paths, files, strict=True):
                        file.seek(0)
                        # The date of a file is no part of a result.
                        archive.writestr(zipfile.ZipInfo(path.name), file.read())
                    if columns:
                        archive.writestr(zipfile.ZipInfo(COLUMNS), columns)

            size = sum(os.fstat(file.fileno()).st_size + 512 for file in files) + len(columns) + 512
            self._store.write(_path(_archive(block[0])), size, write)
        for path in paths:
            path.unlink(missing_ok=True)

    def _tabulated(self, block: dict[Task, BinaryIO]) -> bytes:
        """Columns of a block as a file; none where nothing makes them."""

        def load(task: Task) -> Arrays:
            with damaged(self._store.path(FOLDER, _single(task))):
                data = read_npz(block[task])
            return {name: data[name] for name in data if name != "scene"}

        arrays = None if self.tabulate is None else self.tabulate([*block], load)
        return b"" if arrays is None else bytes_of_arrays(arrays)


def _block(task: Task) -> range:
    start = task[1] // BLOCK * BLOCK
    return range(start, start + BLOCK)


def _single(task: Task) -> str:
    return f"{task[0]}-{task[1]:05d}.npz"


def _archive(task: Task) -> str:
    block = _block(task)
    return f"{task[0]}-{block[0]:05d}-{block[-1]:05d}.zip"


def _path(name: str) -> str:
    return f"{FOLDER}/{name}"


def _foreign(path: Path) -> SceneError:
    return SceneError(
        f"{path}: does not belong to the scene of this folder; remove this file, and the same"
        " command computes it again"
    )
