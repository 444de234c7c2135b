"""Predicted squeal beside stops that squealed: hits, Brier score, area of the ROC, best threshold.

A stop is a trial that squeals or not, and its state gives the predicted probability p. The Brier
score is the mean of (p - y)^2 (G. W. Brier, Monthly Weather Review 78, 1950, 1). The area of the
receiver operating characteristic is the probability that a stop with squeal was given more than one
without (J. A. Hanley, B. J. McNeil, Radiology 143, 1982, 29). The threshold of damping is that of
the largest likelihood. Intervals are of 95 %, from the scatter of the stops alone: by a parametric
bootstrap (B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, 1993, chapter 6), that of
the threshold by the likelihood ratio (S. S. Wilks, Annals of Mathematical Statistics 9, 1938, 60).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from .states import Frame

Array = np.ndarray
Z, DRAWS = 1.959964, 300  # half an interval over the standard deviation, of so many draws
RATIO = 3.841459  # twice the logarithm of a likelihood ratio
FEWEST = 10  # stops with squeal, or without, below which scores tell little
GRID = 400  # thresholds that are tried
RATED = [f"{n}{end}" for n in ("brier", "roc_area", "threshold") for end in ("", "_low", "_high")]
COLUMNS = ["family", "events", "hits", "misses", "false_alarms", "quiet", *RATED, "note"]


def scores(families: Frame, samples: Any, modes: Frame, limit: float) -> Frame:
    """Scores of all modes and of each family.

    Args:
        families: shares of samples and stops in each state, see ``by_family``.
        samples: that have modes in each state.
        modes: all that grow, of which the best threshold is told.
        limit: squeal is predicted in a state from this share on.

    Returns:
        Columns family; events, stops that squealed; hits and misses, of these; false_alarms and
        quiet, of the others; brier, roc_area and threshold, each with its interval; note.
    """
    rows, (tried, expected) = list[Any](), shares_by_threshold(modes, samples[samples > 0])
    named = families[(families.samples > 0) & (families.family != "none")]
    for family, own in named.groupby("family", sort=False):
        p, n, m = own[["share", "stops", "measured_stops"]].to_numpy(float).T
        warned, quiet = p >= limit, n - m
        counts = m, m[warned], m[~warned], quiet[warned], quiet[~warned]
        few = bool(min(m.sum(), quiet.sum()) < FEWEST)
        note = f"{m.sum():g} stops with squeal and {quiet.sum():g} without tell little" * few
        found = with_intervals(p, n, m, tried, expected)
        if rows or tried.size < 2:  # the threshold is one of all modes
            found[2] = np.nan
        rows.append([family, *(int(x.sum()) for x in counts), *found.ravel(), note])
    return pd.DataFrame(rows, columns=COLUMNS)


def rated(p: Array, n: Array, m: Array) -> Array:
    """Brier score and area of the ROC, nan without stops of both kinds; shape (2, ...).

    Args:
        p: predicted probability of each state.
        n: its stops.
        m: of these, those that squealed, shape (..., states).
    """
    quiet, (level, which) = n - m, np.unique(p, return_inverse=True)
    loud, calm = (x @ np.eye(level.size)[which] for x in (m, quiet))
    above = np.tri(level.size, k=-1) + np.eye(level.size) / 2
    with np.errstate(invalid="ignore"):
        area = np.sum((loud @ above) * calm, axis=-1) / (m.sum(axis=-1) * quiet.sum(axis=-1))
    return np.array([np.sum(n * p**2 + m * (1 - 2 * p), axis=-1) / n.sum(), area])


def with_intervals(p: Array, n: Array, m: Array, tried: Array, expected: Array) -> Array:
    """Both, and the threshold of the largest likelihood, with their intervals, shape (3, 3).

    Args:
        p: predicted probability of each state.
        n: its stops.
        m: of these, those that squealed; where all or none did, that is not taken as certain.
        tried: thresholds.
        expected: shares of squeal that they predict, see ``shares_by_threshold``.
    """
    value, rng = rated(p, n, m), np.random.default_rng(0)
    draws = rng.binomial(n.astype(int), (m + 0.5) / (n + 1), (DRAWS, n.size))
    half = Z * np.nanstd(rated(p, n, draws), axis=1)
    likely = np.log(expected) @ m + np.log(1 - expected) @ (n - m)
    inside = tried[likely.max() - likely <= RATIO / 2]
    best = np.array([np.median(tried[likely == likely.max()]), inside[0], inside[-1]])
    ends = np.clip([value, value - half, value + half], 0, 1).T
    return np.array([*ends, np.where(np.isfinite(value[1]), best, np.nan)])


def shares_by_threshold(modes: Frame, samples: Any) -> tuple[Array, Array]:
    """Thresholds of damping that are tried, and the share of squeal that each predicts.

    Args:
        modes: that grow.
        samples: that have modes, by state.

    Returns:
        Thresholds, rising, and shares that are neither 0 nor 1, shape (thresholds, states).
    """
    growth = -modes.groupby(["state", "sample"]).damping.min()
    steps = growth.quantile(np.linspace(0, 1, GRID)).dropna()
    tried = np.unique([0.0, *steps.rolling(2).mean().dropna()])
    beyond = (growth[growth > x].groupby("state").size() for x in tried)
    counts = np.array([each.reindex(samples.index, fill_value=0) for each in beyond])
    return tried, (counts + 0.5) / (samples.to_numpy() + 1.0)
