"""All figures of a run: what there is data for is drawn, the rest is left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from brake_fenicsx.folder.extras import spared
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.results.run import RunData, read_run

from .plots import PLOTS, Plot
from .style import house_style, save

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
