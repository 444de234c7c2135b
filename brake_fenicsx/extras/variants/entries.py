"""Entries of the budget: what a variant changes, bias apart from scatter, and what is left.

Of matched samples the bias is the median of their differences and the scatter their standard
deviation. Where the refinements of a resolution behave, the observed order, Richardson's value and
the Grid Convergence Index follow (P. J. Roache, J. Fluids Eng. 116 (1994) 405,
doi:10.1115/1.2910291; ASME V&V 20-2009, section 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.results.ensemble_statistics import wilson
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.squeal import least_damped
from brake_fenicsx.results.tables import Value

from .comparison import compare_runs
from .page import Row

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

# Of a family's least damped mode: column of modes.csv, its name in columns of the budget, unit.
VALUES = (("frequency_hz", "frequency", "_hz"), ("damping", "damping", ""))
SAFETY = 1.25  # of the index, for three grids
BOOTSTRAP = 400  # resamples
COLUMNS = (
    "knob", "says", "kind", "variant", "change_made", "status", "reason", "approach", "family",
    "family_variant", "frequency_hz", "samples", "samples_variant", "probability",
    "probability_variant", "change", "change_low", "change_high", "paired", "frequency_bias_hz",
    "frequency_scatter_hz", "damping_bias", "damping_scatter", "frequency_order",
    "frequency_limit_hz", "frequency_gci_hz", "damping_order", "damping_limit", "damping_gci",
    "seconds", "memory_mb",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Limit:
    """Observed order [-], Richardson's value, and the index as an error of the finest value."""

    order: float
    value: float
    index: float


def richardson(coarse: float, middle: float, fine: float, ratio: float) -> Limit | None:
    """What three values of one ratio of refinement tend to; None where they do not settle.

    Args:
        coarse: value of the coarsest resolution.
        middle: of one ``ratio`` times as fine.
        fine: of one ``ratio**2`` times as fine.
        ratio: of two resolutions, larger than 1.
    """
    first, second = middle - coarse, fine - middle
    if first == 0.0 or not 0.0 < second / first < 1.0:
        return None
    order = float(np.log(first / second) / np.log(ratio))
    rest = second / (ratio**order - 1.0)
    return Limit(order, fine + rest, SAFETY * abs(rest))


def bias_and_scatter(a: Array, b: Array, paired: bool) -> tuple[float | None, float | None]:
    """Bias and scatter of b - a; the scatter only of paired values, at least two.

    Args:
        a: values of the scene's samples, shape (n,).
        b: of the variant's; of the same samples where they are paired.
        paired: whether they belong together one by one.
    """
    if not (a.size and b.size):
        return None, None
    if not paired:
        return float(np.median(b) - np.median(a)), None
    change = b - a
    return float(np.median(change)), float(change.std(ddof=1)) if change.size > 1 else None


def entries(scene: RunData, variant: RunData, may_pair: bool) -> list[Row]:
    """One row for all modes of an approach together and for each family of either run.

    Args:
        scene: results of the scene.
        variant: results of the variant.
        may_pair: whether the variant draws the same samples where its contact elements are the
            scene's.

    Raises:
        SceneError: a run holds no modes, or they have no approach in common.
    """
    rows = []
    for c in compare_runs(scene, variant, may_pair and _same_elements(scene, variant)):
        a, b, paired = c["family_a"], c["family_b"], c["paired"] == "yes"
        whole = a is None and b is None
        row = blank(
            status="run", approach=c["approach"], family="any" if whole else a, family_variant=b,
            samples=c["samples_a"], samples_variant=c["samples_b"],
            probability=c["probability_a"], probability_variant=c["probability_b"],
            **{name: c[name] for name in ("change", "change_low", "change_high", "paired")},
        )  # fmt: skip
        if not whole:
            row["frequency_hz"] = c["frequency_b_hz" if a is None else "frequency_a_hz"]
        if whole or None not in (a, b):
            sides = (scene, a), (variant, b)
            one, two = (family_values(run, c["approach"], family) for run, family in sides)
            if paired:
                one, two = one.align(two, join="inner", axis=0)
            # Of all modes together the least damped one may be another one.
            for column, name, unit in VALUES[1:] if whole else VALUES:
                x, y = one[column].to_numpy(), two[column].to_numpy()
                bias, scatter = bias_and_scatter(x, y, paired)
                row[f"{name}_bias{unit}"], row[f"{name}_scatter{unit}"] = bias, scatter
        rows.append(row)
    return rows


def statistical(scene: RunData) -> list[Row]:
    """The scene's own uncertainty: Wilson's interval, and a bootstrap of the medians."""
    rows = []
    for c in compare_runs(scene, scene):
        n, p, family = c["samples_a"], c["probability_a"], c["family_a"]
        row = blank(
            knob="samples", says="the number of samples", kind="statistics", status="run",
            variant="samples", change_made="one sample" if n == 1 else f"{n} samples",
            approach=c["approach"], family="any" if family is None else family,
            frequency_hz=c["frequency_a_hz"], samples=n, probability=p, change=0.0,
        )  # fmt: skip
        if n > 1:
            share = wilson(round(p * n), n)
            row["change_low"], row["change_high"] = share.low - p, share.high - p
        if family is not None and n > 1:
            values = family_values(scene, c["approach"], family).to_numpy()
            drawn = np.random.default_rng(0).integers(0, len(values), (BOOTSTRAP, len(values)))
            scatter = np.median(values[drawn], axis=1).std(axis=0)
            row["frequency_scatter_hz"], row["damping_scatter"] = map(float, scatter)
        rows.append(row)
    return rows


def extrapolate(rows: list[Row], knob: str, ratio: float, scene: RunData) -> None:
    """Fill in order, limit and index of the second variant of a resolution, where it settles."""
    first, second = ([r for r in rows if r["variant"] == f"{knob}-{n}"] for n in (1, 2))
    before = {(r["approach"], r["family"]): r for r in first}
    for row in second:
        key = row["approach"], row["family"]
        if key not in before or key[1] in (None, "any"):
            continue
        values = family_values(scene, *key)
        for column, name, unit in VALUES:
            coarse, fine = before[key][f"{name}_bias{unit}"], row[f"{name}_bias{unit}"]
            if coarse is None or fine is None:
                continue
            start = float(values[column].median())
            limit = richardson(start, start + coarse, start + fine, ratio)
            if limit is None:
                reason = f"{name} does not settle: no order"
                row["reason"] = f"{row['reason']}; {reason}" if row["reason"] else reason
            else:
                row[f"{name}_order"], row[f"{name}_limit{unit}"] = limit.order, limit.value
                row[f"{name}_gci{unit}"] = limit.index


def blank(**cells: Value) -> Row:
    """A row with some cells filled."""
    return dict.fromkeys(COLUMNS) | cells


def family_values(run: RunData, approach: str, family: int | None) -> pd.DataFrame:
    """Frequency [Hz] and damping [-] of a family's least damped mode, by number of the sample.

    Args:
        run: the results.
        approach: name of the approach.
        family: number of the family; None: all modes.
    """
    modes = run.squeal.modes(approach)
    own = least_damped(modes if family is None else modes[modes.family == family])
    return own[[column for column, *_ in VALUES]]


def _same_elements(one: RunData, two: RunData) -> bool:
    """Whether two runs have the same contact elements, so that element i draws the same."""
    if one.contact is None or two.contact is None:
        return True
    places = []
    for c in (one.contact, two.contact):
        first = (c["sample"] == c["sample"][0]) & (c["approach"] == c["approach"][0])
        places.append(np.column_stack([c[x][first] for x in "xyz"]))
    a, b = places
    # Gmsh's vertices agree to its tolerance of geometry.
    return a.shape == b.shape and bool(np.allclose(a, b, atol=1e-6, rtol=0.0))
