"""The scene: reading, checking, and what it comes to in SI units."""

from .contact_section import ContactTable, Friction, LawTable, Micro, Statistics
from .parts_section import BUILDERS, MaterialTable
from .read import read_scene
from .samples_section import Distribution, Samples
from .scene import STAGES, Scene, scene_type
from .stability_section import Stability

__all__ = [
    "BUILDERS", "STAGES", "ContactTable", "Distribution", "Friction", "LawTable", "MaterialTable",
    "Micro", "Samples", "Scene", "Stability", "Statistics", "read_scene", "scene_type",
]  # fmt: skip
