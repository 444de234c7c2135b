"""Limit cycles of a study's samples: what the scene and its samples say to ``limit_cycle``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.samples.models import Models
from brake_fenicsx.samples.sampling import friction_law
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.approaches import PERFECT
from brake_fenicsx.stability.modes import Modes

from .contact_forces import PeriodForces
from .sample import SampleCycles
from .sound import nodes_of

if TYPE_CHECKING:
    from brake_fenicsx.model import Model
    from brake_fenicsx.samples.sampling import SampleInput


class Cycles:
    """Limit cycles of any sample of a scene."""

    def __init__(self, scene: Scene, models: Models):
        """Gather the faces whose motion is measured."""
        brake, self._table = models.brake, scene.section("limit_cycle")
        pairs = [contact.faces for contact in scene.contact.values()]
        disc = self._table.radiating or tuple(dict.fromkeys(faces[1] for faces in pairs))
        pads = tuple(dict.fromkeys(faces[0] for faces in pairs))
        nodes = partial(nodes_of, brake.mesh, brake.elastic.free)
        self._scene, self._models, self._faces = scene, models, (nodes(disc), nodes(pads))
        self._threshold = models.stability.threshold if models.stability else 0.0

    def of(
        self,
        sample: SampleInput,
        eq: Equilibrium,
        modes: Modes,
        partner: NDArray[np.intp],
        reduced: bool,
    ) -> dict[str, Any]:
        """Limit cycles of a sample's growing modes; see ``SampleCycles.arrays``.

        Args:
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
        return self.sample(sample, eq).arrays(modes, self._table, self._threshold)

    def sample(self, sample: SampleInput, eq: Equilibrium) -> SampleCycles:
        """The equations of a sample; arguments as above."""
        reduction, scene, approach = self._models.reduction, self._scene, sample.approach
        model, contact = reduction.of(sample.approach), sample.brake.contact
        hard = scene.micro is not None and scene.micro.hardness is not None
        yields = np.array([
            hard and table.law == "library" and approach not in PERFECT
            for table in scene.contact.values()
        ])  # fmt: skip
        followed = model.rows.followed
        law = friction_law(contact, approach, sample.values) if "T" in followed else None
        forces = PeriodForces(
            sample.laws, yields[contact.interface], contact.w, eq.g, sample.friction, followed, law
        )
        damped = reduction.damped(approach)
        return SampleCycles(
            model, sample.brake.point, forces, eq.p > 0, damped, self._faces, contact.T
        )


def limit_cycles(
    model: Model,
    values: Mapping[str, float | str] | None = None,
    approach: str | None = None,
    sample: int = 0,
) -> list[dict[str, Any]]:
    """Limit cycles of the growing modes of a sample, each alone.

    Args:
        model: the scene, see ``prepare``.
        values: scalars of the scene, as in ``Model.modes``.
        approach: one of the scene's; its first if None.
        sample: number of the sample.

    Returns:
        One record for each cycle: ``mode``, ``outcome`` and the measures of limit_cycle.csv;
        ``branch``, amplitude [m] and alpha + i omega [1/s] of the points of its branch.

    Raises:
        SceneError: the scene has no section [limit_cycle].
    """
    if "limit cycles" not in model.study.beside:
        raise SceneError(f"{model.scene.file}: limit_cycle: the section is missing")
    found = model.work_beside("limit cycles", values, approach, sample)
    points = np.array([found["branch_amplitude"], found["branch_s"]])
    rows = zip(found["cycle_mode"], found["cycle_kind"], found["cycle_values"], strict=True)
    return [
        {"mode": int(i), "outcome": str(kind), "branch": points[:, found["branch_mode"] == i]}
        | dict(zip(map(str, found["cycle_names"]), row, strict=True))
        for i, kind, row in rows
    ]
