"""Operators -> braking equilibrium."""

from brake_fenicsx.macro.braking import equilibrium
from brake_fenicsx.macro.contact_forces import EnrichedGap, draw_critical_gaps, draw_waviness
from brake_fenicsx.macro.equilibrium import displacement

__all__ = ["EnrichedGap", "displacement", "draw_critical_gaps", "draw_waviness", "equilibrium"]
