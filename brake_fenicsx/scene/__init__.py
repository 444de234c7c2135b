"""The scene: reading, checking, and what it comes to in SI units."""

from .contact_section import ContactTable, Friction, LawTable, Micro, Statistics, Surface
from .parts_section import BUILDERS, MaterialTable, MeshTable, Part
from .read import read_scene
from .samples_section import Classical, Design, Distribution, Samples
from .scene import STAGES, Scene, scene_type
from .stability_section import Stability

__all__ = [
    "BUILDERS", "STAGES", "Classical", "ContactTable", "Design", "Distribution", "Friction",
    "LawTable", "MaterialTable", "MeshTable", "Micro", "Part", "Samples", "Scene", "Stability",
    "Statistics", "Surface", "read_scene", "scene_type",
]  # fmt: skip
