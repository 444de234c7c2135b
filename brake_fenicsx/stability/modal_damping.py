"""Damping ratios of the parts of a scene, for the modes of its substructures.

The modes w_j of a substructure without contact, with its supports, springs and ties, get

    C = sum_j  M w_j  2 zeta_j omega_j  w_j' M,

so that each alone has the ratio zeta_j. The sum is that of the modes that the reduced model keeps;
those beyond its cutoff omega_c are damped by zeta_c (2 omega_c M + K / (4 omega_c)) with the ratio
at the cutoff: near their ratio where they are flexible. In a complex mode of the brake the damping
is what these modes contribute to it; a changing material leaves C as it is at the centre of its
range.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.damping import ModalDamping

from .substructures import Substructure
from .substructures.substructure import ModalRatio


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
    damping = scene.stability.damping if scene.stability else None
    given = damping.modal if damping else {}
    if not given:
        return list(bodies)
    ratios: list[list[ModalRatio]] = [[] for _ in bodies]
    for name in scene.parts:
        layers = [A for layer, A in masses.items() if layer.partition(".")[0] == name]
        mass = sum(layers[1:], layers[0]).tocsr()
        own = given.get(name, ModalDamping(0.0))
        for found, body in zip(ratios, bodies, strict=True):
            inner = mass[body.dofs][:, body.dofs].tocsr()
            if inner.nnz:
                frequency = np.array(own.frequency)
                found.append(ModalRatio(inner, frequency, np.atleast_1d(own.ratio)))
    return [
        replace(body, ratios=tuple(found)) if any(part.ratio.any() for part in found) else body
        for body, found in zip(bodies, ratios, strict=True)
    ]
