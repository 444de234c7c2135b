"""What a study asks of each sample: does this band or this family squeal, and how much.

    squeal     1 or 0
    growth     largest real part [1/s] of the modes that squeal there, 0 if none does

A mode squeals where it is unstable and its damping lies below minus the threshold of the scene. Any
other mode counts as growth 0: without damping the real part of a stable one is zero but for
round-off, and with damping how fast it decays says nothing about noise. Indices of growth thus
answer for crossing the border and for the strength beyond it, those of squeal for the border alone.
A family that has no mode in a sample does not squeal there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.squeal import squeals

from .results import Results
from .sensitivity import Indices

Array = NDArray[np.float64]

# Bands of equal width besides the whole band; families looked at, the most severe first.
BANDS = 8
MOST_FAMILIES = 20


@dataclass(frozen=True, slots=True)
class Outcome:
    """One thing that may happen in every sample of an approach.

    Attributes:
        scope: "band" or "family".
        where: "low-high" of the band [Hz], or the number of the family.
        frequency: middle of the band, or mean frequency of the family's squeal modes [Hz].
        growth: largest real part where it squeals, else 0 [1/s], shape (samples,).
        damping: lowest damping where it squeals, else 0 [-], shape (samples,).
    """

    scope: str
    where: str
    frequency: float
    growth: Array
    damping: Array

    @property
    def squeal(self) -> Array:
        """1 where it squeals, else 0."""
        return (self.growth > 0).astype(float)

    @property
    def median_damping(self) -> float | None:
        """Median of the damping where it squeals; None where it never does."""
        own = self.damping[self.growth > 0]
        return float(np.median(own)) if own.size else None

    def severity(self, samples: int) -> float:
        """Share of so many samples in which it squeals, times its median damping, unsigned."""
        return float(self.squeal.sum()) / samples * abs(self.median_damping or 0.0)


@dataclass(frozen=True, slots=True)
class Ensemble:
    """Samples of one approach: inputs and outcomes.

    Attributes:
        approach: its name.
        names: random inputs.
        x: their values, shape (samples, inputs); nan where a sample failed.
        good: samples that ended well, shape (samples,).
        outcomes: bands, the whole one first, then families, the most severe first.
        threshold: a mode squeals where its damping lies below minus this.
        indices: of the growth of each outcome, by scope and place, once they are computed.
    """

    approach: str
    names: tuple[str, ...]
    x: Array
    good: NDArray[np.bool_]
    outcomes: tuple[Outcome, ...]
    threshold: float = 0.0
    indices: dict[tuple[str, str], Indices] = field(default_factory=dict)


def ensembles(results: Results, band: Sequence[float], threshold: float = 0.0) -> list[Ensemble]:
    """Approaches of a study that have several samples with modes.

    Args:
        results: stored samples.
        band: the scene's band [Hz].
        threshold: a mode squeals where its damping lies below minus this.
    """
    families = results.families
    found = []
    for approach in dict.fromkeys(name for name, _ in results.tasks):
        tasks = [t for t in results.tasks if t[0] == approach]
        good = np.array([t in families for t in tasks])
        if len(tasks) < 2 or not good.any():
            continue
        names, x = _inputs(results, tasks)
        modes = [
            _squealing(results.stored[t], families[t], threshold) if t in families else None
            for t in tasks
        ]
        outcomes = (*_bands(modes, band), *_families(modes))
        found.append(Ensemble(approach, names, x, good, outcomes, threshold))
    return found


def _inputs(results: Results, tasks: Sequence[Task]) -> tuple[tuple[str, ...], Array]:
    """Names and values of the random inputs."""
    drawn: list[Mapping[str, float]] = []
    for t in tasks:
        d = results.stored.get(t, {})
        drawn.append(
            dict(zip(map(str, d.get("random_names", ())), d.get("random", ()), strict=True))
        )
    names = tuple(sorted({name for values in drawn for name in values}))
    x = np.array([[values.get(name, np.nan) for name in names] for values in drawn])
    return names, x.reshape(len(tasks), len(names))


Squealing = tuple[Array, Array, Array, NDArray[np.int_]]


def _squealing(data: Mapping[str, Any], family: NDArray, threshold: float) -> Squealing:
    """Frequency [Hz], real part [1/s], damping and family of the squeal modes of a sample."""
    own = squeals(data, threshold)
    s = data["s"][own]
    return np.abs(s.imag) / (2 * np.pi), s.real, data["damping"][own], family[own]


def _bands(modes: Sequence[Squealing | None], band: Sequence[float]) -> list[Outcome]:
    edges = np.linspace(band[0], band[1], BANDS + 1)
    pairs = [(band[0], band[1]), *pairwise(edges)]
    found = []
    for low, high in pairs:
        growth, damping = np.zeros((2, len(modes)))
        for k, m in enumerate(modes):
            if m is not None:
                # The last band holds its upper edge.
                inside = (m[0] >= low) & ((m[0] < high) | (high == band[1]))
                growth[k] = m[1][inside].max(initial=0.0)
                damping[k] = m[2][inside].min(initial=0.0)
        where = f"{low:.0f}-{high:.0f}"
        found.append(Outcome("band", where, 0.5 * (low + high), growth, damping))
    return found


def _families(modes: Sequence[Squealing | None]) -> list[Outcome]:
    numbers = {int(f) for m in modes if m is not None for f in m[3] if f >= 0}
    found = []
    for number in sorted(numbers):
        (growth, damping), frequency = np.zeros((2, len(modes))), []
        for k, m in enumerate(modes):
            if m is not None and (own := m[3] == number).any():
                growth[k] = m[1][own].max()
                damping[k] = m[2][own].min()
                frequency.extend(m[0][own])
        found.append(Outcome("family", str(number), float(np.mean(frequency)), growth, damping))
    found.sort(key=lambda o: (-o.severity(len(modes)), o.frequency))
    return found[:MOST_FAMILIES]
