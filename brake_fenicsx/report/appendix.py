"""Appendix of the page: surface, laws, mesh, samples, accuracy and computing time, settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from brake_fenicsx.results.accuracy import ErrorRow, SpeedRow, error_rows, speed_rows, stage_rows
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import Row, Value
from brake_fenicsx.results.tables import Table as Rows

from .blocks import Block, Heading, Picture, Preformatted, Section, Special, Table, Text, pairs
from .figure_blocks import figures
from .mode_cards import Card, heading_of
from .surface_section import law_blocks, of_surface, surface_blocks

SPEED_HEADS = {
    "seconds_per_equilibrium": "equilibrium [s per sample]",
    "seconds_per_stability": "modes [s per sample]",
}
SHOWN = {  # of the summary, elsewhere on the page
    "settings", "in_effect", "versions", "seeds", "seconds", "peak_memory_mb", "process_memory_mb",
    "name", "warnings", "friction", "contact_forces", "finished", "scene_sha256",
}  # fmt: skip


def appendix_sections(run: RunData, cards: Sequence[Card] = ()) -> list[Section]:
    """Sections for specialists; those without content are left out.

    Args:
        run: the results; pictures are read from its ``figures`` folder.
        cards: mode shapes that are not shown before the appendix.
    """
    meshes = sorted((run.directory / "figures").glob("mesh*.png"))
    own = [] if of_surface(run) else [
        Section("laws", "Contact laws", law_blocks(run)),
        Section("surface", "Surface", surface_blocks(run)),
    ]  # fmt: skip
    sections = [
        Section("more-shapes", "Mode shapes of less severe families", [
            *([Special("shapes", cards)] if cards else []),
        ]),
        Section("driver-maps", "Drivers over the pads", figures(run, "driver_maps")),
        *own,
        Section("samples", "Families and convergence over the samples",
                figures(run, "squeal_families", "convergence")),
        Section("mesh", "Mesh", [Picture(path, heading_of(path)) for path in meshes]),
        Section("accuracy", "Accuracy and computing time", _accuracy(run)),
        Section("settings", "Settings, seeds and versions", _settings(run)),
    ]  # fmt: skip
    return [section for section in sections if section.blocks]


def _accuracy(run: RunData) -> list[Block]:
    blocks: list[Block] = []
    if stages := stage_rows(run.summary):
        rows: list[list[Value]] = [[r.stage, r.seconds, r.peak_memory_mb] for r in stages]
        rows.append(["sum", sum(r.seconds for r in stages if r.seconds is not None), None])
        blocks.append(Table(["stage", "time [s]", "peak memory [MB]"], rows))
        blocks.append(Text(
            "Times of the last run only; stages reused from earlier runs count as zero. Times per"
            " sample are medians over all samples."
        ))  # fmt: skip
    if speed := speed_rows(run):
        blocks.append(_table(run, SpeedRow, speed))
    if errors := error_rows(run):
        blocks.append(_table(run, ErrorRow, errors))
        blocks.append(Text(
            "Errors are relative error estimates of the eigenvalues; the condition number of an"
            " eigenvalue relates them to the backward error: error = backward error x condition."
        ))  # fmt: skip
    rest = {key: value for key, value in run.summary.items() if key not in SHOWN}
    facts: list[Block] = [pairs("quantity", rest, digits=6)] if rest else []
    return [*blocks, *figures(run, "eigenvalue_errors"), *facts]


def _table(run: RunData, kind: type[Row], rows: Sequence[Row]) -> Table:
    """Rows by approach, under the names of their columns."""
    heads = [SPEED_HEADS.get(name, name.replace("_", " ")) for name in kind.names()]
    cells = Rows.of(kind, rows).cells
    return Table(heads, [[run.label(str(row[0])), *row[1:]] for row in cells])


def _settings(run: RunData) -> list[Block]:
    """Settings once: those in effect, or as the scene writes them where no others are known."""
    blocks: list[Block] = []
    if isinstance(run.summary.get("in_effect"), Mapping):
        blocks += [
            Text("All settings in SI units, with defaults and changes by --set."),
            pairs("setting", run.summary["in_effect"]),
        ]
    elif run.scene is not None:
        blocks.append(Preformatted(run.scene))
    for key in ("seeds", "versions"):
        if isinstance(run.summary.get(key), Mapping):
            blocks += [Heading(key.capitalize()), pairs(key.rstrip("s"), run.summary[key])]
    return blocks
