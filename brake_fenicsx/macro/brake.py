"""A scene's brake: parts, materials, supports, loads and interfaces to operators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene

from .condensation import Compliance, gathered_vector
from .contact import Contact, contact_elements, join
from .elasticity import Elastic, FaceAddition, assemble_elastic
from .friction import Motion, Rotation, Translation
from .material_table import layer_materials, scene_materials
from .mesh import Mesh
from .parts import check_mesh, scene_mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Brake:
    """Assembled operators of a scene.

    Attributes:
        mesh: the tagged mesh.
        elastic: matrices, loads and the numbering of the free dofs.
        contact: contact elements of all interfaces.
        f: loads [N], all free dofs, the same on every process.
        pressed: sum of the loads' magnitudes [N].
        compliance: the bodies seen from the contact elements, once computed.
    """

    mesh: Mesh
    elastic: Elastic
    contact: Contact
    f: Array
    pressed: float
    compliance: Compliance | None = None

    @property
    def K(self) -> PETSc.Mat:
        """Stiffness [N/m]."""
        return self.elastic.K

    @property
    def M(self) -> PETSc.Mat:
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

    def local(self, u: NDArray) -> NDArray:
        """Values on all local dofs of this process of a whole free vector, zero where held."""
        first, last = self.K.getOwnershipRange()
        return self.elastic.free.expand(u[first:last])


def assemble_brake(scene: Scene, comm: MPI.Comm) -> Brake:
    """Build, mesh and assemble what the scene names.

    Args:
        scene: the scene; the first interface named is the first of the contact elements.
        comm: communicator of mesh and matrices.

    Returns:
        The operators.

    Raises:
        SceneError: a part, face, layer or material does not fit.
    """
    materials = scene_materials(scene)
    mesh = scene_mesh(scene, comm)
    layers = layer_materials(scene, materials, mesh.layers)
    supports = {face: list(held) for face, held in scene.supports.items()}
    loads = {face: load.pressure for face, load in scene.loads.items()}
    sprung = [name for name, spring in scene.springs.items() if spring.faces is None]
    added = [added_to_face(scene, face) for face in dict.fromkeys([*sprung, *scene.masses])]
    elastic = assemble_elastic(
        mesh, layers, supports, loads, scene.mesh.degree, added, scene.mesh.mass == "lumped"
    )
    inert = any(added.inertia for added in scene.masses.values())
    if scene.ties or inert or any(spring.faces for spring in scene.springs.values()):
        from .joints import joined_bodies

        elastic = joined_bodies(scene, mesh, elastic, layers)
    motion = scene_motion(scene)
    try:
        contact = join(
            [
                contact_elements(
                    mesh, elastic.free, (c.faces[0], c.faces[1]), motion, c.discretisation, c.search
                )
                for c in scene.contact.values()
            ]
        )
    except SceneError as error:
        raise SceneError(f"{scene.file}: {error}") from None
    pressed = sum(loads[face] * area for face, (area, _) in elastic.loads.items())
    return Brake(mesh, elastic, contact, gathered_vector(elastic.f), float(pressed))


def added_to_face(scene: Scene, face: str) -> FaceAddition:
    """Springs, dashpots and mass that a scene adds to a face, in x, y, z axes."""
    spring, mass = scene.springs.get(face), scene.masses.get(face)
    turn, none = part_axes(scene, face), np.zeros(3)

    def turned(values: tuple[float, ...] | None) -> Array:
        return np.asarray(turn @ np.diag(none if values is None else values) @ turn.T)

    given = (
        (None, None, None)
        if spring is None
        else (spring.stiffness, spring.stiffness_per_area, spring.damping)
    )
    total, bedding, damping = map(turned, given)
    return FaceAddition(face, total, 0.0 if mass is None else mass.mass, bedding, damping)


def part_axes(scene: Scene, face: str) -> Array:
    """Axes 1, 2 and z of the part of a face as columns, shape (3, 3)."""
    part = scene.parts.get(face.partition(".")[0])
    angle = 0.0 if part is None else part.axis
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


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
    layer_materials(scene, materials, check_mesh(scene, faces, comm))


def scene_motion(scene: Scene) -> Motion:
    """How the disc moves; a scene without motion has no friction, any direction serves then."""
    motion = scene.motion
    if motion is None:
        return Rotation(1.0)
    if motion.direction is not None:
        d = motion.direction
        if len(d) != 3 or not any(d):
            raise SceneError(
                f"{scene.file}: motion.direction = {list(d)!r}: write three numbers, not all zero"
            )
        return Translation((d[0], d[1], d[2]), motion.rate)
    return Rotation(motion.rate)
