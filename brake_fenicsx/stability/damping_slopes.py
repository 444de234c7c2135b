"""Damping of the bodies under scalars of the scene that take other values.

C = alpha M + beta K + sum loss_m K_m / omega_ref + Omega G of the materials m. Each scalar adds its
change times a matrix that is assembled once; where the stiffness of a material changes, by a_j A_j,
the damping takes the share beta + loss_m / omega_ref of it, whatever the scalars are then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import scipy.sparse as sp

from brake_fenicsx.macro.brake import Brake, scene_motion
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.macro.friction import Rotation
from brake_fenicsx.macro.material_table import layer_material, layer_materials, scene_materials
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.damping import Damping, turning_parts
from brake_fenicsx.scene.samples import split_key

from .gyroscopic import gyroscopic

RAYLEIGH = ("stability.damping.rayleigh.alpha", "stability.damping.rayleigh.beta")


def stiffness_share(scene: Scene, material: str, values: Mapping[str, float]) -> float:
    """Share [s] of a change of the stiffness of a material that the damping takes.

    Args:
        scene: the scene.
        material: name of the material.
        values: scalars that differ from the scene, by dotted key, SI.
    """
    table = scene.stability.damping if scene.stability else None
    if table is None:
        return 0.0
    share = 0.0
    if table.rayleigh is not None:
        share += values.get(RAYLEIGH[1], table.rayleigh[1])
    if table.loss:
        loss = scene.materials[material].loss
        share += values.get(f"materials.{material}.loss", loss) / table.reference
    return share


def damping_slopes(scene: Scene, brake: Brake, names: Sequence[str]) -> dict[str, sp.csr_matrix]:
    """Derivatives of the damping by scalars, on the scene's own stiffness; collective.

    Args:
        scene: the scene.
        brake: its operators.
        names: dotted keys: Rayleigh's alpha and beta, loss factors of materials, the speed.

    Returns:
        Dotted key -> dC/d(scalar) [N s/m over its unit], whole on this process.
    """
    table = scene.stability.damping if scene.stability else None
    return {} if table is None else {n: _slope(scene, table, brake, n) for n in names}


def _slope(scene: Scene, table: Damping, brake: Brake, name: str) -> sp.csr_matrix:
    if name in RAYLEIGH:
        return brake.M if name == RAYLEIGH[0] else brake.K
    mesh, free = brake.mesh, brake.elastic.free
    layers = layer_materials(scene, scene_materials(scene), mesh.layers)
    if name == "motion.speed":
        turns = set(turning_parts(scene))
        density = {n: m.rho for n, m in layers.items() if n.partition(".")[0] in turns}
        motion = scene_motion(scene)
        if not isinstance(motion, Rotation):
            raise ValueError("the gyroscopic term needs a rotation")
        A, factor = gyroscopic(mesh, free, density, replace(motion, speed=1.0)), 1.0
    else:
        _, material, _ = split_key(name)
        own = {n: m.C for n, m in layers.items() if _material(scene, n) == material}
        (A,) = affine_parts(mesh, free, [own])
        factor = 1 / table.reference
    return (factor * A).tocsr()


def _material(scene: Scene, layer: str) -> str | None:
    """Name of the material of a layer of the mesh."""
    part, _, inner = layer.partition(".")
    return layer_material(scene.parts[part].material, inner)
