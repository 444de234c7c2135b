#!/usr/bin/env python3
"""Write docs/scene.md, the reference of every key of a scene, from the dataclasses that read it.

Run as: scripts/scene_reference.py [FILE]
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import MISSING, Field
from importlib import import_module
from pathlib import Path
from typing import Any

from brake_fenicsx.scene import BUILDERS, STAGES, scene_type
from brake_fenicsx.scene.keys import (
    keys_of,
    kind_text,
    kinds_of,
    meanings,
    tables,
    written_default,
)
from brake_fenicsx.scene.parts_section import Part, builder_class
from brake_fenicsx.scene.units import DIMENSIONS

OUT = Path(__file__).parents[1] / "docs" / "scene.md"

HEAD = """\
# Reference of the scene

Written by `scripts/scene_reference.py` from the dataclasses that read a scene, where every key is
explained; do not edit it here.

A scene is one TOML file. A quantity is a string with its unit, `"5 bar"`, `"2.825 mm"`. Any unit
of the right dimension is accepted; the unit in the tables is an example. Numbers are positive
unless their row says "zero or more" or "any sign". A key without default is marked **required**. A
key whose default is a dash may be left out. `brake-fenicsx check SCENE.toml` rejects unknown keys,
wrong units and inconsistent combinations. `--set section.key=value` replaces any key from the
command line. `brake-fenicsx schema > scene.json` writes a JSON Schema of the scene, with which an
editor completes and checks keys: for Even Better TOML write `#:schema ./scene.json` as the scene's
first line. Paths are relative to the scene's folder; `~` is the home folder.
"""

STAGES_TEXT = """\
## stages

`stages = [...]`, **required**: which of {stages}
are run, always in this order. Parts of the program that these stages do not need are skipped.
"""

SUPPORTS = """\
## [supports]

`"part.face" = "clamped"`, or a list of the fixed directions: `"pad.ears" = ["x", "y"]`.
"""


def table(cls: Any, *names: str) -> str:
    """Keys of a dataclass, all or those of some names, as a table: value, default, meaning ...

    Raises:
        ValueError: a key without meaning in the dataclass's docstring.
    """
    told = {name: text.replace("|", "\\|") for name, text in meanings(cls).items()}
    lines = ["| key | value | default | choices | meaning |", "| --- | --- | --- | --- | --- |"]
    for f, hint in keys_of(cls):
        if names and f.name not in names:
            continue
        if f.name not in told:
            raise ValueError(f"{cls.__name__}.{f.name}: say under Attributes what it means")
        choices = ", ".join(f"`{_toml(c)}`" for c in f.metadata.get("choices", ()))
        cells = (f"`{f.name}`", value_text(f, hint), default_text(f), choices, told[f.name])
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def value_text(f: Field, hint: Any) -> str:
    """What is written for a key: kind, dimension with an example of a unit, sign."""
    unit = f.metadata.get("unit", "")
    kinds = [kind_text(kind, unit) for kind in kinds_of(hint)]
    if "units" in f.metadata:
        kinds = [f"list of {', '.join(DIMENSIONS[u] for u in f.metadata['units'])}"]
    text = " or ".join(dict.fromkeys(kinds))
    sign = {"zero": "zero or more", "any": "any sign"}.get(f.metadata.get("sign", ""), "")
    return f"{text}, {sign}" if sign else text


def default_text(f: Field) -> str:
    """The default as one would write it in a scene."""
    if f.default is MISSING and f.default_factory is MISSING:
        return "**required**"
    value = written_default(f)
    return "-" if value is None else f"`{_toml(value)}`"


def reference() -> str:
    """The whole page."""
    parts = [HEAD, STAGES_TEXT.format(stages=", ".join(f"`{s}`" for s in STAGES))]
    for name, cls in tables(scene_type()):
        if not cls.__module__.startswith("brake_fenicsx."):
            continue
        if name == "[parts.NAME]":
            parts += _parts()
            continue
        if name == "[springs.NAME]":
            parts.append(SUPPORTS)
        parts.append(f"## {_title(name)}\n\n{_note(cls)}{table(cls)}")
    return "\n".join(parts)


def _parts() -> Iterator[str]:
    """What all parts share, then the parameters of each builder."""
    yield f"## [parts.NAME]\n\n{table(Part, 'material', 'builder', 'axis')}"
    of_file = table(Part, "layers", "morph")
    yield f"### without a builder\n\nA part from the mesh file.\n\n{of_file}"
    for name in BUILDERS:
        cls = builder_class(name)
        note = _plain(
            (import_module(f"brake_fenicsx.geometry.{name}").__doc__ or "").strip().splitlines()[0]
        )
        yield f'### builder = "{name}"\n\n{note}\n\n{table(cls)}'


def _title(name: str) -> str:
    """Heading of a table."""
    name = name.replace("samples.random.NAME", 'samples.random."KEY"')
    for section in ("springs", "masses", "loads"):
        name = name.replace(f"{section}.NAME", f'{section}."PART.FACE"')
    return name


def _note(cls: Any) -> str:
    """First line of the docstring of a table after the names."""
    note = _plain((inspect.getdoc(cls) or "").splitlines()[0].rpartition("]: ")[2])
    return f"{note[:1].upper()}{note[1:]}\n\n"


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


if __name__ == "__main__":
    from generated_page import write_page

    write_page(__doc__, OUT, reference)
