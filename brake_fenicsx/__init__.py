"""From a scan of the pad surface to the squealing modes of a disc brake."""

from importlib import import_module
from typing import Any

__version__ = "0.2.0"

# Imported when first asked for: they bring DOLFINx and PETSc with them.
_WHERE = {
    "run": "pipeline", "assemble": "pipeline", "prepare": "model", "sample": "model",
    "sweep": "model",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Functions of the package."""
    if name in _WHERE:
        return getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
