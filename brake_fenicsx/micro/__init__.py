"""Surface -> boundary-element contact -> pressure-gap laws. Imports no dolfinx.

Each name is imported on use: laws that a formula gives need no surface.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from brake_fenicsx.micro.analytic import (
        ExponentialLaw,
        LinearLaw,
        exponential_law,
        linear_law,
    )
    from brake_fenicsx.micro.combined import OneLaw, join_laws, scaled_laws
    from brake_fenicsx.micro.law import ComputedLaw, Law, LawLibrary, Laws, LawSteps, make_library
    from brake_fenicsx.micro.law_of_surface import contact_law, law_steps
    from brake_fenicsx.micro.library import (
        LawRecipe,
        force_above,
        law_library,
        load_laws,
        save_laws,
    )
    from brake_fenicsx.micro.loading import ContactSolution, solve_contact
    from brake_fenicsx.micro.modulus import plane_strain_modulus, transversely_isotropic_modulus
    from brake_fenicsx.micro.settings import LawSettings

_HOME = {
    "ExponentialLaw": "analytic",
    "LinearLaw": "analytic",
    "OneLaw": "combined",
    "join_laws": "combined",
    "scaled_laws": "combined",
    "exponential_law": "analytic",
    "linear_law": "analytic",
    "contact_law": "law_of_surface",
    "law_steps": "law_of_surface",
    "ComputedLaw": "law",
    "Law": "law",
    "LawLibrary": "law",
    "LawSteps": "law",
    "Laws": "law",
    "make_library": "law",
    "LawRecipe": "library",
    "LawSettings": "settings",
    "force_above": "library",
    "law_library": "library",
    "load_laws": "library",
    "save_laws": "library",
    "ContactSolution": "loading",
    "solve_contact": "loading",
    "plane_strain_modulus": "modulus",
    "transversely_isotropic_modulus": "modulus",
}
__all__ = [
    "ComputedLaw",
    "ContactSolution",
    "ExponentialLaw",
    "Law",
    "LawLibrary",
    "LawRecipe",
    "LawSettings",
    "LawSteps",
    "Laws",
    "LinearLaw",
    "OneLaw",
    "contact_law",
    "exponential_law",
    "force_above",
    "join_laws",
    "law_library",
    "law_steps",
    "linear_law",
    "load_laws",
    "make_library",
    "plane_strain_modulus",
    "save_laws",
    "scaled_laws",
    "solve_contact",
    "transversely_isotropic_modulus",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
