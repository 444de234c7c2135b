#!/usr/bin/env python3
"""Write docs/scene.md, the reference of every key of a scene, from the dataclasses that read it.

Run as: scripts/scene_reference.py [FILE]
"""

from __future__ import annotations

import importlib
import inspect
import re
import sys
import types
import typing
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import pint

from brake_fenicsx.scene import BUILDERS, STAGES, Axis, Scene
from brake_fenicsx.scene.units import DIMENSIONS

OUT = Path(__file__).parents[1] / "docs" / "scene.md"

HEAD = """\
# Reference of the scene

Written by `scripts/scene_reference.py` from the dataclasses that read a scene, where every key is
explained; do not edit it here.

A scene is one TOML file. A quantity is a string with its unit, `"5 bar"`, `"2.825 mm"`; any unit
of the right dimension will do, and the one named below is an example. Numbers are positive unless
their row says "zero or more" or "any sign". A key without default has **required** there; one whose
default is a dash may be left out. `brake-fenicsx check SCENE.toml` refuses unknown keys, wrong
units and what does not fit together; `--set section.key=value` replaces any key from the command
line.
"""

STAGES_TEXT = """\
## stages

`stages = [...]`, **required**: which of {stages}
are run, always in this order. Only what they need is built and imported.
"""

SUPPORTS = """\
## [supports]

`"part.face" = "clamped"`, or a list of the directions held: `"pad.ears" = ["x", "y"]`.
"""

PARTS = """\
## [parts.NAME]

| key | value | default | choices | meaning |
| --- | --- | --- | --- | --- |
| `builder` | text | - | {builders} \
| shape to build; without it the cells come from the file in `[mesh]` |
| `material` | text or table | **required** |  \
| one `[materials]` name, or one for each layer: `{{ lining = "..", plate = ".." }}` |
"""


@dataclass(frozen=True, slots=True)
class Section:
    """One table of the scene: its name as written, and the dataclass that reads it."""

    name: str
    cls: Any


def sections(cls: Any, above: str = "") -> Iterator[Section]:
    """Tables below a dataclass, in the order of its fields, each followed by its own."""
    for f, hint in zip(fields(cls), _hints(cls), strict=True):
        own = f.name
        for kind in _kinds(hint):
            name = f"{above}{own}"
            if typing.get_origin(kind) is dict:
                kind, name = typing.get_args(kind)[1], f"{name}.NAME"
            if is_dataclass(kind) and kind.__module__.startswith("brake_fenicsx.scene"):
                yield Section(name, kind)
                yield from sections(kind, f"{name}.")


def table(cls: Any) -> str:
    """Keys of a dataclass as a table: value and unit, default, choices, meaning.

    Raises:
        ValueError: a key without meaning in the dataclass's docstring.
    """
    told = meanings(cls)
    lines = ["| key | value | default | choices | meaning |", "| --- | --- | --- | --- | --- |"]
    for f, hint in zip(fields(cls), _hints(cls), strict=True):
        if f.name not in told:
            raise ValueError(f"{cls.__name__}.{f.name}: say under Attributes what it means")
        if f.metadata.get("internal"):
            continue
        choices = ", ".join(f"`{_toml(c)}`" for c in f.metadata.get("choices", ()))
        cells = (f"`{f.name}`", value_text(f, hint), default_text(f), choices, told[f.name])
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def meanings(cls: Any) -> dict[str, str]:
    """Meaning of each key, from the section Attributes of the docstring."""
    text = inspect.getdoc(cls) or ""
    _, _, block = text.partition("Attributes:\n")
    found = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", block, re.M)
    # The unit stands beside the meaning; docstrings name SI's. Sections of a scene stay.
    units = re.compile(rf" \[({'|'.join(filter(None, DIMENSIONS))})\]")
    return {name: units.sub("", _plain(words)).rstrip(".") for name, words in found}


def value_text(f: Field, hint: Any) -> str:
    """What is written for a key: kind, dimension with an example of a unit, sign."""
    unit = f.metadata.get("unit", "")
    kinds = [_kind_text(kind, unit) for kind in _kinds(hint)]
    if "units" in f.metadata:
        kinds = [f"list of {', '.join(DIMENSIONS[u] for u in f.metadata['units'])}"]
    text = " or ".join(dict.fromkeys(filter(None, kinds)))
    sign = {"zero": "zero or more", "any": "any sign"}.get(f.metadata.get("sign", ""), "")
    return f"{text}, {sign}" if sign else text


def default_text(f: Field) -> str:
    """The default as one would write it in a scene."""
    if f.default is MISSING and f.default_factory is MISSING:
        return "**required**"
    value = f.default if f.default is not MISSING else f.default_factory()
    if value is None or value in ((), {}) or is_dataclass(value):
        return "-"
    if isinstance(value, float) and not isfinite(value):
        return "-"
    return f"`{_toml(_with_unit(value, f.metadata.get('unit', '')))}`"


def reference() -> str:
    """The whole page."""
    parts = [HEAD, STAGES_TEXT.format(stages=", ".join(f"`{s}`" for s in STAGES))]
    for section in sections(Scene):
        if section.name == "parts.NAME":
            parts += _parts()
            continue
        if section.name == "loads.NAME":
            parts.append(SUPPORTS)
        title, note = _title(section)
        parts.append(f"## [{title}]\n\n{note}{table(section.cls)}")
    return "\n".join(parts)


def _parts() -> Iterator[str]:
    """What all parts share, then the parameters of each builder."""
    builders = ", ".join(f"`{name}`" for name in BUILDERS)
    shared = table(Axis).split("\n", 2)[2]
    yield PARTS.format(builders=builders) + shared
    for name, cls in BUILDERS.items():
        module = importlib.import_module(f"brake_fenicsx.geometry.{name}")
        note = _plain((module.__doc__ or "").strip().splitlines()[0])
        yield f'### builder = "{name}"\n\n{note}\n\n{table(getattr(module, cls))}'


def _title(section: Section) -> tuple[str, str]:
    """Heading of a section, and the first line of its docstring after the names."""
    first = (inspect.getdoc(section.cls) or "").splitlines()[0]
    note = _plain(first.rpartition("]: ")[2])
    name = section.name.replace("samples.random.NAME", 'samples.random."KEY"')
    name = name.replace("loads.NAME", 'loads."PART.FACE"')
    return name, f"{note[:1].upper()}{note[1:]}\n\n"


def _hints(cls: Any) -> list[Any]:
    known = typing.get_type_hints(cls)
    return [known[f.name] for f in fields(cls)]


def _kinds(hint: Any) -> tuple[Any, ...]:
    return typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)


def _kind_text(kind: Any, unit: str) -> str:
    if kind is type(None):
        return ""
    if typing.get_origin(kind) is tuple:
        return f"list of {_kind_text(typing.get_args(kind)[0], unit)}"
    if typing.get_origin(kind) is dict or is_dataclass(kind):
        return "table"
    words = {str: "text", bool: "true or false", int: "whole number"}
    if kind in words:
        return words[kind]
    return DIMENSIONS[unit] if unit else "number"


def _with_unit(value: Any, unit: str) -> Any:
    """A number in SI units as a quantity of the unit that the page names."""
    if isinstance(value, tuple):
        return tuple(_with_unit(v, unit) for v in value)
    if not unit or isinstance(value, str | bool):
        return value
    usual = DIMENSIONS[unit].partition("[")[2].rstrip("]")
    registry = pint.get_application_registry()
    number = registry.Quantity(value, unit).to(registry.Unit(usual)).magnitude
    return f"{number:.10g} {usual}"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _plain(text: str) -> str:
    """Docstring to one line of Markdown."""
    return re.sub(r"\s+", " ", text).strip().replace("``", "`").replace("|", "\\|")


def main(path: Path = OUT) -> None:
    path.write_text(reference(), encoding="utf-8")
    print(f"wrote {path}")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
