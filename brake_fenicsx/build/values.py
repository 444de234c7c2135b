"""Values of a sample: every scalar of the scene that is random or swept, once.

All that differs from the scene in a sample follows from one mapping, dotted key -> SI value: the
stiffness of its materials, its lengths, masses and loads, its friction.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.material import Material
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.samples_section import is_constant, split_key
from brake_fenicsx.scene.scalars import SPEED, is_length

from .material_table import by_material, nominal_value, stiffness, varied_stiffness

Array = NDArray[np.float64]


class Values(dict[str, float]):
    """Scalars that differ from the scene, by dotted key, SI.

    Attributes:
        scene: the scene.
    """

    def __init__(self, scene: Scene, given: Mapping[str, float] | None = None):
        """Take the scalars that are given; all others have the scene's value."""
        super().__init__(given or {})
        self.scene: Scene = scene

    @classmethod
    def of(cls, scene: Scene, given: Mapping[str, float]) -> Values:
        """Some scalars as values, whose materials are computed once."""
        return given if isinstance(given, cls) else cls(scene, given)

    def value(self, name: str) -> float:
        """A scalar of the sample, or of the scene, SI."""
        return self[name] if name in self else nominal_value(self.scene, name)

    def ratio(self, name: str) -> float:
        """A scalar of the sample over that of the scene."""
        return self[name] / nominal_value(self.scene, name) if name in self else 1.0

    @cached_property
    def materials(self) -> dict[str, Array]:
        """Stiffness of each changed material in its own axes [Pa], shape (6, 6)."""
        tables = self.scene.materials
        return {m: varied_stiffness(tables[m], own) for m, own in by_material(self).items()}

    def stiffness(self, material: str) -> Array:
        """Stiffness of a material in its own axes [Pa], shape (6, 6)."""
        found = self.materials.get(material)
        return stiffness(self.scene.materials[material]) if found is None else found

    def moved(self, material: str, ij: tuple[int, int]) -> float:
        """C_ij of a material less that in the scene [Pa]."""
        if material not in self.materials:
            return 0.0
        return float((self.materials[material] - stiffness(self.scene.materials[material]))[ij])

    @property
    def pressures(self) -> Array:
        """Pressures of the loads [Pa], 1 of a force or a displacement, in the order of the names.

        Shape (loads,).
        """
        own = {split_key(n)[1]: v for n, v in self.items() if split_key(n)[0] == "loads"}
        usual = {
            face: 1.0 if load.pressure is None else load.pressure
            for face, load in sorted(self.scene.loads.items())
        }
        return np.array([own.get(face, size) for face, size in usual.items()])

    def check(self) -> None:
        """Refuse values that no brake has.

        Raises:
            SceneError: the key and its value, or the material.
        """
        for name, value in self.items():
            last = split_key(name)[2]
            if isinstance(value, str):
                raise SceneError(f"{name} = {value!r}: write a number, in SI units")
            if is_constant(name):
                continue
            if name == SPEED and not value * nominal_value(self.scene, name) > 0:
                raise SceneError(f"{name} = {value:g}: must not be zero, and have the scene's sign")
            if (last in ("penalty", "rho") or is_length(name)) and not value > 0:
                raise SceneError(f"{name} = {value:g}: must be positive")
            if name != SPEED and not value >= 0:
                raise SceneError(f"{name} = {value:g}: must be zero or more")
        for material, constants in by_material(self).items():
            table = self.scene.materials[material]
            try:
                Material(varied_stiffness(table, constants), table.rho)
            except SceneError as error:
                raise SceneError(f"materials.{material}: {error}") from None
