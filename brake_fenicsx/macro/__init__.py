"""Parts -> mesh -> operators -> braking equilibrium.

What needs dolfinx is imported on use.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from brake_fenicsx.macro.braking import equilibrium
from brake_fenicsx.macro.equilibrium import Equilibrium, displacement
from brake_fenicsx.macro.gap import EnrichedGap, draw_critical_gaps, draw_waviness

_HOME = {"assemble_brake": "brake", "Brake": "brake", "build_mesh": "mesh", "PartBuilder": "mesh"}
__all__ = [
    "Equilibrium",
    "EnrichedGap",
    "displacement",
    "draw_critical_gaps",
    "draw_waviness",
    "equilibrium",
    *_HOME,
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
