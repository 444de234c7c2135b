"""Reduced model of a brake from its substructures: component mode synthesis with exact contact."""

from .contact_rows import ContactLinearisation
from .offline import reduce_bodies, shortfall
from .parameters import CONSTANT, Parameters
from .reduced_model import ReducedModel
from .substructure import Substructure, split_substructures

__all__ = [
    "CONSTANT", "ContactLinearisation", "Parameters", "ReducedModel", "Substructure",
    "reduce_bodies", "shortfall", "split_substructures",
]  # fmt: skip
