"""State of the interfaces whose faces stick, in the first good sample of each approach."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.stuck import StuckState
from brake_fenicsx.scene import Scene

Array = NDArray[np.float64]

# Share of the area of an interface that may be open or beyond the limit without a warning.
FEW = 0.01


def stuck_states(
    scene: Scene,
    brake: Brake,
    first: Mapping[Task, Mapping[str, Any]],
    displacement: Callable[[Task, Mapping[str, Any]], Array],
) -> dict[str, dict[str, Any]]:
    """Interface -> approach -> numbers of elements, shares of the area, forces on the first face.

    Args:
        scene: the scene.
        brake: its operators.
        first: what was stored of the first good sample of each approach.
        displacement: that of the equilibrium of a stored sample [m], shape (dofs,).
    """
    found: dict[str, dict[str, Any]] = {name: {} for name in brake.stuck}
    numbers = list(scene.contact)
    for task, data in first.items():
        u = displacement(task, data)
        for name, stuck in brake.stuck.items():
            own = brake.contact.interface == numbers.index(name)
            limit = _limit(scene, name)
            state = stuck.state(u, data["p"][own], limit)
            found[name][task[0]] = _numbers(state, limit)
    return found


def stuck_warnings(scene: Scene, states: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """A line for each interface that mostly does not do what it is taken to do.

    Args:
        scene: the scene.
        states: see ``stuck_states``.
    """
    lines = []
    for name, by_approach in states.items():
        shares = {
            approach: (s["open"]["area_share"], s.get("beyond_friction", {}).get("area_share", 0.0))
            for approach, s in by_approach.items()
        }
        worst = max(shares, key=lambda approach: sum(shares[approach]), default=None)
        if worst is None or sum(shares[worst]) <= FEW:
            continue
        gone, beyond = (f"{100 * share:.2g} %" for share in shares[worst])
        lines.append(
            f"contact.{name}: stuck, but at the equilibrium ({scene.spoken(worst)}) {gone} of its"
            f" area is open and {beyond} is beyond the limit of its friction; the modes keep its"
            " tangential springs there all the same: press the faces more, or write slip ="
            ' "motion" for faces that slide'
        )
    return lines


def _limit(scene: Scene, name: str) -> float | None:
    """Friction coefficient at rest of an interface; None where the scene gives none."""
    friction = scene.contact[name].friction
    if isinstance(friction, float | int):
        return friction or None
    return float(friction.coefficient(np.zeros(1))[0][0]) or None


def _numbers(state: StuckState, limit: float | None) -> dict[str, Any]:
    """A state as the summary has it."""

    def part(chosen: NDArray[np.bool_]) -> dict[str, Any]:
        return {"elements": int(chosen.sum()), "area_share": state.share(chosen)}

    parts = {"open": part(state.is_open), "stuck": part(~state.is_open & ~state.beyond)}
    if limit is not None:
        parts["beyond_friction"] = part(state.beyond)
    return {
        "elements": int(state.w.size), "area_mm2": 1e6 * float(state.w.sum()), **parts,
        "normal_force_N": state.normal.tolist(), "tangential_force_N": state.tangential.tolist(),
    }  # fmt: skip
