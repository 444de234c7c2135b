"""From a scan of the pad surface to the squealing modes of a disc brake."""

from importlib import import_module

TYPE_CHECKING = False  # as in typing, whose import would take longer than all else here
if TYPE_CHECKING:
    from .model import Model, prepare, sample, sweep
    from .pipeline import assemble, run
    from .sweeps.followed import Branches

__version__ = "0.3.0"
__all__ = ["Branches", "Model", "assemble", "prepare", "run", "sample", "sweep"]

# Imported when first asked for: they bring DOLFINx and PETSc with them.


def __getattr__(name: str) -> object:
    """Functions of the package."""
    if name in __all__:
        homes = {"assemble": "pipeline", "run": "pipeline", "Branches": "sweeps.followed"}
        return getattr(import_module(f"{__name__}.{homes.get(name, 'model')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Names for completion: functions and classes, and what a module has."""
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING", "import_module"})
