"""Modes of a sample in every state: the same roughness and scatter, other numbers of the brake."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.results.families import ModeFamilies
from brake_fenicsx.samples.models import Models
from brake_fenicsx.samples.sampling import SampleInput, at_values
from brake_fenicsx.samples.solve import Equilibria, reduced_modes
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.stability import Modes
from brake_fenicsx.stability.modes import relative_errors

from .states import AXES, imposed_gap, read_matrix, state_values

ARRAYS = [("state_of", int), ("state_s", complex), ("state_damping", float), ("state_mode", int)]
HELD = 2**29  # bytes of compliances at most


class StateModes:
    """Growing modes of any sample of a scene in each of its states."""

    def __init__(self, scene: Scene, models: Models):
        """Read the states, and put those of one modulus one after the other: bodies are shared."""
        states, self._models = read_matrix(scene), models
        self._stability: Any = models.stability
        self._values = state_values(scene, states)
        self._signs = np.where(states.direction == "reverse", -1.0, 1.0)
        numbers, contact = states[[*AXES]], models.brake.contact
        self._gaps = [imposed_gap(scene, contact, row) for row in numbers.to_dict("records")]
        self._equilibria = Equilibria.of_scene(scene, models)
        own = [name for name in self._values if changes_bodies(scene, name)]
        self._order = self._values.reset_index(drop=True).sort_values([*own, *self._values]).index
        # Those of gaps and of slips, between all contact elements.
        most = HELD // (16 * max(contact.interface.size, 1) ** 2)
        for model in models.reduction.models.values():
            model.held = max(1, min(most, 1 + len(self._values[own].drop_duplicates())))
        # Gaps follow the logarithm of the pressure.
        places = numbers.assign(pressure=np.log(numbers.pressure), turns=self._signs)
        places = places.loc[:, places.nunique() > 1]
        self._places = (places / places.std()).to_numpy()

    def of(self, sample: SampleInput, eq: Any, modes: Modes, partners: Any, reduced: bool) -> Any:
        """Growing modes of a sample in every state, as arrays to store.

        Args:
            sample: its inputs.
            eq: its equilibrium in the scene's own state.
            modes: its modes there, whose families those of the states take.
            partners: flutter partner of each.
            reduced: whether they are those of the reduced model; else they lend no family.

        Returns:
            ``state_outcome`` of each state, empty or why it failed, and ``state_missed``, growing
            modes beyond the tolerance; of each growing mode ``state_of``, the number of its state
            from 1, ``state_s`` [1/s], ``state_damping`` and ``state_mode``, the mode of the sample
            that it continues, or -1.
        """
        outcome, missed = [""] * self._signs.size, np.zeros(self._signs.size, int)
        families, known, rows = ModeFamilies(), dict[int, Array](), list[Any]()
        named = np.full(len(modes) + 1, -1)
        if reduced:
            grows, number = np.array(modes.verdict, str) == "unstable", np.arange(len(modes))
            families.add(modes.right, modes.frequency, grows)
            # A flutter pair is one mode: that of the two that grows.
            named[:-1] = np.where((partners >= 0) & grows[partners] & ~grows, partners, number)
        for i in self._order:
            try:
                there, found = self.modes(sample, i, self._start(i, known, eq.g))
            except (BrakeError, np.linalg.LinAlgError) as error:
                outcome[i] = str(error)
                continue
            known[i], grow = there.g, np.array(found.verdict, str) == "unstable"
            same = families.add(found.right[:, grow], found.frequency[grow], grow[grow])
            errors = relative_errors(found.s, found.error)[grow]
            missed[i] = np.sum(errors > self._stability.tolerance)
            columns = found.s[grow], found.damping[grow], named[np.minimum(same, len(modes))]
            rows += [(i + 1, *row) for row in zip(*columns, strict=True)]
        table = np.array(rows, ARRAYS)
        arrays = {name: table[name] for name, _ in ARRAYS}
        return {"state_outcome": np.array(outcome), "state_missed": missed, **arrays}

    def modes(self, sample: SampleInput, i: int, start: Array | None = None) -> Any:
        """Equilibrium and growing modes of a sample in a state.

        Args:
            sample: its inputs in the scene's own state; what is random keeps its ratio to the
                scene's value.
            i: number of the state, from 0.
            start: gaps of an equilibrium nearby [m], or None.

        Raises:
            BrakeError: there is no equilibrium, or no brake has the numbers of the state.
        """
        values = self._values.iloc[i].items()
        here = at_values(sample, {name: x * sample.values.ratio(name) for name, x in values})
        # In reverse friction acts against s.
        friction = replace(here.friction, mu=self._signs[i] * here.friction.mu)
        laws = replace(here.laws, g_cr=here.laws.g_cr - self._gaps[i])
        here, eq = self._equilibria.of(replace(here, friction=friction, laws=laws), True, start)
        return eq, reduced_modes(self._models, here, eq, growing=True)

    def _start(self, i: int, known: Mapping[int, Array], usual: Array) -> Array:
        """Gaps from which a state starts [m], interpolated between those that are known."""
        from scipy.interpolate import RBFInterpolator

        # There may be too few states yet, or all on a line.
        with suppress(ValueError, np.linalg.LinAlgError):
            given = self._places[[*known]], np.array([*known.values()])
            return np.asarray(RBFInterpolator(*given, kernel="cubic")(self._places[[i]])[0])
        return [usual, *known.values()][-1]
