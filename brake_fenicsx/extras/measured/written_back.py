"""Identified constants in the text of a scene: their values are replaced, all else stays as it is.

Each value is found by trying: of the places where a key of this name is written, the right one is
that which changes this key of the scene, and no other, when the text is read again.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.build.material_table import constants
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.scene import MaterialTable, Scene
from brake_fenicsx.scene.read import toml_text
from brake_fenicsx.scene.units import to_si

DIGITS = 6
BOM, MARK = "\ufeff", "\ufffd"
# A text, a list of such or of numbers, a number or a word.
VALUE = r"""("[^"\n]*"|'[^'\n]*'|\[[^\[\]]*\]|[-+\w.]+)"""


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
    text = scene.file.read_bytes().decode("utf-8")
    begin = BOM if text.startswith(BOM) else ""
    text = text.removeprefix(BOM)
    for key, value in _keys(scene.materials[material], values).items():
        text = _replaced(scene.file, text, ("materials", material, key), value)
    return begin + text


def write_text(file: Path, text: str) -> None:
    """Write it whole, or not at all; ends of lines as they are."""
    with whole_file(file) as part:
        part.write_bytes(text.encode("utf-8"))


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


def _replaced(file: Path, text: str, path: tuple[str, ...], value: Any) -> str:
    """The text with another value of one key."""
    where, last = ".".join(path), re.escape(path[-1])
    wanted = tomllib.loads(text)
    table = wanted
    for name in path[:-1]:
        table = table.get(name, {})
    if not isinstance(table, dict) or path[-1] not in table:
        raise SceneError(f"{file}: {where}: the file does not write it; copy the constant by hand")
    old, table[path[-1]] = table[path[-1]], MARK
    for match in re.finditer(rf"""(?<![\w-])["']?{last}["']?[ \t]*=[ \t]*{VALUE}""", text):
        head, tail = text[: match.start(1)], text[match.end(1) :]
        try:
            found = tomllib.loads(f'{head}"{MARK}"{tail}') == wanted
        except ValueError:
            continue
        if found:
            return f"{head}{toml_text(_written(old, value))}{tail}"
    raise SceneError(f"{file}: {where}: cannot be replaced there; copy the constant by hand")


def _written(old: Any, value: Any) -> Any:
    """A value as the scene writes the old one: in its unit, and as a list if that is one."""
    first = old[0] if isinstance(old, list) else old
    if isinstance(value, str):
        return value
    unit = re.sub(r"^\s*[-+\d.eE_]+\s*", "", first) if isinstance(first, str) else ""
    scale = to_si(f"1 {unit}", "Pa") if unit else 1.0
    cells = [float(f"{v / scale:.{DIGITS}g}") for v in np.atleast_1d(value)]
    new = [f"{v:.{DIGITS}g} {unit}" if unit else v for v in cells]
    return new if isinstance(old, list) or len(new) > 1 else new[0]
