"""Errors of the eigenvalues, as the solver or the reduced model estimates them."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.results.run import RunData

from .style import label, light_grid, look, new_figure, stroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_errors(run: RunData) -> Figure | None:
    """Error estimates of the eigenvalues: against frequency, and how many exceed a given error."""
    if run.modes is None:
        return None
    figure, axes = new_figure(1, 2, height=3.1)
    drawn = False
    every = run.errors
    for approach in run.approaches:
        own = np.asarray(run.modes["approach"] == approach) & (every > 0) & np.isfinite(every)
        if own.any():
            drawn, error = True, every[own]
            _draw_bands(axes[0, 0], run.modes["frequency_hz"][own], error, approach)
            _draw_excess(axes[0, 1], error, approach, label(run, approach))
    if not drawn:
        return None
    unit = "relative error estimate of the eigenvalue [-]"
    axes[0, 0].set(yscale="log", xlabel="frequency [kHz]")
    axes[0, 0].set_ylabel("relative error estimate\nof the eigenvalue [-]")
    axes[0, 0].set_title("(a) largest (line) and median (dots) per band")
    axes[0, 1].set(xscale="log", yscale="log", xlabel=unit, ylabel="share of modes above [-]")
    axes[0, 1].set_title("(b) modes whose error exceeds a value")
    axes[0, 1].legend(loc="lower left")
    for axis in axes.flat:
        light_grid(axis)
    return figure


def _draw_bands(axes: Axes, f: NDArray, error: NDArray, approach: str, bands: int = 24) -> None:
    """Largest and median error in equal bands of frequency."""
    colour, marker = look(approach)
    edges = np.linspace(0.0, f.max() * (1 + 1e-12), bands + 1)
    rows = []
    for low, high in pairwise(edges):
        own = error[(low <= f) & (f < high)]
        if own.size:
            rows.append((0.5e-3 * (low + high), own.max(), np.median(own)))
    middle, largest, median = zip(*rows, strict=True)
    axes.plot(middle, largest, color=colour, lw=1.2)
    axes.plot(middle, median, marker, color=colour, ms=3.5)


def _draw_excess(axes: Axes, error: NDArray, approach: str, name: str) -> None:
    """Share of modes with a larger error, at up to 400 of the values, which are sorted."""
    error.sort()
    chosen = np.unique(np.linspace(0, error.size - 1, 400).astype(int))
    share = 1.0 - chosen / error.size
    colour, _ = look(approach)
    axes.step(error[chosen], share, where="post", color=colour, ls=stroke(approach), label=name)
