"""Sections of the page on parameters, inputs and forces, and the appendix for specialists."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from brake_fenicsx.results import answer
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import kilohertz
from brake_fenicsx.results.tables import Value

from .figures import figures
from .mode_cards import Card, heading_of
from .page_blocks import LONGEST, Block, Picture, Section, Special, Table, Text, note, pairs
from .surface_page import law_blocks, of_surface, surface_blocks
from .sweep_figures import axis_of
from .verdict import warnings_of

FAMILIES = 8  # rows of the tables of families, at least 2 of each approach


def rows_of_each(run: RunData) -> int:
    """Rows of each approach in the tables of families."""
    return max(2, FAMILIES // max(len(run.approaches), 1))


def sweep_blocks(run: RunData) -> list[Block]:
    """Branches over the parameter, and where each family begins to squeal."""
    drawn = figures(run, "sweep_branches", "sweep_critical", "sweep_samples", "sweep_chart")
    critical = pd.DataFrame(run.sweep.get("critical", {}))
    if critical.empty:
        return drawn
    texts, (factor, parameter) = kilohertz(critical.frequency_hz.tolist()), axis_of(run)
    values = ["value_5", "value_50", "value_50_low", "value_50_high", "value_95"]
    shown = (factor * critical[values]).to_numpy()
    rows: list[list[Value]] = [
        ["any" if np.isnan(row.family) else int(row.family), text, int(row.samples),
         int(row.squeal_samples), *(f"{v:.4g}" if np.isfinite(v) else "-" for v in cells)]
        for row, text, cells in zip(critical.itertuples(), texts, shown, strict=True)
    ]  # fmt: skip
    return [*drawn, note("sweep", parameter=parameter), Table(Table.headings("sweep"), rows)]


def _causes(run: RunData, most: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Approach, where, and row of probabilities.csv of the whole band and the severest families."""
    table = pd.DataFrame(run.causes.get("probabilities", {"approach": []}))
    for approach in (name for name in run.approaches if (table.approach == name).any()):
        own = table[table.approach == approach]
        families = own[(own.scope == "family") & (own.squeal_samples > 0)]
        families = families.sort_values("severity", ascending=False, kind="stable")
        texts = kilohertz(families.frequency_hz.tolist())
        names = [f"{f} kHz, family {n}" for f, n in zip(texts, families["where"], strict=True)]
        whole = own[own.scope == "band"].head(1)
        rows = pd.concat([whole, families]).head(most).to_dict("records")
        for where, row in zip(["whole band"] * len(whole) + names, rows, strict=False):
            yield approach, where, row


def input_blocks(run: RunData) -> list[Block]:
    """Which inputs move the growth rate, and the probabilities of the most severe families."""
    rows: list[list[Value]] = [
        [
            run.label(approach), where,
            answer.share_text(row["probability"], row["low"], row["high"]),
            _number(row["median_damping"]), row["above_limit"], row["dominant_input"] or None,
            interval_text(*(row[f"correlation{end}"] for end in ("", "_low", "_high"))),
            *(percent(value) for name, value in row.items() if name.startswith("share_")),
        ]
        for approach, where, row in _causes(run, rows_of_each(run))
    ]  # fmt: skip
    heads = Table.headings("inputs", criterion=run.criterion)
    limit = run.in_effect("samples").get("limit")
    limit = f"{100 * limit:g} %" if isinstance(limit, int | float) else "the limit of the scene"
    notes = [note("likely", limit=limit)]
    if any(row[5] is not None for row in rows):
        notes.append(note("strongest"))
    if any(row[7] is not None for row in rows):
        notes.append(note("shares"))
    if rows and all(row[5] is None for row in rows):
        notes.append(note("no_inputs"))
    text = Text(" ".join(one.text for one in notes))
    told: list[Block] = [text, Table.without_empty(heads, rows)] if rows else []
    return [*figures(run, "sensitivity", "input_correlations"), *told]


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
PRESSURES = ("largest_pressure_MPa", "centre_towards_leading_edge_mm")


def forces_blocks(run: RunData) -> list[Block]:
    """Forces of the braking equilibrium on each pad, means over the samples of an approach."""
    found = run.summary.get("contact_forces")
    if not isinstance(found, Mapping):
        return []
    pads = [(run.label(a), name, pad) for a, own in found.items() for name, pad in own.items()]
    rows = [
        [approach, name, *(_with_std(pad, key) for key in FORCES),
         f"{100 * pad['contact_area_mm2'] / pad['face_area_mm2']:.1f} %",
         *(_with_std(pad, key) for key in PRESSURES),
         "-" if (lead := pad["leading_half_share"]) is None else f"{100 * lead:.1f} %"]
        for approach, name, pad in pads
    ]  # fmt: skip
    if not rows:
        return []
    turns = any(pad.get("torque_N_m") for *_, pad in pads)
    return [
        Table(Table.headings("forces"), rows),
        note("forces", less=note("less_friction").text if turns else ""),
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
# Of the summary, elsewhere on the page.
NUMBERS = "versions", "seeds", "seconds", "peak_memory_mb", "process_memory_mb", "samples"
OTHERS = "name", "warnings", "friction", "contact_forces", "finished", "scene_sha256"
SHOWN = {"settings", "in_effect", *NUMBERS, *OTHERS}


def appendix_sections(run: RunData, cards: Sequence[Card] = ()) -> list[Section]:
    """Sections for specialists.

    Args:
        run: the results; pictures are read from its ``figures`` folder.
        cards: mode shapes that are not shown before the appendix.
    """
    own = []
    if not of_surface(run):
        own = [Section("surface", "Surface", surface_blocks(run))]
        own.append(Section("laws", "Contact laws", law_blocks(run)))
    return [
        Section("more-shapes", "Mode shapes of less severe families",
                [Special("shapes", cards)] if cards else []),
        Section("driver-maps", "Drivers over the pads", figures(run, "driver_maps")),
        *own,
        Section("accuracy", "Mesh, accuracy, convergence and computing time", _accuracy(run)),
        Section("remarks", "Other warnings", [Text(f"{t}.") for t in warnings_of(run)[1]]),
        Section("settings", "Settings, seeds and versions", _settings(run)),
    ]  # fmt: skip


def _accuracy(run: RunData) -> list[Block]:
    meshes = sorted((run.directory / "figures").glob("mesh*.png"))
    blocks: list[Block] = [Picture(path, heading_of(path), "half") for path in meshes]
    blocks += figures(run, "eigenvalue_errors", "convergence", look="half")
    if stages := answer.stage_rows(run.summary):
        rows: list[list[Value]] = [
            [answer.STAGES.get(r.stage, r.stage), r.seconds, r.peak_memory_mb] for r in stages
        ]
        rows.append(["sum", sum(r.seconds for r in stages if r.seconds is not None), None])
        blocks.append(Table(["stage", "time [s]", "peak memory [MB]"], rows))
        blocks.append(note("stages"))
    if speed := answer.speed_rows(run):
        blocks.append(Table(*answer.for_reading(run, speed, **SPEED_HEADS)))
    if errors := answer.error_rows(run):
        blocks.append(Table(*answer.for_reading(run, errors)))
        blocks.append(note("errors"))
    rest = {key: value for key, value in run.summary.items() if key not in SHOWN}
    return [*blocks, *pairs(rest)]


def _settings(run: RunData) -> list[Block]:
    """Settings as the scene writes them, with changes by --set, a line for each table of it."""
    blocks: list[Block] = []
    if isinstance(settings := run.summary.get("settings"), Mapping) and settings:
        tables = scene_tables(settings)
        blocks += [note("settings"), Special("pairs", tables)]
    elif run.scene is not None:
        blocks.append(Text(run.scene, "preformatted"))
    for key in ("seeds", "versions"):
        if isinstance(found := run.summary.get(key), Mapping):
            said = ", ".join(f"{name} {value}" for name, value in found.items())
            blocks.append(Text(f"{key.capitalize()}: {said}."))
    return blocks


def scene_tables(table: Mapping[str, Any], name: str = "") -> list[tuple[str, str]]:
    """Tables of a scene to the second level, each with its keys as TOML on one line."""
    inner = {k: v for k, v in table.items() if isinstance(v, Mapping) and name.count(".") < 1}
    own = {k: v for k, v in table.items() if k not in inner}
    lines = [(f"[{name}]" if name else "", _toml(own)[2:-2])] if own else []
    for key, value in inner.items():
        lines += scene_tables(value, f"{name}.{_key(key)}" if name else _key(key))
    return lines


def _key(name: str) -> str:
    return json.dumps(name) if "." in name else name


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(k)} = {_toml(v)}' for k, v in value.items())} }}"
    if isinstance(value, list):
        shown = [*map(_toml, value[:LONGEST]), *["..."] * (len(value) > LONGEST)]
        return f"[{', '.join(shown)}]"
    return json.dumps(value, ensure_ascii=False)
