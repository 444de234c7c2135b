"""Figures of a run as blocks of its page, each with its caption."""

from __future__ import annotations

from brake_fenicsx.results.run import RunData

from .blocks import Block, Picture
from .plots import PLOTS

NAMED = {plot.name: plot for plot in PLOTS}
JUDGED = {  # figures of what squeals
    "figure9_squeal_map", "squeal_families", "probability_per_band", "unstable_per_sample",
    "convergence", "input_correlations", "sensitivity", "drivers", "sweep_branches",
    "sweep_critical", "sweep_samples", "sweep_chart",
}  # fmt: skip


def figures(run: RunData, *names: str, look: str = "plot") -> list[Block]:
    """Figures of a run that are there, each with its caption.

    Args:
        run: the results.
        names: of the figures.
        look: see `Picture`.
    """
    said = {name: f" Squeal: {run.criterion}." if name in JUDGED else "" for name in names}
    paths = {name: run.directory / "figures" / f"{name}.png" for name in names}
    return [
        Picture(path, NAMED[name].told(run) + said[name], look)
        for name, path in paths.items() if path.is_file()
    ]  # fmt: skip
