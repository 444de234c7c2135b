"""Shares of samples, differences, rank correlations, sensitivity indices: with 95 % intervals.

A share has Wilson's score interval (J. Am. Stat. Assoc. 22, 1927, doi:10.2307/2276774), and a
difference of two shares has Newcombe's hybrid score interval: of independent shares (Statistics in
Medicine 17, 1998, 873) or of paired ones (the same volume, 2635). Spearman's correlation has the
interval of Fisher's transform with the standard error 1.03 / sqrt(n - 3) (E. C. Fieller, H. O.
Hartley, E. S. Pearson, Biometrika 44, 1957, 470).

Sensitivity indices say which random input moves an outcome, by the design of the samples:

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

from dataclasses import dataclass

import numpy as np
from scipy import stats

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.samples.designs import HARMONICS, RIGID, library_seed, unit_problem
from brake_fenicsx.scene.samples_section import Plan

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
class Proportion:
    """A share of samples with its 95 % Wilson interval: hits of n, low <= hits / n <= high.

    A single sample is no random sample: its interval is nan.
    """

    hits: int
    n: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share itself."""
        return self.hits / self.n if self.n else float("nan")

    @property
    def cells(self) -> list[float | None]:
        """Share, lower and upper end as cells of a table; None where there is none."""
        shown = self.n > 0, self.n > 1, self.n > 1
        cells = zip(shown, (self.value, self.low, self.high), strict=True)
        return [value if there else None for there, value in cells]


def wilson(hits: int, n: int) -> Proportion:
    """Share of ``hits`` among ``n`` with its interval, which is (0, 1) without a trial.

    One trial has none.
    """
    if n == 0:
        return Proportion(0, 0, 0.0, 1.0)
    if n == 1:
        return Proportion(int(hits), 1, float("nan"), float("nan"))
    # The p-value, which nobody reads, takes longest for another hypothesis.
    interval = stats.binomtest(int(hits), int(n), hits / n).proportion_ci(method="wilson")
    return Proportion(int(hits), int(n), float(interval.low), float(interval.high))


def difference(first: Mask, second: Mask, paired: bool) -> tuple[float, float, float]:
    """Difference of two shares, second minus first, with its 95 % interval.

    Args:
        first: outcome of each sample of the first run.
        second: of the second one; of the same samples where they are paired.
        paired: whether the outcomes belong together one by one.
    """
    p, q = wilson(int(first.sum()), first.size), wilson(int(second.sum()), second.size)
    phi = _phi(first, second) if paired else 0.0
    change = q.value - p.value
    down, up = (q.value - q.low, p.high - p.value), (q.high - q.value, p.value - p.low)
    low, high = (np.sqrt(max(x * x - 2 * phi * x * y + y * y, 0.0)) for x, y in (down, up))
    return change, float(change - low), float(change + high)


def _phi(first: Mask, second: Mask) -> float:
    """Newcombe's phi of a table of four fields, with its correction for continuity."""
    a, b = int(np.sum(first & second)), int(np.sum(first & ~second))
    c, d = int(np.sum(~first & second)), int(np.sum(~first & ~second))
    sums = (a + b) * (c + d) * (a + c) * (b + d)
    if sums == 0:
        return 0.0
    cross = float(a * d - b * c)
    if cross > 0:
        cross = max(cross - first.size / 2, 0.0)
    return float(cross / np.sqrt(sums))


@dataclass(frozen=True, slots=True)
class Correlation:
    """Spearman's rank correlation with its 95 % interval."""

    rho: float
    low: float
    high: float


def rank_correlation(x: Array, y: Array) -> Correlation:
    """Rank correlation of an input with an outcome; nan where one never changes."""
    if x.size < 5 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return Correlation(np.nan, np.nan, np.nan)
    rho = float(stats.spearmanr(x, y)[0])
    z, half = np.arctanh(np.clip(rho, -1 + 1e-12, 1 - 1e-12)), 1.96 * 1.03 / np.sqrt(x.size - 3)
    return Correlation(rho, float(np.tanh(z - half)), float(np.tanh(z + half)))


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


def indices(plan: Plan, x: Array, y: Array, good: Mask) -> Indices:
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
