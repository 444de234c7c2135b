"""What the page says of the surface and its contact laws, and the page of a run of these alone."""

from __future__ import annotations

import numpy as np

from brake_fenicsx.tables import Value

from .blocks import Block, Section, Table, Text
from .rundata import RunData
from .sections import figures
from .surface_figures import surface_statistics
from .verdict import Verdict, warnings_of

# Key, name, unit, and the unit's number in one SI unit; by the names of ISO 25178-2 where it has
# them.
STATISTICS = (
    ("mean", "mean height over the instrument's zero", "µm", 1e6),
    ("median", "median height over the instrument's zero", "µm", 1e6),
    ("S_a", "S_a, arithmetic mean height", "µm", 1e6),
    ("S_q", "S_q, root mean square height", "µm", 1e6),
    ("S_sk", "S_sk, skewness", "-", 1.0),
    ("S_ku", "S_ku, kurtosis", "-", 1.0),
    ("S_p", "S_p, maximum peak height", "µm", 1e6),
    ("S_v", "S_v, maximum pit depth", "µm", 1e6),
    ("S_z", "S_z, maximum height", "µm", 1e6),
    ("S_dq", "S_dq, root mean square gradient", "-", 1.0),
    ("S_dr", "S_dr, developed interfacial area ratio", "%", 100.0),
    ("S_al", "S_al, autocorrelation length (decay to 0.2)", "µm", 1e6),
    ("S_tr", "S_tr, texture aspect ratio (decay to 0.2)", "-", 1.0),
    ("c1", "c1, slope of the power spectrum below q_c", "-", 1.0),
    ("c2", "c2, slope of the power spectrum above q_c", "-", 1.0),
    ("q_c", "q_c, wave number of the crossover", "rad/mm", 1e-3),
    ("C0", "C0, level of the spectrum at q_c", "m⁴", 1.0),
    ("fit_rms", "root mean square of ln(spectrum / fit)", "-", 1.0),
)
SCANNED = ("mean", "median", "fit_rms")  # nothing where numbers are given in place of a scan
FIRST = ("S_a", "S_q", "S_z", "S_sk", "S_ku", "S_dq", "S_dr", "S_al")
UNSURE = 0.5  # standard error over the value


def of_surface(run: RunData) -> bool:
    """Whether a run is of a surface and its laws alone."""
    brake = (run.modes, run.samples, run.contact)
    return all(table is None for table in brake) and (run.surface or run.laws) is not None


def surface_verdict(run: RunData) -> Verdict:
    """The first screen of the page of a surface: its main parameters, and warnings."""
    rows = {key: row for key, row in _rows(run)}
    facts = [
        (str(rows[key][0]), f"{_number(rows[key][1])} {rows[key][3]}".removesuffix(" -"))
        for key in FIRST if key in rows
    ]  # fmt: skip
    return Verdict(facts=[*facts, *_law_facts(run)], warnings=[*warnings_of(run), *_unsure(run)])


def surface_sections(run: RunData) -> list[Section]:
    """Sections of the page of a surface before its appendix."""
    sections = [
        Section("surface", "Surface", surface_blocks(run)),
        Section("laws", "Contact laws", law_blocks(run)),
    ]
    return [section for section in sections if section.blocks]


def surface_blocks(run: RunData) -> list[Block]:
    """Figures and parameters of the surface."""
    if run.surface is None:
        return []
    rows = [row for _, row in _rows(run)]
    blocks: list[Block] = []
    if "heights" not in run.surface:
        said = "The scene gives statistics in place of a scan; the figures show these, and there"
        blocks.append(Text(f"{said} is no fit."))
    blocks += figures(run, "figure4_topography", "figure5_statistics")
    if rows:
        blocks.append(Table(["quantity", "value", "standard error", "unit"], rows))
        blocks.append(Text(
            "Names of ISO 25178-2. The form was removed (surface.level); there is no S-filter"
            " beyond the pixel and no L-filter, so that S_dq and S_dr depend on the size of the"
            " pixel. Standard errors: of heights from blocks of the scan, of the spectrum from its"
            " fit."
        ))  # fmt: skip
    return [
        *blocks,
        *figures(run, "bearing_curve", look="half"),
        *figures(run, "figure6_artificial"),
    ]


def law_blocks(run: RunData) -> list[Block]:
    """Figures of the contact laws and of the real contact."""
    return figures(run, "figure8_laws", "figure7_contact_maps")


def _rows(run: RunData) -> list[tuple[str, list[Value]]]:
    """Keys and rows of the table of parameters: name, value, standard error, unit."""
    if run.surface is None:
        return []
    stats, by_numbers = surface_statistics(run.surface), "heights" not in run.surface
    rows: list[tuple[str, list[Value]]] = []
    for key, text, unit, factor in STATISTICS:
        value, error = stats.get(key), stats.get(f"{key}_error")
        if by_numbers and key in SCANNED:
            continue
        if not isinstance(value, int | float) or not np.isfinite(value):
            continue
        if isinstance(of_log := stats.get(f"ln_{key}_error"), int | float):
            error = of_log * value
        spread = float(error) * factor if isinstance(error, int | float) else np.nan
        shown = spread if np.isfinite(spread) else None
        rows.append((key, [text, float(value) * factor, shown, unit]))
    return rows


def parameter_rows(run: RunData) -> list[list[Value]]:
    """Name, value, standard error and unit of every parameter of the surface."""
    return [[key, *row[1:]] for key, row in _rows(run)]


def _unsure(run: RunData) -> list[str]:
    """Parameters of the spectrum that the scan hardly determines."""
    return [
        f"the standard error of {row[0]} is {_number(row[2])} at a value of {_number(row[1])}"
        f" {row[3]}: the scan hardly determines it".replace(" -:", ":")
        for key, row in _rows(run)
        if key in ("c1", "c2", "q_c", "C0") and isinstance(row[2], float)
        and isinstance(row[1], float) and row[2] > UNSURE * abs(row[1])
    ]  # fmt: skip


def _law_facts(run: RunData) -> list[tuple[str, str]]:
    micro = run.summary.get("in_effect", {}).get("micro")
    if run.laws is None or not isinstance(micro, dict):
        return []
    patch, hardness = micro.get("patch"), micro.get("hardness")
    facts = [("Contact laws", f"{len(run.laws['d'])}")]
    if isinstance(patch, float) and isinstance(micro.get("pixels"), int):
        facts.append(
            ("Patch", f"{1e3 * patch:.4g} mm, {micro['pixels']} x {micro['pixels']} points")
        )
    if isinstance(micro.get("E"), float):
        facts.append(("Young's modulus", f"{micro['E'] / 1e6:.4g} MPa, nu {micro.get('nu')}"))
    said = f"{hardness / 1e6:.4g} MPa" if isinstance(hardness, float) else "none (elastic)"
    return [*facts, ("Hardness", said)]


def _number(value: Value) -> str:
    return f"{value:.3g}" if isinstance(value, float) else "-"
