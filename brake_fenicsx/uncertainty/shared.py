"""What the modes of a study's samples share: operators, layers' masses, reduced models."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.layer_mass import layer_masses
from brake_fenicsx.macro.material_table import layer_materials, scene_materials
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import Scene, Stability
from brake_fenicsx.stability import DampedReduced, Reduced
from brake_fenicsx.stability.participation import kinetic_grams
from brake_fenicsx.stability.terms import Terms, record

from .bulk import Bulk

if TYPE_CHECKING:
    from .changing import ChangingBodies

Array = NDArray[np.float64]


@dataclass(slots=True)
class Shared:
    """What the samples' modes share.

    Attributes:
        brake: operators of the scene.
        K: its stiffness [N/m], whole on this process.
        M: its mass [kg], likewise.
        stability: the scene's settings.
        masses: mass of each layer [kg], shape (dofs, dofs).
        terms: damping terms; None without damping.
        damping: what acts, with its numbers, for log and summary.
        bulk: unit changes of random materials and loads, if there are any.
        reduced: the reduced model, if it serves any sample.
        grams: masses of the layers in its real modes, shape (modes, modes).
        shapes: real modes that tell families apart where there is no reduced model.
        damped: the reduced model with damping, if it serves any sample.
        changing: the reduced model of bodies whose materials change, if there is one.
        changing_grams: masses of the layers in its coordinates.
        onto: its coordinates in those of ``basis``; None where there is no such basis.
    """

    brake: Brake
    K: PETSc.Mat
    M: PETSc.Mat
    stability: Stability
    masses: dict[str, sp.csr_matrix]
    terms: Terms | None = None
    damping: dict[str, Any] = field(default_factory=dict)
    bulk: Bulk | None = None
    reduced: Reduced | None = None
    grams: dict[str, Array] = field(default_factory=dict)
    shapes: Array | None = None
    damped: DampedReduced | None = None
    changing: ChangingBodies | None = None
    changing_grams: dict[str, Array] = field(default_factory=dict)
    onto: Array | None = None

    def take_changing(self, changing: ChangingBodies) -> None:
        """Use a reduced model of bodies whose materials change."""
        self.changing = changing
        own = changing.basis
        self.changing_grams = {
            name: own.coordinates.projected(A) for name, A in self.masses.items()
        }
        if self.basis is not None:
            self.onto = own.coordinates.projected(local_rows(self.M), self.basis)

    @property
    def only_damped(self) -> bool:
        """Whether the reduced model without damping knows statics alone."""
        return self.damped is not None and len(self.damped.reduced.basis.NN) == 1

    @property
    def basis(self) -> Array | None:
        """Real modes in whose coordinates families are followed, shape (dofs, modes)."""
        return self.shapes if self.reduced is None else self.reduced.Phi


def share(
    scene: Scene,
    brake: Brake,
    whole: tuple[PETSc.Mat, PETSc.Mat],
    bulk: Bulk | None,
    reduced: Reduced | None,
    terms: Terms | None,
) -> Shared:
    """Assemble what the samples' modes share; collective.

    Args:
        scene: the scene, with its section [stability].
        brake: its operators.
        whole: stiffness [N/m] and mass [kg], whole on this process.
        bulk: unit changes of random materials and loads, if there are any.
        reduced: the reduced model, if it serves any sample.
        terms: damping terms of the scene; None without damping.
    """
    if scene.stability is None:
        raise ValueError("a scene without [stability] has no modes")
    layers = layer_materials(scene, scene_materials(scene), brake.mesh.layers)
    density = {name: m.rho for name, m in layers.items()}
    masses = layer_masses(brake.mesh, brake.elastic.free, density)
    damping = record(scene, brake.contact)
    shared = Shared(brake, *whole, scene.stability, masses, terms, damping, bulk, reduced)
    if reduced is not None:
        shared.grams = kinetic_grams(masses, reduced.Phi)
    return shared
