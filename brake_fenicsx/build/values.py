"""Values of a sample: every scalar of the scene that is random or swept, once.

All that differs from the scene in a sample follows from one mapping, dotted key -> SI value: the
stiffness of its materials, its lengths, masses and loads, its friction.

Laws of random inputs give values by their quantiles, from a point of the unit interval. Cutting at
min and max shrinks the interval of probabilities, so that no point is wasted and a design keeps its
structure.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from brake_fenicsx.errors import SceneError, located
from brake_fenicsx.extensions import InputLaw
from brake_fenicsx.macro.material import Material
from brake_fenicsx.scene import Distribution, Scene
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
            with located(f"materials.{material}"):
                Material(varied_stiffness(table, constants), table.rho)


def quantile(d: Distribution | InputLaw, u: ArrayLike, nominal: float = np.nan) -> Array:
    """Values of a law at some probabilities.

    Args:
        d: the law, in SI units, or one of a user's own.
        u: probabilities, in [0, 1].
        nominal: the value in the scene, which ``spread`` refers to, SI.

    Returns:
        Values, same shape.
    """
    u = np.asarray(u, float)
    if not isinstance(d, Distribution):
        return d.quantile(u, nominal)
    if d.law == "uniform":
        low, high = d.min, d.max
        if d.spread is not None:
            low, high = nominal * (1 - d.spread), nominal * (1 + d.spread)
        return np.asarray(low + u * (high - low))
    if d.law == "measured":
        values = np.sort([v for v in d.values if d.min <= v <= d.max])
        return values[np.minimum((u * values.size).astype(int), values.size - 1)]
    if d.mean is None or d.sd is None:
        raise SceneError(f"samples.random: a {d.law} law needs mean and sd")
    if d.law == "normal":
        return d.mean + d.sd * _normal(u, (d.min - d.mean) / d.sd, (d.max - d.mean) / d.sd)
    # Mean and standard deviation of the logarithm from those of the value.
    variance = np.log1p((d.sd / d.mean) ** 2)
    sd = np.sqrt(variance)
    low, high = np.log(d.min) if d.min > 0 else -np.inf, np.log(d.max)
    mean = np.log(d.mean) - 0.5 * variance
    return np.asarray(np.exp(mean + sd * _normal(u, (low - mean) / sd, (high - mean) / sd)))


def _normal(u: Array, low: float, high: float) -> Array:
    """Quantiles of the standard normal law between two bounds."""
    if low > 0:
        # Probabilities next to 1 have no digits left; those next to 0 have.
        return -_normal(1 - u, -high, -low)
    first, last = special.ndtr(low), special.ndtr(high)
    return np.asarray(special.ndtri(first + u * (last - first)))
