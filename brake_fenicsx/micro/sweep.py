"""A surface pressed step by step, from one touching pixel to a high load.

While few pixels touch, the law consists of straight pieces with corners, one for each pixel that
comes into contact: small steps, and cheap ones, with the active set on the highest pixels. With
many pixels it is smooth: wide steps with conjugate gradients. These also help out where the active
set does not settle or a plateau touches at once.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from brake_fenicsx.arguments import Array, Index
from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.micro import active
from brake_fenicsx.micro.halfspace import HalfSpace
from brake_fenicsx.micro.loading import dense, first_guess
from brake_fenicsx.micro.qp import certify, projected_cg

# Candidates up to which a sweep, which uses their dense influence many times, does without FFT.
HIGHEST = 3000
CORNERS = 300  # touching pixels up to which the corners of a law need the finest steps


@dataclass(frozen=True, slots=True)
class Step:
    """One point of a sweep, all over E* and for the sum over pixels.

    Attributes:
        d: far-field separation [m].
        total: sum of the pressures [-].
        stiffness: -d total / dd of further loading [1/m]: yielding pixels keep their pressure.
        vibration: the same of small vibrations about this state [1/m]: unloading is elastic, so
            every touching pixel answers; none yields and none opens. Without a hardness it is the
            stiffness of loading.
        touching: number of touching pixels.
        gap: certificate: duality gap over the work, not over load and S_q as other programs have
            it (see ``ContactSolution``) [-].
    """

    d: float
    total: float
    stiffness: float
    vibration: float
    touching: int
    gap: float


Loads = Callable[[float, int], float]  # the next sum of pressures, of the last and its pixels


def sweep(
    space: HalfSpace,
    h: Array,
    lowest: float,
    highest: float,
    following: Loads,
    tolerance: float,
    hardness: float | None = None,
    stop: int | None = None,
    enough: float = np.inf,
) -> list[Step]:
    """Press a surface step by step, from one touching pixel or more to a high load.

    Args:
        space: the half-space.
        h: heights over their mean [m], shape (nx, ny).
        lowest: first sum of pressures over E* [-].
        highest: sum to reach or pass [-]; under a hardness to reach.
        following: the next sum of pressures, of the last one and the number of touching pixels.
        tolerance: of the certificate of each step [-].
        hardness: pressure over E* at which a pixel yields [-]; None for an elastic surface.
        stop: end where more pixels than these touch; None to go on to ``highest``.
        enough: end at the first step of this sum or more [-]. The steps before it are those of a
            sweep to ``highest``, digit for digit.

    Returns:
        Steps of rising load. A periodic surface may close before ``highest``: then the sweep ends,
        since its separation cannot fall further.

    Raises:
        SceneError: a tolerance without meaning, or a hardness that cannot carry ``highest``.
        NotConverged: a step misses the tolerance.
    """
    if not 0.0 < tolerance < np.inf:
        raise SceneError(f"tolerance = {tolerance}; give a positive number, such as 1e-6")
    cap = np.inf if hardness is None else hardness
    if not cap > 0.0 or highest >= cap * h.size:
        raise SceneError(f"""hardness = {cap:.4g} E* under a mean pressure of {highest / h.size:.4g}
            E*: the hardness must be higher; lower the highest pressure of the law""")
    limit = h.size if stop is None else stop
    few = dense(h.size) if stop is None else min(stop, 2 * dense(h.size))
    end = min(enough, highest * (1.0 - 1e-9))
    steps, reached = _few_steps(space, h, lowest, highest, following, tolerance, cap, few, end)
    if steps[-1].total >= end or _closed(space, steps[-1]):
        return steps
    return steps + _many_steps(
        space, h, highest, following, tolerance, steps[-1], reached, cap, limit, end
    )


def _few_steps(
    space: HalfSpace, h: Array, lowest: float, highest: float, following: Loads,
    tolerance: float, cap: float, most: int, end: float,
) -> tuple[list[Step], tuple[Array, Array]]:  # fmt: skip
    """Steps with the active set, to ``end`` or ``most`` pixels."""
    order = _highest_first(h)
    total = min(lowest, highest)
    yielding = int(total / cap)  # the highest pixels, and the next one
    pixels = _highest(space, h, order, max(64, 4 * yielding))
    start, none = np.append(yielding, np.arange(yielding)), np.zeros(yielding + 1)
    contact = _translate(pixels, order, active.Touching(start, none, none, h, 0.0, yielding, 0))
    steps: list[Step] = []
    answer = active.ElasticAnswer()
    while True:
        solved = _by_active_set(pixels, total, contact, cap, h.size)
        # Until all pixels that are not among the highest stay below the plane.
        while isinstance(pixels, active.HighPixels) and not (
            solved is not None and h.ravel()[order[pixels.height.size]] <= solved.d
        ):
            pixels = _highest(space, h, order, 2 * pixels.height.size)
            contact = _translate(pixels, order, contact)
            answer = answer if isinstance(pixels, active.HighPixels) else active.ElasticAnswer()
            solved = _by_active_set(pixels, total, contact, cap, h.size)
        if solved is None:  # the pixels are all of them by now
            last = _spread(pixels, contact, h, order)[0] if steps else None
            solved = _by_gradients(space, h, total, last, tolerance, cap)
        contact = solved
        steps.append(_few_step(space, pixels, contact, total, tolerance, cap, answer))
        if total >= end or contact.points.size > most or _closed(space, steps[-1]):
            return steps, _spread(pixels, contact, h, order)
        total = min(following(total, contact.points.size), highest)


def steps_per_decade(fine: float, coarse: float) -> Loads:
    """Loads of a whole law: a corner of the law weighs the less, the more pixels touch.

    Args:
        fine: steps per decade of load while few pixels touch; fewer from 300 on.
        coarse: steps per decade when many touch.
    """

    def following(total: float, touching: int) -> float:
        return float(total * 10.0 ** (1.0 / max(coarse, fine * min(1.0, CORNERS / touching))))

    return following


def given(loads: Array) -> Loads:
    """These sums of pressures alone, rising."""
    return lambda total, _: float(loads[np.searchsorted(loads, total * (1.0 + 1e-9))])


def _closed(space: HalfSpace, step: Step) -> bool:
    """Whether a periodic surface is all but in full contact."""
    size = space.shape[0] * space.shape[1]
    return space.boundary == "periodic" and step.touching >= min(0.97 * size, size - 1)


def _highest_first(h: Array) -> Index:
    """Flat indices of the highest pixels, as many as have a dense influence and the next one."""
    count = min(h.size, HIGHEST + 1)
    top = np.sort(np.argpartition(h, h.size - count, axis=None)[h.size - count :])
    return np.asarray(top[np.argsort(-h.ravel()[top], kind="stable")])


def _highest(space: HalfSpace, h: Array, order: Index, count: int) -> active.Pixels:
    """The highest pixels, or all where these are too many or the boundary is periodic."""
    if space.boundary == "free" and count < min(h.size, HIGHEST):
        return active.HighPixels(space, h, order[:count])
    return active.AllPixels(space, h)


def _translate(pixels: active.Pixels, order: Index, contact: active.Touching) -> active.Touching:
    """Solution on the highest pixels, by their ranks, as one on ``pixels``."""
    if isinstance(pixels, active.HighPixels):
        return contact
    return replace(contact, points=np.asarray(order[contact.points]))


def _by_active_set(
    pixels: active.Pixels, total: float, last: active.Touching, cap: float, size: int
) -> active.Touching | None:
    """The contact at a given load, from the touching and yielding pixels of the last one."""
    held = last.points[last.points.size - last.plastic :]
    return active.active_set(pixels, None, total, last.points, 2 * dense(size), cap=cap, held=held)


def _by_gradients(
    space: HalfSpace, h: Array, total: float, p: Array | None, tolerance: float, cap: float
) -> active.Touching:
    """The same by conjugate gradients, among all pixels."""
    guess = first_guess(space, h, None, total, cap) if p is None else p
    solved = projected_cg(space, h, None, total, guess, tolerance, cap=cap)
    elastic, top = (solved.p > 0.0) & (solved.p < cap), solved.p >= cap
    unit = space.unit_answer(elastic, np.zeros_like(h))
    points = np.concatenate([np.flatnonzero(elastic), np.flatnonzero(top)])
    p, u, count = solved.p.ravel()[points], unit.ravel()[points], int(np.count_nonzero(top))
    return active.Touching(points, p, u, solved.w.ravel(), solved.d, count, solved.iterations)


def _few_step(
    space: HalfSpace, pixels: active.Pixels, solved: active.Touching, total: float,
    tolerance: float, cap: float, answer: active.ElasticAnswer,
) -> Step:  # fmt: skip
    """Record of an active-set solution, with its certificate."""
    p = np.zeros(pixels.height.size)
    p[solved.points] = solved.pressure
    gap = certify(space, pixels.height, p, solved.gap, solved.d, True, cap).gap
    if gap > tolerance:
        raise NotConverged(f"active set: certificate {gap:.2g}, wanted {tolerance:.2g}")
    stiffness = vibration = float(solved.unit.sum())
    if solved.plastic:
        vibration = answer(pixels, solved.points)
    return Step(solved.d, total, stiffness, vibration, solved.points.size, gap)


def _spread(
    pixels: active.Pixels, contact: active.Touching, h: Array, order: Index
) -> tuple[Array, Array]:
    """Pressures over E* [-] and answer to a unit approach [1/m] on the grid, shape (nx, ny)."""
    where = order[contact.points] if isinstance(pixels, active.HighPixels) else contact.points
    p, unit = np.zeros(h.size), np.zeros(h.size)
    p[where], unit[where] = contact.pressure, contact.unit
    return p.reshape(h.shape), unit.reshape(h.shape)


def _many_steps(
    space: HalfSpace, h: Array, highest: float, following: Loads, tolerance: float,
    last: Step, reached: tuple[Array, Array], cap: float, limit: int, end: float,
) -> list[Step]:  # fmt: skip
    """Continue at given loads with conjugate gradients."""
    found: list[Step] = []
    p, unit = reached
    whole = unit
    while last.total < end and last.touching <= limit and not _closed(space, last):
        total = min(following(last.total, last.touching), highest)
        guess = np.maximum(p + (total - last.total) / last.stiffness * unit, 0.0)
        solved = projected_cg(space, h, None, total, guess, tolerance, cap=cap)
        p = solved.p
        touching, elastic = p > 0.0, (p > 0.0) & (p < cap)
        if space.boundary == "periodic" and elastic.all():  # the separation cannot fall further
            break
        unit = space.unit_answer(elastic, unit)
        whole = unit if cap == np.inf else space.unit_answer(touching, whole)
        count, k = int(np.count_nonzero(touching)), float(unit.sum())
        last = Step(solved.d, total, k, float(whole.sum()), count, solved.gap)
        found.append(last)
    return found
