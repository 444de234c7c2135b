"""Sections of the page on parameters, inputs and forces, and the appendix for specialists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from brake_fenicsx.results.accuracy import STAGES, error_rows, speed_rows, stage_rows
from brake_fenicsx.results.answer import for_reading, share_text
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import Value

from .figures import figures
from .mode_cards import Card, heading_of
from .page_blocks import Block, Picture, Section, Special, Table, Text, pairs
from .surface_page import law_blocks, of_surface, surface_blocks

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


def cause_rows(run: RunData, most: int = 12) -> list[tuple[str, str, dict[str, Any]]]:
    """What is known of the squeal of the whole band and of the families, the most severe first.

    Args:
        run: the results.
        most: rows of each approach.

    Returns:
        Approach, where, and a row of probabilities.csv by its names; nan of an empty cell.
    """
    table = run.causes.get("probabilities")
    if table is None:
        return []
    every = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    rows: list[tuple[str, str, dict[str, Any]]] = []
    for approach in run.approaches:
        own = [row for row in every if row["approach"] == approach]
        whole = [row for row in own if row["scope"] == "band"][:1]
        families = [row for row in own if row["scope"] == "family" and row["squeal_samples"]]
        families.sort(key=lambda row: -row["severity"])
        texts = kilohertz([row["frequency_hz"] for row in families])
        names = ["whole band" for _ in whole]
        names += [f"{f} kHz, family {row['where']}" for f, row in zip(texts, families, strict=True)]
        pairs = zip(names, [*whole, *families], strict=True)
        rows += [(approach, where, row) for where, row in pairs][:most]
    return rows


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
    limit = run.in_effect("samples").get("limit")
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


SPEED_HEADS = {
    "seconds_per_equilibrium": "equilibrium [s per sample]",
    "seconds_per_stability": "modes [s per sample]",
}
SHOWN = {  # of the summary, elsewhere on the page
    "settings", "in_effect", "versions", "seeds", "seconds", "peak_memory_mb", "process_memory_mb",
    "name", "warnings", "friction", "contact_forces", "finished", "scene_sha256",
}  # fmt: skip


def appendix_sections(run: RunData, cards: Sequence[Card] = ()) -> list[Section]:
    """Sections for specialists.

    Args:
        run: the results; pictures are read from its ``figures`` folder.
        cards: mode shapes that are not shown before the appendix.
    """
    meshes = sorted((run.directory / "figures").glob("mesh*.png"))
    own = [] if of_surface(run) else [
        Section("laws", "Contact laws", law_blocks(run)),
        Section("surface", "Surface", surface_blocks(run)),
    ]  # fmt: skip
    return [
        Section("more-shapes", "Mode shapes of less severe families",
                [Special("shapes", cards)] if cards else []),
        Section("driver-maps", "Drivers over the pads", figures(run, "driver_maps")),
        *own,
        Section("samples", "Families and convergence over the samples",
                figures(run, "squeal_families", "convergence")),
        Section("mesh", "Mesh", [Picture(path, heading_of(path)) for path in meshes]),
        Section("accuracy", "Accuracy and computing time", _accuracy(run)),
        Section("settings", "Settings, seeds and versions", _settings(run)),
    ]  # fmt: skip


def _accuracy(run: RunData) -> list[Block]:
    blocks: list[Block] = []
    if stages := stage_rows(run.summary):
        rows: list[list[Value]] = [
            [STAGES.get(r.stage, r.stage), r.seconds, r.peak_memory_mb] for r in stages
        ]
        rows.append(["sum", sum(r.seconds for r in stages if r.seconds is not None), None])
        blocks.append(Table(["stage", "time [s]", "peak memory [MB]"], rows))
        blocks.append(Text(
            "Times of the last run only; stages reused from earlier runs count as zero. Times per"
            " sample are medians over all samples."
        ))  # fmt: skip
    if speed := speed_rows(run):
        blocks.append(Table(*for_reading(run, speed, **SPEED_HEADS)))
    if errors := error_rows(run):
        blocks.append(Table(*for_reading(run, errors)))
        blocks.append(Text(
            "Errors are relative error estimates of the eigenvalues; the condition number of an"
            " eigenvalue relates them to the backward error: error = backward error x condition."
        ))  # fmt: skip
    rest = {key: value for key, value in run.summary.items() if key not in SHOWN}
    facts: list[Block] = [pairs("quantity", rest, digits=6)] if rest else []
    return [*blocks, *figures(run, "eigenvalue_errors"), *facts]


def _settings(run: RunData) -> list[Block]:
    """Settings once: those in effect, or as the scene writes them where no others are known."""
    blocks: list[Block] = []
    if isinstance(run.summary.get("in_effect"), Mapping):
        blocks += [
            Text("All settings in SI units, with defaults and changes by --set."),
            pairs("setting", run.summary["in_effect"]),
        ]
    elif run.scene is not None:
        blocks.append(Text(run.scene, "preformatted"))
    for key in ("seeds", "versions"):
        if isinstance(run.summary.get(key), Mapping):
            blocks += [Text(key.capitalize(), "heading"), pairs(key.rstrip("s"), run.summary[key])]
    return blocks
