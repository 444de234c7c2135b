"""The results folder: every file appears whole or not at all, and a killed run finds its own.

scene.toml            the scene as run, with the hash of what its results depend on
running/              the runs at work in the folder (lock.py)
surface.npz laws.npz  stages surface and micro
cache/                what all samples share (interface compliance, reduced basis)
samples/              finished samples (sample_files.py)
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.files import ResultFiles, emptied, remove_remains
from brake_fenicsx.folder.lock import Lock, Share
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.sample_files import SampleFiles

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


class Store(ResultFiles):
    """One results folder.

    Attributes:
        lock: of the run on its first process; None elsewhere.
        share: the part of the samples that this run computes; all of them if None.
        samples: the finished samples.
    """

    def __init__(self, directory: Path):
        super().__init__(directory)
        self.lock: Lock | None = None
        self.share: Share | None = None
        self.samples: SampleFiles = SampleFiles(self)

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
            raise SceneError(f"""-o {folder}: a broken symbolic link (to {os.readlink(folder)});
                {remedy}""")
        mark = self._mark()
        if mark == digest:
            return
        known = self.samples.scene()
        if known == digest:
            logger.warning("%s: damaged or lost; the samples are of this scene", self.path(MARK))
        elif mark or known:
            raise SceneError(f"""{folder}: contains results of another scene, or of other content of
                a file that it names; {remedy}""")
        elif mark is not None:
            raise SceneError(f"""{self.path(MARK)}: damaged, and no sample says which scene the
                folder is of; {remedy}, or remove the folder""")
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
        self.write_text(MARK, self.digest)
        for name in ("cache", "samples"):
            self.path(name).mkdir(exist_ok=True)
        self.write_text("scene.toml", scene)

    def forget_tables(self) -> None:
        """Remove the tables of an earlier run, of which this one may not make all."""
        for name in MADE_OF_SAMPLES:
            self.path(name).unlink(missing_ok=True)
