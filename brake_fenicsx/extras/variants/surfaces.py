"""Two surfaces or libraries of laws compared: parameters, spectra, stiffness of contact.

A change is judged by the standard errors of both scans, which do not contain how scans of one
surface differ; for laws the band over scans stands in ``tables/law_support.csv`` of each run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.micro.law import LawLibrary, LawSteps
from brake_fenicsx.micro.support import PRESSURES
from brake_fenicsx.report.contact_figures import settings_of
from brake_fenicsx.report.page_blocks import Block, Picture, Table, Text
from brake_fenicsx.report.style import BLUE, VERMILION, drawn, light_grid, new_figure, panel
from brake_fenicsx.report.surface_figures import bearing_curves
from brake_fenicsx.report.surface_page import parameter_rows
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import Value, text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Runs = tuple[RunData, RunData]
COLUMNS = (
    "quantity", "unit", "pressure_Pa", "a", "a_error", "b", "b_error", "ratio", "standard_errors",
)  # fmt: skip
HEADS = (
    "quantity", "A", "standard error", "B", "standard error", "B / A",
    "difference / standard error", "unit",
)  # fmt: skip
LAW_HEADS = (
    "mean pressure [MPa]", "quantity", "A: median", "5 to 95 % of the laws", "B: median",
    "5 to 95 % of the laws", "B / A",
)  # fmt: skip
AT = (("separation", "m"), ("loading stiffness", "Pa/m"), ("stiffness of vibrations", "Pa/m"),
      ("touching share", "-"))  # fmt: skip
LOOKS = (BLUE, "-"), (VERMILION, "--")


def of_surfaces(runs: Runs) -> bool:
    """Whether both runs have a surface or laws that may be compared."""
    return all(run.surface is not None or run.laws is not None for run in runs)


def surface_rows(runs: Runs) -> list[list[Value]]:
    """Parameters of both surfaces, then the laws at some pressures, in the order of `COLUMNS`.

    Args:
        runs: A and B.
    """
    a, b = ({str(row[0]): row for row in parameter_rows(run)} for run in runs)
    rows: list[list[Value]] = []
    for name in a:
        if name in b:
            (x, ex, unit), (y, ey, _) = (_numbers(side[name]) for side in (a, b))
            error = None if ex is None or ey is None else float(np.hypot(ex, ey))
            far = (y - x) / error if x is not None and y is not None and error else None
            rows.append([name, unit, None, x, ex, y, ey, _ratio(x, y), far])
    for p, first, second in _laws(runs):
        for name, unit in AT:
            (x, *_), (y, *_) = first[name], second[name]
            rows.append([name, unit, p, x, None, y, None, _ratio(x, y), None])
    return rows


def _numbers(row: list[Value]) -> tuple[float | None, float | None, str]:
    value, error = (v if isinstance(v, float) else None for v in row[1:3])
    return value, error, str(row[3])


def _ratio(x: float | None, y: float | None) -> float | None:
    return y / x if x and y is not None else None


def pressures(runs: Runs) -> list[float]:
    """Mean pressures [Pa] at which laws are compared: usual ones, and those of the brakes."""
    found = {*PRESSURES}
    for run in runs:
        force, area = (run.summary.get(name) for name in ("pressed_N", "face_area_mm2"))
        if force and area:
            found.add(float(f"{1e6 * force / area:.3g}"))
    return sorted(found)


Medians = dict[str, tuple[float, float, float]]


def _laws(runs: Runs) -> list[tuple[float, Medians, Medians]]:
    """Pressure, and median, 5 and 95 % over the laws of each quantity in A and B."""
    libraries = [_library(run) for run in runs]
    known = [found for found in libraries if found is not None]
    if len(known) < 2:
        return []
    sides = ([(p, _medians(one.at_pressure(p))) for p in pressures(runs)] for one in known)
    return [(p, a, b) for (p, a), (_, b) in zip(*sides, strict=True)]


def _library(run: RunData) -> LawLibrary | None:
    if run.laws is None:
        return None
    names = (*LawSteps._fields, "count", "seed")
    arrays: dict[str, Any] = {k: v for k, v in run.laws.items() if k in names}
    return LawLibrary(**arrays)


def _medians(at: LawSteps) -> Medians:
    values = at.d, at.k, at.v, np.full(at.d.size, np.nan) if at.area is None else at.area
    ends = [np.quantile(np.asarray(x), [0.5, 0.05, 0.95]).tolist() for x in values]
    return {name: (x[0], x[1], x[2]) for (name, _), x in zip(AT, ends, strict=True)}


def surface_blocks(runs: Runs) -> list[Block]:
    """What a page says of two surfaces: spectra, tables of parameters and of laws.

    Args:
        runs: A and B.
    """
    parameters = [[r[0], *r[3:], r[1]] for r in surface_rows(runs) if r[2] is None]
    blocks: list[Block] = [Picture(drawn(lambda: draw_surfaces(runs)), CAPTION)]
    if parameters:
        blocks += [
            Text(
                "Parameters of the surfaces. The difference is given in standard errors of both"
                " together; they do not contain how several scans of one surface differ."
            ),
            Table.without_empty(HEADS, parameters),
        ]
    if laws := _laws(runs):
        cells = [
            [f"{p / 1e6:.3g}", f"{name} [{unit}]", *_shown(a[name]), *_shown(b[name]),
             _ratio(a[name][0], b[name][0])]
            for p, a, b in laws for name, unit in AT
        ]  # fmt: skip
        said = (f"{name}: {_made(run)}" for name, run in zip("AB", runs, strict=True))
        blocks += [Text(f"Laws of contact. {'; '.join(said)}."), Table(LAW_HEADS, cells)]
    return blocks


def surface_text(runs: Runs) -> str:
    """The comparison of two surfaces for the terminal."""
    rows = [
        [r[0] if r[2] is None else f"{r[0]} at {float(r[2]) / 1e6:.3g} MPa", r[3], r[5], r[7], r[8],
         r[1]]
        for r in surface_rows(runs)
    ]  # fmt: skip
    return text_table(("quantity", "A", "B", "B / A", "difference / standard error", "unit"), rows)


def _shown(values: tuple[float, float, float]) -> list[Value]:
    return [values[0], f"{values[1]:.3g} to {values[2]:.3g}"]


def _made(run: RunData) -> str:
    """Number of laws, modulus and hardness."""
    settings, n = settings_of(run.laws or {}), len((run.laws or {})["count"])
    hard, modulus = settings.get("hardness"), settings.get("E_star", np.nan)
    said = f"hardness {hard / 1e6:.4g} MPa" if hard else "no hardness (elastic)"
    return f"{n} laws, E* {modulus / 1e6:.4g} MPa, {said}"


CAPTION = (
    "Power spectral density, bearing curve, and median stiffness of small vibrations of the laws"
    " with the band from 5 to 95 % of them."
)


def draw_surfaces(runs: Runs) -> Figure:
    """Spectra, bearing curves and stiffnesses of both runs in one figure."""
    figure, axes = new_figure(1, 3, height=2.9)
    spectrum, bearing, stiffness = axes[0]
    for name, (colour, style), run in zip("AB", LOOKS, runs, strict=True):
        if (s := run.surface) is not None:
            q, C = (s["q"], s["C"]) if "q" in s else (s["spectrum_q"], s["spectrum_C"])
            spectrum.loglog(q / 1e3, C, color=colour, ls=style, label=name)
            if "heights" in s:
                share, heights, _ = bearing_curves(s)
                bearing.plot(100 * share, 1e6 * heights, color=colour, ls=style, label=name)
        if (library := _library(run)) is not None:
            p: NDArray = np.geomspace(PRESSURES[0], PRESSURES[-1], 40)
            v = [np.quantile(np.asarray(library.at_pressure(x).v), [0.05, 0.5, 0.95]) for x in p]
            low, middle, high = np.array(v).T / 1e9
            stiffness.fill_between(p / 1e6, low, high, color=colour, alpha=0.2, lw=0)
            stiffness.loglog(p / 1e6, middle, color=colour, ls=style, label=name)
    ticks = [p / 1e6 for p in PRESSURES]
    spectrum.set(xlabel="wave number [rad/mm]", ylabel="density [m$^4$]")
    bearing.set(xlabel="material ratio [%]", ylabel=r"height [$\mu$m]")
    stiffness.set_xticks(ticks, [f"{p:g}" for p in ticks])
    stiffness.minorticks_off()
    stiffness.set(xlabel="mean pressure [MPa]", ylabel="stiffness of vibrations [N/mm$^3$]")
    for letter, axis in zip("abc", axes[0], strict=True):
        panel(axis, letter, "")
        light_grid(axis)
        if axis.get_legend_handles_labels()[1]:
            axis.legend()
    return figure
