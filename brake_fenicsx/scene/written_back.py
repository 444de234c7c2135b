"""Other values in the text of a scene: they are replaced, all else stays as it is.

Each is found by trying: of the places where a key of this name is written, the right one is that
which changes this key of the scene, and no other, when the text is read again.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.files import whole_file

from .read import toml_text
from .units import to_si

DIGITS = 6
BOM, MARK = "\ufeff", "\ufffd"
# A text, a list of such or of numbers, a number or a word.
VALUE = r"""("[^"\n]*"|'[^'\n]*'|\[[^\[\]]*\]|[-+\w.]+)"""


def with_values(file: Path, values: Mapping[tuple[str, ...], Any]) -> str:
    """Text of a scene's file with other values of some keys.

    Args:
        file: the file.
        values: names of the tables and of the key -> value, SI.

    Raises:
        SceneError: the file does not write one of them.
    """
    text = file.read_bytes().decode("utf-8")
    begin = BOM if text.startswith(BOM) else ""
    text = text.removeprefix(BOM)
    for path, value in values.items():
        text = _replaced(file, text, path, value)
    return begin + text


def write_text(file: Path, text: str) -> None:
    """Write it whole, or not at all, ends of lines as they are."""
    with whole_file(file) as part:
        part.write_bytes(text.encode("utf-8"))


def _replaced(file: Path, text: str, path: tuple[str, ...], value: Any) -> str:
    """The text with another value of one key."""
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
            return f"{head}{toml_text(_written(old, value))}{tail}"
    raise SceneError(f"{file}: {where}: cannot be replaced there; change it by hand")


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
