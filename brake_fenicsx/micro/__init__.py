"""Surface -> boundary-element contact -> pressure-gap laws. Imports no dolfinx."""

from brake_fenicsx.micro.analytic import (
    ExponentialLaw,
    LinearLaw,
    OneLaw,
    exponential_law,
    linear_law,
)
from brake_fenicsx.micro.contact_law import contact_law, law_steps
from brake_fenicsx.micro.law import ComputedLaw, Law, LawLibrary, Laws, make_library
from brake_fenicsx.micro.library import (
    LawRecipe,
    force_above,
    law_library,
    load_laws,
    save_laws,
)
from brake_fenicsx.micro.loading import ContactSolution, solve_contact
from brake_fenicsx.micro.modulus import plane_strain_modulus, transversely_isotropic_modulus

__all__ = [
    "ComputedLaw",
    "ContactSolution",
    "ExponentialLaw",
    "Law",
    "LawLibrary",
    "LawRecipe",
    "Laws",
    "LinearLaw",
    "OneLaw",
    "contact_law",
    "exponential_law",
    "force_above",
    "law_library",
    "law_steps",
    "linear_law",
    "load_laws",
    "make_library",
    "plane_strain_modulus",
    "save_laws",
    "solve_contact",
    "transversely_isotropic_modulus",
]
