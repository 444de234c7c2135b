"""Loads on faces: a pressure, a force and a moment, or the displacement of a support.

Pressures and forces are dead: they do not turn with the face.

A force F and a moment m about the centroid of the face are spread as the traction whose virtual
work is F . mean displacement + m . mean rotation (``macro.mean_motion``): uniform, and linear in
x, y, z. A displacement g of held dofs, zero elsewhere, gives u = u' + g and the load -K g on the
free dofs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.elasticity import (
    COMPONENTS,
    Elastic,
    FreeDofs,
    face_area,
    stiffness_action,
    unit_loads,
)
from brake_fenicsx.macro.faces import faces_of_bodies, gather_face
from brake_fenicsx.macro.mean_motion import mean_displacement, mean_of_nodes, mean_rotation
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import Scene

from .bodies import part_axes
from .material_table import layer_materials

Array = NDArray[np.float64]

# Pressure of light braking [Pa].
USUAL = 1e5


def load_vectors(scene: Scene, mesh: Mesh, elastic: Elastic) -> tuple[Array, Array]:
    """Loads of a scene, in the order of their names.

    Args:
        scene: the scene.
        mesh: its mesh.
        elastic: all bodies.

    Returns:
        Nodal forces, shape (free dofs, loads): of 1 Pa [N/Pa] for a pressure, of the whole [N] for
        a force with its moment or a displacement; and what the scene multiplies them by, the
        pressure or 1.

    Raises:
        SceneError: a set of nodes under a pressure or a moment.
    """
    vectors = [_vector(scene, mesh, elastic, face) for face in sorted(scene.loads)]
    sizes = [
        1.0 if load.pressure is None else load.pressure for _, load in sorted(scene.loads.items())
    ]
    return np.array(vectors).reshape(len(vectors), elastic.free.size).T, np.array(sizes)


def lift(scene: Scene, mesh: Mesh, free: FreeDofs) -> Array | None:
    """Prescribed displacements of all supports on the dofs of the mesh [m]; None without any."""
    moved = {f: load.displacement for f, load in scene.loads.items() if load.displacement}
    if not moved:
        return None
    g = np.zeros((free.column.size // 3, 3))
    for face, values in moved.items():
        nodes = np.unique(gather_face(mesh, free, face).number)
        for name, value in values.items():
            g[nodes, COMPONENTS[name]] = value
    return g.reshape(-1)


def pressing(scene: Scene, mesh: Mesh, area: float) -> float:
    """Sum of the sizes of all forces of a scene's loads [N], or a usual one.

    Args:
        scene: the scene.
        mesh: its mesh.
        area: of the contact [m^2].
    """
    forces = 0.0
    for face, load in scene.loads.items():
        if load.pressure is not None:
            forces += load.pressure * face_area(mesh, face)
        elif load.force is not None:
            forces += float(np.linalg.norm(load.force))
    # Displacements alone do not say: the springs that the bodies are condensed on take any value.
    return forces or USUAL * area


def _vector(scene: Scene, mesh: Mesh, elastic: Elastic, face: str) -> Array:
    load, free = scene.loads[face], elastic.free
    if load.pressure is not None:
        return unit_loads(mesh, free, face)
    if load.displacement is not None:
        return _displaced(scene, mesh, elastic, face)
    axes, nodes = part_axes(scene, face), elastic.sets.get(face)
    given = None if nodes is not None else gather_face(mesh, free, face)
    f = np.zeros(free.size)
    if load.force is not None:
        mean = mean_of_nodes(nodes) if given is None else mean_displacement(given, free.size)
        f += mean.T @ (axes @ load.force)
    if load.moment is not None:
        if given is None:
            raise SceneError(
                f'{scene.file}: loads."{face}".moment: a set of nodes has no rotation; write forces'
                " on sets that lie apart"
            )
        if len(faces_of_bodies(free, given)) > 1:
            raise SceneError(
                f'{scene.file}: loads."{face}".moment: the face lies on several bodies; give each a'
                " part of its own, and a load on the face of each"
            )
        f += mean_rotation(given, free.size).T @ (axes @ load.moment)
    return f


def _displaced(scene: Scene, mesh: Mesh, elastic: Elastic, face: str) -> Array:
    """Load [N] of the displacement of one support."""
    free, alone = elastic.free, replace(scene, loads={face: scene.loads[face]})
    g = lift(alone, mesh, free)
    if g is None:
        raise ValueError(f"{face}: no displacement")
    moved = np.flatnonzero(g.reshape(-1, 3).any(axis=1))
    coupled = {f"contact.{n}": c.faces for n, c in scene.contact.items()}
    coupled |= {f"ties.{n}": tie.faces for n, tie in scene.ties.items()}
    coupled |= {f"springs.{n}": s.faces or (n,) for n, s in scene.springs.items()}
    for where, faces in coupled.items():
        for other in faces:
            if other in mesh.faces and np.isin(gather_face(mesh, free, other).number, moved).any():
                raise SceneError(
                    f'{scene.file}: loads."{face}".displacement: moves nodes of {other!r} too, on'
                    f" which {where} acts; move another face, or write a force"
                )
    materials = layer_materials(scene, mesh.layers)
    f = np.zeros(free.size)
    f[: free.local.size] = -stiffness_action(mesh, free, materials, g)[free.local]
    return f
