"""A scene's brake: parts, materials, supports, loads and interfaces to operators."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import sections
from brake_fenicsx.macro.condensation import Compliance
from brake_fenicsx.macro.contact_elements import Contact, join
from brake_fenicsx.macro.elasticity import Elastic
from brake_fenicsx.macro.material import Material
from brake_fenicsx.macro.stuck import Stuck, stick
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene

from .bodies import assemble_bodies, on_matrices
from .interfaces import check_apart, interface_elements, scene_motion, uncovered, zone_of
from .loads import lift, load_vectors, pressing
from .material_table import layer_materials, scene_materials
from .scene_mesh import check_mesh, scene_mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Brake:
    """Assembled operators of a scene.

    Attributes:
        mesh: the tagged mesh.
        elastic: matrices, loads and the numbering of the free dofs.
        contact: contact elements of all interfaces.
        f: loads [N], all free dofs.
        pressed: sum of the loads' magnitudes [N].
        unit_loads: load vectors of the scene's loads, see ``loads.load_vectors``.
        lift: prescribed displacements on the dofs of the mesh [m]; None without any.
        compliance: the bodies seen from the contact elements, see ``macro.braking``; None until
            then.
        stuck: interfaces whose faces stick, by name; their springs are in the stiffness.
        faced: interface -> area of its first face that lies opposite to the second, and the whole
            area of the first [m^2], regardless of its zone.
        materials: layer, "part.layer" -> its material in x, y, z.
    """

    mesh: Mesh
    elastic: Elastic
    contact: Contact
    f: Array
    pressed: float
    unit_loads: Array
    lift: Array | None = None
    compliance: Compliance | None = None
    stuck: dict[str, Stuck] = field(default_factory=dict)
    faced: dict[str, tuple[float, float]] = field(default_factory=dict)
    materials: dict[str, Material] = field(default_factory=dict)

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
    found: dict[str, Contact] = {}
    stuck: dict[str, Stuck] = {}
    faced: dict[str, tuple[float, float]] = {}
    for name, table in scene.contact.items():
        one = interface_elements(scene, name, mesh, elastic.free, comm)
        opposite = float(one.w.sum())
        faced[name] = opposite, opposite + one.uncovered
        if table.zone is not None:
            one = zone_of(one, table.zone, f"{scene.file}: contact.{name}")
        if table.tangential_stiffness is not None:
            one, stuck[name] = stick(one, table.tangential_stiffness)
            elastic = replace(elastic, K=elastic.K + stuck[name].matrix())
        found[name] = one
    contact = join([*found.values()])
    if len(found) > 1:
        check_apart(scene, found)
        contact = replace(contact, uncovered=uncovered(scene, found))
    vectors, sizes = load_vectors(scene, mesh, elastic)
    pressed = pressing(scene, mesh, float(contact.w.sum()))
    moved = lift(scene, mesh, elastic.free)
    materials = layer_materials(scene, mesh.layers)
    return Brake(
        mesh, elastic, contact, vectors @ sizes, pressed, vectors, moved, stuck=stuck,
        faced=faced, materials=materials,
    )  # fmt: skip


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
            raise SceneError(
                f"{scene.file}: {where} = {face!r}: a set of nodes has no area; name a face of a"
                " part with a mesh, to which the set is tied"
            )
    layer_materials(scene, check_mesh(scene, faces, comm), materials)
