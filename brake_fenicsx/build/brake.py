"""A scene's brake: operators of what it names, and its inventory to compare with other models."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx import compat
from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import OfOneProcess, SceneError, lines
from brake_fenicsx.extensions import sections
from brake_fenicsx.macro import contact_elements, contact_forces, elasticity, material
from brake_fenicsx.macro.equilibrium import Compliance
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.parts_section import Motion
from brake_fenicsx.scene.scene import slides
from brake_fenicsx.stability.damping_matrices import gyroscopic

from .bodies import assemble_bodies, lift, load_vectors, on_matrices, pressing
from .interfaces import check_apart, interface_elements, scene_motion, uncovered, zone_of
from .material_table import layer_materials, scene_materials
from .scene_mesh import check_mesh, scene_mesh


@dataclass(frozen=True, slots=True)
class Brake(OfOneProcess):
    """Assembled operators of a scene.

    Attributes:
        mesh: the tagged mesh.
        elastic: matrices, loads and the numbering of the free dofs.
        contact: contact elements of all interfaces.
        f: loads [N], all free dofs.
        pressed: sum of the loads' magnitudes [N].
        unit_loads: load vectors of the scene's loads, see ``bodies.load_vectors``.
        lift: prescribed displacements on the dofs of the mesh [m]; None without any.
        compliance: the bodies seen from the contact elements, see ``macro.braking``; None until
            then.
        stuck: interfaces whose faces stick, by name; their springs are in the stiffness.
        faced: interface -> area of its first face that lies opposite to the second, and the whole
            area of the first [m^2], regardless of its zone.
        materials: layer, "part.layer" -> its material in x, y, z.
    """

    mesh: Mesh
    elastic: elasticity.Elastic
    contact: contact_elements.Contact
    f: Array
    pressed: float
    unit_loads: Array
    lift: Array | None = None
    compliance: Compliance | None = None
    stuck: dict[str, contact_elements.Stuck] = field(default_factory=dict)
    faced: dict[str, tuple[float, float]] = field(default_factory=dict)
    materials: dict[str, material.Material] = field(default_factory=dict)

    def __repr__(self) -> str:
        """One line."""
        return f"Brake({self.K.shape[0]} dofs, {self.w.size} contact elements)"

    @property
    def K(self) -> sp.csr_matrix:
        """Stiffness [N/m]."""
        return self.elastic.K

    @property
    def M(self) -> sp.csr_matrix:
        """Mass [kg]."""
        return self.elastic.M

    @property
    def N(self) -> sp.csr_matrix:
        """Gap operator."""
        return self.contact.N

    @property
    def T(self) -> sp.csr_matrix:
        """Slip operator along the sliding direction."""
        return self.contact.T

    @property
    def R(self) -> sp.csr_matrix:
        """Slip operator across the sliding direction."""
        return self.contact.R

    @property
    def w(self) -> Array:
        """Areas of the contact elements [m^2]."""
        return self.contact.w

    @property
    def g0(self) -> Array:
        """Gaps of the undeformed bodies [m]."""
        return self.contact.g0

    @property
    def points(self) -> Array:
        """Centres of the contact elements [m]."""
        return self.contact.points

    def size(self) -> dict[str, Any]:
        """Cells, free dofs and contact elements, and the side of a mean one [mm]."""
        domain = self.mesh.domain
        cells = int(domain.topology.index_map(domain.topology.dim).size_global)
        return {
            "cells": cells,
            "dofs": self.elastic.free.size,
            "contact_elements": len(self.w),
            "mean_patch_mm": 1e3 * float(np.sqrt(self.w.mean())),
        }


def assemble_brake(scene: Scene, comm: MPI.Comm) -> Brake:
    """Build, mesh and assemble what the scene names; collective.

    Args:
        scene: the scene; the first interface named is the first of the contact elements.
        comm: the processes, each of which gets the whole brake.

    Returns:
        The operators.

    Raises:
        SceneError: a part, face, layer or material does not fit.
    """
    mesh = scene_mesh(scene, comm)
    elastic = assemble_bodies(scene, mesh)
    found: dict[str, contact_elements.Contact] = {}
    stuck: dict[str, contact_elements.Stuck] = {}
    faced: dict[str, tuple[float, float]] = {}
    for name, table in scene.contact.items():
        one = interface_elements(scene, name, mesh, elastic.free, comm)
        opposite = float(one.w.sum())
        faced[name] = opposite, opposite + one.uncovered
        if table.zone is not None:
            one = zone_of(one, table.zone, f"{scene.file}: contact.{name}")
        if table.tangential_stiffness is not None:
            one, stuck[name] = contact_elements.stick(one, table.tangential_stiffness)
            elastic = replace(elastic, K=elastic.K + stuck[name].matrix())
        found[name] = one
    contact = contact_elements.join([*found.values()])
    if len(found) > 1:
        check_apart(scene, found)
        contact = replace(contact, uncovered=uncovered(scene, found))
    vectors, sizes = load_vectors(scene, mesh, elastic)
    pressed = pressing(scene, mesh, float(contact.w.sum()))
    moved = {face: load for face, load in scene.loads.items() if load.displacement}
    lifted = lift(mesh, elastic.free, moved) if moved else None
    materials = layer_materials(scene, mesh.layers)
    f = vectors @ sizes
    return Brake(mesh, elastic, contact, f, pressed, vectors, lifted, None, stuck, faced, materials)


def layer_matrix(
    scene: Scene, brake: Brake, enters: str, given: Mapping[str, Any]
) -> sp.csr_matrix:
    """A matrix of some layers by themselves.

    Args:
        scene: the scene.
        brake: its operators.
        enters: "K" for stiffness [N/m], "C" for the gyroscopic term [N s/m], "M" for mass [kg].
        given: layer -> stiffness in x, y, z [Pa], or density [kg/m^3].
    """
    mesh, free, motion = brake.mesh, brake.elastic.free, scene_motion(scene)
    if enters == "K":
        return elasticity.affine_parts(mesh, free, [given])[0]
    if enters == "C" and isinstance(motion, contact_forces.Rotation):
        return gyroscopic(mesh, free, given, motion)
    return sum(elasticity.layer_masses(mesh, free, given, scene.mesh.mass == "lumped").values())


def check_brake(scene: Scene, comm: MPI.Comm) -> None:
    """Refuse what cannot be built, before anything is meshed or written.

    Raises:
        SceneError: a material, a part's parameters, a face or the motion is wrong, or PETSc is.
    """
    compat.require_real_petsc()
    materials = scene_materials(scene)
    scene_motion(scene)
    faces = {f'supports."{face}"': face for face in scene.supports}
    for table in ("springs", "masses", "loads", "contact", "ties"):
        for name, one in getattr(scene, table).items():
            pair = getattr(one, "faces", None)
            named = {f'{table}."{name}"': name} if pair is None else {}
            faces |= named | {f"{table}.{name}.faces[{i}]": f for i, f in enumerate(pair or ())}
    areas: dict[str, str] = {}  # that sections of extras name
    for section in sections(scene):
        areas |= getattr(section, "areas", {})
    faces |= areas
    for where, face in faces.items():
        load = scene.loads.get(face) if where.startswith("loads.") else None
        pressed = load is not None and load.pressure is not None
        spread = where in areas or where.startswith("contact.") or pressed
        if spread and on_matrices(scene, face):
            raise SceneError(f"""{scene.file}: {where} = {face!r}: a set of nodes has no area; name
                a face of a part with a mesh, to which the set is tied""")
    layer_materials(scene, check_mesh(scene, faces, comm), materials)


def parts_of(scene: Scene, brake: Brake) -> dict[str, dict[str, Any]]:
    """Mass and extent of each part: {"mass_kg": .., "extent_mm": [x, y, z]}.

    Masses that the scene adds to faces are left out; the extent of a body given by matrices is that
    of its nodes.
    """
    mesh = brake.mesh
    mass = dict.fromkeys(mesh.extents, 0.0)
    for layer, volume in mesh.volumes.items():
        mass[layer.partition(".")[0]] += brake.materials[layer].rho * volume
    boxes = {n: (mass[n], box) for n, box in mesh.extents.items()} | brake.elastic.bodies
    return {
        name: {"mass_kg": boxes[name][0], "extent_mm": [1e3 * side for side in boxes[name][1]]}
        for name in scene.parts
        if name in boxes
    }


def interfaces_of(scene: Scene, brake: Brake) -> dict[str, dict[str, Any]]:
    """Area, number of elements, area without opposite face and gaps of each interface."""
    interfaces = {}
    for i, name in enumerate(scene.contact):
        elements = brake.contact.interface == i
        opposite, whole = brake.faced[name]
        interfaces[name] = {
            "area_mm2": _rounded(1e6 * brake.w[elements].sum()),
            "contact_elements": int(elements.sum()),
            "faces_nothing_mm2": _rounded(1e6 * (whole - opposite)),
            "gap_um": [_rounded(1e6 * end(brake.g0[elements])) for end in (np.min, np.max)],
        }
    return interfaces


@lines
def inventory_lines(
    scene: Scene, parts: dict[str, dict[str, Any]], interfaces: dict[str, dict[str, Any]]
) -> Iterator[str]:
    """Parts and interfaces, as above, a line each."""
    for name, part in parts.items():
        sides = " x ".join(f"{side:.4g}" for side in part["extent_mm"])
        yield f"part {name}: {part['mass_kg']:.4g} kg, {sides} mm"
    motion = scene.motion
    for name, one in interfaces.items():
        faces = scene.contact[name].faces
        pad, disc = (face.partition(".")[0] for face in faces)
        if not slides(scene, name):
            sliding = f"{disc!r} and {pad!r} stick"
        elif motion is None:
            sliding = f"{disc!r} under {pad!r}, no motion"
        elif motion.direction is not None:
            along = ", ".join(f"{x:g}" for x in motion.direction)
            sliding = f"{disc!r} slides over {pad!r} along ({along}) at {motion.speed or '1 m/s'}"
        else:
            speed = motion.speed or "1 rad/s"
            sliding = f"{disc!r} turns about {_axis(motion)} under {pad!r} at {speed}"
        low, high = one["gap_um"]
        yield f"""contact {name}: {sliding}; area {one["area_mm2"]:.4g} mm^2,
            {one["contact_elements"]} elements; {one["faces_nothing_mm2"]:.4g} mm^2 of {faces[0]}
            have no opposite face; gap before the load {low:.4g} to {high:.4g} um"""


def _axis(motion: Motion) -> str:
    """The axis of a rotation in words."""
    axis = motion.axis or "z"
    named = axis if isinstance(axis, str) else f"({', '.join(f'{a:g}' for a in axis)})"
    if motion.point is None:
        return named
    return f"{named} through ({', '.join(f'{1e3 * a:g}' for a in motion.point)}) mm"


def _rounded(value: float) -> float:
    """A number without its round-off, and no negative zero."""
    return round(float(value), 6) + 0.0
