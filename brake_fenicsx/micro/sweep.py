"""A surface pressed step by step, from one touching pixel to a high load.

While few pixels touch, the law consists of straight pieces with corners, one for each pixel that
comes into contact: small steps, and cheap ones, with the active set on the highest pixels. With
many pixels it is smooth: wide steps with conjugate gradients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.micro.active import AllPixels, HighPixels, Pixels, Touching, active_set
from brake_fenicsx.micro.halfspace import Array, HalfSpace, Index
from brake_fenicsx.micro.loading import DENSE, FEW
from brake_fenicsx.micro.qp import certify, projected_cg, unit_answer


@dataclass(frozen=True, slots=True)
class Step:
    """One point of a sweep, all over E* and for the sum over pixels.

    Attributes:
        d: far-field separation [m].
        total: sum of the pressures [-].
        stiffness: -d total / dd [1/m].
        touching: number of touching pixels.
        gap: certificate [-].
    """

    d: float
    total: float
    stiffness: float
    touching: int
    gap: float


@dataclass(frozen=True, slots=True)
class Reached:
    """Where a sweep stands.

    Attributes:
        p: pressures over E* [-], shape (nx, ny).
        unit: answer to a unit approach [1/m], shape (nx, ny).
    """

    p: Array
    unit: Array


def sweep(
    space: HalfSpace, h: Array, lowest: float, highest: float, fine: int, coarse: int,
    tolerance: float,
) -> list[Step]:  # fmt: skip
    """Press a surface from one touching pixel to a high load.

    Args:
        space: the half-space.
        h: heights over their mean [m], shape (nx, ny).
        lowest: first sum of pressures over E* [-].
        highest: sum to reach or pass [-].
        fine: steps per decade of load while few pixels touch.
        coarse: steps per decade when many touch.
        tolerance: of the certificate of each step [-].

    Returns:
        Steps of rising load. A periodic surface may close before ``highest``: then the sweep ends,
        since its separation cannot fall further.

    Raises:
        NotConverged: a step misses the tolerance.
    """
    steps, reached = _few_steps(space, h, lowest, highest, fine, tolerance)
    if steps[-1].total >= highest * (1.0 - 1e-9) or _closed(space, steps[-1]):
        return steps
    return steps + _many_steps(space, h, highest, coarse, tolerance, steps[-1], reached)


def _few_steps(
    space: HalfSpace, h: Array, lowest: float, highest: float, per_decade: int, tolerance: float
) -> tuple[list[Step], Reached]:
    """Steps of equal ratio in the load with the active set, until ``DENSE`` pixels touch."""
    order = np.argsort(-h, axis=None, kind="stable")
    pixels = _highest(space, h, order, 64)
    at, found = _translate(pixels, order, np.array([0])), None
    steps: list[Step] = []
    for k in range(10**6):
        total = min(lowest * 10.0 ** (k / per_decade), highest)
        solved = active_set(pixels, None, total, at, 2 * DENSE)
        while isinstance(pixels, HighPixels) and not _suffice(pixels, h, order, solved):
            pixels = _highest(space, h, order, 2 * pixels.height.size)
            solved = active_set(pixels, None, total, _translate(pixels, order, at), 2 * DENSE)
        if solved is None:
            break
        at, found = solved.points, solved
        steps.append(_few_step(space, pixels, solved, total, tolerance))
        if total >= highest or at.size > DENSE or _closed(space, steps[-1]):
            break
    if found is None:
        raise NotConverged("first touch: the active set does not settle")
    return steps, _spread(pixels, found, h, order)


def _closed(space: HalfSpace, step: Step) -> bool:
    """Whether a periodic surface is all but in full contact."""
    size = space.shape[0] * space.shape[1]
    return space.boundary == "periodic" and step.touching >= min(0.97 * size, size - 1)


def _highest(space: HalfSpace, h: Array, order: Index, count: int) -> Pixels:
    """The highest pixels, or all where these are too many or the boundary is periodic."""
    if space.boundary == "free" and count <= FEW:
        return HighPixels(space, h, order[:count])
    return AllPixels(space, h)


def _suffice(pixels: HighPixels, h: Array, order: Index, solved: Touching | None) -> bool:
    """Whether all pixels that are not among the highest stay below the plane."""
    count = pixels.height.size
    return solved is not None and (count == h.size or h.ravel()[order[count]] <= solved.d)


def _translate(pixels: Pixels, order: Index, at: Index) -> Index:
    """Ranks of touching pixels as indices of the new ``pixels``; the highest come first."""
    return at if isinstance(pixels, HighPixels) else np.asarray(order[at])


def _few_step(
    space: HalfSpace, pixels: Pixels, solved: Touching, total: float, tolerance: float
) -> Step:
    """Record of an active-set solution, with its certificate."""
    p = np.zeros(pixels.height.size)
    p[solved.points] = solved.pressure
    gap = certify(space, pixels.height, p, solved.gap, solved.d, True).gap
    if gap > tolerance:
        raise NotConverged(f"active set: certificate {gap:.2g}, wanted {tolerance:.2g}")
    return Step(solved.d, total, float(solved.unit.sum()), solved.points.size, gap)


def _spread(pixels: Pixels, found: Touching, h: Array, order: Index) -> Reached:
    """Pressures and answer on the grid."""
    where = order[found.points] if isinstance(pixels, HighPixels) else found.points
    p, unit = np.zeros(h.size), np.zeros(h.size)
    p[where], unit[where] = found.pressure, found.unit
    return Reached(p.reshape(h.shape), unit.reshape(h.shape))


def _many_steps(
    space: HalfSpace, h: Array, highest: float, per_decade: int, tolerance: float, last: Step,
    reached: Reached,
) -> list[Step]:  # fmt: skip
    """Continue with conjugate gradients, the separation chosen for even steps in load."""
    found: list[Step] = []
    p, unit = reached.p, reached.unit
    while last.total < highest and not _closed(space, last):
        ratio = 10.0 ** (1.0 / per_decade)
        # Along constant d(ln p)/dd, which falls as the load rises: a little short of the ratio.
        d = last.d - last.total / last.stiffness * np.log(ratio)
        if d <= 0.0 and space.boundary == "periodic":
            break
        guess = np.maximum(p + (last.d - d) * unit, 0.0)
        solved = projected_cg(space, h, float(d), None, guess, tolerance)
        p = solved.p
        unit = unit_answer(space, p > 0.0, unit)
        count = int(np.count_nonzero(p))
        last = Step(solved.d, float(p.sum()), float(unit.sum()), count, solved.gap)
        found.append(last)
    return found
