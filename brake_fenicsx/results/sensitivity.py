"""Which random input moves an outcome: first-order and total indices with 95 % intervals.

    fast       extended FAST, first and, without roughness, total; means over the independent search
               curves, intervals from their spread by Student's t, widened by the bias of the
               method. (Resampling a curve, as SALib's own interval does, destroys the order its
               spectrum is made of.)
    saltelli   first and total, of the roughness as well, which counts as one more input; intervals
               by SALib's bootstrap over the rows
    others     RBD-FAST, first; intervals by SALib's bootstrap over halves of the samples, of many
               over those of the first 1,024, narrowed by the square root of the number

First-order index: share of the variance of the outcome that an input explains alone, on the mean
over all others. Total index: share that is left on average when all but this input are held, with
its interactions, also those with the roughness. Where each sample has a roughness of its own, all
frequencies of a search curve of FAST contain its scatter: no total index is given then, and the
first-order intervals are wider by the share of the scatter at the frequencies of one input.

Samples that failed are left out, which only RBD-FAST allows; in the two others their outcome is
set to the mean of the others, and no index is given where more than 2 % are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from brake_fenicsx.samples.designs import HARMONICS, RIGID, library_seed, unit_problem
from brake_fenicsx.scene.samples_section import Plan

Array = NDArray[np.float64]

# Fewest samples for RBD-FAST: twice the harmonics are taken from n / 2 frequencies.
FEWEST = 60
# Harmonics of RBD-FAST.
RBD_HARMONICS = 10
# Largest share of a rigid design that may be filled.
FILLED = 0.02
# Largest bias of FAST's first-order and total indices on Ishigami's function, 200 to 1000 points.
BIAS = np.array([0.01, 0.05])
CONFIDENCE = 0.95
RESAMPLES = 100
# Samples from which intervals of RBD-FAST are computed.
RESAMPLED = 1024


@dataclass(frozen=True, slots=True)
class Indices:
    """Indices of one outcome for each input; nan where the design cannot give them.

    Attributes:
        first: first-order indices, shape (inputs,); with Saltelli's design of rough samples the
            last one is that of the roughness.
        first_half: half widths of their 95 % intervals.
        total: total indices.
        total_half: half widths of their intervals.
        method: "FAST", "Saltelli" or "RBD-FAST".
        used: samples used.
        filled: failed samples whose outcome was set to the mean.
    """

    first: Array
    first_half: Array
    total: Array
    total_half: Array
    method: str
    used: int
    filled: int


def indices(plan: Plan, x: Array, y: Array, good: NDArray[np.bool_]) -> Indices:
    """Indices of one outcome.

    Args:
        plan: design of the samples.
        x: inputs, shape (samples, inputs); any rising function of the points of the design.
        y: outcome, shape (samples,).
        good: samples that have an outcome, shape (samples,).

    Returns:
        The indices; all nan where the outcome never changes or the samples are too few.
    """
    d = x.shape[1]
    method = {"fast": "FAST", "saltelli": "Saltelli"}.get(plan.design, "RBD-FAST")
    none = np.full(d, np.nan)
    used, missing = int(good.sum()), int((~good).sum())
    rigid = plan.design in RIGID
    short = missing > FILLED * y.size if rigid else used < FEWEST
    if not d or short or used == 0 or np.ptp(y[good]) == 0:
        return Indices(none, none, none, none, method, used, 0)
    if not rigid:
        first, half = _rbd(x[good], y[good])
        return Indices(first, half, none, none, method, used, 0)
    whole = np.where(good, y, y[good].mean())
    found = _fast(plan, whole, d) if plan.design == "fast" else _saltelli(whole, d + plan.rough)
    return Indices(*found, method, used, missing)


def _rbd(x: Array, y: Array) -> tuple[Array, Array]:
    from SALib.analyze import rbd_fast

    m = min(len(y), RESAMPLED)
    # A resampling without any change, where changes are few, leaves no interval.
    with library_seed(1), np.errstate(invalid="ignore", divide="ignore"):
        found = rbd_fast.analyze(
            unit_problem(x.shape[1]), x[:m], y[:m], M=RBD_HARMONICS, num_resamples=RESAMPLES, seed=1
        )
        half = np.array(found["S1_conf"], float) * np.sqrt(m / len(y))
        if m == len(y):
            return np.array(found["S1"], float), half
        whole = [rbd_fast.permute_outputs(column, y) for column in x.T]
        first = [rbd_fast.compute_first_order(values, RBD_HARMONICS) for values in whole]
        return np.array([rbd_fast.unskew_S1(s, RBD_HARMONICS, len(y)) for s in first]), half


def _saltelli(y: Array, inputs: int) -> tuple[Array, Array, Array, Array]:
    from SALib.analyze import sobol

    problem = unit_problem(inputs)
    found = sobol.analyze(problem, y, calc_second_order=False, num_resamples=RESAMPLES, seed=1)
    first, half, total, total_half = (
        np.array(found[name], float) for name in ("S1", "S1_conf", "ST", "ST_conf")
    )
    return first, half, total, total_half


def _fast(plan: Plan, y: Array, inputs: int) -> tuple[Array, Array, Array, Array]:
    from SALib.analyze.fast import compute_orders

    curves = y.reshape(plan.curves, inputs, -1)
    n = curves.shape[2]
    omega = (n - 1) // (2 * HARMONICS)
    found = np.full((plan.curves, inputs, 2), np.nan)
    for c in range(plan.curves):
        for i in range(inputs):
            # A curve on which the outcome never changes has no spectrum.
            if np.ptp(curves[c, i]) > 0:
                found[c, i] = compute_orders(curves[c, i], n, HARMONICS, omega)
    mean = found.mean(axis=0)
    half = np.full_like(mean, np.nan)
    if plan.curves > 1:
        t = stats.t.ppf(0.5 + CONFIDENCE / 2, plan.curves - 1)
        half = t * found.std(axis=0, ddof=1) / np.sqrt(plan.curves) + BIAS
    if plan.rough:
        # Of scatter, which fills all n / 2 frequencies, as much as the harmonics are of these.
        half[:, 0] += 2 * HARMONICS / n * (1 - mean[:, 0])
        mean[:, 1] = half[:, 1] = np.nan
    return mean[:, 0], half[:, 0], mean[:, 1], half[:, 1]
