"""All figures of a run: names, what draws them, captions; their files, and blocks of the page.

Captions that are the same for all runs stand in templates/texts.toml.
"""

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

from . import (
    contact_figures,
    input_figures,
    sample_figures,
    squeal_figures,
    surface_figures,
    sweep_figures,
)
from .page_blocks import Block, Picture, texts
from .style import house_style, save

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


DRAWN: Mapping[str, Callable[[RunData], Figure | None]] = {
    "figure4_topography": surface_figures.draw_topography,
    "figure5_statistics": surface_figures.draw_statistics,
    "bearing_curve": surface_figures.draw_bearing_curve,
    "figure6_artificial": surface_figures.draw_artificial,
    "figure7_contact_maps": contact_figures.draw_contact_maps,
    "figure8_laws": contact_figures.draw_laws,
    "figure9_squeal_map": squeal_figures.draw_squeal_map,
    "probability_per_band": sample_figures.draw_probability,
    "unstable_per_sample": sample_figures.draw_counts,
    "convergence": sample_figures.draw_convergence,
    "input_correlations": input_figures.draw_correlations,
    "sensitivity": input_figures.draw_sensitivity,
    "sweep_branches": sweep_figures.draw_branches,
    "sweep_critical": sweep_figures.draw_critical,
    "sweep_samples": sweep_figures.draw_worst,
    "sweep_chart": sweep_figures.draw_chart,
    "drivers": input_figures.draw_drivers,
    "driver_maps": input_figures.draw_driver_maps,
    "contact_pressure": contact_figures.draw_contact_pressure,
    "eigenvalue_errors": sample_figures.draw_errors,
}
CAPTIONS: dict[str, Any] = texts("captions") | {
    "figure4_topography": surface_figures.topography_caption,
    "figure8_laws": contact_figures.laws_caption,
}
PLOTS: tuple[Plot, ...] = (
    *(Plot(name, CAPTIONS[name], draw) for name, draw in DRAWN.items()),
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
    there = {name: path for name, path in paths.items() if path.is_file()}
    return [Picture(path, NAMED[n].caption_of(run), look) for n, path in there.items()]
