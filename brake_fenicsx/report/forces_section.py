"""Table of the forces on each pad, means over the samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from brake_fenicsx.results.run import RunData

from .blocks import Block, Table, Text

ROUND_OFF = 1e-6  # relative scatter that is none
FORCES = ("normal_N", "friction_N", "torque_N_m", "effective_radius_mm")


def forces_blocks(run: RunData) -> list[Block]:
    """Forces of the braking equilibrium on each pad, means over the samples of an approach."""
    found = run.summary.get("contact_forces")
    if not isinstance(found, Mapping):
        return []
    rows = []
    for approach, pads in found.items():
        for name, pad in pads.items():
            closed = 100 * pad["contact_area_mm2"] / pad["face_area_mm2"]
            lead = pad["leading_half_share"]
            rows.append(
                [
                    run.label(approach), name,
                    *(_with_std(pad, key) for key in FORCES),
                    f"{closed:.1f} %", _with_std(pad, "largest_pressure_MPa"),
                    _with_std(pad, "centre_towards_leading_edge_mm"),
                    "-" if lead is None else f"{100 * lead:.1f} %",
                ]
            )  # fmt: skip
    if not rows:
        return []
    heads = [
        "approach", "pad", "normal force [N]", "friction force [N]", "brake torque [N m]",
        "effective radius [mm]", "face in contact", "largest pressure [MPa]",
        "centre of pressure towards the leading edge [mm]", "force on the leading half",
    ]  # fmt: skip
    turns = any(pad.get("torque_N_m") for pads in found.values() for pad in pads.values())
    less = (
        " Friction force: its resultant, which is less than the friction coefficient times the"
        " normal force, because the direction of friction turns along the pad."
    )
    return [
        Table(heads, rows),
        Text(
            "Means over the samples, with their standard deviation. The disc enters the pad"
            f" at the leading edge.{less if turns else ''} Torque: torque of this pad against the"
            " rotation; effective radius: torque over friction coefficient times normal force."
        ),
    ]


def _with_std(numbers: Mapping[str, Any], name: str) -> str:
    """A mean with its standard deviation, where the scene has the one and samples the other."""
    value, spread = numbers.get(name), numbers.get(f"{name}_std")
    if value is None:
        return "-"
    if spread is None or spread < ROUND_OFF * abs(value):
        return f"{value:.4g}"
    return f"{value:.4g} +- {spread:.2g}"
