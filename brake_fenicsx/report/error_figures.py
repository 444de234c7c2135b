"""Errors of the eigenvalues, as the solver or the reduced model estimates them."""

from __future__ import annotations

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
            drawn = True
            f, error = run.modes["frequency_hz"][own] / 1e3, every[own]
            _draw_bands(axes[0, 0], f, error, approach)
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
    """Largest and median error in equal bands of frequency [kHz]."""
    colour, marker = look(approach)
    edges = np.linspace(0.0, f.max() * (1 + 1e-12), bands + 1)
    place = np.digitize(f, edges) - 1
    full = [j for j in range(bands) if np.any(place == j)]
    middle = 0.5 * (edges[1:] + edges[:-1])[full]
    axes.plot(middle, [error[place == j].max() for j in full], color=colour, lw=1.2)
    medians = [np.median(error[place == j]) for j in full]
    axes.plot(middle, medians, marker, color=colour, ms=3.5)


def _draw_excess(axes: Axes, error: NDArray, approach: str, name: str) -> None:
    """Share of modes with a larger error, at up to 400 of the values."""
    ordered = np.sort(error)
    chosen = np.unique(np.linspace(0, error.size - 1, 400).astype(int))
    share = 1.0 - chosen / error.size
    colour, _ = look(approach)
    axes.step(ordered[chosen], share, where="post", color=colour, ls=stroke(approach), label=name)
