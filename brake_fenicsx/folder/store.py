"""The results folder: every file appears whole or not at all, and a killed run finds its own.

scene.toml            the scene as run, with the hash of what its results depend on
running/              the runs at work in the folder (lock.py)
surface.npz laws.npz  stages surface and micro
cache/                what all samples share (interface compliance, reduced basis)
samples/              finished samples (sample_files.py)
"""

from __future__ import annotations

import json
import os
import re
import struct
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import check_mapped, npy, read_npz
from brake_fenicsx.folder.files import emptied, remove_remains, whole_file
from brake_fenicsx.folder.lock import Lock, Share
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.sample_files import SampleFiles, damaged

# What to forget when a stage is run again; later stages lose theirs too.
RUNNING, MARK = "running", "scene.sha256"
PREPARED = "cache/prepared.json"  # approaches whose samples have all that they share
_FILES = {
    "surface": ("surface.npz",),
    "micro": ("laws.npz", "contact_maps.npz"),
    "equilibrium": ("cache", "samples"),
    "stability": ("cache", "samples"),
    "uncertainty": ("samples",),
    "report": (
        "figures", "fields", "report.html", "contact_faces.npz", "laws.csv",
        "artificial_surface.csv", "artificial_surface.npz",
    ),
}  # fmt: skip

# What is made of the samples and the lines of a sweep at the end of every run.
MADE_OF_SAMPLES = (
    "samples.csv", "modes.csv", "modes.parquet", "contact.csv", "contact.npz", "drivers.csv",
    "drivers_contact.csv", "probabilities.csv", "convergence.csv", "sensitivity.csv", "causes.npz",
    "shapes.npz", "sweep.npz", "sweep.csv", "lock_in.csv", "chart.csv", "critical.csv",
    "critical_curve.csv", "mode_shapes.npz",
)  # fmt: skip


# Arrays begin at multiples of so many bytes in a file; the number of the zip field that pads them
# (any reader skips it) [bytes].
ALIGNED, PADDING = 64, 0xD935


class Store:
    """One results folder.

    Attributes:
        directory: the folder.
        digest: hash of the scene whose results the folder holds; set by ``check``.
        lock: of the run on its first process; None elsewhere.
        share: the part of the samples that this run computes; all of them if None.
        samples: the finished samples.
    """

    def __init__(self, directory: Path):
        self.directory: Path = directory
        self.digest: str = ""
        self.lock: Lock | None = None
        self.share: Share | None = None
        self.samples: SampleFiles = SampleFiles(self)

    def path(self, *names: str) -> Path:
        """A path in the folder."""
        return self.directory.joinpath(*names)

    def check(self, digest: str) -> None:
        """Refuse a folder that holds results of another scene, or something else.

        Args:
            digest: hash of the scene.

        Raises:
            SceneError: the folder's scene differs in more than stages and number of samples; the
                folder is none, or holds files that are no results.
        """
        self.digest = digest
        folder, remedy = self.directory, "choose another folder with -o"
        if folder.is_symlink() and not folder.exists():
            raise SceneError(
                f"-o {folder}: a broken symbolic link (to {os.readlink(folder)}); {remedy}"
            )
        mark = self._mark()
        if mark == digest:
            return
        known = self.samples.scene()
        if known == digest:
            logger.warning("%s: damaged or lost; the samples are of this scene", self.path(MARK))
        elif mark or known:
            raise SceneError(
                f"{folder}: contains results of another scene, or of other content of a file"
                f" that it names; {remedy}"
            )
        elif mark is not None:
            raise SceneError(
                f"{self.path(MARK)}: damaged, and no sample says which scene the folder is of;"
                f" {remedy}, or remove the folder"
            )
        elif found := sorted(p.name for p in folder.glob("[!.]*") if p.name != RUNNING):
            raise SceneError(f"-o {folder}: contains {found[0]!r} and no results; {remedy}")

    def _mark(self) -> str | None:
        """Hash of the scene as the folder has it; "" of one that is damaged, None without."""
        path = self.path(MARK)
        text = path.read_text("utf-8", "replace").strip() if path.is_file() else None
        return text if text is None or re.fullmatch("[0-9a-f]{64}", text) else ""

    def known(self) -> str:
        """Hash of the scene of the folder; "" where nothing tells it."""
        return self.samples.scene() or self._mark() or ""

    def open(self, scene: str, from_stage: str | None = None) -> None:
        """Make the folder, or enter it; forget what ``from_stage`` and later stages left.

        Args:
            scene: text of the scene's file.
            from_stage: a stage, or None.
        """
        self.directory.mkdir(parents=True, exist_ok=True)
        if from_stage is not None:
            later = list(_FILES)[list(_FILES).index(from_stage) :]
            for name in dict.fromkeys(file for stage in later for file in _FILES[stage]):
                emptied(self.path(name))
            self.samples = SampleFiles(self)
        remove_remains(self.directory)
        _write(self.path(MARK), self.digest)
        for name in ("cache", "samples"):
            self.path(name).mkdir(exist_ok=True)
        _write(self.path("scene.toml"), scene)

    def forget_tables(self) -> None:
        """Remove the tables of an earlier run, of which this one may not make all."""
        for name in MADE_OF_SAMPLES:
            self.path(name).unlink(missing_ok=True)

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
        _write(self.path(name), json.dumps(strict, indent=1) + "\n")


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


def _write(path: Path, text: str) -> None:
    with whole_file(path, durable=True) as part:
        part.write_text(text, "utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value)
