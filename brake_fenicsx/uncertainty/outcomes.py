"""What a study asks of each sample: is this band or this family unstable, and how much.

    unstable   1 or 0
    growth     real part [1/s] of the most unstable mode there, 0 if none is unstable

A stable mode counts as growth 0: without damping its real part is zero but for round-off, and with
damping how fast it decays says nothing about noise. Indices of growth thus answer for crossing the
border and for the strength beyond it, those of unstable for the border alone. A family that has no
mode in a sample is not unstable there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .ensemble import Task
from .results import Results

Array = NDArray[np.float64]

# Bands of equal width besides the whole band; families looked at, the most frequent first.
BANDS = 8
MOST_FAMILIES = 20


@dataclass(frozen=True, slots=True)
class Outcome:
    """One thing that may happen in every sample of an approach.

    Attributes:
        scope: "band" or "family".
        where: "low-high" of the band [Hz], or the number of the family.
        frequency: middle of the band, or mean frequency of the family's unstable modes [Hz].
        growth: largest real part where unstable, else 0 [1/s], shape (samples,).
    """

    scope: str
    where: str
    frequency: float
    growth: Array

    @property
    def unstable(self) -> Array:
        """1 where unstable, else 0."""
        return (self.growth > 0).astype(float)


@dataclass(frozen=True, slots=True)
class Ensemble:
    """Samples of one approach: inputs and outcomes.

    Attributes:
        approach: its name.
        names: random inputs.
        x: their values, shape (samples, inputs); nan where a sample failed.
        good: samples that ended well, shape (samples,).
        outcomes: bands, the whole one first, then families, the most frequent first.
    """

    approach: str
    names: tuple[str, ...]
    x: Array
    good: NDArray[np.bool_]
    outcomes: tuple[Outcome, ...]


def ensembles(results: Results, band: Sequence[float]) -> list[Ensemble]:
    """Approaches of a study that have several samples with modes.

    Args:
        results: stored samples.
        band: the scene's band [Hz].
    """
    families = results.families()
    found = []
    for approach in dict.fromkeys(name for name, _ in results.tasks):
        tasks = [t for t in results.tasks if t[0] == approach]
        good = np.array([t in families for t in tasks])
        if len(tasks) < 2 or not good.any():
            continue
        names, x = _inputs(results, tasks)
        modes = [
            _unstable(results.stored[t], families[t]) if t in families else None for t in tasks
        ]
        outcomes = (*_bands(modes, band), *_families(modes))
        found.append(Ensemble(approach, names, x, good, outcomes))
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


Unstable = tuple[Array, Array, NDArray[np.int_]]


def _unstable(data: Mapping[str, Any], family: NDArray) -> Unstable:
    """Frequency [Hz], real part [1/s] and family of the unstable modes of a sample."""
    own = data["verdict"] == "unstable"
    s = data["s"][own]
    return np.abs(s.imag) / (2 * np.pi), s.real, family[own]


def _bands(modes: Sequence[Unstable | None], band: Sequence[float]) -> list[Outcome]:
    edges = np.linspace(band[0], band[1], BANDS + 1)
    pairs = [(band[0], band[1]), *pairwise(edges)]
    found = []
    for low, high in pairs:
        growth = np.zeros(len(modes))
        for k, m in enumerate(modes):
            if m is not None:
                # The last band holds its upper edge.
                inside = (m[0] >= low) & ((m[0] < high) | (high == band[1]))
                growth[k] = m[1][inside].max(initial=0.0)
        found.append(Outcome("band", f"{low:.0f}-{high:.0f}", 0.5 * (low + high), growth))
    return found


def _families(modes: Sequence[Unstable | None]) -> list[Outcome]:
    numbers = {int(f) for m in modes if m is not None for f in m[2] if f >= 0}
    found = []
    for number in sorted(numbers):
        growth, pitch = np.zeros(len(modes)), []
        for k, m in enumerate(modes):
            if m is not None and (own := m[2] == number).any():
                growth[k] = m[1][own].max()
                pitch.extend(m[0][own])
        found.append(Outcome("family", str(number), float(np.mean(pitch)), growth))
    found.sort(key=lambda o: (-o.unstable.sum(), o.frequency))
    return found[:MOST_FAMILIES]
