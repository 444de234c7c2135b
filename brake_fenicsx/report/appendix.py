"""Appendix of the page: surface, laws, mesh, samples, accuracy and computing time, settings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from brake_fenicsx.tables import Value

from .accuracy import ERROR_COLUMNS, SPEED_COLUMNS, error_rows, speed_rows, stage_rows
from .blocks import Block, Heading, Picture, Preformatted, Section, Table, Text, pairs
from .picture import heading_of
from .rundata import RunData
from .sections import figures
from .surface_figures import surface_statistics

SPEED_HEADS = {
    "seconds_per_equilibrium": "equilibrium [s per sample]",
    "seconds_per_stability": "modes [s per sample]",
}
STATISTICS = (
    ("mean", "mean height over the instrument's zero [µm]", 1e6),
    ("median", "median height over the instrument's zero [µm]", 1e6),
    ("S_q", "S_q, root mean square [µm]", 1e6),
    ("S_sk", "S_sk, skewness [-]", 1.0),
    ("S_ku", "S_ku, kurtosis [-]", 1.0),
    ("c1", "c1, slope below q_c [-]", 1.0),
    ("c2", "c2, slope above q_c [-]", 1.0),
    ("q_c", "q_c, crossover [rad/m]", 1.0),
    ("C0", "C0, level of the spectrum at q_c [m⁴]", 1.0),
    ("fit_rms", "root mean square of ln(spectrum / fit) [-]", 1.0),
)
SHOWN = {  # of the summary, elsewhere on the page
    "settings", "in_effect", "versions", "seeds", "seconds", "peak_memory_mb", "process_memory_mb",
    "name", "warnings", "friction", "contact_forces", "finished", "scene_sha256",
}  # fmt: skip


def appendix_sections(run: RunData) -> list[Section]:
    """Sections for specialists; those without content are left out.

    Args:
        run: the results; pictures are read from its ``figures`` folder.
    """
    meshes = sorted((run.directory / "figures").glob("mesh*.png"))
    sections = [
        Section("laws", "Contact laws", figures(run, "figure8_laws", "figure7_contact_maps")),
        Section("surface", "Surface", _surface(run)),
        Section("samples", "Families and convergence over the samples",
                figures(run, "squeal_families", "convergence")),
        Section("mesh", "Mesh", [Picture(path, heading_of(path)) for path in meshes]),
        Section("accuracy", "Accuracy and computing time", _accuracy(run)),
        Section("settings", "Settings, seeds and versions", _settings(run)),
    ]  # fmt: skip
    return [section for section in sections if section.blocks]


def _surface(run: RunData) -> list[Block]:
    if run.surface is None:
        return []
    stats = surface_statistics(run.surface)
    by_numbers = "heights" not in run.surface
    rows: list[list[Value]] = []
    for key, text, factor in STATISTICS:
        value, error = stats.get(key), stats.get(f"{key}_error")
        if by_numbers and key in ("mean", "median", "fit_rms"):
            continue
        if not isinstance(value, int | float) or not np.isfinite(value):
            continue
        if isinstance(of_log := stats.get(f"ln_{key}_error"), int | float):
            error = of_log * value
        spread = float(error) * factor if isinstance(error, int | float) else np.nan
        rows.append([text, float(value) * factor, spread if np.isfinite(spread) else None])
    blocks = figures(run, "figure4_topography", "figure5_statistics", "figure6_artificial")
    if by_numbers:
        said = "The scene gives statistics in place of a scan; the figures show these, and there"
        blocks = [Text(f"{said} is no fit."), *blocks]
    return [*blocks, Table(["quantity", "value", "standard error"], rows)] if rows else blocks


def _accuracy(run: RunData) -> list[Block]:
    blocks: list[Block] = []
    if stages := stage_rows(run.summary):
        seconds = [float(row[1]) for row in stages if isinstance(row[1], int | float)]
        whole: list[Value] = ["sum", sum(seconds), None]
        blocks.append(Table(["stage", "time [s]", "peak memory [MB]"], [*stages, whole]))
        blocks.append(Text(
            "Times of the last run only; stages reused from earlier runs count as zero. Times per"
            " sample are medians over all samples."
        ))  # fmt: skip
    if speed := speed_rows(run):
        heads = [SPEED_HEADS.get(name, name.replace("_", " ")) for name in SPEED_COLUMNS]
        blocks.append(Table(heads, [[run.label(str(row[0])), *row[1:]] for row in speed]))
    if errors := error_rows(run):
        heads = [name.replace("_", " ") for name in ERROR_COLUMNS]
        blocks.append(Table(heads, [[run.label(str(row[0])), *row[1:]] for row in errors]))
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
            pairs("setting", run.summary["in_effect"], digits=12),
        ]
    elif isinstance(run.summary.get("settings"), Mapping):
        blocks.append(pairs("setting", run.summary["settings"]))
    elif run.scene is not None:
        blocks.append(Preformatted(run.scene))
    for key in ("seeds", "versions"):
        if isinstance(run.summary.get(key), Mapping):
            blocks += [Heading(key.capitalize()), pairs(key.rstrip("s"), run.summary[key])]
    return blocks
