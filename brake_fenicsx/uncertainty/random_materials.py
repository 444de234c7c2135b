"""Bodies that change from sample to sample: random and swept materials and damping.

The stiffness is linear in the C_ij of every material, and the damping in its scalars: matrices of
unit changes are assembled once, and a sample's are sums of them. The scalars of nearly all samples
lie in a box that their distributions and the values of a sweep span; the reduced model is
interpolated over it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.material import rotate_about_z
from brake_fenicsx.macro.material_table import (
    STIFFNESSES,
    constants,
    layer_material,
    stiffness,
    varied_stiffness,
)
from brake_fenicsx.macro.mesh import Mesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.samples import is_constant, split_key
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.scene.sweep import Range

from .designs import quantile
from .inputs import by_material, nominal_value

Array = NDArray[np.float64]

# Voigt indices of the nine orthotropic stiffnesses.
VOIGT = {name: (int(name[1]) - 1, int(name[2]) - 1) for name in STIFFNESSES["orthotropic"]}

# Probability of a constant beyond either end of the box, and how far from its centre, in half
# widths, a sample may lie and still be taken.
TAIL, BEYOND = 1e-3, 1.1


class Box:
    """The box that the scalars of the bodies of nearly all samples, and of a sweep, lie in.

    Moduli E enter as E^-1/2, between the bending of layers, which goes with 1/E, and the
    indentation of a transversely isotropic half-space, which goes with the root of a product of
    moduli: one degree less than with 1/E reaches the same error, two less than with E.
    """

    def __init__(self, scene: Scene):
        """Span the box by the distributions and the swept values of the scalars."""
        self._scene = scene
        self.names = [n for n in scene.varied if changes_bodies(scene, n)]
        ends = []
        for name in self.names:
            values = [_scaled(name, v) for v in _spanning(scene, name)]
            ends.append((min(values), max(values)))
        self.low, self.high = np.array(ends).reshape(-1, 2).T

    def point(self, drawn: Mapping[str, float]) -> Array:
        """A sample's point of [-1, 1]^d; scalars that are not drawn have the scene's value."""
        values = [
            _scaled(n, drawn[n] if n in drawn else nominal_value(self._scene, n))
            for n in self.names
        ]
        width = np.where(self.high > self.low, self.high - self.low, 1.0)
        return np.asarray((2 * np.array(values) - self.low - self.high) / width)

    def holds(self, drawn: Mapping[str, float]) -> bool:
        """Whether a sample lies in the box or hardly beyond it."""
        return bool(np.all(np.abs(self.point(drawn)) <= BEYOND))

    def values(self, x: Array) -> dict[str, float]:
        """The scalars at a point of the box, SI."""
        scaled = 0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * x
        return {n: _unscaled(n, v) for n, v in zip(self.names, scaled, strict=True)}

    def materials(self, x: Array) -> dict[str, Array]:
        """Stiffness of the materials at a point of the box [Pa], each of shape (6, 6)."""
        return changed_materials(self._scene, self.values(x))


def changed_materials(scene: Scene, values: Mapping[str, float]) -> dict[str, Array]:
    """Stiffness [Pa] of the materials of which some constants are given, each of shape (6, 6)."""
    return {m: varied_stiffness(scene.materials[m], c) for m, c in by_material(values).items()}


def _spanning(scene: Scene, name: str) -> list[float]:
    """Values of a scalar that lie in the box; a sweep has the scene's own brake in it too."""
    law, nominal = scene.samples.random.get(name), nominal_value(scene, name)
    values: list[float] = []
    if law is not None:
        values += map(float, quantile(law, [TAIL, 1 - TAIL], nominal))
    if scene.sweep is not None:
        values += [nominal, *scene.sweep.parameters.get(name, Range()).points]
    return values


def _scaled(name: str, value: float) -> float:
    """E^-1/2 of a modulus, any other constant itself."""
    return value**-0.5 if _is_modulus(name) and value > 0 else value


def _unscaled(name: str, value: float) -> float:
    """The constant of a scaled value."""
    return value**-2.0 if _is_modulus(name) and value > 0 else value


def _is_modulus(name: str) -> bool:
    """Whether a constant is positive: E, G, or on the diagonal of the stiffness."""
    constant = split_key(name)[2]
    return constant[0] in "EG" or (constant[0] == "C" and constant[1] == constant[2])


@dataclass(frozen=True, slots=True)
class RandomMaterials:
    """What changes in the bodies, by unit changes.

    Attributes:
        scene: the scene.
        box: the box of the scalars that the bodies depend on.
        nominal: changed material -> its stiffness in the scene [Pa], shape (6, 6).
        changes: (material, C_ij) -> stiffness of a unit change [N/m per Pa].
        slopes: scalar that the damping alone depends on -> its unit change [N s/m].
    """

    scene: Scene
    box: Box
    nominal: dict[str, Array]
    changes: dict[tuple[str, str], sp.csr_matrix]
    slopes: dict[str, sp.csr_matrix]

    @property
    def matrices(self) -> list[sp.csr_matrix]:
        """Unit changes of the stiffness, then those of the damping alone."""
        return [*self.changes.values(), *self.slopes.values()]

    def coefficients(self, x: Array) -> Array:
        """Coefficients of these in stiffness and damping at a point of the box, shape (2, all)."""
        values = self.box.values(x)
        a = self._coefficients({**self.nominal, **changed_materials(self.scene, values)})
        c = self._damping_coefficients(a, values)
        return np.array([[*a, *(0.0 for _ in self.slopes)], c])

    def change(self, materials: Mapping[str, Array]) -> sp.csr_matrix:
        """What some materials add to the stiffness of the scene [N/m].

        Args:
            materials: random material -> its stiffness in its own axes [Pa], shape (6, 6).
        """
        coefficients = self._coefficients({**self.nominal, **materials})
        return _combined(coefficients, [*self.changes.values()])

    def damping_change(self, values: Mapping[str, float]) -> sp.csr_matrix:
        """What a sample adds to the damping of the scene's bodies [N s/m].

        Args:
            values: its scalars that differ from the scene, by dotted key, SI.
        """
        a = self._coefficients({**self.nominal, **changed_materials(self.scene, values)})
        return _combined(self._damping_coefficients(a, values), self.matrices)

    def softening(self) -> float:
        """Least r with K(x) >= r K(0) throughout the box, as quadratic forms: of the C(x).

        Raises:
            InaccurateResult: a material is not positive definite at a corner of the box.
        """
        names = self.box.names
        centre, least = self.box.materials(np.zeros(len(names))), 1.0
        for corner in product(*((-1.0, 1.0) if is_constant(n) else (0.0,) for n in names)):
            for name, C in self.box.materials(np.array(corner)).items():
                least = min(least, float(la.eigvalsh(C, centre[name])[0]))
        if not least > 0:
            raise InaccurateResult(
                "a material is not positive definite everywhere in the box of its values"
            )
        return least

    def _coefficients(self, materials: Mapping[str, Array]) -> Array:
        return np.array(
            [(materials[m] - self.nominal[m])[VOIGT[constant]] for m, constant in self.changes]
        )

    def _damping_coefficients(self, a: Array, values: Mapping[str, float]) -> Array:
        """Those of the damping: its share of each change of stiffness, and its own scalars."""
        from brake_fenicsx.stability.damping import stiffness_share

        shares = [stiffness_share(self.scene, material, values) for material, _ in self.changes]
        own = [values.get(n, nominal_value(self.scene, n)) for n in self.slopes]
        usual = [nominal_value(self.scene, n) for n in self.slopes]
        return np.r_[a * shares, np.subtract(own, usual)]


def _combined(coefficients: Array, parts: list[sp.csr_matrix]) -> sp.csr_matrix:
    """Sum of some matrices, at least one."""
    none = sp.csr_matrix(parts[0].shape)
    return sum((c * part for c, part in zip(coefficients, parts, strict=True) if c), none)


def assemble_random(scene: Scene, brake: Brake) -> RandomMaterials:
    """Assemble the unit changes of what is random or swept in a scene's bodies.

    Args:
        scene: the scene.
        brake: its operators.
    """
    varied = by_material(dict.fromkeys(scene.varied))
    keys, directions = [], []
    for material, constants_of in varied.items():
        for constant in moved_entries(scene, material, [*constants_of]):
            keys.append((material, constant))
            directions.append(unit_change(scene, brake.mesh, material, constant))
    mesh, free = brake.mesh, brake.elastic.free
    parts: list[sp.csr_matrix] = []
    for direction in directions:
        parts += affine_parts(mesh, free, [direction])
        # Changes of one material have one pattern.
        first, last = parts[0], parts[-1]
        if np.array_equal(first.indptr, last.indptr) and np.array_equal(
            first.indices, last.indices
        ):
            last.indices, last.indptr = first.indices, first.indptr
    box, slopes = Box(scene), {}
    if names := [n for n in box.names if not is_constant(n)]:
        from brake_fenicsx.stability.damping import damping_slopes

        slopes = damping_slopes(scene, brake, names)
    return RandomMaterials(
        scene,
        box,
        {name: stiffness(scene.materials[name]) for name in varied},
        dict(zip(keys, parts, strict=True)),
        slopes,
    )


def moved_entries(scene: Scene, material: str, names: list[str]) -> list[str]:
    """Which C_ij some constants of a material move."""
    table = scene.materials[material]
    C, usual = stiffness(table), constants(table)
    moved = np.zeros((6, 6), dtype=bool)
    for name in names:
        change = varied_stiffness(table, {name: usual[name] * 1.001 or 1e-3}) - C
        moved |= np.abs(change) > 1e-9 * np.abs(C).max()
    return [constant for constant, index in VOIGT.items() if moved[index]]


def unit_change(scene: Scene, mesh: Mesh, material: str, constant: str) -> dict[str, Array]:
    """Change of every layer's stiffness under one of a material's C_ij, in x, y, z axes."""
    unit = np.zeros((6, 6))
    i, j = VOIGT[constant]
    unit[i, j] = unit[j, i] = 1.0
    changes = {}
    for layer in mesh.layers:
        name, _, inner = layer.partition(".")
        if layer_material(scene.parts[name].material, inner) == material:
            angle = scene.parts[name].axis + scene.materials[material].axis
            changes[layer] = rotate_about_z(unit, angle)
    return changes
