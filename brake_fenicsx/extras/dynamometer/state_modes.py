"""Modes of a sample in every state: the same roughness and scatter, other numbers of the brake."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.build.values import Values
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.macro.sliding_friction import Rotation
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

from .states import AXES, read_columns, read_matrix, state_values, units_of_state

ARRAYS = [("state_of", int), ("state_s", complex), ("state_damping", float), ("state_mode", int)]
GAP = 'write a length with units, as "1 um * (r - 118 mm) / (22 mm)", or a CSV file of x, y, gap'


class StateModes:
    """Growing modes of any sample of a scene in each of its states."""

    def __init__(self, scene: Scene, models: Models):
        """Read the states."""
        self._scene, self._models, states = scene, models, read_matrix(scene)
        self._stability: Any = models.stability
        self._values = state_values(scene, states)
        self._signs = np.where(states.direction == "reverse", -1.0, 1.0)
        axes = states[[n for n in AXES if n in states]].to_dict("records")
        self._gaps = [imposed_gap(scene, models.brake.contact, state) for state in axes]
        self._equilibria = Equilibria.of_scene(scene, models)

    def of(self, sample: SampleInput, eq: Any, modes: Modes, _: Any, reduced: bool) -> Any:
        """Growing modes of a sample in every state, as arrays to store.

        Args:
            sample: its inputs.
            eq: its equilibrium in the scene's own state.
            modes: its modes there, whose families those of the states take.
            _: flutter partner of each.
            reduced: whether they are those of the reduced model; else they lend no family.

        Returns:
            ``state_outcome`` of each state, empty or why it failed, and ``state_missed``, modes
            beyond the tolerance; of each growing mode ``state_of``, the number of its state from
            1, ``state_s`` [1/s], ``state_damping`` and ``state_mode``, the mode of the sample that
            it continues, or -1.
        """
        n = self._signs.size
        outcome, missed, rows = [""] * n, np.zeros(n, int), list[Any]()
        starts = {1.0: eq.g}
        for i, sign in enumerate(self._signs):
            try:
                there, found = self.modes(sample, i, starts.get(sign))
            except (BrakeError, np.linalg.LinAlgError) as error:
                outcome[i] = str(error)
                continue
            starts[sign], same = there.g, np.full(len(found), -1)
            # Reversed friction transposes the problem of symmetric bodies.
            shapes = modes.right if sign > 0 else modes.left.conj()
            given = shapes, modes.frequency, found.right, found.frequency, RESEMBLES
            for own, other, _ in same_families(*given) if reduced else ():
                same[other] = own
            errors = relative_errors(found.s, found.error)
            missed[i] = np.sum(errors > self._stability.tolerance)
            grow = np.array(found.verdict, str) == "unstable"
            columns = found.s[grow], found.damping[grow], same[grow]
            rows += [(i + 1, *row) for row in zip(*columns, strict=True)]
        table = np.array(rows, ARRAYS)
        arrays = {name: table[name] for name, _ in ARRAYS}
        return {"state_outcome": np.array(outcome), "state_missed": missed, **arrays}

    def modes(self, sample: SampleInput, i: int, start: Any = None) -> Any:
        """Equilibrium and modes of a sample in a state.

        Args:
            sample: its inputs in the scene's own state.
            i: number of the state, from 0.
            start: gaps of an equilibrium nearby [m], or None.

        Raises:
            BrakeError: there is no equilibrium, or no brake has the numbers of the state.
        """
        here = self._in_state(sample, i)
        friction = here.friction  # in reverse it acts against s, and damps as before
        turned = replace(here, friction=replace(friction, mu=self._signs[i] * friction.mu))
        here, eq = self._equilibria.of(turned, True, start)
        rates = here.brake.rates(friction, eq.p)
        contact = ContactLinearisation.of(eq.k_vibration, here.friction.mu, *rates)
        model = self._models.reduction.of(here.approach)
        return eq, model.modes(here.brake.point, contact, self._stability.zeta_max)

    def _in_state(self, sample: SampleInput, i: int) -> SampleInput:
        """Inputs of a sample in a state; what is random keeps its ratio to the scene's value."""
        given = self._values.iloc[i]
        own = {name: x * sample.values.ratio(name) for name, x in given.items()}
        values = Values(self._scene, {**sample.values, **own})
        check_values(sample.approach, values)
        brake, laws = self._models.brake.at(values), sample.laws
        laws = replace(laws, g_cr=laws.g_cr - self._gaps[i])
        scaled = () if sample.approach in PERFECT else scaled_interfaces(self._scene)
        # For the modulus that the lining has in the state.
        ratios = [
            law_factor(name, values) / law_factor(name, sample.values) if name in scaled else 1.0
            for name in self._scene.contact
        ]
        if {*ratios} != {1.0}:
            joined = join_laws([scaled_laws(laws.laws, x) for x in ratios])
            index = laws.index + brake.contact.interface * len(laws.laws)
            laws = replace(laws, laws=joined, index=index)
        friction = friction_of_contact(brake.contact, sample.approach, values)
        return replace(sample, brake=brake, laws=laws, friction=friction)


def imposed_gap(scene: Scene, contact: Any, state: Mapping[str, float]) -> np.ndarray:
    """Gap that a state adds to each contact element [m], shape (elements,).

    Args:
        scene: its section ``states.gap`` has a formula or a file for an interface. A formula has
            units, "1 um * (r - 118 mm) / (22 mm)"; its names are x, y, z, r, the distance from the
            axis, and the numbers of the state. Pint evaluates it; it is never run as code.
        contact: the elements.
        state: pressure [Pa], speed [rad/s or m/s] and temperature [K above 0 degC].

    Raises:
        SceneError: the formula or the file is none.
    """
    import pint
    from scipy.interpolate import griddata

    out, motion = np.zeros(contact.interface.size), scene_motion(scene)
    units = units_of_state(scene, x="m", y="m", gap="m", temperature="delta_degC")
    registry: Any = pint.get_application_registry()  # type: ignore[no-untyped-call, unused-ignore]
    known = {name: registry.Quantity(x, units[name]) for name, x in state.items()}
    for name, given in scene.section("states").gap.items():
        own = contact.interface == list(scene.contact).index(name)
        x = contact.points[own]
        flat = motion.local(x) if isinstance(motion, Rotation) else x
        with reading(None, "as a gap", GAP, at=f"states.gap.{name} = {given[:80]!r}: "):
            if given.endswith(".csv"):
                table = read_columns(scene.path(given), units.__getitem__)
                at = table[["x", "y"]], table.gap, x[:, :2]
                inside, nearest = griddata(*at, "linear"), griddata(*at, "nearest")
                out[own] = np.where(np.isfinite(inside), inside, nearest)
            else:
                places = zip("xyzr", [*x.T, np.hypot(*flat.T[:2])], strict=True)
                known |= {n: registry.Quantity(place, "m") for n, place in places}
                out[own] = registry.parse_expression(given, **known).to("m").magnitude
            if not np.isfinite(out).all() or re.search(r"[^\w\s.+*/()-]", given):
                raise ValueError("it is no number on some contact element")
    return out
