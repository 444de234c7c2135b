"""Surface and contact laws: on the page, on a page of their own, and as tables."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.folder.files import whole_file
from brake_fenicsx.results.run import Arrays, RunData
from brake_fenicsx.results.tables import Value, write_rows

from .contact_figures import settings_of
from .figures import figures
from .page_blocks import Block, Section, Table, note, texts
from .surface_figures import bearing_curves, surface_statistics
from .verdict import Verdict, warnings_of

# Numbers of a unit in one SI unit; key, name, unit and this of every parameter, by the names of
# ISO 25178-2 where it has them.
FACTORS = {"µm": 1e6, "-": 1.0, "%": 100.0, "1/mm": 1e-3, "m⁴": 1.0}
STATISTICS = [
    (key, text, unit, FACTORS[unit])
    for key, line in texts("statistics").items()
    for text, _, unit in (line.partition(" | "),)
]
SCANNED = ("mean", "median", "fit_rms")  # nothing where numbers are given in place of a scan
FIRST = ("S_a", "S_q", "S_z", "S_sk", "S_ku", "S_dq", "S_dr", "S_al")
MOST_COLUMNS = 6  # of scans in a table
UNSURE = 0.5  # standard error over the value
LAW_COLUMNS = {
    "d": "d_m",
    "p": "p_Pa",
    "k": "k_Pa_per_m",
    "v": "k_vibration_Pa_per_m",
    "area": "touching_share",
}
SUPPORT_COLUMNS = (
    "p_Pa", "scan_pixels", "grid_pixels",
    *(f"{name}_{share}_Pa_per_m" for name in ("k", "k_vibration", "k_patch", "k_vibration_patch")
      for share in ("5", "50", "95")),
)  # fmt: skip
HEIGHTS = "artificial_surface"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of the surface in its unit; numbers that are not known are None.

    Attributes:
        key: its short name.
        text: its name.
        unit: of its numbers.
        value: of the surface.
        error: standard error of the value.
        each: with several scans their mean and standard deviation, and the value of each.
    """

    key: str
    text: str
    unit: str
    value: float | None
    error: float | None
    each: list[float | None]


def of_surface(run: RunData) -> bool:
    """Whether a run is of a surface and its laws alone."""
    brake = (run.modes, run.samples, run.contact)
    return all(table is None for table in brake) and (run.surface or run.laws) is not None


def surface_verdict(run: RunData) -> Verdict:
    """The first screen of the page of a surface: its main parameters, and warnings."""
    known = {p.key: p for p in parameters(run)}
    facts = [(p.text, _fact(p)) for key in FIRST if (p := known.get(key))]
    if scans := scans_of(run):
        facts.insert(0, ("Scans", f"{len(scans)}; ±: standard deviation over the scans"))
    return Verdict(facts=[*facts, *_law_facts(run)], warnings=[*warnings_of(run)[0], *_unsure(run)])


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
    known = parameters(run)
    return [
        *([note("no_scan")] if "heights" not in run.surface else []),
        *figures(run, "figure4_topography", "bearing_curve", look="half"),
        *figures(run, "figure5_statistics"),
        *(_parameter_blocks(run, known) if known else []),
        *figures(run, "figure6_artificial", "figure7_contact_maps", look="half"),
        *_own_surfaces(run),
    ]


def _parameter_blocks(run: RunData, known: list[Parameter]) -> list[Block]:
    """Tables of the parameters, and what they are."""
    level = run.in_effect("surface").get("level", "")
    form = {"plane": "The least-squares plane", "second-order": "The second-order polynomial"}
    names = note("parameters", form=form.get(level, "The mean height")).text
    scans = scans_of(run)
    over = ["mean", "standard deviation"] if scans else []
    heads = ["quantity", "value", "standard error", *over, "unit"]
    first = Table(heads, [[p.text, p.value, p.error, *p.each[:2], p.unit] for p in known])
    if not scans:
        return [first, note("errors_of_one_scan", names=names)]
    blocks: list[Block] = [first, note("errors_of_scans", names=names)]
    lost = [[k, s["file"], s["missing"], s["outliers"]] for k, s in enumerate(scans, start=1)]
    blocks.append(Table(["scan", "file", "missing points", "masked outliers"], lost))
    return [*blocks, *_beside({f"scan {k}": scan for k, scan in enumerate(scans, start=1)})]


def _own_surfaces(run: RunData) -> list[Block]:
    """Tables of the surfaces that interfaces have of their own, beside that of the others."""
    own = run.summary.get("own_surfaces", {})
    if run.surface is None or not own:
        return []
    return [note("own_surfaces"), *_beside({"surface": surface_statistics(run.surface), **own})]


def _beside(surfaces: Mapping[str, Mapping[str, Any]]) -> Iterator[Table]:
    """Parameters of several surfaces, of some in a table."""
    for start in range(0, len(surfaces), MOST_COLUMNS):
        names = [*surfaces][start : start + MOST_COLUMNS]
        rows = [
            [text, *(_of_scan(surfaces[n], key, factor) for n in names), unit]
            for key, text, unit, factor in STATISTICS
        ]
        known = [row for row in rows if any(value is not None for value in row[1:-1])]
        yield Table(["quantity", *names, "unit"], known)


def law_blocks(run: RunData) -> list[Block]:
    """Figure of the contact laws; without a surface also that of the real contact."""
    more = figures(run, "figure7_contact_maps", look="half") if run.surface is None else []
    return [*figures(run, "figure8_laws"), *more]


def parameters(run: RunData) -> list[Parameter]:
    """Parameters of the surface of a run that are known."""
    if run.surface is None:
        return []
    stats, scans = surface_statistics(run.surface), scans_of(run)
    over = [stats["scan_mean"], stats["scan_std"], *scans] if scans else []
    found = []
    for key, text, unit, factor in STATISTICS:
        if "heights" not in run.surface and key in SCANNED:
            continue
        value, error = _scaled(stats, key, factor), _scaled(stats, f"{key}_error", factor)
        if value is not None and (of_log := _scaled(stats, f"ln_{key}_error", 1.0)) is not None:
            error = of_log * value
        each = [_scaled(table, key, factor) for table in over]
        if value is not None or any(v is not None for v in each):
            found.append(Parameter(key, text, unit, value, error, each))
    return found


def _scaled(table: Mapping[str, Any], key: str, factor: float) -> float | None:
    """A finite number of a table times a factor; None if there is none."""
    value = table.get(key)
    if not isinstance(value, int | float) or not np.isfinite(value):
        return None
    return float(value) * factor


def _of_scan(table: Mapping[str, Any], key: str, factor: float) -> float | None:
    """The same; None where numbers are given in place of the scan that has it."""
    return None if key in SCANNED and "S_a" not in table else _scaled(table, key, factor)


def scans_of(run: RunData) -> list[dict[str, Any]]:
    """Parameters of each scan, where several are averaged."""
    found = surface_statistics(run.surface).get("scans") if run.surface else None
    return found if isinstance(found, list) else []


def parameter_rows(run: RunData) -> list[list[Value]]:
    """Key, value, standard error and unit of every parameter; mean, scatter, and each scan."""
    return [[p.key, p.value, p.error, p.unit, *p.each] for p in parameters(run)]


def _unsure(run: RunData) -> list[str]:
    """Parameters of the spectrum that the scan hardly determines."""
    return [
        f"the standard error of {p.text} is {p.error:.3g} at a value of {p.value:.3g} {p.unit}: the"
        " scan hardly determines it".replace(" -:", ":")
        for p in parameters(run)
        if p.key in ("c1", "c2", "q_c", "C0") and p.error is not None and p.value is not None
        and p.error > UNSURE * abs(p.value)
    ]  # fmt: skip


def _law_facts(run: RunData) -> list[tuple[str, str]]:
    micro = run.in_effect("micro")
    if run.laws is None or not micro:
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


def _fact(p: Parameter) -> str:
    """Value and unit, with the standard deviation over several scans."""
    scatter = f" ± {p.each[1]:.2g}" if p.each and p.each[1] is not None else ""
    return f"{'-' if p.value is None else f'{p.value:.3g}'}{scatter} {p.unit}".removesuffix(" -")


def write_surface_tables(run: RunData) -> list[Path]:
    """Write laws.csv, and the tables of the surface into ``tables``.

    A run of a surface alone also gets its first artificial surface: artificial_surface.npz and, in
    metres, artificial_surface.csv.

    Args:
        run: the results.

    Returns:
        Paths written; what the run has no numbers for is left out.
    """
    tables: dict[str, tuple[Sequence[str], Iterable[Sequence[Value]]]] = {}
    if run.laws is not None and "count" in run.laws:
        heads = [head for name, head in LAW_COLUMNS.items() if name in run.laws]
        tables["laws"] = ["law", "step", *heads], _law_rows(run.laws)
    if run.laws is not None and (support := settings_of(run.laws).get("support")):
        columns = [support[name] for name in ("pressure", "scan_pixels", "grid_pixels")]
        bands = (row for name in ("k", "v", "k_patch", "v_patch") for row in support[name])
        tables["tables/law_support"] = SUPPORT_COLUMNS, zip(*columns, *bands, strict=True)
    s, heights = run.surface or {}, list[Path]()
    if s:
        scans = [f"scan_{k}" for k in range(1, len(scans_of(run)) + 1)]
        over = ["mean", "standard_deviation", *scans] if scans else []
        heads = ["parameter", "value", "standard_error", "unit", *over]
        tables["tables/surface"] = heads, parameter_rows(run)
    if "q" in s:
        low, high = s["q_band"]
        # The fit is a power law on both sides of a corner, which its own table resolves.
        fit = np.exp(np.interp(np.log(s["q"]), np.log(s["fit_q"]), np.log(s["fit_C"])))
        inside = (s["q"] >= low) & (s["q"] <= high)
        within = [float(c) if i else None for c, i in zip(fit, inside, strict=True)]
        columns = [s["q"], s["C"], within, ["yes" if i else "no" for i in inside]]
        columns += [*s["scan_C"]] if scans else []
        heads = ["q_rad_per_m", "C_m4", "fit_m4", "reliable", *(f"C_{k}_m4" for k in scans)]
        tables["tables/spectrum"] = heads, zip(*columns, strict=True)
    if "heights" in s and np.isfinite(s["heights"]).any():
        share, whole, each = bearing_curves(s)
        heads = ["material_ratio", "height_m", *(f"height_{k}_m" for k in scans)]
        tables["tables/bearing_curve"] = heads, zip(share, whole, *each, strict=True)
    if of_surface(run) and "artificial" in s:
        heights = _write_heights(run.directory, s["artificial"], s["artificial_size"])
    (run.directory / "tables").mkdir(exist_ok=True)
    paths = {run.directory / f"{name}.csv": table for name, table in tables.items()}
    return [*(write_rows(path, *table) for path, table in paths.items()), *heights]


def _law_rows(laws: Arrays) -> Iterator[list[Value]]:
    """One row for each step of each law."""
    arrays = [laws[name] for name in LAW_COLUMNS if name in laws]
    for i, count in enumerate(laws["count"]):
        for j in range(int(count)):
            yield [i, j, *(float(array[i, j]) for array in arrays)]


def _write_heights(folder: Path, heights: AnyArray, size: AnyArray) -> list[Path]:
    """Heights [m], shape (nx, ny), and their size [m], as npz and as text with a row for each x."""
    paths = [folder / f"{HEIGHTS}.npz", folder / f"{HEIGHTS}.csv"]
    for path in paths:
        with whole_file(path) as part, part.open("wb") as file:
            if path.suffix == ".npz":
                np.savez(file, heights=heights, size=size)
            else:
                np.savetxt(file, heights, fmt="%.7e", delimiter=",")
    return paths
