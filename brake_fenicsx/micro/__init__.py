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
        OneLaw,
        exponential_law,
        linear_law,
    )
    from brake_fenicsx.micro.law import ComputedLaw, Law, LawLibrary, Laws, make_library
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

_HOME = {
    "ExponentialLaw": "analytic",
    "LinearLaw": "analytic",
    "OneLaw": "analytic",
    "exponential_law": "analytic",
    "linear_law": "analytic",
    "contact_law": "law_of_surface",
    "law_steps": "law_of_surface",
    "ComputedLaw": "law",
    "Law": "law",
    "LawLibrary": "law",
    "Laws": "law",
    "make_library": "law",
    "LawRecipe": "library",
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


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
