"""Identified constants in the text of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from brake_fenicsx.build.material_table import constants
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import MaterialTable, Scene
from brake_fenicsx.scene.written_back import with_values


def target(scene: Scene, path: str | Path) -> Path:
    """The file that gets the constants, refused where that is another scene or its paths get lost.

    Args:
        scene: the scene.
        path: its own file, or a new one beside it.
    """
    file, own = Path(path), scene.file
    if file.resolve() != own.resolve():
        if file.exists():
            raise SceneError(f"--write {file}: is there already; name the scene or a new file")
        if file.resolve().parent != own.resolve().parent:
            raise SceneError(
                f"--write {file}: name a file in {own.resolve().parent}, from which the paths of"
                " the scene start"
            )
    return file


def with_constants(scene: Scene, material: str, values: Mapping[str, float]) -> str:
    """Text of the scene's file with other constants of a material.

    Args:
        scene: the scene.
        material: its name.
        values: constant, as in ``constants``, or "loss" -> value, SI.

    Raises:
        SceneError: the file does not write one of them.
    """
    keys = _keys(scene.materials[material], values)
    return with_values(scene.file, {("materials", material, key): v for key, v in keys.items()})


def _keys(table: MaterialTable, values: Mapping[str, float]) -> dict[str, Any]:
    """Keys of a material table and their values; engineering constants of one are orthotropic."""
    if not any("_" in name for name in values):
        return dict(values)
    c = constants(table) | dict(values)
    ratios = [c["nu_12"], c["nu_31"] * c["E_1"] / c["E_3"], c["nu_32"] * c["E_2"] / c["E_3"]]
    new: dict[str, Any] = {} if table.model == "orthotropic" else {"model": "orthotropic"}
    new |= {"E": [c[f"E_{i}"] for i in "123"], "nu": ratios}
    new |= {"G": [c[f"G_{ij}"] for ij in ("23", "13", "12")]}
    return new | {name: v for name, v in values.items() if name == "loss"}
