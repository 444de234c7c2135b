"""All figures of a run: what there is data for is drawn, the rest is left out."""

from __future__ import annotations

from pathlib import Path

from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.results.run import RunData, read_run

from .plots import PLOTS
from .style import house_style, save


def make_figures(
    directory: str | Path | RunData, share: slice = slice(None), draw: bool = True
) -> list[Path]:
    """Draw every figure a run has data for, as PNG and SVG in ``directory/figures``.

    Args:
        directory: the run directory, or its results already read.
        share: of the figures, where several processes draw them.
        draw: False removes those of an earlier run, and draws none.

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
        for plot in PLOTS[share]:
            figure = plot.draw(run) if draw else None
            if figure is not None:
                written += save(figure, folder, plot.name)
                release_memory()
                continue
            for old in folder.glob(f"{plot.name}.*"):
                old.unlink()  # of an earlier run with other stages or keys
    return written
