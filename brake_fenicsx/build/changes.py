"""Bodies that change from sample to sample: random and swept materials, lengths and damping.

The stiffness is linear in the C_ij of every material, the mass in its densities and in masses on
faces, the damping in its scalars, and all are sums of a few functions of a length
(``macro.stretching``, ``macro.morphing``): the matrices are assembled once, and a sample's are sums
of them. The scalars of nearly all samples lie in a box that their distributions and the values of a
sweep span; the reduced model is interpolated over it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.build.brake import Brake
from brake_fenicsx.build.distributions import quantile
from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.build.material_table import (
    STIFFNESSES,
    by_material,
    constants,
    layer_materials,
    material_of,
    nominal_value,
    scene_materials,
    stiffness,
    varied_stiffness,
)
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.macro.elasticity import affine_parts, face_mass
from brake_fenicsx.macro.friction import Rotation
from brake_fenicsx.macro.layer_mass import layer_masses
from brake_fenicsx.macro.material import rotate_about_z
from brake_fenicsx.macro.matrix_series import Power
from brake_fenicsx.macro.stretching import Assembly
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import turning_parts
from brake_fenicsx.scene.samples_section import is_constant, split_key, unit_of
from brake_fenicsx.scene.scalars import SPEED, changes_bodies, is_inertia, is_length
from brake_fenicsx.scene.sweep_section import Range

from .lengths import Shapes, lengths_in, shapes_of
from .moving_contact import MovingContact

if TYPE_CHECKING:
    from brake_fenicsx.stability.substructures import Parameters

Array = NDArray[np.float64]

# Voigt indices of the nine orthotropic stiffnesses.
VOIGT = {name: (int(name[1]) - 1, int(name[2]) - 1) for name in STIFFNESSES["orthotropic"]}

TURNING = "turning"

Split = Callable[[Mesh, Assembly], dict[Power, sp.csr_matrix]]

# Probability of a constant beyond either end of the box, and how far from its centre, in half
# widths, a sample may lie and still be taken.
TAIL, BEYOND = 1e-3, 1.1


class Box:
    """The box that the scalars of the bodies of nearly all samples, and of a sweep, lie in.

    Moduli E enter as E^-1/2, between the bending of layers, which goes with 1/E, and the
    indentation of a transversely isotropic half-space, which goes with the root of a product of
    moduli: one degree less than with 1/E reaches the same error, two less than with E. Lengths
    h enter as ln h, between compression, which goes with h, and bending, with h^-3: on a block over
    a factor of two the largest error is 9e-5 so, 2.5e-3 with h, 1.1e-3 with 1/h.
    """

    def __init__(self, scene: Scene):
        """Span the box by the distributions and the swept values of the scalars."""
        self._scene = scene
        self.names: list[str] = [n for n in scene.varied if changes_bodies(scene, n)]
        ends = []
        for name in self.names:
            values = [_scaled(name, v) for v in _spanning(scene, name)]
            ends.append((min(values), max(values)))
        box: Array = np.array(ends).reshape(-1, 2)
        self.low: Array = box[:, 0]
        self.high: Array = box[:, 1]

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

    def span(self, name: str) -> tuple[float, float]:
        """Lowest and highest value of a scalar that samples are taken with, the scene's too."""
        i, usual = self.names.index(name), nominal_value(self._scene, name)
        beyond = 0.5 * (BEYOND - 1) * (self.high[i] - self.low[i])
        ends = [_unscaled(name, v) for v in (self.low[i] - beyond, self.high[i] + beyond)]
        return min(*ends, usual), max(*ends, usual)

    def part(self, name: str, share: float) -> tuple[float, float]:
        """Ends of a part of the range of a scalar, SI: about its middle, or as near as may be.

        The range of a sweep has the scene's own value in it.
        """
        i, middle = self.names.index(name), 0.0
        if self._scene.sweep is not None:
            middle = float(np.clip(0.0, *(self.point({})[i] + share * np.array([-1.0, 1.0]))))
        axis = np.eye(len(self.names))[i]
        ends = [self.values((middle + side) * axis)[name] for side in (-share, share)]
        return min(ends), max(ends)

    def values(self, x: Array) -> dict[str, float]:
        """The scalars at a point of the box, SI."""
        scaled = 0.5 * (self.low + self.high) + 0.5 * (self.high - self.low) * x
        return {n: _unscaled(n, v) for n, v in zip(self.names, scaled, strict=True)}

    def materials(self, x: Array) -> dict[str, Array]:
        """Stiffness of the materials at a point of the box [Pa], each of shape (6, 6)."""
        return changed_materials(self._scene, self.values(x))


def softening(box: Box) -> float:
    """Least r with K(x) >= r K(0) at any one thickness, as quadratic forms: of the C(x).

    Raises:
        InaccurateResult: a material is not positive definite at the centre of the box or a corner.
    """
    centre, least = np.zeros(len(box.names)), 1.0
    corners = product(*((-1.0, 1.0) if is_constant(n) else (0.0,) for n in box.names))
    usual = _definite(box, centre)
    for corner in corners:
        for name, C in _definite(box, np.array(corner)).items():
            least = min(least, float(la.eigvalsh(C, usual[name])[0]))
    return least


def _definite(box: Box, x: Array) -> dict[str, Array]:
    """Stiffness of the materials at a point of the box, all positive definite."""
    found = box.materials(x)
    for name, C in found.items():
        if not la.eigvalsh(C)[0] > 0:
            own = (n for n in box.names if split_key(n)[1] == name)
            values = ", ".join(f"{n} = {box.values(x)[n]:.3g} {unit_of(n)}" for n in own)
            raise InaccurateResult(
                f"materials.{name} is not positive definite everywhere in the range of its values,"
                f" with {values} for example; narrow the range"
            )
    return found


def check_box(scene: Scene) -> None:
    """Refuse ranges of random and swept scalars that hold no material or no length.

    Raises:
        SceneError: the key and the remedy.
    """
    stability = scene.stability if "stability" in scene.stages else None
    try:
        box = Box(scene)
        if stability and (stability.method, stability.on_tolerance) == ("reduced", "warn"):
            softening(box)
    except InaccurateResult as error:
        raise SceneError(f'{scene.file}: stability.method = "reduced": {error}') from None
    except SceneError as error:
        raise SceneError(f"{scene.file}: {error}") from None


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
    least = min(values)
    possible = least >= 0 if name.endswith(".mass") else least > 0
    if not possible and (is_length(name) or is_inertia(name) or _is_modulus(name)):
        where = 'samples.random."{}"' if law is not None else 'sweep.parameters."{}"'
        raise SceneError(
            f"{where.format(name)}: the law reaches {least:.3g} {unit_of(name)} with a probability"
            f" of {TAIL:g}; write a positive min, or a smaller sd"
        )
    return values


def _scaled(name: str, value: float) -> float:
    """E^-1/2 of a modulus, the logarithm of a thickness, any other constant itself."""
    if is_length(name):
        return float(np.log(value))
    return value**-0.5 if _is_modulus(name) and value > 0 else value


def _unscaled(name: str, value: float) -> float:
    """The constant of a scaled value."""
    if is_length(name):
        return float(np.exp(value))
    return value**-2.0 if _is_modulus(name) and value > 0 else value


def _in_bodies(name: str) -> bool:
    """Whether a scalar of the bodies enters stiffness or mass, and not their damping alone."""
    return is_constant(name) or is_length(name) or is_inertia(name)


def _is_modulus(name: str) -> bool:
    """Whether a constant is positive: E, G, or on the diagonal of the stiffness."""
    constant = split_key(name)[2]
    return constant[0] in "EG" or (constant[0] == "C" and constant[1] == constant[2])


class Term(NamedTuple):
    """What a matrix that the bodies have a changing multiple of belongs to.

    Attributes:
        material: the material, or the dotted key of a mass.
        constant: C_ij of which it is a unit change; "" for its stiffness in the scene, "rho" for
            its mass, "turning" for its gyroscopic term, "mass" for 1 kg on a face.
        lengths: scalars that the layers follow; none of the other layers of the material.
        power: number of the function of these lengths.
    """

    material: str
    constant: str
    lengths: tuple[str, ...] = ()
    power: Power = ()


@dataclass(frozen=True, slots=True)
class ChangingBodies:
    """What changes in the bodies, as multiples of matrices.

    Attributes:
        scene: the scene.
        box: the box of the scalars that the bodies depend on.
        nominal: changed material -> its stiffness in the scene [Pa], shape (6, 6).
        changes: term -> stiffness [N/m], of a C_ij [N/m per Pa], mass [kg], or gyroscopic term
            [N s/m].
        slopes: scalar that the damping alone depends on -> its unit change [N s/m].
        shapes: lengths of the same layers, by their dotted keys -> what they do.
        contact: the contact elements, which some of these move.
    """

    scene: Scene
    box: Box
    nominal: dict[str, Array]
    changes: dict[Term, sp.csr_matrix]
    slopes: dict[str, sp.csr_matrix]
    shapes: Shapes
    contact: MovingContact

    @property
    def matrices(self) -> list[sp.csr_matrix]:
        """Those of the stiffness and the mass, then those of the damping alone."""
        return [*self.changes.values(), *self.slopes.values()]

    @property
    def parameters(self) -> Parameters:
        """What the reduced model interpolates over."""
        from brake_fenicsx.stability.substructures import Parameters

        names = self.box.names
        shapes = tuple(i for i, n in enumerate(names) if is_length(n) or is_inertia(n))
        sliding = tuple(i for i, name in enumerate(names) if name in self.contact.names)
        return Parameters(
            len(names), self.coefficients, softening(self.box), shapes, sliding,
            self._contact if sliding else None, tuple(names),
        )  # fmt: skip

    def _contact(self, x: Array) -> tuple[dict[str, sp.csr_matrix], Array]:
        """Rows and areas of the contact elements at a point of the box."""
        found = self.contact.at(self.box.values(x))
        return {"N": found.N, "T": found.T, "R": found.R}, found.w

    def changed_by(self, values: Mapping[str, float]) -> bool:
        """Whether stiffness or mass of the bodies depend on one of some scalars."""
        return any(_in_bodies(n) for n in values if n in self.box.names)

    def check_range(self, values: Mapping[str, float]) -> None:
        """Refuse lengths that the matrices do not reach.

        Raises:
            SceneError: the length, its value and the range.
        """
        for names, shape in self.shapes.items():
            ends = getattr(shape, "ends", [(0.0, np.inf)])
            lengths = lengths_in(names, shape, values)
            for name, length, (low, high) in zip(names, lengths, ends, strict=True):
                if not low <= length <= high:
                    raise SceneError(
                        f"{name} = {length:g} m: lies beyond the range that was prepared,"
                        f" {low:.4g} to {high:.4g} m; widen that, or write min and max of the law"
                    )

    def coefficients(self, x: Array) -> Array:
        """Coefficients of the matrices at a point of the box; see ``coefficients_of``."""
        return self.coefficients_of(self.box.values(x))

    def coefficients_of(self, values: Mapping[str, float]) -> Array:
        """Coefficients of the matrices in stiffness, damping and mass, shape (3, matrices).

        Args:
            values: scalars that differ from the scene, by dotted key, SI.
        """
        C = {**self.nominal, **changed_materials(self.scene, values)}
        out, shares = np.zeros((3, len(self.matrices))), self._shares(values)
        heavier = {
            split_key(n)[1]: v / nominal_value(self.scene, n)
            for n, v in values.items()
            if n in self.box.names and split_key(n)[2] == "rho"
        }
        for j, (material, constant, names, power) in enumerate(self.changes):
            factor, usual_factor, is_mass = 1.0, 1.0, constant in ("rho", "mass")
            inertia = constant in ("rho", TURNING)
            if shape := self.shapes.get(names):
                at = lengths_in(names, shape, values)
                factor = shape.factor(power, at, inertia)
                usual_factor = shape.factor(power, shape.usual, inertia)
            if constant in VOIGT:
                change = factor * (C[material] - self.nominal[material])[VOIGT[constant]]
            elif constant == "mass":
                usual = nominal_value(self.scene, material)
                change = values.get(material, usual) - usual
            else:
                change = factor * (heavier.get(material, 1.0) if inertia else 1.0) - usual_factor
            if constant == TURNING:
                usual = nominal_value(self.scene, SPEED)
                out[1, j] = change * values.get(SPEED, usual) / usual
                continue
            out[2 if is_mass else 0, j] = change
            out[1, j] = change * shares["" if is_mass else material]
        for j, name in enumerate(self.slopes, len(self.changes)):
            usual = nominal_value(self.scene, name)
            out[1, j] = values.get(name, usual) - usual
        return out

    def stiffness_change(self, values: Mapping[str, float]) -> sp.csr_matrix:
        """What some scalars, by dotted key, SI, add to the stiffness of the scene [N/m]."""
        return self.combined(self.coefficients_of(values)[0])

    def damping_change(self, values: Mapping[str, float]) -> sp.csr_matrix:
        """What they add to the damping of the scene's bodies [N s/m]."""
        return self.combined(self.coefficients_of(values)[1])

    def mass_change(self, values: Mapping[str, float]) -> sp.csr_matrix:
        """What they add to the mass [kg]."""
        return self.combined(self.coefficients_of(values)[2])

    def _shares(self, values: Mapping[str, float]) -> dict[str, float]:
        """Share that the damping takes of the stiffness of each material [s], "": of the mass."""
        from brake_fenicsx.build.damping_terms import mass_share, stiffness_share

        materials = {term.material for term in self.changes if term.constant != "mass"}
        shares = {m: stiffness_share(self.scene, m, values) for m in materials}
        return shares | {"": mass_share(self.scene, values)}

    def combined(self, coefficients: Array) -> sp.csr_matrix:
        """Sum of multiples of the matrices."""
        parts = self.matrices
        none = sp.csr_matrix(parts[0].shape)
        return sum((c * part for c, part in zip(coefficients, parts, strict=True) if c), none)


def assemble_changes(scene: Scene, brake: Brake) -> ChangingBodies:
    """Assemble what the random and swept scalars of a scene change in its bodies.

    Args:
        scene: the scene.
        brake: its operators.

    Raises:
        SceneError: a face in use grows with a thickness.
    """
    mesh, free = brake.mesh, brake.elastic.free
    varied, box = by_material(dict.fromkeys(scene.varied)), Box(scene)
    shapes = shapes_of(scene, mesh, {n: box.span(n) for n in filter(is_length, box.names)})
    shaped = {layer: names for names, shape in shapes.items() for layer in shape.layers}
    densities = {split_key(n)[1] for n in box.names if split_key(n)[2] == "rho"}
    found: dict[Term, sp.csr_matrix] = {}

    def assemble(changes: Mapping[str, Array]) -> sp.csr_matrix:
        return affine_parts(mesh, free, [changes])[0]

    def weigh(density: Mapping[str, float]) -> sp.csr_matrix:
        return sum(layer_masses(mesh, free, density, lumped).values())

    def follow(term: Term, split: Split, make: Callable[..., sp.csr_matrix], own: Any) -> None:
        for power, matrix in split(mesh, partial(make, own)).items():
            # The matrices of the scene have what depends neither on a length nor on a density.
            dense = term.constant in ("rho", TURNING) and term.material in densities
            if any(power) or term.constant in VOIGT or dense:
                found[term._replace(power=power)] = matrix

    for material, constants_of in varied.items():
        for constant in moved_entries(scene, material, [*constants_of]):
            changes = unit_change(scene, mesh, material, constant)
            for names in ((), *shapes):
                own = {layer: C for layer, C in changes.items() if shaped.get(layer, ()) == names}
                if own:
                    split = shapes[names].stiffness if names else _whole
                    follow(Term(material, constant, names), split, assemble, own)
    lumped, turns, motion = scene.mesh.mass == "lumped", turning_parts(scene), scene_motion(scene)
    layers, groups = layer_materials(scene, scene_materials(scene), mesh.layers), dict[Any, Any]()
    for layer, m in layers.items():
        material, names = material_of(scene, layer), shaped.get(layer, ())
        if names or material in densities:
            groups.setdefault((material, names), {})[layer] = m
    for (material, names), own in groups.items():
        term, inertia = Term(material, "", names), shapes[names].inertia if names else _whole
        if names:
            follow(term, shapes[names].stiffness, assemble, {n: m.C for n, m in own.items()})
        follow(term._replace(constant="rho"), inertia, weigh, {n: m.rho for n, m in own.items()})
        turning = {n: m.rho for n, m in own.items() if n.partition(".")[0] in turns}
        if turning and isinstance(motion, Rotation):
            from brake_fenicsx.stability.damping_matrices import gyroscopic

            turn = partial(gyroscopic, mesh, free, rotation=motion)
            follow(term._replace(constant=TURNING), inertia, turn, turning)
    for name in box.names:
        if split_key(name)[2] == "mass":
            found[Term(name, "mass")] = face_mass(mesh, free, split_key(name)[1], lumped)
    _share_patterns([*found.values()])
    slopes: dict[str, sp.csr_matrix] = {}
    if damping := [n for n in box.names if not _in_bodies(n)]:
        from brake_fenicsx.build.damping_terms import damping_slopes

        slopes = damping_slopes(scene, brake, damping)
    nominal = {name: stiffness(scene.materials[name]) for name in varied}
    contact = MovingContact(scene, brake, shapes)
    return ChangingBodies(scene, box, nominal, found, slopes, shapes, contact)


def _whole(_: Mesh, assemble: Assembly) -> dict[Power, sp.csr_matrix]:
    """A matrix of layers that no length changes."""
    return {(): assemble()}


def _share_patterns(matrices: list[sp.csr_matrix]) -> None:
    """Let matrices of one pattern, such as the changes of one material, share its arrays."""
    patterns: list[sp.csr_matrix] = []
    for A in matrices:
        for B in patterns:
            if np.array_equal(A.indptr, B.indptr) and np.array_equal(A.indices, B.indices):
                A.indices, A.indptr = B.indices, B.indptr
                break
        else:
            patterns.append(A)


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
        if material_of(scene, layer) == material:
            part = scene.parts[layer.partition(".")[0]]
            angle = part.axis + scene.materials[material].axis
            changes[layer] = rotate_about_z(unit, angle)
    return changes
