"""Modes of a sample in every state: the same roughness and scatter, other numbers of the brake."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.build.material_table import nominal_value
from brake_fenicsx.build.values import Values
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.macro.gap import EnrichedGap
from brake_fenicsx.micro import join_laws, scaled_laws
from brake_fenicsx.results.families import RESEMBLES, same_families
from brake_fenicsx.samples.equilibria import Equilibria
from brake_fenicsx.samples.models import Models
from brake_fenicsx.samples.random_inputs import PERFECT, check_values, law_factor, scaled_interfaces
from brake_fenicsx.samples.sampling import SampleInput, friction_of_contact
from brake_fenicsx.scene import Scene
from brake_fenicsx.stability import Modes
from brake_fenicsx.stability.modes import relative_errors
from brake_fenicsx.stability.substructures import ContactLinearisation

from .gaps import imposed_gap
from .matrix import AXES, read_matrix, state_values

Array = NDArray[np.float64]


class StateModes:
    """Growing modes of any sample of a scene in each of its states."""

    def __init__(self, scene: Scene, models: Models):
        """Read the states."""
        self._scene, self._models, states = scene, models, read_matrix(scene)
        self._values = state_values(scene, states)
        self._reverse = [way == "reverse" for way in states.direction]
        axes = [{n: row[n] for n in AXES if n in row} for row in states.to_dict("records")]
        self._gaps = [imposed_gap(scene, models.brake.contact, state) for state in axes]
        self._equilibria = Equilibria.of_scene(scene, models)

    def of(
        self,
        sample: SampleInput,
        eq: Equilibrium,
        modes: Modes,
        partner: NDArray[np.intp],
        reduced: bool,
    ) -> dict[str, Any]:
        """Growing modes of a sample in every state, as arrays to store.

        Args:
            sample: its inputs.
            eq: its equilibrium in the scene's own state.
            modes: its modes there, whose families those of the states take.
            partner: flutter partner of each; not used.
            reduced: whether they are those of the reduced model; else they lend no family.

        Returns:
            ``state_outcome`` of each state, empty or why it failed, and ``state_missed``, modes
            beyond the tolerance; of each growing mode ``state_of``, the number of its state from
            0, ``state_s`` [1/s], ``state_damping`` and ``state_mode``, the mode of the sample that
            it continues, or -1.
        """
        outcome, missed = [""] * len(self._reverse), np.zeros(len(self._reverse), int)
        starts: dict[bool, Array | None] = {False: eq.g, True: None}
        rows = list[tuple[int, complex, float, int]]()
        for i, reverse in enumerate(self._reverse):
            try:
                there, found = self.modes(sample, i, starts[reverse])
            except BrakeError as error:
                outcome[i] = str(error)
                continue
            starts[reverse], same = there.g, np.full(len(found), -1)
            given = modes.right, modes.frequency, found.right, found.frequency, RESEMBLES
            for own, other, _ in same_families(*given) if reduced else ():
                same[other] = own
            missed[i] = np.sum(relative_errors(found.s, found.error) > self._settings.tolerance)
            for j in np.flatnonzero(np.array(found.verdict, str) == "unstable"):
                rows.append((i, found.s[j], found.damping[j], same[j]))
        columns = zip(*rows, strict=True) if rows else [()] * 4
        names = {"of": int, "s": complex, "damping": float, "mode": int}
        found_modes: dict[str, Any] = {
            f"state_{name}": np.array(values, kind)
            for (name, kind), values in zip(names.items(), columns, strict=True)
        }
        return {"state_outcome": np.array(outcome), "state_missed": missed, **found_modes}

    @property
    def _settings(self) -> Any:
        return self._models.stability

    def modes(
        self, sample: SampleInput, i: int, start: Array | None = None
    ) -> tuple[Equilibrium, Modes]:
        """Equilibrium and modes of a sample in a state.

        Args:
            sample: its inputs in the scene's own state.
            i: number of the state, from 0.
            start: gaps of an equilibrium nearby [m].

        Raises:
            BrakeError: there is no equilibrium, or no brake has the numbers of the state.
        """
        here = self._in_state(sample, i)
        friction = here.friction
        if self._reverse[i]:  # friction acts against s, and damps as before
            here = replace(here, friction=replace(friction, mu=-friction.mu))
        here, eq = self._equilibria.of(here, True, start)
        rates = here.brake.rates(friction, eq.p)
        contact = ContactLinearisation.of(eq.k_vibration, here.friction.mu, *rates)
        model = self._models.reduction.of(here.approach)
        return eq, model.modes(here.brake.point, contact, self._settings.zeta_max)

    def _in_state(self, sample: SampleInput, i: int) -> SampleInput:
        """Inputs of a sample in a state; what is random keeps its ratio to the scene's value."""
        values = dict(sample.values)
        for name, column in self._values.items():
            ratio = values[name] / nominal_value(self._scene, name) if name in values else 1.0
            values[name] = float(column[i]) * ratio
        drawn = Values(self._scene, values)
        check_values(sample.approach, drawn)
        brake, laws = self._models.brake.at(drawn), self._laws(sample, drawn)
        laws = replace(laws, g_cr=laws.g_cr - self._gaps[i])
        friction = friction_of_contact(brake.contact, sample.approach, drawn)
        return replace(sample, brake=brake, laws=laws, friction=friction)

    def _laws(self, sample: SampleInput, values: Values) -> EnrichedGap:
        """Laws of a sample for the modulus that its lining has in a state."""
        laws, names = sample.laws, scaled_interfaces(self._scene)
        ratios = [
            law_factor(name, values) / law_factor(name, sample.values) if name in names else 1.0
            for name in self._scene.contact
        ]
        if sample.approach in PERFECT or {*ratios} == {1.0}:
            return laws
        index = laws.index + sample.brake.contact.interface * len(laws.laws)
        return replace(
            laws, laws=join_laws([scaled_laws(laws.laws, x) for x in ratios]), index=index
        )
