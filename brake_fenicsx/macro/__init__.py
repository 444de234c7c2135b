"""Operators -> braking equilibrium."""

from brake_fenicsx.macro.braking import equilibrium
from brake_fenicsx.macro.equilibrium import Equilibrium, displacement
from brake_fenicsx.macro.gap import EnrichedGap, draw_critical_gaps, draw_waviness

__all__ = [
    "EnrichedGap",
    "Equilibrium",
    "displacement",
    "draw_critical_gaps",
    "draw_waviness",
    "equilibrium",
]
