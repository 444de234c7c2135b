"""Limit cycles: the amplitude at which the growth of a squealing mode ends."""

from .contact_forces import PatchForces
from .growth import Branch, Cycle, follow, time_to_reach
from .harmonic_balance import HarmonicBalance, Response, Tangent, Vibration
from .reduced_bodies import ReducedBodies

__all__ = [
    "Branch",
    "Cycle",
    "HarmonicBalance",
    "PatchForces",
    "ReducedBodies",
    "Response",
    "Tangent",
    "Vibration",
    "follow",
    "time_to_reach",
]
