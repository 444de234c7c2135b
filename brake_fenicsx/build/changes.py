"""Matrices of a brake by the scalars of its scene: materials, lengths, masses and damping.

The stiffness is linear in the C_ij of every material, the mass in its densities and in masses on
faces, the damping in its scalars, and all are sums of a few functions of a length
(``macro.stretching``, ``macro.morphing``). So the matrices of a sample are those of the scene and

    sum_j  (m_j(values) - m_j(scene)) A_j,

of matrices A_j that are assembled once and multiples m_j of the values, one row of a table each:

    C_ij of a material              (C_ij(values) - C_ij(scene)) f(lengths)     stiffness
    layers that a length changes    f(lengths)                                  stiffness
    density                         rho(values) / rho(scene) f(lengths)         mass, turning layers
    mass on a face                  the mass                                    mass
    Rayleigh, loss factor, speed    the scalar                                  damping

The damping takes a share of every change of stiffness and mass beside.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.elasticity import face_mass
from brake_fenicsx.macro.material import rotate_about_z
from brake_fenicsx.macro.stretching import Power
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.samples_section import is_constant, split_key
from brake_fenicsx.scene.scalars import SPEED, is_inertia, is_length
from brake_fenicsx.scene.scene import turning_parts
from brake_fenicsx.stability.substructures import Parameters

from . import material_table
from .brake import Brake, layer_matrix
from .damping_terms import damping_slope, mass_share, stiffness_share
from .interfaces import scene_motion
from .lengths import MovingContact, Shape, Shapes, lengths_in, shapes_of
from .values import Box, Values, softening

Of = Callable[[Values], float]

# Voigt indices of the nine orthotropic stiffnesses.
VOIGT = {
    name: (int(name[1]) - 1, int(name[2]) - 1) for name in material_table.STIFFNESSES["orthotropic"]
}
# Rows of the coefficients: stiffness, damping, mass.
ROWS = "KCM"


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A row of the table.

    Attributes:
        matrix: A_j: stiffness [N/m], of a C_ij [N/m per Pa], damping [N s/m] or mass [kg].
        enters: "K", "C" or "M".
        constant: the C_ij of which it is a unit change; "" of another one.
        multiple: m_j.
        share: of a change of the multiple, what the damping takes [s or 1/s].
    """

    matrix: sp.csr_matrix
    enters: str
    constant: str
    multiple: Of
    share: Of


@dataclass(frozen=True, slots=True)
class ChangingBodies:
    """What the scalars of a scene change in its matrices.

    Attributes:
        scene: the scene.
        box: the box of the scalars that the bodies depend on.
        terms: the table.
        shapes: lengths of the same layers, by their dotted keys -> what they do.
        contact: the contact elements, which some of these move.
    """

    scene: Scene
    box: Box
    terms: list[Term]
    shapes: Shapes
    contact: MovingContact

    @property
    def matrices(self) -> list[sp.csr_matrix]:
        """A_j."""
        return [term.matrix for term in self.terms]

    @property
    def parameters(self) -> Parameters:
        """What the reduced model interpolates over."""
        names = self.box.names
        shapes = tuple(i for i, n in enumerate(names) if is_length(n) or is_inertia(n))
        sliding = tuple(i for i, name in enumerate(names) if name in self.contact.names)
        return Parameters(
            len(names), lambda x: self.coefficients(self.box.values(x)), softening(self.box),
            shapes, sliding, self._contact if sliding else None, tuple(names),
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
                    raise SceneError(f"""{name} = {1e3 * length:.6g} mm: lies beyond the range that
                        was prepared, {1e3 * low:.4g} to {1e3 * high:.4g} mm; widen that, or write
                        min and max of the law""")

    def coefficients(self, values: Mapping[str, float]) -> Array:
        """Coefficients of the matrices in stiffness, damping and mass, shape (3, matrices).

        Args:
            values: scalars that differ from the scene, by dotted key, SI.
        """
        here, usual = Values.of(self.scene, values), Values(self.scene)
        out = np.zeros((3, len(self.terms)))
        for j, term in enumerate(self.terms):
            out[ROWS.index(term.enters), j] = change = term.multiple(here) - term.multiple(usual)
            out[1, j] = change * term.share(here)
        return out

    def change(self, values: Mapping[str, float], which: str) -> sp.csr_matrix | None:
        """What some scalars add to a matrix of the scene; None where none enters a matrix.

        Args:
            values: by dotted key, SI.
            which: "K" [N/m], "C" [N s/m] or "M" [kg].
        """
        if not self.terms:
            return None
        parts = zip(self.coefficients(values)[ROWS.index(which)], self.matrices, strict=True)
        return sum((c * A for c, A in parts if c), sp.csr_matrix(self.matrices[0].shape))


def assemble_changes(scene: Scene, brake: Brake) -> ChangingBodies:
    """Assemble what the random and swept scalars of a scene change in its bodies.

    Args:
        scene: the scene.
        brake: its operators.

    Raises:
        SceneError: a face in use grows with a thickness.
    """
    box = Box(scene)
    ranges = {name: box.span(name) for name in filter(is_length, box.names)}
    shapes = shapes_of(scene, brake.mesh, ranges)
    table = _Rows(scene, brake, box, shapes)
    terms = [*table.moduli(), *table.layers()]
    _share_patterns([term.matrix for term in terms])
    terms += table.scalars()
    return ChangingBodies(scene, box, terms, shapes, MovingContact(scene, brake, shapes))


@dataclass(frozen=True, slots=True)
class _Rows:
    """Rows of the table, kind by kind."""

    scene: Scene
    brake: Brake
    box: Box
    shapes: Shapes

    def moduli(self) -> Iterator[Term]:
        """The C_ij that random and swept constants move."""
        for material, names in material_table.by_material(dict.fromkeys(self.scene.varied)).items():
            share = partial(stiffness_share, self.scene, material)
            for constant in moved_entries(self.scene, material, [*names]):
                changes = unit_change(self.scene, self.brake.mesh, material, constant)
                amount = partial(Values.moved, material=material, ij=VOIGT[constant])
                for lengths in ((), *self.shapes):
                    own = {n: C for n, C in changes.items() if self._lengths(n) == lengths}
                    yield from self._rows("K", own, lengths, amount, share, constant)

    def layers(self) -> Iterator[Term]:
        """Stiffness, mass and gyroscopic term of layers that a length or a density changes."""
        dense = {split_key(n)[1] for n in self.box.names if split_key(n)[2] == "rho"}
        turns, groups = list[str](), dict[Any, Any]()
        if isinstance(scene_motion(self.scene), Rotation):
            turns = turning_parts(self.scene)
        for layer, m in self.brake.materials.items():
            material, lengths = material_table.material_of(self.scene, layer), self._lengths(layer)
            if lengths or material in dense:
                groups.setdefault((material, lengths), {})[layer] = m
        for (material, lengths), own in groups.items():
            # The matrices of the scene have what depends on neither length nor density.
            fixed, share = material in dense, partial(stiffness_share, self.scene, material)
            ratio = partial(Values.ratio, name=f"materials.{material}.rho")
            rho = {layer: m.rho for layer, m in own.items()}
            turning = {n: value for n, value in rho.items() if n.partition(".")[0] in turns}
            C = {layer: m.C for layer, m in own.items()} if lengths else {}
            yield from self._rows("K", C, lengths, _one, share, fixed=False)
            yield from self._rows("M", rho, lengths, ratio, self._mass_share, fixed=fixed)
            faster = partial(Values.ratio, name=SPEED)
            yield from self._rows("C", turning, lengths, ratio, faster, fixed=fixed)

    def scalars(self) -> Iterator[Term]:
        """Masses on faces, and what the damping alone depends on."""
        for name in self.box.names:
            amount = partial(Values.value, name=name)
            if split_key(name)[2] == "mass":
                lumped = self.scene.mesh.mass == "lumped"
                given = self.brake.elastic.free, split_key(name)[1], lumped
                yield Term(face_mass(self.brake.mesh, *given), "M", "", amount, self._mass_share)
            elif not _in_bodies(name):
                yield Term(damping_slope(self.scene, self.brake, name), "C", "", amount, _one)

    def _rows(
        self, enters: str, given: Mapping[str, Any], lengths: tuple[str, ...], amount: Of,
        share: Of, constant: str = "", fixed: bool = True,
    ) -> Iterator[Term]:  # fmt: skip
        """A row for each function of some lengths; ``fixed``: for the constant one too.

        Args:
            enters: see ``Term``.
            given: layer -> stiffness [Pa], or density [kg/m^3].
            lengths: that the layers follow.
            amount: what the function is multiplied by.
            share: see ``Term``.
            constant: likewise.
            fixed: see above.
        """
        make = partial(layer_matrix, self.scene, self.brake, enters, given)
        shape = self.shapes.get(lengths)
        if not given or (shape is None and not fixed):
            return
        split: dict[Power, sp.csr_matrix] = {(): make()}
        if shape is not None:
            split = (shape.stiffness if enters == "K" else shape.inertia)(self.brake.mesh, make)
        for power, A in split.items():
            if fixed or any(power):
                multiple = partial(_multiple, shape, lengths, power, enters != "K", amount)
                yield Term(A, enters, constant, multiple, share)

    def _lengths(self, layer: str) -> tuple[str, ...]:
        """Lengths that a layer follows."""
        return next((names for names, s in self.shapes.items() if layer in s.layers), ())

    def _mass_share(self, values: Values) -> float:
        return mass_share(self.scene, values)


def _multiple(
    shape: Shape | None, lengths: tuple[str, ...], power: Power, inertia: bool, amount: Of,
    values: Values,
) -> float:  # fmt: skip
    """A function of some lengths times an amount."""
    if shape is None:
        return amount(values)
    return shape.factor(power, lengths_in(lengths, shape, values), inertia) * amount(values)


def _one(_: Values) -> float:
    return 1.0


def _in_bodies(name: str) -> bool:
    """Whether a scalar of the bodies enters stiffness or mass, and not their damping alone."""
    return is_constant(name) or is_length(name) or is_inertia(name)


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
    C, usual = material_table.stiffness(table), material_table.constants(table)
    moved = np.zeros((6, 6), dtype=bool)
    for name in names:
        change = material_table.varied_stiffness(table, {name: usual[name] * 1.001 or 1e-3}) - C
        moved |= np.abs(change) > 1e-9 * np.abs(C).max()
    return [constant for constant, index in VOIGT.items() if moved[index]]


def unit_change(scene: Scene, mesh: Mesh, material: str, constant: str) -> dict[str, Array]:
    """Change of every layer's stiffness under one of a material's C_ij, in x, y, z axes."""
    unit = np.zeros((6, 6))
    i, j = VOIGT[constant]
    unit[i, j] = unit[j, i] = 1.0
    changes = {}
    for layer in mesh.layers:
        if material_table.material_of(scene, layer) == material:
            part = scene.parts[layer.partition(".")[0]]
            angle = part.axis + scene.materials[material].axis
            changes[layer] = rotate_about_z(unit, angle)
    return changes
