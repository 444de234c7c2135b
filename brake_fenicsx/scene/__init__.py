"""The scene: reading, checking, and what it comes to in SI units."""

from brake_fenicsx.scene.contact import ContactTable, Friction, LawTable
from brake_fenicsx.scene.mesh import MeshTable
from brake_fenicsx.scene.parts import BUILDERS, Part
from brake_fenicsx.scene.read import read_scene
from brake_fenicsx.scene.samples import Classical, Design, Distribution, Samples
from brake_fenicsx.scene.sections import STAGES, MaterialTable, Scene, Stability, scene_type
from brake_fenicsx.scene.surface import Micro, Statistics, Surface

__all__ = [
    "BUILDERS", "STAGES", "Classical", "ContactTable", "Design", "Distribution", "Friction",
    "LawTable", "MaterialTable", "MeshTable", "Micro", "Part", "Samples", "Scene", "Stability",
    "Statistics", "Surface", "read_scene", "scene_type",
]  # fmt: skip
