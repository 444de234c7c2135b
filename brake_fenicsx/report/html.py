"""One self-contained HTML page of a run: opens offline, prints well, every text escaped."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.tables import Value

from .accuracy import ERROR_COLUMNS, SPEED_COLUMNS, error_rows, speed_rows, stage_rows
from .contact_forces import forces_section
from .counts import representative_modes
from .figures import PLOTS, make_figures
from .html_parts import image, pairs, table
from .overview import approach_rows, cause_rows, family_rows, open_points, share_text
from .page_style import CSS
from .rundata import RunData, read_run
from .surface_figures import surface_statistics

SHAPES = (
    "<p>The most severe families of each approach, at most four: of each the squeal mode of median "
    "damping (-2 alpha / |omega|). Colour: displacement relative to its maximum. Exploded view of "
    "the deformed bodies at the phase of largest motion, from both sides.</p>"
)
FAMILIES = 12  # rows of each approach in the table of families
CAPTIONS = {plot.name: plot.caption for plot in PLOTS}
JUDGED = {  # figures of what squeals
    "figure9_squeal_map", "squeal_families", "probability_per_band", "unstable_per_sample",
    "convergence", "input_correlations", "sensitivity", "drivers", "sweep_branches",
    "sweep_critical", "sweep_samples", "sweep_chart",
}  # fmt: skip
LAST_START = (
    "<p>Times of the last run only; stages reused from earlier runs count as zero. Times per "
    "sample are medians over all samples.</p>"
)
BY_NUMBERS = (
    "<p>The scene gives statistics in place of a scan; the figures show these, and there is no "
    "fit.</p>"
)
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


def write_report(directory: str | Path | RunData, redraw: bool = True) -> Path:
    """Write ``directory/report.html`` with all figures and tables of a run inside.

    Args:
        directory: the run directory, or its results already read.
        redraw: draw the figures anew; False takes those in ``directory/figures``.

    Returns:
        The path of the page.

    Raises:
        SceneError: the directory holds no result, or a file of it cannot be read.
    """
    run = read_run(directory)
    if redraw:
        make_figures(run)
    path = run.directory / "report.html"
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_text(render_page(run), encoding="utf-8")
    os.replace(part, path)
    return path


def render_page(run: RunData) -> str:
    """The page as text.

    Args:
        run: the results; pictures are read from its ``figures`` folder.

    Returns:
        HTML that is well-formed XML too; sections without content are left out.
    """
    sections = [
        ("squeal", "Squeal map", _squeal(run)),
        ("probability", "Probability per band", _probability(run)),
        ("sweep", "Lock-in over the parameter", _sweep(run)),
        ("inputs", "Which inputs cause it", _inputs(run)),
        ("forces", "Forces on the pads", forces_section(run)),
        ("drivers", "What drives a mode", _figures(run, "drivers", "driver_maps")),
        ("pressure", "Contact pressure on the pads", _figures(run, "contact_pressure")),
        ("shapes", "Mesh and mode shapes", _shapes(run)),
        ("laws", "Contact laws", _figures(run, "figure8_laws", "figure7_contact_maps")),
        ("surface", "Surface", _surface(run)),
        ("accuracy", "Accuracy and computing time", _accuracy(run)),
        ("settings", "Settings, seeds and versions", _settings(run)),
    ]
    shown = [section for section in sections if section[2]]
    links = "\n".join(f'<a href="#{key}">{escape(title)}</a>' for key, title, _ in shown)
    body = "\n".join(
        f'<section id="{key}">\n<h2>{number}. {escape(title)}</h2>\n{content}\n</section>'
        for number, (key, title, content) in enumerate(shown, start=1)
    )
    name = escape(_title(run))
    return (
        '<!DOCTYPE html>\n<html xmlns="http://www.w3.org/1999/xhtml" lang="en">\n<head>\n'
        '<meta charset="utf-8"/>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1"/>\n'
        f"<title>{name}</title>\n<style>\n{CSS}</style>\n</head>\n<body>\n"
        f"<header>\n<h1>{name}</h1>\n{_noted(run)}{_lead(run)}\n</header>\n<nav>\n{links}\n</nav>\n"
        f"<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _title(run: RunData) -> str:
    name = run.summary.get("name") or run.directory.resolve().name
    return f"Brake squeal study: {name}"


def _lead(run: RunData) -> str:
    """What came out, in one table."""
    rows = approach_rows(run)
    if not rows:
        return "<p>This run computed no modes.</p>"
    heads = [
        "approach",
        "samples",
        "failed",
        "modes",
        "unstable modes",
        "neutral modes",
        f"squeal modes ({run.criterion})",
        "squeal samples",
        "share of squeal samples",
        "most severe (squeal samples, median damping)",
    ]
    body = [[_name(run, row), *row[1:6], *row[7:9], share_text(row[9:12]), row[12]] for row in rows]
    return table(heads, body) + (
        f"<p>A mode counts as squeal where it is unstable with {run.criterion} "
        "(-2 alpha / |omega|; stability.threshold of the scene). Families are ranked by severity: "
        "the share of samples in which the family squeals, times the median of its damping "
        "there.</p>"
        "<p>Neutral: the sign of the growth rate is uncertain within its numerical error, or the "
        "mode is a rigid-body motion.</p>"
        "<p>Shares have 95 % Wilson intervals, which describe the sampling error and not the error "
        "of the model.</p>"
    )


def _noted(run: RunData) -> str:
    """Warnings of the run, what it leaves open, and the friction of each approach."""
    warnings, friction = run.summary.get("warnings"), run.summary.get("friction")
    lines = [f"Warning: {text}." for text in warnings] if isinstance(warnings, list) else []
    if text := open_points(run):
        lines.append(f"Warning: {text}.")
    if isinstance(friction, Mapping):
        said = (f"{run.label(name)} {text}" for name, text in friction.items())
        lines.append(f"Friction coefficient: {', '.join(said)}.")
    return "".join(f"<p>{escape(text)}</p>\n" for text in lines)


def _damping(run: RunData) -> str:
    """Which damping acts."""
    terms = run.summary.get("damping")
    if not isinstance(terms, Mapping) or not terms:
        return ""
    named = ", ".join(map(str, terms))
    return f"<p>Active damping terms (settings below): {escape(named)}.</p>"


def _squeal(run: RunData) -> str:
    figures = _figures(run, "figure9_squeal_map", "squeal_families")
    if not figures:
        return ""
    rows = [
        [
            _name(run, row),
            "by frequency" if row[1] == -1 else row[1],
            _kilo(row[2]),
            _kilo(row[3]),
            row[5],
            share_text(row[6:9]),
            *row[9:11],
        ]
        for row in family_rows(run, FAMILIES)
    ]
    heads = [
        "approach",
        "family",
        "frequency [kHz]",
        "spread [kHz]",
        f"squeal samples ({run.criterion})",
        "share",
        "median damping [-]",
        "lowest damping [-]",
    ]
    note = (
        "<p>An eigenvalue is alpha + i omega; drawn is -2 alpha / |omega|, twice the "
        "damping ratio. "
        "A mode with negative damping grows from the equilibrium: a squeal candidate, which counts "
        f"as squeal with {run.criterion}. A linear analysis does not predict the amplitude.</p>"
    )
    left = len(family_rows(run)) - len(rows)
    rest = "family" if left == 1 else "families"
    more = f"<p>{left} less severe {rest}: tables/families.csv.</p>" if left else ""
    return note + _damping(run) + figures + (table(heads, rows) if rows else "") + more


def _probability(run: RunData) -> str:
    return _figures(run, "probability_per_band", "unstable_per_sample", "convergence")


def _inputs(run: RunData) -> str:
    """Which inputs move the growth rate, and the probabilities of the most severe families."""
    rows = [
        [
            _name(run, row),
            row[1],
            share_text(row[2:5]),
            *row[5:7],
            row[7] or "-",
            _interval(row[8:11]),
            *(_percent(v) for v in row[11:]),
        ]
        for row in cause_rows(run)
    ]
    heads = [
        "approach",
        "where",
        f"probability of squeal ({run.criterion})",
        "median damping [-]",
        "likely to squeal",
        "strongest input",
        "rank correlation",
        "friction",
        "materials",
        "loads",
        "rest",
    ]
    limit = _limit(run)
    note = (
        f"<p>Likely to squeal: yes if the 95 % interval of the probability lies above {limit}, "
        "open if it contains that limit.</p>"
    )
    if any(row[5] != "-" for row in rows):
        note += (
            "<p>Strongest input: the random input with the strongest rank correlation with "
            "squeal; none where all samples or no sample squeal.</p>"
        )
    if any(row[7] != "-" for row in rows):
        note += (
            "<p>Friction, materials, loads: their shares of the variance of the growth rate (sums "
            "of first-order indices). The rest is interactions, and roughness where contact is "
            "rough. Negative shares are sampling error.</p>"
        )
    if rows and all(row[5] == "-" for row in rows):
        note += (
            "<p>The scene has no random input, or too few samples to separate their effects.</p>"
        )
    full = [j for j in range(len(heads)) if any(row[j] not in ("-", None) for row in rows)]
    short = [[row[j] for j in full] for row in rows]
    told = note + table([heads[j] for j in full], short) if rows else ""
    return _figures(run, "sensitivity", "input_correlations") + told


def _sweep(run: RunData) -> str:
    """Branches over the parameter, and where each family begins to squeal."""
    names = ("sweep_branches", "sweep_critical", "sweep_samples", "sweep_chart")
    figures, critical = _figures(run, *names), run.sweep.get("critical")
    if critical is None or not critical["family"].size:
        return figures
    rows = []
    for i, family in enumerate(critical["family"]):
        low, middle, high = (critical[f"value_{p}"][i] for p in (5, 50, 95))
        interval = [critical[f"value_50_{end}"][i] for end in ("low", "high")]
        rows.append([
            "any" if np.isnan(family) else int(family), f"{critical['frequency_hz'][i] / 1e3:.3f}",
            int(critical["samples"][i]), int(critical["squeal_samples"][i]),
            *(_censored(v) for v in (low, middle, *interval, high)),
        ])  # fmt: skip
    heads = [
        "family", "frequency [kHz]", "samples", "squeal samples", "5 % squeal by", "50 % squeal by",
        "lower end of its 95 % interval", "upper end", "95 % squeal by",
    ]  # fmt: skip
    note = (
        f"<p>Value of {escape(str(critical['parameter'][0]))} (SI units) at which a family begins "
        "to squeal, over the rough samples; a dash lies outside the values that were "
        "followed.</p>"
    )
    return figures + note + table(heads, rows)


def _censored(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"


def _limit(run: RunData) -> str:
    """The limit of the scene beyond which a family is called likely to squeal."""
    facts = run.summary.get("probabilities")
    limit = facts.get("limit") if isinstance(facts, Mapping) else None
    return f"{100 * limit:g} %" if isinstance(limit, int | float) else "the limit of the scene"


def _interval(values: Sequence[Value]) -> str:
    """A number with its interval, or a dash."""
    numbers = [float(v) for v in values if isinstance(v, float)]
    return "{:.2f} ({:.2f} to {:.2f})".format(*numbers) if len(numbers) == 3 else "-"


def _percent(value: Value) -> str:
    # No "-0 %".
    return f"{round(100 * value) + 0} %" if isinstance(value, float) else "-"


def _shapes(run: RunData) -> str:
    """The mesh, then the most severe modes of each approach."""
    folder = run.directory / "figures"
    meshes, modes = sorted(folder.glob("mesh*.png")), sorted(folder.glob("mode_*.png"))
    parts = [image(path, _heading(path), "shape") for path in meshes]
    parts += [SHAPES] if modes else []
    left = {*modes}
    for row in approach_rows(run):
        chosen = representative_modes(run, str(row[0]))
        rank = {f"{mode.frequency:05.0f}Hz": j for j, mode in enumerate(chosen)}
        paths = sorted(
            sorted(folder.glob(f"mode_{row[0]}_*Hz.png")),
            key=lambda path: rank.get(path.stem.rpartition("_")[2], len(rank)),
        )
        left -= {*paths}
        text = "" if row[7] else "<p>No mode of any sample squeals; none is drawn.</p>"
        if paths or text:
            drawn = [image(path, _heading(path), "shape") for path in paths]
            parts += [f"<h3>{escape(_name(run, row))}</h3>", text, *drawn]
    parts += [image(path, _heading(path), "shape") for path in sorted(left)]
    return "\n".join(part for part in parts if part)


def _heading(path: Path) -> str:
    """The heading drawn in a picture, or the name of its file."""
    pillow: Any = import_module("PIL.Image")  # comes with matplotlib
    with pillow.open(path) as picture:
        return str(picture.info.get("Title", path.stem.replace("_", " ")))


def _surface(run: RunData) -> str:
    if run.surface is None:
        return ""
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
    names = ("figure4_topography", "figure5_statistics", "figure6_artificial")
    numbers = table(["quantity", "value", "standard error"], rows) if rows else ""
    return (BY_NUMBERS if by_numbers else "") + _figures(run, *names) + numbers


def _accuracy(run: RunData) -> str:
    parts = []
    stages = stage_rows(run.summary)
    if stages:
        seconds = [float(row[1]) for row in stages if isinstance(row[1], int | float)]
        whole: list[Value] = ["sum", sum(seconds), None]
        parts.append(table(["stage", "time [s]", "peak memory [MB]"], [*stages, whole]))
        parts.append(LAST_START)
    speed = speed_rows(run)
    if speed:
        heads = [SPEED_HEADS.get(name, name.replace("_", " ")) for name in SPEED_COLUMNS]
        parts.append(table(heads, [[_name(run, row), *row[1:]] for row in speed]))
    errors = error_rows(run)
    if errors:
        heads = [name.replace("_", " ") for name in ERROR_COLUMNS]
        parts.append(table(heads, [[_name(run, row), *row[1:]] for row in errors]))
        parts.append(
            "<p>Errors are relative error estimates of the eigenvalues; the condition number of an "
            "eigenvalue relates them to the backward error: error = backward error x condition.</p>"
        )
    known = {
        "settings",
        "in_effect",
        "versions",
        "seeds",
        "seconds",
        "peak_memory_mb",
        "process_memory_mb",
        "name",
    }
    known |= {"warnings", "friction"}
    rest = {key: value for key, value in run.summary.items() if key not in known}
    if not parts and not rest:
        return ""
    facts = pairs("quantity", rest, digits=6) if rest else ""
    return "\n".join([*parts, _figures(run, "stages", "eigenvalue_errors"), facts])


def _settings(run: RunData) -> str:
    parts = [
        f"<h3>{escape(key.capitalize())}</h3>\n" + pairs(key.rstrip("s"), run.summary[key])
        for key in ("versions", "seeds", "settings")
        if isinstance(run.summary.get(key), Mapping)
    ]
    if isinstance(run.summary.get("in_effect"), Mapping):
        parts.append(
            "<h3>In effect</h3>\n<p>All settings in SI units, including defaults.</p>\n"
            + pairs("setting", run.summary["in_effect"], digits=12)
        )
    if run.scene is not None:
        parts.append(
            "<h3>Scene file</h3>\n<p>As written; the settings above include changes by --set.</p>\n"
            f"<pre>{escape(run.scene)}</pre>"
        )
    return "\n".join(parts)


def _figures(run: RunData, *names: str) -> str:
    said = {name: f" Squeal: {run.criterion}." if name in JUDGED else "" for name in names}
    paths = {name: run.directory / "figures" / f"{name}.png" for name in names}
    return "\n".join(
        image(path, CAPTIONS[name] + said[name]) for name, path in paths.items() if path.is_file()
    )


def _name(run: RunData, row: Sequence[Value]) -> str:
    """Name of the approach at the head of a row."""
    return run.label(str(row[0]))


def _kilo(value: Value) -> str:
    return f"{value / 1e3:.3f}" if isinstance(value, float) else "-"
