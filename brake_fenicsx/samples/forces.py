"""Contact of the samples in the summary: forces on the pads, and interfaces whose faces stick."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.build.brake import Brake
from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.macro.contact_elements import Contact, PadForces, StuckState, pad_forces
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.scene import Scene

# Values that differ by less, relatively, are the same.
ROUND_OFF = 1e-9
# Share of the area of an interface that may be open or beyond the limit without a warning.
FEW = 0.01


def mean_friction(contact: Contact, mu: Array) -> float:
    """Mean friction coefficient over the contact elements that slide.

    Args:
        contact: contact elements.
        mu: friction coefficient of each, shape (elements,).
    """
    chosen = mu[contact.speed > 0]
    ends = {float(chosen.min()), float(chosen.max())} if chosen.size else {0.0}
    # The mean of equal numbers is off by round-off.
    return float(f"{chosen.mean():.12g}") if len(ends) > 1 else ends.pop()


def forces_of_sample(scene: Scene, contact: Contact, p: Array, mu: Array) -> Array:
    """Numbers of the forces on the pads at an equilibrium.

    Args:
        scene: the scene.
        contact: contact elements of the sample.
        p: their pressures [Pa], shape (elements,).
        mu: their friction coefficients, likewise.

    Returns:
        Shape (pads, numbers), in the order of ``force_statistics``.
    """
    motion = scene_motion(scene)
    pads = pad_forces(contact, list(scene.contact), motion, p, mu)
    return np.array([[*_numbers(pad, isinstance(motion, Rotation)).values()] for pad in pads])


def moved(contact: Contact) -> Array:
    """What is stored of contact elements that a length moved, shape (elements, 7)."""
    return np.column_stack([contact.w, contact.points, contact.s])


def contact_of(contact: Contact, data: Mapping[str, Any]) -> Contact:
    """Contact elements of a stored sample by those of the scene."""
    if "moved" not in data:
        return contact
    w, points, s = np.split(np.asarray(data["moved"]), [1, 4], axis=1)
    return replace(contact, w=w[:, 0], points=points, s=s)


def force_statistics(
    scene: Scene, brake: Brake, first: Mapping[str, Any], values: Array
) -> dict[str, dict[str, Any]]:
    """Pad -> mean of each force over the good samples of an approach, and its standard deviation.

    Args:
        scene: the scene.
        brake: its operators.
        first: arrays of one sample.
        values: see ``forces_of_sample``, shape (samples, pads, numbers).

    Returns:
        Numbers by names that end in their unit; "normal_N_std" beside "normal_N" where there are
        two samples or more, None where something is not defined.
    """
    motion = scene_motion(scene)
    pads = pad_forces(
        brake.contact, list(scene.contact), motion, first["p"], np.asarray(first["mu"])
    )
    names = [_numbers(pad, isinstance(motion, Rotation)) for pad in pads]
    return {
        pad.name: _statistics([*own], values[:, i])
        for i, (pad, own) in enumerate(zip(pads, names, strict=True))
    }


def _numbers(pad: PadForces, turns: bool) -> dict[str, float]:
    x, y, z = 1e3 * pad.centre
    edges = np.degrees(pad.edges) if turns else 1e3 * np.array(pad.edges)
    unit = "deg" if turns else "mm"
    torque = {"torque_N_m": pad.torque, "effective_radius_mm": 1e3 * pad.effective_radius}
    return {
        "normal_N": pad.normal, "friction_N": float(np.linalg.norm(pad.friction)),
        **(torque if turns else {}),
        "contact_area_mm2": 1e6 * pad.area, "face_area_mm2": 1e6 * pad.nominal_area,
        "largest_pressure_MPa": 1e-6 * pad.largest_pressure,
        "centre_x_mm": x, "centre_y_mm": y, "centre_z_mm": z,
        "centre_towards_leading_edge_mm": 1e3 * pad.towards_leading,
        "leading_half_share": pad.leading_share,
        f"leading_edge_{unit}": float(edges[0]), f"trailing_edge_{unit}": float(edges[1]),
    }  # fmt: skip


def _statistics(names: list[str], rows: Array) -> dict[str, float | None]:
    """Mean and standard deviation of each column, shape (samples, names)."""
    out: dict[str, float | None] = {}
    for name, values in zip(names, rows.T, strict=True):
        known = bool(np.isfinite(values).all())
        out[name] = float(values.mean()) if known else None
        if len(values) > 1 and known and np.ptp(values) > ROUND_OFF * np.abs(values).max():
            out[f"{name}_std"] = float(values.std(ddof=1))
    return out


def stuck_states(
    scene: Scene,
    brake: Brake,
    first: Mapping[Task, Mapping[str, Any]],
    displaced: Mapping[Task, Array],
) -> dict[str, dict[str, Any]]:
    """Interface -> approach -> numbers of elements, shares of the area, forces on the first face.

    Args:
        scene: the scene.
        brake: its operators.
        first: what was stored of the first good sample of each approach.
        displaced: displacements of their equilibria [m], shape (dofs,) each.
    """
    found: dict[str, dict[str, Any]] = {name: {} for name in brake.stuck}
    numbers = list(scene.contact)
    for task, data in first.items():
        for name, stuck in brake.stuck.items():
            own = brake.contact.interface == numbers.index(name)
            limit = _limit(scene, name)
            state = stuck.state(displaced[task], data["p"][own], limit)
            found[name][task[0]] = _numbers_of_state(state, limit)
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


def law_warnings(scene: Scene, samples: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """A line where pressures leave the range in which the laws are known.

    Args:
        scene: the scene.
        samples: figures of each approach, see ``results.output``.
    """
    shares = {name: s.get("force_share_beyond_laws", 0.0) for name, s in samples.items()}
    worst = max(shares, key=lambda approach: shares[approach], default="")
    if shares.get(worst, 0.0) <= FEW:
        return []
    return [
        f"contact: at the equilibrium of a sample ({scene.spoken(worst)})"
        f" {100 * shares[worst]:.2g} % of the normal force stands on elements above the"
        " highest pressure of their laws, from where"
        " these go on as straight lines: raise micro.max_pressure or micro.hardness, or measure a"
        " law.table to higher pressures"
    ]


def _limit(scene: Scene, name: str) -> float | None:
    """Friction coefficient at rest of an interface; None where the scene gives none."""
    friction = scene.contact[name].friction
    if isinstance(friction, float | int):
        return friction or None
    return float(friction.coefficient(np.zeros(1))[0][0]) or None


def _numbers_of_state(state: StuckState, limit: float | None) -> dict[str, Any]:
    """A state as the summary has it."""

    def part(chosen: Mask) -> dict[str, Any]:
        return {"elements": int(chosen.sum()), "area_share": state.share(chosen)}

    parts = {"open": part(state.is_open), "stuck": part(~state.is_open & ~state.beyond)}
    if limit is not None:
        parts["beyond_friction"] = part(state.beyond)
    return {
        "elements": int(state.w.size), "area_mm2": 1e6 * float(state.w.sum()), **parts,
        "normal_force_N": state.normal.tolist(), "tangential_force_N": state.tangential.tolist(),
    }  # fmt: skip
