"""Other values in the text of a scene: they are replaced, all else stays as it is.

Each is found by trying: of the places where a key of this name is written, the right one is that
which changes this key of the scene, and no other, when the text is read again.
"""

import re
import tomllib
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from brake_fenicsx.errors import SceneError, located
from brake_fenicsx.folder.files import whole_file

from .keys import walk
from .read import toml_text
from .scalars import SPEED, si_unit
from .scene import Scene
from .units import in_unit_of

BOM, MARK = "\ufeff", "\ufffd"
# A text, a list of such or of numbers, a number or a word.
VALUE = r"""("[^"\n]*"|'[^'\n]*'|\[[^\[\]]*\]|[-+\w.]+)"""


def with_values(scene: Scene, values: Mapping[tuple[str, ...], Any]) -> str:
    """Text of a scene's file with other values of some keys.

    Args:
        scene: the scene.
        values: names of the tables and of the key -> value, SI.

    Raises:
        SceneError: the file does not write one of them.
    """
    file, units = scene.file, _units(scene)
    text = file.read_bytes().decode("utf-8")
    begin = BOM if text.startswith(BOM) else ""
    text = text.removeprefix(BOM)
    for path, value in values.items():
        text = _replaced(file, text, path, value, units.get(path, ""))
    return begin + text


def _units(scene: Scene) -> dict[tuple[str, ...], str | tuple[str, ...]]:
    """SI unit of each key, or of each number of its list."""
    units: dict[tuple[str, ...], str | tuple[str, ...]] = {}
    parts = [walk(part.parameters, ("parts", name)) for name, part in scene.parts.items()]
    for keys, about, _ in chain(walk(scene), *parts):
        unit = about.get("units") or about.get("unit", "")
        units[keys] = si_unit(scene, keys[-2]) if unit == "*" else unit
    return units | {tuple(SPEED.split(".")): si_unit(scene, SPEED)}


def write_text(file: Path, text: str) -> None:
    """Write it whole, or not at all, ends of lines as they are."""
    with whole_file(file) as part:
        part.write_bytes(text.encode("utf-8"))


def _replaced(
    file: Path, text: str, path: tuple[str, ...], value: Any, unit: str | tuple[str, ...]
) -> str:
    """The text with another value of one key, of an SI unit or one for each number of a list."""
    where, last = ".".join(path), re.escape(path[-1])
    wanted = tomllib.loads(text)
    table = wanted
    for name in path[:-1]:
        table = table.get(name, {})
    if not isinstance(table, dict) or path[-1] not in table:
        raise SceneError(f"{file}: {where}: the file does not write it; add it by hand")
    old, table[path[-1]] = table[path[-1]], MARK
    for match in re.finditer(rf"""(?<![\w-])["']?{last}["']?[ \t]*=[ \t]*{VALUE}""", text):
        head, tail = text[: match.start(1)], text[match.end(1) :]
        try:
            found = tomllib.loads(f'{head}"{MARK}"{tail}') == wanted
        except ValueError:
            continue
        if found:
            with located(f"{file}: {where}", ValueError):
                return f"{head}{toml_text(_written(old, value, unit))}{tail}"
    raise SceneError(f"{file}: {where}: cannot be replaced there; change it by hand")


def _written(old: Any, value: Any, unit: str | tuple[str, ...]) -> Any:
    """A value as the scene writes the old one: in its unit, and as a list if that is one."""
    if isinstance(value, str):
        return value
    many = value if isinstance(value, list | tuple) else [value]
    units = [unit] * len(many) if isinstance(unit, str) else unit
    like = old if isinstance(old, list) else [old]
    like = like if len(like) == len(many) else like[:1] * len(many)
    new = [in_unit_of(*one) for one in zip(many, like, units, strict=True)]
    return new if isinstance(old, list) or len(new) > 1 else new[0]
