"""Finished samples of a results folder: one file each, and one archive for each full block.

A sample is written as ``samples/APPROACH-00012.npz``. Once all samples of a block of ``BLOCK``
numbers are there, the files are copied as they are into one archive without compression,
``samples/APPROACH-00000-00255.zip``, and removed. Both appear whole or not at all, and both carry
the hash of the scene. Whoever reads while another process packs finds a sample in one of the two.
Who packs also writes what the tables need of the block, as columns, into the archive: the end of a
run then reads no sample.
"""

import json
import math
import os
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, BinaryIO

import numpy as np

from brake_fenicsx.errors import SceneError

from .arrays import Arrays, mapped_member, read_npz
from .files import ResultFiles, damaged

Task = tuple[str, int]
Tabulate = Callable[[Sequence[Task], Callable[[Task], Arrays | None]], Arrays | None]

# Samples of an archive: 10^5 samples are 400 files, and a damaged one costs little.
BLOCK = 256
FOLDER = "samples"
# Columns of a block in its archive; other columns have another number.
COLUMNS = "columns-1"
HEADS = 2**18  # bytes in which the line of ``bytes_of_arrays`` ends

_SINGLE = re.compile(r"(.+)-(\d{5,})\.npz")
_ARCHIVE = re.compile(r"(.+)-\d{5,}-\d{5,}\.zip")


class SampleFiles:
    """Samples of one results folder.

    Attributes:
        tabulate: makes the columns of a block from its tasks and a function that reads each of
            them; None of blocks without. No columns are written if it is None.
    """

    def __init__(self, files: ResultFiles):
        self._files = files
        self.tabulate: Tabulate | None = None
        # Names of the samples in the files of this scene that were looked at, and archives whose
        # columns were compared with their checksum.
        self._known: dict[str, frozenset[str]] = {}
        self._whole: set[str] = set()

    def save(self, task: Task, **arrays: Any) -> None:
        """Write the arrays of a sample with the hash of its scene; pack its block if it is full.

        Args:
            task: approach and number of the sample.
            arrays: arrays by name.
        """
        self._files.save(_path(_single(task)), scene=np.array(self._files.digest), **arrays)
        block = [(task[0], k) for k in _block(task)]
        if set(map(_single, block)) <= set(self._names()):
            self._pack(block)

    def present(self) -> set[Task]:
        """All samples that are stored; their arrays are not read.

        Raises:
            SceneError: a file is damaged, or belongs to another scene.
        """
        names = {name for file in self._names() for name in self._content(file)}
        found = (_SINGLE.fullmatch(name) for name in names)
        return {(match[1], int(match[2])) for match in found if match}

    def scene(self) -> str:
        """Hash of the scene of the first sample that can be read; "" without any."""
        for name in self._names():
            with suppress(SceneError, OSError):
                return self._look(name)[0]
        return ""

    def load(self, task: Task) -> Arrays | None:
        """Arrays of a sample; None where it is not computed yet.

        Raises:
            SceneError: its file is damaged, or belongs to another scene.
        """
        name = _single(task)
        # Between the two another process may have packed it.
        data = self._files.load(_path(name))
        if data is None and name in self._content(_archive(task)):
            with self._opened(_archive(task)) as archive, archive.open(name) as member:
                data = read_npz(member)
        if data is not None and str(data.pop("scene", "")) != self._files.digest:
            raise self._foreign(name)
        return data

    def columns(self, task: Task) -> Arrays | None:
        """Columns of the block of a sample; None where it is not packed, or was packed without.

        They are mapped into memory; their checksum is looked at the first time.

        Raises:
            SceneError: the archive is damaged, or belongs to another scene.
        """
        if COLUMNS not in self._content(_archive(task)):
            return None
        with self._opened(_archive(task)) as archive:
            content = mapped_member(archive, COLUMNS, check=_archive(task) not in self._whole)
        self._whole.add(_archive(task))
        return arrays_of_bytes(content)

    def _names(self) -> list[str]:
        """Files of samples; none where there is no folder yet."""
        folder = self._files.path(FOLDER)
        there = sorted(os.listdir(folder)) if folder.is_dir() else []
        return [name for name in there if _SINGLE.fullmatch(name) or _ARCHIVE.fullmatch(name)]

    def _content(self, name: str) -> frozenset[str]:
        """What a file of this scene holds, looked at once; nothing where there is none."""
        if name not in self._known:
            try:
                digest, names = self._look(name)
            except FileNotFoundError:
                return frozenset()
            if digest != self._files.digest:
                raise self._foreign(name)
            self._known[name] = names
        return self._known[name]

    def _look(self, name: str) -> tuple[str, frozenset[str]]:
        """Hash of the scene of a file, and what it holds.

        Raises:
            FileNotFoundError: there is no such file, or it was packed meanwhile.
        """
        if _ARCHIVE.fullmatch(name):
            with self._opened(name) as archive:
                return archive.comment.decode(), frozenset(archive.namelist())
        data = self._files.load(_path(name), ["scene"])
        if data is None:
            raise FileNotFoundError(name)
        return str(data.get("scene", "")), frozenset({name})

    @contextmanager
    def _opened(self, name: str) -> Iterator[zipfile.ZipFile]:
        """An archive."""
        path = self._files.path(FOLDER, name)
        with path.open("rb") as stream, damaged(path), zipfile.ZipFile(stream) as archive:
            yield archive

    def _foreign(self, name: str) -> SceneError:
        return SceneError(f"""{self._files.path(FOLDER, name)}: does not belong to the scene of this
            folder; remove this file, and the same command computes it again""")

    def _pack(self, block: Sequence[Task]) -> None:
        """Copy the files of a block into its archive, and remove them."""
        paths = [self._files.path(FOLDER, _single(task)) for task in block]
        with ExitStack() as opened:
            try:
                files = [opened.enter_context(path.open("rb")) for path in paths]
            except FileNotFoundError:
                return  # Another process has packed them.

            columns = self._tabulated(dict(zip(block, files, strict=True)))

            def write(target: BinaryIO) -> None:
                with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
                    archive.comment = self._files.digest.encode()
                    for path, file in zip(paths, files, strict=True):
                        file.seek(0)
                        # The date of a file is no part of a result.
                        archive.writestr(zipfile.ZipInfo(path.name), file.read())
                    if columns:
                        archive.writestr(zipfile.ZipInfo(COLUMNS), columns)

            size = sum(os.fstat(file.fileno()).st_size + 512 for file in files) + len(columns) + 512
            self._files.write(_path(_archive(block[0])), size, write)
        for path in paths:
            path.unlink(missing_ok=True)

    def _tabulated(self, block: dict[Task, BinaryIO]) -> bytes:
        """Columns of a block as a file; none where nothing makes them."""

        def load(task: Task) -> Arrays:
            with damaged(self._files.path(FOLDER, _single(task))):
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


def arrays_of_bytes(content: bytes | memoryview) -> Arrays:
    """The arrays of ``bytes_of_arrays``, which cannot be written to."""
    line = bytes(content[:HEADS]).partition(b"\n")[0]
    start, out = len(line) + 1, {}
    for name, kind, shape in json.loads(line):
        dtype, size = np.dtype(kind), math.prod(shape)
        out[name] = np.frombuffer(content, dtype, size, start).reshape(shape)
        start += size * dtype.itemsize
    return out
