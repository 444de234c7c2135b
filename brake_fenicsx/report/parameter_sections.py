"""Sections of the page on parameters, random inputs and forces on the pads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import Value

from .figures import figures
from .overview import cause_rows, share_text
from .page_blocks import Block, Table, Text

FAMILIES = 8  # rows of the tables of families, at least 2 of each approach


def rows_of_each(run: RunData) -> int:
    """Rows of each approach in the tables of families."""
    return max(2, FAMILIES // max(len(run.approaches), 1))


def sweep_blocks(run: RunData) -> list[Block]:
    """Branches over the parameter, and where each family begins to squeal."""
    drawn = figures(run, "sweep_branches", "sweep_critical", "sweep_samples", "sweep_chart")
    critical = run.sweep.get("critical")
    if critical is None or not critical["family"].size:
        return drawn
    rows: list[list[Value]] = []
    texts = kilohertz(critical["frequency_hz"].tolist())
    for i, family in enumerate(critical["family"]):
        low, middle, high = (critical[f"value_{p}"][i] for p in (5, 50, 95))
        interval = [critical[f"value_50_{end}"][i] for end in ("low", "high")]
        rows.append([
            "any" if np.isnan(family) else int(family), texts[i],
            int(critical["samples"][i]), int(critical["squeal_samples"][i]),
            *(_censored(v) for v in (low, middle, *interval, high)),
        ])  # fmt: skip
    heads = [
        "family", "frequency [kHz]", "samples", "squeal samples", "5 % squeal by", "50 % squeal by",
        "lower end of its 95 % interval", "upper end", "95 % squeal by",
    ]  # fmt: skip
    note = (
        f"Value of {critical['parameter'][0]} (SI units) at which a family begins to squeal, over"
        " the rough samples. A dash means a value outside the range of the sweep."
    )
    return [*drawn, Text(note), Table(heads, rows)]


def input_blocks(run: RunData) -> list[Block]:
    """Which inputs move the growth rate, and the probabilities of the most severe families."""
    rows: list[list[Value]] = [
        [
            run.label(approach), where, share_text(row["probability"], row["low"], row["high"]),
            _number(row["median_damping"]), row["above_limit"], row["dominant_input"] or None,
            interval_text(*(row[f"correlation{end}"] for end in ("", "_low", "_high"))),
            *(percent(value) for name, value in row.items() if name.startswith("share_")),
        ]
        for approach, where, row in cause_rows(run, rows_of_each(run))
    ]  # fmt: skip
    heads = [
        "approach", "where", f"probability of squeal ({run.criterion})", "median damping [-]",
        "likely to squeal", "strongest input", "rank correlation", "friction", "materials",
        "loads", "rest",
    ]  # fmt: skip
    limit = run.summary.get("in_effect", {}).get("samples", {}).get("limit")
    limit = f"{100 * limit:g} %" if isinstance(limit, int | float) else "the limit of the scene"
    notes = [
        f"Likely to squeal: yes if the 95 % interval of the probability lies above {limit}, open"
        " if it contains that limit."
    ]
    if any(row[5] is not None for row in rows):
        notes.append(
            "Strongest input: the random input with the strongest rank correlation with squeal;"
            " none where all samples or no sample squeal."
        )
    if any(row[7] is not None for row in rows):
        notes.append(
            "Friction, materials, loads: their shares of the variance of the growth rate (sums of"
            " first-order indices). The rest is interactions, and roughness where contact is"
            " rough. Negative shares are sampling error."
        )
    if rows and all(row[5] is None for row in rows):
        notes.append(
            "The scene has no random input, or too few samples to separate their effects; random"
            " inputs are listed in [samples.random], and stability.drivers gives derivatives."
        )
    told: list[Block] = [Text(" ".join(notes)), Table.without_empty(heads, rows)] if rows else []
    return [*figures(run, "sensitivity", "input_correlations"), *told]


def _censored(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def interval_text(*values: float) -> str | None:
    """A number with its interval; None without."""
    return "{:.2f} ({:.2f} to {:.2f})".format(*values) if np.all(np.isfinite(values)) else None


def percent(value: float) -> str | None:
    """A share in per cent, without "-0 %"."""
    return f"{round(100 * value) + 0} %" if np.isfinite(value) else None


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
