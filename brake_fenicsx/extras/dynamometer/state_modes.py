"""Modes of a sample in every state: the same roughness and scatter, other numbers of the brake."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.macro.sliding_friction import Rotation
from brake_fenicsx.results.families import ModeFamilies
from brake_fenicsx.samples.equilibria import Equilibria
from brake_fenicsx.samples.models import Models
from brake_fenicsx.samples.sampling import SampleInput, at_values
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.scalars import changes_bodies
from brake_fenicsx.stability import Modes
from brake_fenicsx.stability.modes import relative_errors
from brake_fenicsx.stability.substructures import ContactLinearisation

from .states import AXES, read_columns, read_matrix, state_values, units_of_state

ARRAYS = [("state_of", int), ("state_s", complex), ("state_damping", float), ("state_mode", int)]
HELD = 2**29  # bytes of compliances at most
GAP = 'write a length with units, as "1 um * (r - 118 mm) / (22 mm)", or a CSV file of x, y, gap'


class StateModes:
    """Growing modes of any sample of a scene in each of its states."""

    def __init__(self, scene: Scene, models: Models):
        """Read the states, and put those of one modulus one after the other: bodies are shared."""
        states, self._models = read_matrix(scene), models
        self._stability: Any = models.stability
        self._values = state_values(scene, states)
        self._signs = np.where(states.direction == "reverse", -1.0, 1.0)
        numbers = states[[n for n in AXES if n in states]]
        each = numbers.T.to_dict().values()
        self._gaps = [imposed_gap(scene, models.brake.contact, state) for state in each]
        self._equilibria = Equilibria.of_scene(scene, models)
        own = [name for name in self._values if changes_bodies(scene, name)]
        self._order = self._values.reset_index(drop=True).sort_values([*own, *self._values]).index
        if not any(changes_bodies(scene, name) for name in scene.samples.random):
            # Those of gaps and of slips, between all contact elements.
            most = HELD // (16 * max(models.brake.contact.interface.size, 1) ** 2)
            for model in models.reduction.models.values():
                model.held = max(1, min(most, 1 + len(self._values[own].drop_duplicates())))
        # Gaps follow the logarithm of the pressure.
        logs = {name: np.log(numbers[name]) for name in AXES[:2] if name in numbers}
        places = numbers.assign(**logs, turns=self._signs)
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
        grows, number = np.array(modes.verdict, str) == "unstable", np.arange(len(modes))
        # A flutter pair is one mode: that of the two that grows.
        named = np.append(
            np.where((partners >= 0) & grows[partners] & ~grows, partners, number), -1
        )
        if reduced:
            families.add(modes.right, modes.frequency, grows)
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
            same = named[np.minimum(same, len(modes))] if reduced else np.full_like(same, -1)
            columns = found.s[grow], found.damping[grow], same
            rows += [(i + 1, *row) for row in zip(*columns, strict=True)]
        table = np.array(sorted(rows, key=itemgetter(0)), ARRAYS)
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
        friction = here.friction  # in reverse it acts against s, and damps as before
        turned = replace(friction, mu=self._signs[i] * friction.mu)
        laws = replace(here.laws, g_cr=here.laws.g_cr - self._gaps[i])
        here, eq = self._equilibria.of(replace(here, friction=turned, laws=laws), True, start)
        rates = here.brake.rates(friction, eq.p)
        contact = ContactLinearisation.of(eq.k_vibration, turned.mu, *rates)
        model = self._models.reduction.of(here.approach)
        return eq, model.modes(here.brake.point, contact, self._stability.zeta_max, growing=True)

    def _start(self, i: int, known: Mapping[int, Array], usual: Array) -> Array:
        """Gaps from which a state starts [m], interpolated between those that are known."""
        from scipy.interpolate import RBFInterpolator

        # There may be too few states yet, or all on a line.
        with suppress(ValueError, np.linalg.LinAlgError):
            given = self._places[[*known]], np.array([*known.values()])
            return np.asarray(RBFInterpolator(*given, kernel="cubic")(self._places[[i]])[0])
        return [usual, *known.values()][-1]


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
    from scipy.interpolate import RBFInterpolator

    x, motion, out = contact.points, scene_motion(scene), np.zeros(contact.interface.size)
    flat = motion.local(x) if isinstance(motion, Rotation) else x
    units = units_of_state(scene, temperature="delta_degC", **dict.fromkeys([*"xyzr", "gap"], "m"))
    registry: Any = pint.get_application_registry()  # type: ignore[no-untyped-call, unused-ignore]
    numbers = {**state, **dict(zip("xyzr", [*x.T, np.hypot(*flat.T[:2])], strict=True))}
    known = {name: registry.Quantity(value, units[name]) for name, value in numbers.items()}
    for name, given in scene.section("states").gap.items():
        with reading(None, "as a gap", GAP, at=f"states.gap.{name} = {given[:80]!r}: "):
            if given.endswith(".csv"):
                table = read_columns(scene.path(given), units.__getitem__)
                found = RBFInterpolator(table[["x", "y"]], table.gap, kernel="linear")(x[:, :2])
            else:
                found = registry.parse_expression(given, **known).to("m").magnitude
            own = contact.interface == [*scene.contact].index(name)
            out[own] = np.broadcast_to(found, own.shape)[own]
            if not np.isfinite(out).all() or re.search(r"[^\w\s.+*/()-]", given):
                raise ValueError("it is no number on some contact element")
    return out
