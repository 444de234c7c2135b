"""Surface -> boundary-element contact -> pressure-gap laws. Imports no dolfinx.

Each name is imported on use: laws that a formula gives need no surface.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .combined import OneLaw, exponential_law, join_laws, linear_law, scaled_laws
    from .hardness import fit_hardness
    from .law import Law, LawLibrary, LawSteps, make_library
    from .law_of_surface import (
        LawSettings,
        contact_law,
        law_steps,
        plane_strain_modulus,
        transversely_isotropic_modulus,
    )
    from .library import LawRecipe, force_above, law_library, load_laws, save_laws
    from .loading import solve_contact

__all__ = [
    "Law", "LawLibrary", "LawRecipe", "LawSettings", "LawSteps", "OneLaw", "contact_law",
    "exponential_law", "fit_hardness", "force_above", "join_laws", "law_library", "law_steps",
    "linear_law", "load_laws", "make_library", "plane_strain_modulus", "save_laws", "scaled_laws",
    "solve_contact", "transversely_isotropic_modulus",
]  # fmt: skip
# In the order of what they import: a name is looked for in the lightest module that has it.
_MODULES = ("combined", "law", "loading", "law_of_surface", "library", "hardness")


def __getattr__(name: str) -> Any:
    for module in _MODULES if name in __all__ else ():
        found = getattr(import_module(f"{__name__}.{module}"), name, None)
        if found is not None:
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
