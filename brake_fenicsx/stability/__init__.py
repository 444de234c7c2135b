"""Equilibrium -> complex modes, at full order and reduced."""

from brake_fenicsx.stability.eigen import complex_modes
from brake_fenicsx.stability.full.interface import contact_interface
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.substructures import (
    ContactLinearisation,
    Parameters,
    ReducedModel,
    reduce_bodies,
    split_substructures,
)
from brake_fenicsx.stability.substructures.offline import Reduced

__all__ = [
    "ContactLinearisation", "Modes", "Parameters", "Reduced", "ReducedModel", "complex_modes",
    "contact_interface", "reduce_bodies", "split_substructures",
]  # fmt: skip
