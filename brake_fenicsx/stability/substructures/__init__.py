"""Reduced model of a brake from its substructures: component mode synthesis with exact contact."""

from .contact import ContactLinearisation
from .model import ReducedModel, reduced_brake
from .parameters import Parameters
from .substructure import Substructure, split_substructures

__all__ = [
    "ContactLinearisation", "Parameters", "ReducedModel", "Substructure", "reduced_brake",
    "split_substructures",
]  # fmt: skip
