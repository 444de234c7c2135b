"""Forces on the pads over the samples of each approach, for the summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.macro.brake import Brake, scene_motion
from brake_fenicsx.macro.friction import Rotation
from brake_fenicsx.macro.resultants import PadForces, pad_forces
from brake_fenicsx.scene import Scene

Array = NDArray[np.float64]

# Values that differ by less, relatively, are the same.
ROUND_OFF = 1e-9


def forces_of_sample(scene: Scene, brake: Brake) -> Callable[[Mapping[str, Any]], list[PadForces]]:
    """What makes the forces on the pads from the arrays of a stored sample.

    Args:
        scene: the scene.
        brake: its operators.
    """
    motion, names = scene_motion(scene), list(scene.contact)

    def forces(data: Mapping[str, Any]) -> list[PadForces]:
        return pad_forces(brake.contact, names, motion, data["p"], np.asarray(data["mu"]))

    return forces


def forces_of_samples(
    scene: Scene, found: Mapping[Task, list[PadForces]]
) -> dict[str, dict[str, dict[str, Any]]]:
    """Approach -> pad -> mean of each force over the good samples, and its standard deviation.

    Args:
        scene: the scene.
        found: forces on the pads of each good sample.

    Returns:
        Numbers by names that end in their unit; "normal_N_std" beside "normal_N" where there are
        two samples or more, None where something is not defined.
    """
    turns = isinstance(scene_motion(scene), Rotation)
    out: dict[str, dict[str, dict[str, Any]]] = {}
    for approach in dict.fromkeys(name for name, _ in found):
        samples = [pads for task, pads in found.items() if task[0] == approach]
        out[approach] = {
            pads[0].name: _statistics([_numbers(pad, turns) for pad in pads])
            for pads in zip(*samples, strict=True)
        }
    return out


def _numbers(pad: PadForces, turns: bool) -> dict[str, float]:
    x, y, z = 1e3 * pad.centre
    edges = np.degrees(pad.edges) if turns else 1e3 * np.array(pad.edges)
    unit = "deg" if turns else "mm"
    torque = {
        "torque_N_m": pad.torque, "effective_radius_mm": 1e3 * pad.effective_radius,
    }  # fmt: skip
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


def _statistics(rows: list[dict[str, float]]) -> dict[str, float | None]:
    out: dict[str, float | None] = {}
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        known = bool(np.isfinite(values).all())
        out[name] = float(values.mean()) if known else None
        if len(values) > 1 and known and np.ptp(values) > ROUND_OFF * np.abs(values).max():
            out[f"{name}_std"] = float(values.std(ddof=1))
    return out
