"""Two surfaces or libraries of laws compared: parameters, spectra, stiffness of contact.

A change is judged by the standard errors of both scans, which do not contain how scans of one
surface differ; that of the median of laws is half the distance of the laws whose ranks lie one
standard deviation of the binomial distribution from the middle. The mean height is left out: its
zero is that of the instrument.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.micro.law import LawLibrary, LawSteps
from brake_fenicsx.micro.library import PRESSURES
from brake_fenicsx.report import contact_figures, page_blocks, style, surface_figures, surface_page
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import Value, text_table

Runs = tuple[RunData, RunData]
BOTH = "a", "a_error", "b", "b_error", "ratio", "ratio_error", "standard_errors"
COLUMNS = "quantity", "unit", "pressure_Pa", *BOTH
SHOWN = "A", "standard error", "B", "standard error", "B / A", "standard error"
HEADS = "quantity", *SHOWN, "difference / standard error", "unit"
# What a library says of its laws at a pressure: its name, unit, SI in it, attribute.
AT = (
    ("separation", "µm", 1e6, "d"),
    ("loading stiffness", "N/mm³", 1e-9, "k"),
    ("stiffness of vibrations", "N/mm³", 1e-9, "v"),
    ("touching share", "-", 1.0, "area"),
)
# A difference of more standard errors is said; values that the zero of heights shifts are none.
SURE, SHIFTED = 3.0, ("mean", "median")
LOOKS = (style.BLUE, "-"), (style.VERMILION, "--")
CAPTION = (
    "Power spectral density, bearing curve, and median stiffness of small vibrations of the laws"
    " with the band from 5 to 95 % of them."
)


def surface_rows(runs: Runs) -> list[list[Value]]:
    """Parameters of both surfaces, then medians of the laws at some pressures, in order of COLUMNS.

    Args:
        runs: A and B. There are no rows where one has neither a surface nor laws.
    """
    there = all(run.surface is not None or run.laws is not None for run in runs)
    return [*_parameters(runs), *_laws(runs)] if there else []


def _parameters(runs: Runs) -> Iterator[list[Value]]:
    a, b = ({p.key: p for p in surface_page.parameters(run)} for run in runs)
    for name in (name for name in a if name in b and name not in SHIFTED):
        one, two = a[name], b[name]
        yield [name, one.unit, None, *_beside(one.value, one.error, two.value, two.error)]


def _laws(runs: Runs) -> Iterator[list[Value]]:
    libraries = [library for run in runs if (library := _library(run)) is not None]
    for p in pressures(runs) if len(libraries) == 2 else []:
        steps = [library.at_pressure(p) for library in libraries]
        for name, unit, factor, key in AT:
            one, two = (_median(getattr(at, key), factor) for at in steps)
            yield [name, unit, p, *_beside(*one, *two)]


def _beside(x: float | None, ex: float | None, y: float | None, ey: float | None) -> list[Value]:
    """Both values with their errors, their ratio with its error, and how far they lie apart."""
    if x is None or y is None:
        return [x, ex, y, ey, None, None, None]
    ratio = y / x if x else None
    if ex is None or ey is None:
        return [x, ex, y, ey, ratio, None, None]
    error = float(np.hypot(ex, ey))
    spread = float(np.hypot(ex * y / x, ey) / abs(x)) if x else None
    return [x, ex, y, ey, ratio, spread, (y - x) / error if error else None]


def differing(rows: Sequence[Sequence[Value]]) -> str:
    """What differs by more than some standard errors, in a sentence: of a law, at both ends."""
    found: dict[Value, list[str]] = {}
    for row, (name, x, _, y, _, ratio, error, far, unit) in zip(rows, _cells(rows), strict=True):
        if isinstance(far, float) and abs(far) > SURE:
            times = "" if ratio is None or error is None else f", {ratio:.3g} +- {error:.1g} times"
            text = f"{name} {x:.3g} and {y:.3g} {unit}{times}".replace(" -,", ",")
            found.setdefault(row[0], []).append(text)
    if not any(isinstance(row[-1], float) for row in rows):
        return ""
    said = []
    for law, (text, *more) in found.items():
        if more:
            text += f", and {more[-1].removeprefix(f'{law} ')} ({len(more) + 1} pressures)"
        said.append(text)
    return (
        f"A and B differ by more than {SURE:.0f} standard errors in: {'; '.join(said) or 'none'}."
    )


def _median(values: AnyArray | None, factor: float) -> tuple[float | None, float | None]:
    """Median of laws and its standard error, from the order of their values."""
    if values is None:
        return None, None
    x, n = np.sort(values) * factor, len(values)
    ends = np.interp(0.5 * (n - 1) + 0.5 * np.sqrt(n) * np.array([-1, 1]), np.arange(n), x)
    return float(np.median(x)), float(0.5 * np.diff(ends)[0]) if n > 1 else None


def pressures(runs: Runs) -> list[float]:
    """Mean pressures [Pa] at which laws are compared: usual ones, and those of the brakes."""
    found = {*PRESSURES}
    for run in runs:
        force, area = (run.summary.get(name) for name in ("pressed_N", "face_area_mm2"))
        if force and area:
            found.add(float(f"{1e6 * force / area:.3g}"))
    return sorted(found)


def _library(run: RunData) -> LawLibrary | None:
    if run.laws is None:
        return None
    names = (*LawSteps._fields, "count", "seed")
    arrays: dict[str, Any] = {k: v for k, v in run.laws.items() if k in names}
    return LawLibrary(**arrays)


def surface_blocks(runs: Runs, rows: Sequence[Sequence[Value]]) -> list[page_blocks.Block]:
    """What a page says of two surfaces: spectra, and the table of parameters and laws.

    Args:
        runs: A and B.
        rows: of ``surface_rows``.
    """
    said = [f"{name}: {_made(run)}" for name, run in zip("AB", runs, strict=True) if run.laws]
    text = (
        "The difference is given in standard errors of both together; they do not contain how"
        " several scans of one surface differ."
    )
    return [
        *([page_blocks.Text(sentence)] if (sentence := differing(rows)) else []),
        page_blocks.Picture(style.drawn(lambda: draw_surfaces(runs)), CAPTION),
        page_blocks.Text(f"{text} Laws of contact: {'; '.join(said)}." if said else text),
        page_blocks.Table.without_empty(HEADS, list(_cells(rows))),
    ]


def surface_text(rows: Sequence[Sequence[Value]]) -> str:
    """The comparison of two surfaces for the terminal.

    Args:
        rows: of ``surface_rows``.
    """
    return "\n".join([text_table(HEADS, _cells(rows)), differing(rows)]).rstrip()


def _cells(rows: Sequence[Sequence[Value]]) -> Iterator[list[Value]]:
    """The rows in the order of HEADS."""
    for name, unit, p, *cells in rows:
        yield [name if p is None else f"{name} at {float(p) / 1e6:.3g} MPa", *cells, unit]


def _made(run: RunData) -> str:
    """Number of laws, modulus and hardness."""
    settings, n = contact_figures.settings_of(run.laws or {}), len((run.laws or {})["count"])
    hard, modulus = settings.get("hardness"), settings.get("E_star", np.nan)
    said = f"hardness {hard / 1e6:.4g} MPa" if hard else "no hardness (elastic)"
    return f"{n} laws, E* {modulus / 1e6:.4g} MPa, {said}"


def draw_surfaces(runs: Runs) -> style.Figure:
    """Spectra, bearing curves and stiffnesses of both runs in one figure."""
    figure, axes = style.new_figure(1, 3, height=2.9)
    spectrum, bearing, stiffness = axes[0]
    for name, (colour, dashes), run in zip("AB", LOOKS, runs, strict=True):
        looks: dict[str, Any] = {"color": colour, "ls": dashes, "label": name}
        if (s := run.surface) is not None:
            q, C = (s["q"], s["C"]) if "q" in s else (s["spectrum_q"], s["spectrum_C"])
            spectrum.loglog(q / 1e3, C, **looks)
            if "heights" in s:
                share, heights, _ = surface_figures.bearing_curves(s)
                bearing.plot(100 * share, 1e6 * heights, **looks)
        if (library := _library(run)) is not None:
            p: AnyArray = np.geomspace(PRESSURES[0], PRESSURES[-1], 40)
            v = [np.quantile(np.asarray(library.at_pressure(x).v), [0.05, 0.5, 0.95]) for x in p]
            low, middle, high = np.array(v).T / 1e9
            stiffness.fill_between(p / 1e6, low, high, color=colour, alpha=0.2, lw=0)
            stiffness.loglog(p / 1e6, middle, **looks)
    ticks = [p / 1e6 for p in PRESSURES]
    spectrum.set(xlabel="wave number [1/mm]", ylabel="density [m$^4$]")
    bearing.set(xlabel="material ratio [%]", ylabel=r"height [$\mu$m]")
    stiffness.set_xticks(ticks, [f"{p:g}" for p in ticks])
    stiffness.minorticks_off()
    stiffness.set(xlabel="mean pressure [MPa]", ylabel="stiffness of vibrations [N/mm$^3$]")
    for letter, axis in zip("abc", axes[0], strict=True):
        style.panel(axis, letter, "")
        style.light_grid(axis)
        if axis.get_legend_handles_labels()[1]:
            axis.legend()
    return figure
