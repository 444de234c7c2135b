"""The scene: reading, checking, and what it comes to in SI units."""

from brake_fenicsx.scene.contact_section import ContactTable, Friction, LawTable
from brake_fenicsx.scene.parts_section import BUILDERS, MaterialTable, MeshTable, Part
from brake_fenicsx.scene.read import read_scene
from brake_fenicsx.scene.samples_section import Classical, Design, Distribution, Samples
from brake_fenicsx.scene.scene import STAGES, Scene, scene_type
from brake_fenicsx.scene.stability_section import Stability
from brake_fenicsx.scene.surface_section import Micro, Statistics, Surface

__all__ = [
    "BUILDERS", "STAGES", "Classical", "ContactTable", "Design", "Distribution", "Friction",
    "LawTable", "MaterialTable", "MeshTable", "Micro", "Part", "Samples", "Scene", "Stability",
    "Statistics", "Surface", "read_scene", "scene_type",
]  # fmt: skip
