"""Equilibrium -> complex modes, at full order and reduced."""

from brake_fenicsx.stability.damped_reduction import DampedReduced
from brake_fenicsx.stability.eigen import complex_modes
from brake_fenicsx.stability.interface import contact_interface
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.reduction import Reduced

__all__ = ["DampedReduced", "Modes", "Reduced", "complex_modes", "contact_interface"]
