"""Figures over the samples: counts, probabilities, convergence, errors of eigenvalues."""

from __future__ import annotations

import numpy as np
import pandas as pd

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.results.ensemble_statistics import wilson
from brake_fenicsx.results.run import RunData

from . import style

POINTS, BANDS = 400, 24  # of a curve over the samples; of frequency, in a figure of errors
HATCHES = ("", "///", "...", "xxx")
NARROW = 4.6  # [in] of figures that stand two in a row


def draw_counts(run: RunData) -> style.Figure | None:
    """Histogram of the number of squeal modes per sample."""
    shown = _sampled(run)
    if not shown:
        return None
    figure, axes = style.new_figure(1, 1, height=3.0, width=NARROW)
    axis = axes[0, 0]
    records = [run.squeal.count(approach) for approach in shown]
    top, width = max(int(r.per_sample.max()) for r in records), 0.8 / len(records)
    for j, record in enumerate(records):
        share = np.bincount(record.per_sample, minlength=top + 1) / record.samples
        x = np.arange(top + 1) + (j - (len(records) - 1) / 2) * width
        mean = record.per_sample.mean()
        text = f"{style.label(run, record.approach)}: {record.samples} samples, mean {mean:.2f}"
        looks = {"color": style.look(record.approach)[0], "hatch": HATCHES[j % 4], "label": text}
        axis.bar(x, share, 0.92 * width, edgecolor="white", linewidth=0.4, **looks)
    for approach in _single(run):
        number = int(run.squeal.count(approach).per_sample[0])
        text = f"{style.label(run, approach)}: one run, {number}"
        axis.axvline(number, color=style.look(approach)[0], ls="--", lw=1.4, label=text)
    modes = f"squeal modes ({run.criterion}) per sample [-]"
    style.finish(axis, "y", xlabel=modes, ylabel="share of samples [-]")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def draw_probability(run: RunData) -> style.Figure | None:
    """Probability of at least one squeal mode per frequency band, with Wilson intervals."""
    shown = _sampled(run)
    if run.modes is None or not shown:
        return None
    edges = run.squeal.edges
    figure, axes = style.new_figure(
        len(shown), 1, height=1.0 + 1.7 * len(shown), width=NARROW, sharex=True, sharey=True
    )
    centre, width = (edges[1:] + edges[:-1]) / 2e3, np.diff(edges) / 1e3
    for axis, approach in zip(axes.flat, shown, strict=True):
        shares = run.squeal.share_per_band(approach)
        value = np.array([s.value for s in shares])
        reach = np.array([[s.value - s.low, s.high - s.value] for s in shares]).T
        colour = style.look(approach)[0]
        axis.bar(centre, value, 0.94 * width, color=colour, alpha=0.75)
        axis.errorbar(centre, value, reach, fmt="none", ecolor=style.BLACK, elinewidth=1, capsize=2)
        title, limits = f"{style.label(run, approach)}: {shares[0].n} samples", (0, edges[-1] / 1e3)
        style.finish(
            axis, "y", title=title, ylim=(0, 1.08), xlim=limits, ylabel="probability of\nsqueal [-]"
        )
        _mark_deterministic(axis, run)
    if axes[0, 0].get_legend_handles_labels()[0]:
        axes[0, 0].legend(loc="upper right", bbox_to_anchor=(1.0, 1.25), handletextpad=0.1)
    elif calm := _single(run):
        names = ", ".join(style.label(run, name) for name in calm)
        axes[0, 0].set_title(f"{names}: no squeal mode in the one run", loc="right", size=8)
    axes[-1, 0].set_xlabel(f"{style.KHZ}, bands of {width[0]:g} kHz\nsqueal: {run.criterion}")
    return figure


def draw_convergence(run: RunData) -> style.Figure | None:
    """Share of samples that squeal and mean number of squeal modes as the samples come in."""
    shown = [a for a in _sampled(run) if run.squeal.count(a).samples >= 3]
    if not shown:
        return None
    figure, axes = style.new_figure(1, 2, height=2.9, width=5.4)
    for approach in shown:
        colour, _ = style.look(approach)
        per_sample = run.squeal.count(approach).per_sample
        size = per_sample.size
        n = np.unique(np.linspace(1, size, min(size, POINTS)).astype(int))
        hits = np.cumsum(per_sample > 0)[n - 1]
        bounds = [wilson(int(h), int(m)) for h, m in zip(hits, n, strict=True)]
        line = style.stroke(approach)
        axes[0, 0].plot(n, hits / n, line, color=colour, label=style.label(run, approach))
        low, high = [s.low for s in bounds], [s.high for s in bounds]
        axes[0, 0].fill_between(n, low, high, color=colour, alpha=0.2, lw=0)
        counts = pd.Series(per_sample).expanding()
        mean, error = (x.iloc[n - 1] for x in (counts.mean(), 1.96 * counts.sem().fillna(0.0)))
        axes[0, 1].plot(n, mean, line, color=colour, label=style.label(run, approach))
        axes[0, 1].fill_between(n, mean - error, mean + error, color=colour, alpha=0.2, lw=0)
    for axis, text, limits in (
        (axes[0, 0], "share of samples that squeal [-]", (-0.02, 1.02)),
        (axes[0, 1], "mean squeal modes per sample [-]", (0, None)),
    ):
        style.finish(
            axis, xlabel=f"samples [-]; squeal:\n{run.criterion}", ylabel=text, ylim=limits
        )
        axis.xaxis.get_major_locator().set_params(integer=True)
    axes[0, 0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=3)
    return figure


def _sampled(run: RunData) -> list[str]:
    """Approaches with more than one sample; a single run has no distribution."""
    return [a for a in run.approaches if run.squeal.count(a).samples > 1]


def _single(run: RunData) -> list[str]:
    return [a for a in run.approaches if run.squeal.count(a).samples == 1]


def _mark_deterministic(axes: style.Axes, run: RunData) -> None:
    """Markers on top where an approach of one run squeals."""
    for approach in _single(run):
        colour, marker = style.look(approach)
        f = run.squeal.squeal_modes(approach).frequency_hz / 1e3
        if not f.size:
            # An empty line beyond the axes has no extent that a layout could work with.
            continue
        text = f"{style.label(run, approach)}: squeal modes of its one run"
        y = np.full(f.size, 1.04)
        axes.plot(f, y, marker, color=colour, ms=4, label=text, clip_on=False)


def draw_errors(run: RunData) -> style.Figure | None:
    """Error estimates of the eigenvalues: against frequency, and how many exceed a given error."""
    if run.modes is None:
        return None
    figure, axes = style.new_figure(1, 2, height=2.9, width=5.4)
    drawn = False
    every = run.errors
    for approach in run.approaches:
        rows = np.asarray(run.modes["approach"] == approach) & (every > 0) & np.isfinite(every)
        if rows.any():
            drawn, error = True, every[rows]
            _draw_bands(axes[0, 0], run.modes["frequency_hz"][rows], error, approach)
            _draw_excess(axes[0, 1], error, approach, style.label(run, approach))
    if not drawn:
        return None
    (left, right), unit = axes[0], "relative error estimate\nof the eigenvalue [-]"
    title = "(a) largest (line),\nmedian (markers)"
    style.finish(left, title=title, yscale="log", xlabel=style.KHZ, ylabel=unit)
    title, share = "(b) modes whose error\nexceeds a value", "share of modes above [-]"
    style.finish(right, title=title, xscale="log", yscale="log", xlabel=unit, ylabel=share)
    right.legend(loc="lower left")
    return figure


def _draw_bands(axes: style.Axes, f: AnyArray, error: AnyArray, approach: str) -> None:
    """Largest and median error in equal bands of frequency."""
    colour, marker = style.look(approach)
    width = f.max() * (1 + 1e-12) / BANDS
    band = (f // width).astype(np.int16)
    held = np.flatnonzero(np.bincount(band))
    # Band by band: a study has 10^7 modes.
    ends = np.array(
        [(values.max(), np.median(values)) for values in (error[band == i] for i in held)]
    )
    middle = 1e-3 * width * (held + 0.5)
    axes.plot(middle, ends[:, 0], color=colour, lw=1.2)
    axes.plot(middle, ends[:, 1], marker, color=colour, ms=3.5)


def _draw_excess(axes: style.Axes, error: AnyArray, approach: str, name: str) -> None:
    """Share of modes with a larger error, at up to so many of the values, which are sorted."""
    error.sort()
    chosen = np.unique(np.linspace(0, error.size - 1, POINTS).astype(int))
    looks = {"color": style.look(approach)[0], "ls": style.stroke(approach), "label": name}
    axes.step(error[chosen], 1.0 - chosen / error.size, where="post", **looks)
