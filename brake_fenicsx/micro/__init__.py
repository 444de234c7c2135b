"""Surface -> boundary-element contact -> pressure-gap laws. Imports no dolfinx."""

from brake_fenicsx.micro.law import (
    ComputedLaw,
    ExponentialLaw,
    Law,
    LawLibrary,
    Laws,
    LinearLaw,
    OneLaw,
    exponential_law,
    linear_law,
    make_library,
)
from brake_fenicsx.micro.library import contact_law, law_steps, load_laws, save_laws
from brake_fenicsx.micro.loading import ContactSolution, solve_contact

__all__ = [
    "ComputedLaw",
    "ContactSolution",
    "ExponentialLaw",
    "Law",
    "LawLibrary",
    "Laws",
    "LinearLaw",
    "OneLaw",
    "contact_law",
    "exponential_law",
    "law_steps",
    "linear_law",
    "load_laws",
    "make_library",
    "save_laws",
    "solve_contact",
]
