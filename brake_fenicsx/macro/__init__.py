"""Parts -> mesh -> operators -> braking equilibrium.

Names are imported on use: a scene without parts never loads dolfinx.
"""

from __future__ import annotations

from typing import Any

_HOME = {
    "equilibrium": "equilibrium",
    "Equilibrium": "equilibrium",
    "displacement": "equilibrium",
    "EnrichedGap": "gap",
    "draw_critical_gaps": "gap",
    "Material": "material",
    "build_mesh": "mesh",
    "assemble_brake": "brake",
    "Brake": "brake",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
