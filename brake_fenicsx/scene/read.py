"""A scene: one TOML file to checked, frozen settings in SI units."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.mesh import MeshTable, read_mesh
from brake_fenicsx.scene.rules import check_consistent
from brake_fenicsx.scene.samples import read_samples
from brake_fenicsx.scene.sections import (
    BUILDERS,
    STAGES,
    Axis,
    Contact,
    Load,
    MaterialTable,
    Micro,
    Motion,
    Part,
    Scene,
    Stability,
    Surface,
)
from brake_fenicsx.scene.tables import check_keys, override, read_table


def read_scene(file: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read and check a scene.

    Args:
        file: path of the TOML file.
        overrides: "section.key=value" of the command line; the value is TOML, or a bare string.

    Returns:
        The scene, in SI units.

    Raises:
        SceneError: one line naming file, key, value and remedy.
    """
    path = Path(file)
    try:
        table = tomllib.loads(path.read_text())
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file; give the path of a scene") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: not a TOML file: {error}") from None
    except OSError as error:
        raise SceneError(
            f"{path}: cannot be read ({error.strerror}); give the path of a scene"
        ) from None
    for text in overrides:
        override(table, text)
    try:
        return _scene(path, table)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def _scene(path: Path, table: dict[str, Any]) -> Scene:
    known = {f.name for f in fields(Scene)} - {"file", "table"}
    check_keys(table, known, "")
    stages = tuple(table.get("stages", ()))
    for stage in stages:
        if stage not in STAGES:
            raise SceneError(f"stages: unknown stage {stage!r}; use {', '.join(STAGES)}")
    stages = tuple(s for s in STAGES if s in stages)
    if not stages:
        raise SceneError(f"stages = []: nothing to do; name some of {', '.join(STAGES)}")
    one = {
        name: read_table(cls, table[name], name) if name in table else None
        for name, cls in (
            ("surface", Surface), ("micro", Micro), ("motion", Motion), ("stability", Stability)
        )
    }  # fmt: skip
    samples = read_samples(table.get("samples", {}), path.parent)
    mesh = read_mesh(table.get("mesh", {}))
    scene = Scene(
        path, table, stages, one["surface"], one["micro"],
        mesh,
        {n: _part(t, f"parts.{n}", mesh) for n, t in table.get("parts", {}).items()},
        _each(MaterialTable, table, "materials"),
        _each(Contact, table, "contact"),
        {n: _support(t, f"supports.{n}") for n, t in table.get("supports", {}).items()},
        _each(Load, table, "loads"),
        one["motion"], one["stability"], samples,
    )  # fmt: skip
    check_consistent(scene)
    return scene


def _each(cls: Any, table: dict[str, Any], section: str) -> dict[str, Any]:
    """Read a section of named tables."""
    return {n: read_table(cls, t, f"{section}.{n}") for n, t in table.get(section, {}).items()}


def _part(table: dict[str, Any], where: str, mesh: MeshTable) -> Part:
    builder = table.get("builder")
    if builder is None and mesh.file is None:
        raise SceneError(
            f"{where}.builder: missing; use one of {', '.join(BUILDERS)}, or name a mesh.file"
        )
    if builder is not None and builder not in BUILDERS:
        raise SceneError(f"{where}.builder = {builder!r}: use one of {', '.join(BUILDERS)}")
    if "material" not in table:
        raise SceneError(f"{where}: no material; write material = NAME, or one NAME for each layer")
    material = table["material"]
    rest = {k: v for k, v in table.items() if k not in ("builder", "material", "axis")}
    turn = {k: v for k, v in table.items() if k == "axis"}
    if builder is None:
        if rest:
            raise SceneError(f"{where}.{next(iter(rest))}: has no meaning without a builder")
        return Part(None, None, material, read_table(Axis, turn, where).axis or 0.0)
    if rest.get("shim") is False:
        rest["shim"] = 0
    module = importlib.import_module(f"brake_fenicsx.geometry.{builder}")
    parameters = read_table(getattr(module, BUILDERS[builder]), rest, where)
    axis = read_table(Axis, turn, where).axis
    if axis is None:
        axis = getattr(parameters, "axis", 0.0)
    return Part(builder, parameters, material, axis)


def _support(value: Any, where: str) -> tuple[str, ...]:
    if value == "clamped":
        return ("x", "y", "z")
    if isinstance(value, list) and value and set(value) <= {"x", "y", "z"}:
        return tuple(value)
    raise SceneError(f'{where} = {value!r}: write "clamped" or a list of "x", "y", "z"')
