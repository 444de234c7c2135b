"""Limit cycles of a study's samples: what the scene and its samples say to ``limit_cycle``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.extras.limit_cycle.contact_forces import Coefficient, PatchForces
from brake_fenicsx.extras.limit_cycle.sample import Faces, SampleCycles, Settings, cycles_of_modes
from brake_fenicsx.extras.limit_cycle.sound import nodes_of
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.samples.models import Models
from brake_fenicsx.samples.sampling import coefficient
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import PERFECT, friction_of
from brake_fenicsx.stability.modes import Modes

if TYPE_CHECKING:
    from brake_fenicsx.samples.sampling import SampleInput


class Cycles:
    """Limit cycles of any sample of a scene."""

    def __init__(self, scene: Scene, models: Models):
        """Gather the faces whose motion is measured."""
        table, brake = scene.limit_cycle, models.brake
        if table is None:
            raise ValueError("a scene without [limit_cycle]")
        pairs = [contact.faces for contact in scene.contact.values()]
        disc = table.radiating or tuple(dict.fromkeys(faces[1] for faces in pairs))
        pads = tuple(dict.fromkeys(faces[0] for faces in pairs))
        nodes = partial(nodes_of, brake.mesh, brake.elastic.free)
        self._scene, self._models, self._faces = scene, models, Faces(nodes(disc), nodes(pads))
        threshold = models.stability.threshold if models.stability else 0.0
        self._settings = Settings(
            table.harmonics, table.points, table.largest, table.damping_below, threshold
        )

    def of(
        self,
        approach: str,
        sample: SampleInput,
        eq: Equilibrium,
        modes: Modes,
        partner: NDArray[np.intp],
        reduced: bool,
    ) -> dict[str, Any]:
        """Limit cycles of a sample's growing modes, as arrays to store; see ``cycles_of_modes``.

        Args:
            approach: of the sample.
            sample: its inputs.
            eq: its equilibrium.
            modes: its modes.
            partner: flutter partner of each; not used.
            reduced: whether they are those of the reduced model.

        Raises:
            InaccurateResult: they are not.
        """
        if not reduced:
            raise InaccurateResult("a sample at full order has none: they are of the reduced model")
        cycles, slip = self.sample(approach, sample, eq), self._models.contact(sample.random).T
        return cycles_of_modes(cycles, modes, self._settings, self._faces, slip)

    def sample(self, approach: str, sample: SampleInput, eq: Equilibrium) -> SampleCycles:
        """The equations of a sample; arguments as above."""
        models, scene = self._models, self._scene
        damped = models.damped(approach)
        model, interface = models.reduced[damped], models.brake.contact.interface
        tables = list(scene.contact.items())
        hard = scene.micro is not None and scene.micro.hardness is not None
        yields = np.array([
            hard and table.law == "library" and approach not in PERFECT for _, table in tables
        ])  # fmt: skip
        values = (
            sample.random.get(f"contact.{name}.friction", friction_of(scene, approach, name))
            for name, _ in tables
        )
        coefficients: tuple[Coefficient, ...] = tuple(partial(coefficient, v) for v in values)
        forces = PatchForces(
            sample.laws, yields[interface], models.contact(sample.random).w, eq.g, sample.mu,
            sample.speed, interface, model.rows.followed,
            coefficients if "T" in model.rows.followed else (),
        )  # fmt: skip
        p = models.parameter_point(sample.random)
        return SampleCycles(model, p, forces, eq.p > 0, damped)
