"""Equilibrium -> complex modes, at full order and reduced."""

from brake_fenicsx.stability.eigen import complex_modes
from brake_fenicsx.stability.interface import contact_interface
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.reduction import Reduced

__all__ = ["Modes", "Reduced", "complex_modes", "contact_interface"]
