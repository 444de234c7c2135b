"""Damping of a scene's brake: what all samples share, and what each adds at its interface.

Rayleigh, loss factors and the turning disc belong to the bodies and are assembled once. Friction's
own terms, C_s and C_mu of ``stability.damping_matrices``, take the sample's pressures, friction and
speeds at equilibrium.

Damping ratios of the parts of a scene: the modes w_j of a substructure without contact, with its
supports, springs and ties, get

    C = sum_j  M w_j  2 zeta_j omega_j  w_j' M,

so that each alone has the ratio zeta_j. The sum is that of the modes that the reduced model keeps;
those beyond its cutoff omega_c are damped by zeta_c (2 omega_c M + K / (4 omega_c)) with the ratio
at the cutoff: near their ratio where they are flexible. In a complex mode of the brake the damping
is what these modes contribute to it; a changing material leaves C as it is at the centre of its
range.

Under scalars of the scene that take other values, C = alpha M + beta K + sum loss_m K_m / omega_ref
+ Omega G of the materials m. Each scalar adds its change times a matrix that is assembled once;
where the stiffness of a material changes, by a_j A_j, the damping takes the share beta + loss_m /
omega_ref of it, whatever the scalars are then.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.macro import contact_elements, contact_forces
from brake_fenicsx.scene import Scene, samples_section, scalars, stability_section
from brake_fenicsx.scene.scene import active_terms, damped_bodies, damped_springs, turning_parts
from brake_fenicsx.stability.damping_matrices import friction_damping
from brake_fenicsx.stability.substructures import Substructure
from brake_fenicsx.stability.substructures.substructure import ModalRatio

from .brake import Brake, layer_matrix
from .interfaces import scene_motion
from .material_table import material_of

RAYLEIGH = ("stability.damping.rayleigh.alpha", "stability.damping.rayleigh.beta")


@dataclass(frozen=True, slots=True)
class Terms:
    """Damping terms of a scene.

    Attributes:
        bulk: those of the bodies [N s/m], whole on this process; None if there are none.
        turns: whether friction turns with the direction of sliding.
        falls: whether it changes with the speed.
    """

    bulk: sp.csr_matrix | None = None
    turns: bool = False
    falls: bool = False

    def matrix(
        self,
        contact: contact_elements.Contact,
        friction: contact_forces.SlidingFriction,
        p: Array,
        change: sp.csr_matrix | None = None,
    ) -> sp.csr_matrix | None:
        """Damping of one sample at its equilibrium, C [N s/m]; None where nothing damps it.

        Args:
            contact: contact elements.
            friction: of these.
            p: pressures at equilibrium [Pa], shape (elements,).
            change: what the sample adds to the damping of the scene's bodies [N s/m].
        """
        parts = [] if self.bulk is None else [self.bulk]
        if change is not None and change.nnz:
            parts.append(change)
        rates = friction.rates(p, self.turns, self.falls)
        if np.any(rates):
            parts.append(friction_damping(contact.T, contact.R, contact.w, *rates))
        return _sum(parts)


def damping_terms(scene: Scene, brake: Brake) -> Terms:
    """Assemble the damping terms of a scene."""
    table = scene.damping or stability_section.Damping()
    return Terms(_sum([*_terms_of_bodies(scene, brake, table)]), table.sliding, table.slope)


def _terms_of_bodies(
    scene: Scene, brake: Brake, table: stability_section.Damping
) -> Iterator[sp.csr_matrix]:
    """Damping of the bodies: their dashpots, then a matrix for each term that the scene names."""
    if brake.elastic.C is not None:
        yield brake.elastic.C
    if table.rayleigh is not None:
        yield table.rayleigh[0] * brake.M + table.rayleigh[1] * brake.K
    if table.loss:
        damped = {n: m.loss / table.reference * m.C for n, m in brake.materials.items() if m.loss}
        yield layer_matrix(scene, brake, "K", damped)
    if table.gyroscopic and isinstance(scene_motion(scene), contact_forces.Rotation):
        yield layer_matrix(scene, brake, "C", turning_density(scene, brake))
    for term in table.own:
        yield term.matrix(brake)


def record(scene: Scene, contact: contact_elements.Contact) -> dict[str, Any]:
    """What acts where, with its numbers, for log and summary; empty without damping."""
    table, moving = scene.damping or stability_section.Damping(), contact.speed[contact.speed > 0]
    speeds = {"speeds_m_s": [float(moving.min()), float(moving.max())] if moving.size else []}
    losses = {name: m.loss for name, m in scene.materials.items() if m.loss}
    rate, turns = scene.motion.rate if scene.motion else 0.0, turning_parts(scene)
    facts: dict[str, dict[str, Any]] = {
        "springs": {f"{name}_N_s_m": [*c] for name, c in damped_springs(scene).items()},
        "matrices": {**damped_bodies(scene)},
        "rayleigh": dict(zip(("alpha_1_s", "beta_s"), table.rayleigh or (), strict=False)),
        "loss": {"omega_ref_rad_s": table.reference, "factors": losses} if table.loss else {},
        "sliding": speeds if table.sliding else {},
        "slope": speeds if table.slope else {},
        "gyroscopic": {"speed_rad_s": rate, "parts": turns} if table.gyroscopic else {},
        "own": {"terms": [repr(term) for term in table.own]} if table.own else {},
        "modal": {name: asdict(given) for name, given in table.modal.items()},
    }
    acting = {name: active_terms(scene, name) for name in scene.samples.approaches}
    return {
        term: {**numbers, "approaches": [name for name, terms in acting.items() if term in terms]}
        for term, numbers in facts.items()
        if numbers
    }


def _sum(parts: list[sp.csr_matrix]) -> sp.csr_matrix | None:
    """Sum of some matrices; None where there are none."""
    return sum(parts[1:], parts[0]).tocsr() if parts else None


def with_modal_damping(
    scene: Scene, bodies: Sequence[Substructure], masses: Mapping[str, sp.csr_matrix]
) -> list[Substructure]:
    """Substructures with the damping ratios that a scene names for their parts.

    Args:
        scene: the scene.
        bodies: its substructures.
        masses: mass of each layer, "part.layer", and of bodies given by matrices [kg], shape
            (dofs, dofs).
    """
    given = scene.damping.modal if scene.damping else {}
    if not given:
        return list(bodies)
    ratios: list[list[ModalRatio]] = [[] for _ in bodies]
    for name in scene.parts:
        layers = [A for layer, A in masses.items() if layer.partition(".")[0] == name]
        mass = sum(layers[1:], layers[0]).tocsr()
        own = given.get(name, stability_section.ModalDamping(0.0))
        for found, body in zip(ratios, bodies, strict=True):
            inner = mass[body.dofs][:, body.dofs].tocsr()
            if inner.nnz:
                frequency = np.array(own.frequency)
                found.append(ModalRatio(inner, frequency, np.atleast_1d(own.ratio)))
    return [
        replace(body, ratios=tuple(found)) if any(part.ratio.any() for part in found) else body
        for body, found in zip(bodies, ratios, strict=True)
    ]


def stiffness_share(scene: Scene, material: str, values: Mapping[str, float]) -> float:
    """Share [s] of a change of the stiffness of a material that the damping takes.

    Args:
        scene: the scene.
        material: name of the material.
        values: scalars that differ from the scene, by dotted key, SI.
    """
    table, share = scene.damping, 0.0
    if table and table.rayleigh:
        share += values.get(RAYLEIGH[1], table.rayleigh[1])
    if table and table.loss:
        loss = scene.materials[material].loss
        share += values.get(f"materials.{material}.loss", loss) / table.reference
    return share


def mass_share(scene: Scene, values: Mapping[str, float]) -> float:
    """Share [1/s] of a change of the mass that the damping takes; arguments as above."""
    table = scene.damping
    alpha = table.rayleigh[0] if table and table.rayleigh else 0.0
    return values.get(RAYLEIGH[0], alpha)


def turning_density(scene: Scene, brake: Brake) -> dict[str, float]:
    """Density of the layers that turn [kg/m^3]."""
    turns = {*turning_parts(scene)}
    return {n: m.rho for n, m in brake.materials.items() if n.partition(".")[0] in turns}


def damping_slope(scene: Scene, brake: Brake, name: str) -> sp.csr_matrix:
    """Derivative of the damping by a scalar, on the scene's own stiffness.

    Args:
        scene: the scene, with damping.
        brake: its operators.
        name: dotted key: Rayleigh's alpha or beta, the loss factor of a material, the speed.

    Returns:
        dC/d(scalar) [N s/m over its unit], whole on this process.
    """
    motion = scene_motion(scene)
    if name in RAYLEIGH:
        return brake.M if name == RAYLEIGH[0] else brake.K
    if name == scalars.SPEED and isinstance(motion, contact_forces.Rotation):
        return layer_matrix(scene, brake, "C", turning_density(scene, brake)) / motion.speed
    if scene.damping is None:
        raise ValueError(f"{name}: a scene without damping")
    material = samples_section.split_key(name)[1]
    own = {n: m.C for n, m in brake.materials.items() if material_of(scene, n) == material}
    return layer_matrix(scene, brake, "K", own) / scene.damping.reference
