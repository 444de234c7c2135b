"""What a scene comes to: its keys and the defaults of those it leaves out, in SI units."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from brake_fenicsx.scene import Scene

# What is no setting.
_OTHER = ("file", "table", "own")


def in_effect(scene: Scene) -> dict[str, Any]:
    """All settings of a scene, in SI units; what is neither given nor has a default is left out.

    Args:
        scene: the scene.

    Returns:
        Section -> its settings, as plain values.
    """
    sections = {f.name: _plain(getattr(scene, f.name)) for f in fields(scene)}
    return {name: value for name, value in sections.items() if name not in _OTHER and _said(value)}


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
