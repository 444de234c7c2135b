"""The worst family of squeal modes of a run, and the smallest change of a number that quiets it.

Modes of changed samples get their family by shape, as those of a sweep do. The shapes of the run's
families are taken to the brake at hand by the nearest nodes, so that its mesh may be another one.
The smallest change after which hardly any sample squeals is found by search.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

from mpi4py import MPI

import numpy as np
from scipy.stats import beta, binom

from brake_fenicsx.arguments import AnyArray
from brake_fenicsx.errors import BrakeError, SceneError, StorageError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import in_turns
from brake_fenicsx.mac import mac
from brake_fenicsx.results import ensemble_statistics, families, squeal
from brake_fenicsx.results.run import RunData
from brake_fenicsx.samples.numbering import dof_places
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene.units import quantity_text
from brake_fenicsx.sweeps.matching import Points, State, likeness

from .comparison import shapes_of
from .countermeasure_keys import Countermeasure

# Step of the derivative, relative to the range.
STEP = 1e-3
# Share of the samples that may still squeal, and confidence that it is no larger.
MOST, SURE = 0.05, 0.95
LONGEST = 20_000  # no longer run is proposed


@dataclass(frozen=True, slots=True)
class Worst:
    """The family that squeals in most samples of an approach; of equal ones the most unstable.

    Attributes:
        count: its approach, number, frequency and share.
        any: share of samples in which any family squeals.
        samples: numbers of the samples that ended well.
        loud: numbers of those in which it squeals.
        shapes: of all families that squeal, at nodes.
        column: its place among these.
        threshold: a mode squeals where its damping lies below minus this.
    """

    count: squeal.Family
    any: ensemble_statistics.Proportion
    samples: list[int]
    loud: list[int]
    shapes: dict[str, AnyArray]
    column: int
    threshold: float


def worst_family(run: RunData, approach: str) -> Worst | None:
    """The worst family of an approach; None where none squeals.

    Raises:
        SceneError: modes squeal, and have no family.
    """
    modes, shapes = run.squeal.squeal_modes(approach), shapes_of(run)
    if not len(modes):
        return None
    found = [f for f in run.squeal.families(approach) if f.key >= 0]
    if not found or shapes is None:
        raise SceneError(f"""{run.directory}: modes of a single sample belong to no family; raise
            samples.n""")
    worst = max(found, key=lambda f: (f.share.value, -f.median))
    loud = sorted({*run.squeal.squeal_modes(approach, worst.key)["sample"]})
    every = ensemble_statistics.wilson(modes["sample"].nunique(), worst.share.n)
    samples = [int(k) for k in run.squeal.good(approach)]
    column = int(np.flatnonzero(shapes["families"] == worst.key)[0])
    return Worst(worst, every, samples, loud, shapes, column, run.threshold)


class Trial:
    """Samples of a prepared brake, and which of their modes are the worst family."""

    def __init__(self, study: Study, worst: Worst, comm: MPI.Comm, lever: Countermeasure):
        """Give the families coordinates of this brake; collective.

        Args:
            study: samples of the brake.
            worst: the worst family.
            comm: processes that share the samples.
            lever: the number that samples take at other values.
        """
        self._study, self._worst, self._comm, self._lever = study, worst, comm, lever
        places = dof_places(study.brake, study.models.numbering.body)
        shapes = families.shapes_at_dofs(worst.shapes, places)
        found = study.models.coordinates.of(shapes)
        if found is None:
            raise ValueError("a scene with a sweep has coordinates")
        self._known = found / np.linalg.norm(found, axis=0)
        self._points: dict[tuple[int, str], Points] = {}

    def outcomes(self, x: float, fixed: Mapping[str, float] | None = None) -> Iterator[bool]:
        """Whether the worst family squeals in each sample at a value; collective.

        A sample without an equilibrium counts as one that squeals.

        Args:
            x: the value.
            fixed: values of further numbers of the scene.
        """
        logger.info("%s = %s: samples ...", self._lever.key, quantity_text(x, self._lever.unit))
        samples = self._worst.samples
        return in_turns(
            len(samples), lambda i: self._squeals(x, samples[i], fixed or {}), self._comm
        )

    def _squeals(self, x: float, k: int, fixed: Mapping[str, float]) -> bool:
        try:
            return bool(self._loud(self._state(x, k, fixed)))
        except StorageError:
            raise
        except BrakeError:
            return True

    def _state(self, x: float, k: int, fixed: Mapping[str, float] = MappingProxyType({})) -> State:
        task, other = (self._worst.count.approach, k), repr(sorted(fixed.items()))
        # A random number moves with its distribution.
        ratio, key = self._study.sample(task).values.ratio, self._lever.key
        line = Points(self._study, task, key, {n: y * ratio(n) for n, y in fixed.items()})
        return self._points.setdefault((k, other), line)(x * ratio(key))

    def _loud(self, state: State) -> list[int]:
        """Modes that squeal and are of the worst family.

        One whose stability its estimated error leaves open ("neutral") counts by its damping.
        """
        verdict = np.where(state.verdict == "neutral", "unstable", state.verdict)
        known = {"verdict": verdict, "damping": state.damping}
        modes = np.flatnonzero(squeal.squeals(known, self._worst.threshold))
        numbers = families.known_numbers(mac(self._known, state.right[:, modes]))
        return [int(i) for i, n in zip(modes, numbers, strict=True) if n == self._worst.column]

    def slope(self, start: float, stop: float) -> float | None:
        """Change of damping between two values, from its derivative at the first one.

        It is that of the first sample in which the worst family squeals; its mode is continued by
        the likest one a small step away. None where there is no such sample.
        """
        for k in self._worst.loud:
            a = self._state(start, k)
            if own := self._loud(a):
                i = min(own, key=lambda i: a.damping[i])
                b = self._state(start + STEP * (stop - start), k)
                j = int(np.argmin(np.abs(likeness(a, b)[i] - 1.0)))
                return float(b.damping[j] - a.damping[i]) / STEP
        return None


@dataclass(frozen=True, slots=True)
class Change:
    """The smallest change that is enough, or the farthest one where none is.

    Attributes:
        value: of the number; None where no value is enough.
        share: samples that squeal at it, or at the farthest value.
    """

    value: float | None
    share: ensemble_statistics.Proportion


def few(hits: int, samples: int) -> bool:
    """Whether at most so large a share of these samples squeals, whatever other ones would do."""
    return hits <= int(MOST * samples)


def limits(hits: int, samples: int) -> tuple[float, float]:
    """Exact interval of a share (C. J. Clopper and E. S. Pearson, Biometrika 26(4), 1934).

    With a confidence of SURE the share of all is at most the upper end, and so at least the lower.
    """
    low, high = beta.ppf([1 - SURE, SURE], [hits, hits + 1], [samples - hits + 1, samples - hits])
    return (float(low) if hits else 0.0), (float(high) if hits < samples else 1.0)


def allowed(samples: int) -> int:
    """Samples of a search that may squeal: were MOST of all to squeal, more would, almost surely.

    It is the largest number whose upper limit is at most MOST; none of too few samples. Where the
    share falls with the change, values at which more than MOST of all samples squeal pass with a
    probability of 1 - SURE at most, however many are tried: the samples are the same ones at all of
    them.
    """
    return int(max(binom.ppf(1 - SURE, samples, MOST) - 1, 0))


def needed(hits: int, samples: int) -> int | None:
    """Samples that show a share of at most MOST if as large a share of them squeals; None: none."""
    n = np.arange(samples, LONGEST)
    again = np.ceil(n * (hits / samples) - 1e-9)
    found = np.flatnonzero(again <= binom.ppf(1 - SURE, n, MOST) - 1)
    return int(n[found[0]]) if found.size else None


def smallest_change(
    outcomes: Callable[[float], Iterable[bool]],
    ends: tuple[float, float],
    samples: int,
    steps: int,
    accuracy: float,
) -> Change:
    """Search for the smallest change that is enough.

    Values are tried from the first end outward: nothing is assumed of how the samples depend on the
    number from one to the next. Within the last step the border is found by bisection.

    Args:
        outcomes: gives, sample by sample, whether it squeals at a value; samples that cannot change
            the answer are not asked for.
        ends: value of the scene, and the farthest one.
        samples: how many there are.
        steps: values that are tried outward.
        accuracy: of the value, relative to the range.
    """
    most = allowed(samples)

    def hits(x: float) -> int:
        count = 0
        for squealing in outcomes(x):
            count += squealing
            if count > most:
                break
        return count

    start, stop = ends
    for before, x in pairwise(_short(v) for v in np.linspace(start, stop, steps + 1)):
        if (count := hits(x)) > most:
            continue
        # Halves of a step reach the accuracy exactly, but for round-off.
        while abs(x - before) > accuracy * abs(stop - start) * (1 + 1e-9):
            middle = _short(0.5 * (before + x))
            if (there := hits(middle)) <= most:
                x, count = middle, there
            else:
                before = middle
        return Change(x, ensemble_statistics.wilson(count, samples))
    return Change(None, ensemble_statistics.wilson(sum(outcomes(stop)), samples))


def _short(x: float) -> float:
    """A value without the last digits, which only round-off fills."""
    return float(f"{x:.12g}")
