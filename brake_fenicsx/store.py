"""The results folder: every file appears whole or not at all, and a killed run finds its own.

scene.toml            the scene as run, with the hash of what its results depend on
surface.npz laws.npz  stages surface and micro
cache/                what all samples share (interface compliance, reduced basis)
samples/              one file per finished sample
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene

# What to forget when a stage is run afresh; later stages lose theirs too.
_FILES = {
    "surface": ("surface.npz",),
    "micro": ("laws.npz", "contact_maps.npz"),
    "equilibrium": ("cache", "samples"),
    "stability": ("cache", "samples"),
    "uncertainty": ("samples",),
    "report": ("figures", "fields", "report.html", "contact_faces.npz"),
}


class Store:
    """One results folder."""

    def __init__(self, directory: Path):
        self.directory = directory

    def path(self, *names: str) -> Path:
        """A path in the folder."""
        return self.directory.joinpath(*names)

    def check(self, scene: Scene) -> None:
        """Refuse a folder that holds results of another scene.

        Raises:
            SceneError: the folder's scene differs in more than stages and number of samples.
        """
        mark = self.path("scene.sha256")
        if mark.exists() and mark.read_text() != result_digest(scene):
            raise SceneError(
                f"{self.directory}: holds results of another scene; choose another folder with -o,"
                " or remove it"
            )

    def open(self, scene: Scene, from_stage: str | None = None) -> None:
        """Make the folder, or enter it; forget what ``from_stage`` and later stages left."""
        self.directory.mkdir(parents=True, exist_ok=True)
        if from_stage is not None:
            later = list(_FILES)[list(_FILES).index(from_stage) :]
            for name in {file for stage in later for file in _FILES[stage]}:
                target = self.path(name)
                if target.is_dir():
                    shutil.rmtree(target)
                else:
                    target.unlink(missing_ok=True)
        for name in ("cache", "samples"):
            self.path(name).mkdir(exist_ok=True)
        _write(self.path("scene.toml"), scene.file.read_text())
        _write(self.path("scene.sha256"), result_digest(scene))

    def save(self, name: str, **arrays: Any) -> None:
        """Write arrays under a name relative to the folder."""
        path = self.path(name)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        with part.open("wb") as file:
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        """Arrays under a name; None where there are none."""
        path = self.path(name)
        if not path.exists():
            return None
        with np.load(path, allow_pickle=False) as data:
            return {key: data[key] for key in data.files}

    def save_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a JSON file."""
        _write(self.path(name), json.dumps(content, indent=1, default=_plain) + "\n")


def result_digest(scene: Scene) -> str:
    """Hash of all that the results of a sample depend on."""
    left_out = ("n", "approaches", "limit", "processes_per_sample")
    samples = {k: v for k, v in scene.table.get("samples", {}).items() if k not in left_out}
    table = {k: v for k, v in scene.table.items() if k not in ("stages", "samples")}
    content = {**table, "samples": samples, "base": str(scene.file.resolve().parent)}
    s = scene.samples
    # The points of a design hang together; fast and joint take the inputs from multi-scale.
    whole = [s.plan(a) for a in s.approaches if s.takes_random(a) and not s.plan(a).grows]
    if whole:
        content["designs"] = [[p.n, p.design, p.curves] for p in whole]
    if s.random and {"fast", "joint"} & {*s.approaches}:
        content["multi-scale"] = "roughness alone"
    if measured := {name: d.digest for name, d in s.random.items() if d.digest}:
        content["measured"] = measured
    return Scene.hash(content)


def _write(path: Path, text: str) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_text(text)
    os.replace(part, path)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value)
