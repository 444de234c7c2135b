"""What a scene comes to: its settings in effect, and hashes of what results depend on."""

import hashlib
import math
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from brake_fenicsx import __version__
from brake_fenicsx.extensions import extras, named
from brake_fenicsx.folder.files import digest

from . import LawTable, Samples, Scene, contact_section, scalars

# Format of laws and samples on disk: what older programs wrote is not read as current.
FORMAT = 4

# Sections whose numbers change no result of a sample, or of which only some do; with those of
# extras that compute nothing beside samples.
NO_RESULT = ("stages", "samples", "sweep", "extensions")

# Keys of an interface that mesh, matrices and contact elements do not depend on.
_LAWS = ("law", "gap", "friction", "friction_in_equilibrium", "surface")


def in_effect(scene: Scene) -> dict[str, Any]:
    """All settings of a scene, in SI units; what is neither given nor has a default is left out.

    Args:
        scene: the scene.

    Returns:
        Section -> its settings, as plain values.
    """
    names = (f.name for f in fields(scene) if not f.metadata.get("internal"))
    return _plain({name: getattr(scene, name) for name in names})


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        value = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, dict):
        return {str(k): v for k, v in ((k, _plain(v)) for k, v in value.items()) if _said(v)}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, str | int | float | bool | None):
        return value
    return str(value) if isinstance(value, Path) else type(value).__name__


def _said(value: Any) -> bool:
    """Neither nothing, nor empty, nor a bound that is none."""
    if isinstance(value, float):
        return math.isfinite(value)
    return value is not None and value not in ("", [], {})


def result_digest(scene: Scene) -> str:
    """Hash of all that the results of a sample depend on."""
    aside = {*NO_RESULT, *(key for e in extras() if not e.samples for key in e.sections)}
    table = {k: v for k, v in scene.table.items() if k not in aside}
    for name, f, _ in _keys_of_extras(scene, "aside"):
        table[name] = {k: v for k, v in table.get(name, {}).items() if k != f}
    # What counts as squeal changes no result of a sample but what extras make of modes that squeal.
    if "stability" in table and not any(extra.of_squeal for extra in named(scene)):
        table["stability"] = {k: v for k, v in table["stability"].items() if k != "threshold"}
    # The reduced model of all samples reaches over the values of a sweep that changes the bodies.
    swept = scene.sweep.parameters if scene.sweep else {}
    laws = {n: c.law.steps for n, c in scene.contact.items() if isinstance(c.law, LawTable)}
    more = {
        "sweep": {k: r.points for k, r in swept.items() if scalars.changes_bodies(scene, k)},
        "extensions": scene.own.marks,
        "laws": {n: steps for n, steps in laws.items() if steps},
        **_inputs(scene.samples),
    }
    content = {**table, **{name: value for name, value in more.items() if value}}
    left_out = ("n", "approaches", "limit")
    samples = {k: v for k, v in scene.table.get("samples", {}).items() if k not in left_out}
    return digest({**content, "samples": samples, "files": file_digests(scene), "format": FORMAT})


def _inputs(s: Samples) -> dict[str, Any]:
    """What the random inputs of a sample depend on beside their keys."""
    # The points of a design belong together; parametric and joint take the inputs from multi-scale.
    plans = [s.plan(a) for a in s.approaches if s.takes_random(a) and not s.plan(a).grows]
    crossed = {p: ["roughness"] * (p.rough and p.design == "saltelli") for p in plans}
    alone = s.random and {"parametric", "joint"} & {*s.approaches}
    return {
        "designs": [[p.n, p.design, p.curves, *crossed[p]] for p in plans],
        "multi-scale": "roughness alone" if alone else "",
        "measured": {n: text for n, d in s.random.items() if (text := getattr(d, "digest", ""))},
    }


def bodies_key(scene: Scene) -> dict[str, Any]:
    """Key of the bodies: what mesh, matrices and contact elements of a scene depend on."""
    names = ("parts", "mesh", "materials", "supports", "springs", "masses")
    out: dict[str, Any] = {name: scene.table.get(name) for name in names}
    if "ties" in scene.table:
        out["ties"] = scene.table["ties"]
    out["contact"] = {
        name: {k: v for k, v in table.items() if k not in _LAWS}
        for name, table in scene.table.get("contact", {}).items()
    }
    out["loads"] = [
        face if load.pressure is not None else [face, load.force, load.moment, load.displacement]
        for face, load in sorted(scene.loads.items())
    ]
    out["motion"] = {k: v for k, v in scene.table.get("motion", {}).items() if k != "speed"}
    if scene.own.marks:
        out["extensions"] = scene.own.marks
    out["files"] = _files(scene, "mesh.", "parts.")
    versions = (getattr(sys.modules.get(name), "__version__", "") for name in ("dolfinx", "gmsh"))
    return {**out, "versions": [__version__, *map(str, versions)]}


def laws_key(scene: Scene) -> dict[str, Any]:
    """Key of the laws: what the laws of a scene depend on."""
    surface = scene.table.get("surface")
    out = {"surface": surface, "micro": scene.table.get("micro"), "versions": [__version__, FORMAT]}
    out["patch"] = scene.micro.patch if scene.micro else None  # that of the mesh as a length
    return {**out, "files": _files(scene, "surface.")}


def file_digests(scene: Scene) -> dict[str, str]:
    """Hash of the content of each file, by the key that names it; of files that are there.

    Args:
        scene: the scene.
    """
    files = {"mesh.file": scene.mesh.file, **_surface_files("surface", scene.surface)}
    for name, contact in scene.contact.items():
        files |= _surface_files(f"contact.{name}.surface", contact.surface)
    for name, part in scene.parts.items():
        for f in fields(part.matrices) if part.matrices else ():
            if isinstance(value := getattr(part.matrices, f.name), str):
                files[f"parts.{name}.matrices.{f.name}"] = value
        files |= {f"parts.{name}.morph.{n}": m.displaced for n, m in part.morph.items()}
    for section, name, value in _keys_of_extras(scene, "file"):
        named = value.values() if isinstance(value, dict) else value
        each = (value,) if isinstance(value, str) else named or ()
        files |= {f"{section}.{name}.{k}": file for k, file in enumerate(each)}
    paths = {key: scene.path(file) for key, file in files.items() if file is not None}
    return {
        key: hashlib.sha256(path.read_bytes()).hexdigest()
        for key, path in paths.items()
        if path.is_file()
    }


def _surface_files(where: str, surface: contact_section.Surface | None) -> dict[str, str | None]:
    """Files of a surface by the key that names each."""
    if surface is None:
        return {}
    numbers = [f".{k}" for k in range(1, len(surface.scans) + 1)] if surface.scans[1:] else [""]
    scans = {f"{where}.scan{k}": file for k, file in zip(numbers, surface.scans, strict=False)}
    return {f"{where}.form": surface.form, **scans}


def _keys_of_extras(scene: Scene, mark: str) -> Iterator[tuple[str, str, Any]]:
    """Section, name and value of the keys of extras that have a mark in their metadata.

    Args:
        scene: the scene.
        mark: "file" of those that name files, "aside" of those that change no sample.
    """
    for name in (name for extra in extras() for name in extra.sections):
        section = scene.section(name)
        for f in fields(section) if is_dataclass(section) else ():
            if f.metadata.get(mark):
                yield name, f.name, getattr(section, f.name)


def _files(scene: Scene, *sections: str) -> dict[str, str]:
    return {key: d for key, d in file_digests(scene).items() if key.startswith(sections)}
