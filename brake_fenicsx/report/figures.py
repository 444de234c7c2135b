"""All figures of a run: what there is data for is drawn, the rest is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .accuracy import draw_errors, draw_stages
from .contact_figures import draw_contact_pressure
from .driver_figures import draw_drivers
from .micro_figures import draw_contact_maps, draw_laws
from .rundata import RunData, read_run
from .sensitivity_figures import draw_sensitivity
from .squeal_figures import (
    draw_convergence,
    draw_counts,
    draw_families,
    draw_probability,
    draw_squeal_map,
)
from .style import house_style, save
from .surface_figures import draw_artificial, draw_statistics, draw_topography

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Plot:
    """One figure: the name of its files, its caption, and how it is drawn."""

    name: str
    caption: str
    draw: Callable[[RunData], Figure | None]


PLOTS = (
    Plot(
        "figure4_topography",
        "Levelled scan of the pad surface, and profiles through its centre.",
        draw_topography,
    ),
    Plot(
        "figure5_statistics",
        "Height distribution, and radial power spectrum of the scan with its bi-fractal fit; "
        "sub-windows and decimated scans show how far each wave number can be trusted. "
        "Below: measured spectrum over fit.",
        draw_statistics,
    ),
    Plot(
        "figure6_artificial",
        "Scan and one artificial surface at the same length and height scale, with the height "
        "distribution and the spectrum that the artificial surface reached. Where the patch is "
        "longer than the scan its spectrum goes further down, and the level is set so that the "
        "variance of the heights stays that of the scan.",
        draw_artificial,
    ),
    Plot(
        "figure7_contact_maps",
        "Real contact of one artificial surface with a rigid plane as the load grows; circles mark "
        "where the few points of a light contact lie.",
        draw_contact_maps,
    ),
    Plot(
        "figure8_laws",
        "Library of pressure-gap laws: pressure against separation, linear and log, and "
        "stiffness against pressure with the range of pressures met on the pads.",
        draw_laws,
    ),
    Plot(
        "figure9_squeal_map",
        "Complex modes of every sample. Negative damping is an unstable mode: a squeal candidate.",
        draw_squeal_map,
    ),
    Plot(
        "squeal_families",
        "Unstable modes by family, with mean frequency and number of samples in which the family "
        "is unstable.",
        draw_families,
    ),
    Plot(
        "probability_per_band",
        "Probability that a brake of the population has at least one unstable mode in the band.",
        draw_probability,
    ),
    Plot(
        "unstable_per_sample",
        "Number of unstable modes of each sample.",
        draw_counts,
    ),
    Plot(
        "convergence",
        "How the answer settles as samples come in; bands are 95 % intervals.",
        draw_convergence,
    ),
    Plot(
        "drivers",
        "What goes with instability: Spearman's rank correlation of each random input with the "
        "number of unstable modes of the sample, with 95 % intervals.",
        draw_drivers,
    ),
    Plot(
        "sensitivity",
        "Share of the variance of the growth rate (0 where stable) that each random input explains "
        "alone, with 95 % intervals; diamonds: together with its interactions. Empty bars: too few "
        "samples for an interval.",
        draw_sensitivity,
    ),
    Plot(
        "contact_pressure",
        "Contact pressure at equilibrium, both pads seen along the disc axis from the same side. "
        "Empty patches are open elements.",
        draw_contact_pressure,
    ),
    Plot(
        "eigenvalue_errors",
        "Error estimates of the eigenvalues, as the solver or the reduced model states them.",
        draw_errors,
    ),
    Plot(
        "stages",
        "Time and memory of each stage of this run.",
        draw_stages,
    ),
)


def make_figures(directory: str | Path | RunData) -> list[Path]:
    """Draw every figure a run has data for, as PNG and SVG in ``directory/figures``.

    Args:
        directory: the run directory, or its results already read.

    Returns:
        Paths written, in the order of the figures.

    Raises:
        SceneError: the directory holds no result, or a file of it cannot be read.
    """
    run = read_run(directory)
    folder = run.directory / "figures"
    folder.mkdir(exist_ok=True)
    written: list[Path] = []
    with house_style():
        for plot in PLOTS:
            figure = plot.draw(run)
            if figure is not None:
                written += save(figure, folder, plot.name)
    return written
