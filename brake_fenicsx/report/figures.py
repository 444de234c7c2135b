"""All figures of a run: names, captions, what draws them; their files, and blocks of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from brake_fenicsx.extensions import Extra, extras, load, shown
from brake_fenicsx.folder.log import logger, spared
from brake_fenicsx.folder.processes import release_memory
from brake_fenicsx.results.run import RunData, read_run

from .contact_figures import draw_contact_maps, draw_contact_pressure, draw_laws, laws_caption
from .input_figures import draw_correlations, draw_driver_maps, draw_drivers, draw_sensitivity
from .page_blocks import Block, Picture
from .sample_figures import draw_convergence, draw_counts, draw_errors, draw_probability
from .squeal_figures import draw_squeal_map
from .style import house_style, save
from .surface_figures import (
    draw_artificial,
    draw_bearing_curve,
    draw_statistics,
    draw_topography,
    topography_caption,
)
from .sweep_figures import draw_branches, draw_chart, draw_critical, draw_worst

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Plot:
    """One figure: the name of its files, its caption, and how it is drawn.

    SQUEAL in a caption stands for what counts as squeal.
    """

    name: str
    caption: str | Callable[[RunData], str]
    draw: Callable[[RunData], Figure | None]

    def caption_of(self, run: RunData) -> str:
        """The caption of the figure of a run."""
        text = self.caption if isinstance(self.caption, str) else self.caption(run)
        return text.replace("SQUEAL", f"Squeal: {run.criterion}.")


def _of_extra(extra: Extra, draw: str, run: RunData) -> Figure | None:
    """A figure of an extra, which is imported where a run has its tables."""
    return load(draw)(run) if extra in shown(run) else None


PLOTS: tuple[Plot, ...] = (
    Plot("figure4_topography", topography_caption, draw_topography),
    Plot(
        "figure5_statistics",
        "Height distribution, and radial power spectrum C(q) of the scan with its bi-fractal fit "
        "(2 pi times the integral of q C is the variance). Of several scans, thin lines are the "
        "scans and the thick line is their mean. Below: ratio of measured spectrum "
        "and fit, on a logarithmic scale.",
        draw_statistics,
    ),
    Plot(
        "bearing_curve",
        "Bearing curve (material ratio curve, Abbott curve): share of the surface that lies above "
        "a height. Of several scans, thin lines are the scans and the thick line is all heights "
        "together.",
        draw_bearing_curve,
    ),
    Plot(
        "figure6_artificial",
        "Scan and one artificial surface at the same length and height scale, with the height "
        "distribution and spectrum of the artificial surface. A patch longer than the scan has "
        'longer waves too: with surface.S_q = "spectrum" the artificial spectrum follows the fit '
        'of the measured one, and the variance follows from it; with "scan" the artificial '
        "spectrum lies lower, so that the variance is that of the scan.",
        draw_artificial,
    ),
    Plot(
        "figure7_contact_maps",
        "Real contact of the artificial surface of the first law with a rigid plane at growing mean"
        " pressure p, with the hardness of the laws if they have one; circles mark the few points"
        " of a light contact. E* is the composite modulus.",
        draw_contact_maps,
    ),
    Plot("figure8_laws", laws_caption, draw_laws),
    Plot(
        "figure9_squeal_map",
        "Frequency and damping of every complex mode of every sample; the scale is linear between "
        "-0.0001 and 0.0001 and logarithmic beyond. Negative damping is an unstable mode, "
        "grey where it lies above the threshold of squeal. Without damping terms an unstable mode "
        "has a mirror image that decays. SQUEAL",
        draw_squeal_map,
    ),
    Plot(
        "probability_per_band",
        "Probability that a brake of the population has at least one squeal mode in the band: "
        "share of samples, with 95 % Wilson intervals. SQUEAL",
        draw_probability,
    ),
    Plot(
        "unstable_per_sample",
        "Number of squeal modes per sample: share of samples with each number. SQUEAL",
        draw_counts,
    ),
    Plot(
        "convergence",
        "Convergence with the number of samples: share of samples with a squeal mode, and mean "
        "number of squeal modes, with 95 % intervals. SQUEAL",
        draw_convergence,
    ),
    Plot(
        "input_correlations",
        "Inputs correlated with squeal: Spearman's rank correlation of each random input with the "
        "number of squeal modes of the sample, from -1 to 1, with 95 % intervals. SQUEAL",
        draw_correlations,
    ),
    Plot(
        "sensitivity",
        "Share of the variance of the growth rate (0 where no mode squeals) that each random input "
        "explains alone, with 95 % intervals, in the whole band and in the most severe families; "
        "roughness, where it is one of them, is all that laws and critical gaps do. Diamonds: "
        "total share, with all interactions of the input, also those with the roughness, where "
        "the design provides it. Empty bars: too few samples for an interval. Negative shares are "
        "sampling error of the estimate. SQUEAL",
        draw_sensitivity,
    ),
    Plot(
        "sweep_branches",
        "Modes of the nominal brake of the scene over the parameter: frequency above, damping "
        "below. Dots: two modes merge (lock-in); squares: they split; diamonds: two damped modes "
        "pass next to a merging point. Coloured: branches that squeal, with their frequency at the "
        "onset and the values at which squeal begins and ends (filled and hollow triangles). "
        "Lines are straight between computed points. Dotted: the threshold of squeal. SQUEAL",
        draw_branches,
    ),
    Plot(
        "sweep_critical",
        "Distribution of the critical value: share of the rough samples in which each family "
        "squeals up to a value of the parameter, with 95 % Wilson intervals. SQUEAL",
        draw_critical,
    ),
    Plot(
        "sweep_samples",
        "Range over the samples of the sweep: lowest damping of any mode of a sample, and "
        "number of its squeal modes. SQUEAL",
        draw_worst,
    ),
    Plot(
        "sweep_chart",
        "Stability chart over two parameters: number of squeal modes of the nominal brake, "
        "and its largest negative damping. White line: where squeal begins. SQUEAL",
        draw_chart,
    ),
    Plot(
        "drivers",
        "What drives the most severe families: change of the growth rate alpha [1/s] to first "
        "order by a friction coefficient larger by 0.01, a loss factor larger by 0.001, and "
        "pressures, stiffnesses and masses larger by 1 %. Of more than two approaches: the first "
        "and the last, which has the most random inputs. Bars: first sample of the approach; "
        "hollow bars are not reliable, because the mode nearly merges with another one. Diamonds: "
        "median over the samples where the family squeals. Above: mean frequency of the family, "
        "and alpha, the median where there is one. SQUEAL",
        draw_drivers,
    ),
    Plot(
        "driver_maps",
        "Most unstable mode of the first sample of each approach, over the contact elements: "
        "derivative of the growth rate with respect to the logarithm of the contact "
        "stiffness (red: a stiffer element raises the growth rate), and work of friction over a "
        "period relative to the energy of the mode (red: friction feeds energy in). Both per area; "
        "the scales end at 98 %.",
        draw_driver_maps,
    ),
    Plot(
        "contact_pressure",
        "Contact pressure [MPa] at equilibrium, first sample of each approach, seen "
        "along the disc axis from one side. Empty patches are open elements; the mean refers to "
        "the whole face. The colour scale ends at the 98 % quantile of closed elements.",
        draw_contact_pressure,
    ),
    Plot(
        "eigenvalue_errors",
        "Error estimates of the eigenvalues relative to |lambda|, by the solver or the reduced "
        "model.",
        draw_errors,
    ),
    *(
        Plot(name, caption, partial(_of_extra, extra, draw))
        for extra in extras()
        for name, (draw, caption) in extra.figures.items()
    ),
)


# Ending of the file that stands for a figure that could not be drawn, and says why.
LOST = ".lost"


def make_figures(
    directory: str | Path | RunData, share: slice = slice(None), draw: bool = True,
    own: Mapping[str, Callable[[RunData], Any]] = MappingProxyType({}),
) -> list[Path]:  # fmt: skip
    """Draw every figure a run has data for, as PNG and SVG in ``directory/figures``.

    Args:
        directory: the run directory, or its results already read.
        share: of the figures, where several processes draw them.
        draw: False removes those of an earlier run, and draws none.
        own: figures of a user's own by name, drawn as own_NAME.

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
        given = [Plot(f"own_{name}", name, draw_it) for name, draw_it in own.items()]
        for plot in [*PLOTS, *given][share]:
            for old in folder.glob(f"{plot.name}.*"):
                old.unlink()  # perhaps of an earlier run with other stages or keys
            if not draw:
                continue
            made, lost = spared(f"figure {plot.name}", partial(_draw, plot, run, folder))
            written += made or []
            if lost:
                # The page names it, now and when it is written again.
                (folder / f"{plot.name}{LOST}").write_text(lost[0], "utf-8")
                logger.warning("%s", lost[0])
    return written


def lost_figures(directory: Path) -> list[str]:
    """Figures of a results folder that could not be drawn, and why, a line each."""
    return [path.read_text("utf-8") for path in sorted((directory / "figures").glob(f"*{LOST}"))]


def _draw(plot: Plot, run: RunData, folder: Path) -> list[Path]:
    """Files of one figure; none where a run has no data for it."""
    figure = plot.draw(run)
    if figure is None:
        return []
    written = save(figure, folder, plot.name)
    release_memory()
    return written


NAMED = {plot.name: plot for plot in PLOTS}


def figures(run: RunData, *names: str, look: str = "plot") -> list[Block]:
    """Figures of a run that are there, each with its caption.

    Args:
        run: the results.
        names: of the figures.
        look: see `Picture`.
    """
    paths = {name: run.directory / "figures" / f"{name}.png" for name in names}
    return [
        Picture(path, NAMED[name].caption_of(run), look)
        for name, path in paths.items() if path.is_file()
    ]  # fmt: skip
