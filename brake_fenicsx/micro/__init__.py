"""Surface -> boundary-element contact -> pressure-gap laws. Imports no dolfinx.

Each name is imported on use: laws that a formula gives need no surface.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from brake_fenicsx.micro.analytic import ExponentialLaw as ExponentialLaw
    from brake_fenicsx.micro.analytic import LinearLaw as LinearLaw
    from brake_fenicsx.micro.analytic import exponential_law as exponential_law
    from brake_fenicsx.micro.analytic import linear_law as linear_law
    from brake_fenicsx.micro.combined import OneLaw as OneLaw
    from brake_fenicsx.micro.combined import join_laws as join_laws
    from brake_fenicsx.micro.combined import scaled_laws as scaled_laws
    from brake_fenicsx.micro.hardness import HardnessFit as HardnessFit
    from brake_fenicsx.micro.hardness import fit_hardness as fit_hardness
    from brake_fenicsx.micro.law import ComputedLaw as ComputedLaw
    from brake_fenicsx.micro.law import Law as Law
    from brake_fenicsx.micro.law import LawLibrary as LawLibrary
    from brake_fenicsx.micro.law import Laws as Laws
    from brake_fenicsx.micro.law import LawSteps as LawSteps
    from brake_fenicsx.micro.law import make_library as make_library
    from brake_fenicsx.micro.law_of_surface import contact_law as contact_law
    from brake_fenicsx.micro.law_of_surface import law_steps as law_steps
    from brake_fenicsx.micro.library import LawRecipe as LawRecipe
    from brake_fenicsx.micro.library import force_above as force_above
    from brake_fenicsx.micro.library import law_library as law_library
    from brake_fenicsx.micro.library import load_laws as load_laws
    from brake_fenicsx.micro.library import save_laws as save_laws
    from brake_fenicsx.micro.loading import ContactSolution as ContactSolution
    from brake_fenicsx.micro.loading import solve_contact as solve_contact
    from brake_fenicsx.micro.settings import LawSettings as LawSettings
    from brake_fenicsx.micro.settings import plane_strain_modulus as plane_strain_modulus
    from brake_fenicsx.micro.settings import (
        transversely_isotropic_modulus as transversely_isotropic_modulus,
    )

_NAMES = {
    "analytic": "ExponentialLaw LinearLaw exponential_law linear_law",
    "combined": "OneLaw join_laws scaled_laws",
    "hardness": "HardnessFit fit_hardness",
    "law": "ComputedLaw Law LawLibrary LawSteps Laws make_library",
    "law_of_surface": "contact_law law_steps",
    "library": "LawRecipe force_above law_library load_laws save_laws",
    "loading": "ContactSolution solve_contact",
    "settings": "LawSettings plane_strain_modulus transversely_isotropic_modulus",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
