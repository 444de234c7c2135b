"""Contact of a rigid plane with a rough elastic half-space at one separation or load, and a sweep.

Separations are those of the plane from the surface's undeformed mean plane. With a free boundary
they contain the sinking of the whole half-space; only ``law.contact_law`` corrects for it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from brake_fenicsx.errors import NotConverged, SceneError, SurfaceError
from brake_fenicsx.micro.halfspace import Array, HalfSpace, Index, half_space
from brake_fenicsx.micro.qp import State, active_set, projected_cg, unit_answer

DENSE = 400  # touching pixels up to which dense factors are faster than FFTs (bench_micro.py)
FEW = 700  # candidates up to which their dense influence is faster than one FFT product


@dataclass(frozen=True, slots=True)
class ContactSolution:
    """Pressures under a rigid plane, with the proof of how good they are.

    Attributes:
        pressure: contact pressure [Pa], shape (nx, ny).
        gap: distance of the deformed surface from the plane [m], shape (nx, ny).
        separation: plane over the undeformed mean plane of the surface [m].
        load: resultant [N].
        mean_pressure: load over the area of the patch [Pa].
        area_fraction: share of the pixels that touch [-].
        residual: duality gap over the work of the pressures [-].
        penetration: largest overlap left [m].
        complementarity: pressure times gap over the work [-].
        solver: ``"active-set"``, ``"pcg"`` or ``"none"`` where nothing touches.
        iterations: of the solver.
        seconds: wall-clock time [s].
    """

    pressure: Array
    gap: Array
    separation: float
    load: float
    mean_pressure: float
    area_fraction: float
    residual: float
    penetration: float
    complementarity: float
    solver: str
    iterations: int
    seconds: float


def solve_contact(
    heights: Array,
    size: Array | tuple[float, float],
    E_star: float,
    separation: float | None = None,
    load: float | None = None,
    boundary: str = "free",
    tol: float = 1e-8,
    solver: str = "auto",
    start: Array | None = None,
    max_iterations: int = 2000,
) -> ContactSolution:
    """Press a rigid plane on a rough elastic half-space.

    Args:
        heights: heights [m], shape (nx, ny); their mean plane is the origin of separations.
        size: lengths of the patch [m], shape (2,).
        E_star: composite modulus E / (1 - nu^2) [Pa].
        separation: plane over the mean plane [m]; give this or ``load``.
        load: resultant [N].
        boundary: ``"free"`` or ``"periodic"``.
        tol: duality gap over the work of the pressures at which to stop [-].
        solver: ``"auto"``, ``"active-set"`` or ``"pcg"``.
        start: pressure to start from [Pa], shape (nx, ny).
        max_iterations: of the conjugate gradients.

    Raises:
        SceneError: an argument without meaning.
        SurfaceError: missing or infinite heights.
        NotConverged: the certificate stays above ``tol``.
    """
    began = time.perf_counter()
    h, lengths = _checked(heights, size, E_star, tol, solver)
    if (separation is None) == (load is None):
        raise SceneError("solve_contact: give either 'separation' or 'load'")
    if load is not None and not (np.isfinite(load) and load >= 0.0):
        raise SceneError(f"load = {load} N; a contact only pushes, give zero or more")
    if separation is not None and not np.isfinite(separation):
        raise SceneError(f"separation = {separation} m; give a finite number")
    if boundary == "periodic" and separation is not None and separation <= 0.0:
        raise SceneError(
            f"separation = {separation} m: a periodic surface is flat at 0 and the pressure is "
            "not defined; give 'load'"
        )
    pixel = lengths / np.array(h.shape)
    space = half_space(h.shape, (float(pixel[0]), float(pixel[1])), boundary)
    area = float(np.prod(pixel))
    total = None if load is None else load / (E_star * area)
    guess = None if start is None else np.where(np.isfinite(start), start, 0.0) / E_star
    state, name = solve(space, h, separation, total, guess, tol, solver, max_iterations)
    found = float(state.p.sum())
    return ContactSolution(
        state.p * E_star, state.w, state.d, found * E_star * area, found * E_star / h.size,
        float(np.mean(state.p > 0.0)), state.gap, state.penetration, state.complementarity,
        name, state.iterations, time.perf_counter() - began,
    )  # fmt: skip


def solve(
    space: HalfSpace,
    h: Array,
    d: float | None,
    total: float | None,
    guess: Array | None,
    tolerance: float,
    solver: str = "auto",
    max_iterations: int = 2000,
) -> tuple[State, str]:
    """Choose a solver by the number of touching pixels and run it.

    Args:
        space: the half-space.
        h: heights over their mean [m], shape (nx, ny).
        d: separation [m] or None.
        total: sum of the pressures over E* [-] or None.
        guess: pressures over E* to start from [-], or None.
        tolerance: of the certificate [-].
        solver: ``"auto"``, ``"active-set"`` or ``"pcg"``.
        max_iterations: of the conjugate gradients.

    Returns:
        The solution and the name of the solver.
    """
    highest = float(h.max())
    if total == 0.0 or (d is not None and d >= highest):
        at = highest if d is None else d
        return State(np.zeros_like(h), at - h, at, 0.0, 0.0, 0.0, 0), "none"
    if total is not None and space.boundary == "periodic":
        closed = _closed(space, h, total)
        if closed is not None:
            return closed, "none"
    if guess is None or not (guess > 0.0).any():
        guess = _first_guess(space, h, d, total)
    if solver != "pcg":
        begin = np.flatnonzero(guess.ravel() > 0.0)
        if solver == "active-set" or begin.size <= DENSE:
            state = active_set(space, h, d, total, begin, _candidates(space, h, d))
            if state is not None and state.gap <= tolerance:
                return state, "active-set"
            if solver == "active-set":
                raise NotConverged("active set: the pivoting cycles; use solver = 'pcg'")
    return projected_cg(space, h, d, total, guess, tolerance, max_iterations), "pcg"


def _checked(
    heights: Array, size: Array | tuple[float, float], E_star: float, tol: float, solver: str
) -> tuple[Array, Array]:
    """Heights over their mean and the patch lengths, or a named error."""
    h, lengths = np.asarray(heights, dtype=float), np.array(size, dtype=float)
    if h.ndim != 2:
        raise SurfaceError(f"heights of shape {h.shape}; a patch has two dimensions")
    if not np.isfinite(h).all():
        raise SurfaceError(
            f"heights: {np.count_nonzero(~np.isfinite(h))} points are missing; fill them first"
        )
    if lengths.shape != (2,) or not (np.isfinite(lengths).all() and lengths.min() > 0.0):
        raise SceneError(f"size = {size} m; give two positive lengths")
    if not (np.isfinite(E_star) and E_star > 0.0):
        raise SceneError(f"E_star = {E_star} Pa; a modulus is positive")
    if not tol > 0.0:
        raise SceneError(f"tol = {tol}; give a positive number")
    if solver not in ("auto", "active-set", "pcg"):
        raise SceneError(f"solver = {solver!r}; choose 'auto', 'active-set' or 'pcg'")
    return h - h.mean(), lengths


def _candidates(space: HalfSpace, h: Array, d: float | None) -> Index | None:
    """Pixels that can touch at separation d, if they are few.

    All pressures push down a free half-space everywhere, so what lies below the plane before any
    pressure never touches. That is not so under a periodic boundary.
    """
    if d is None or space.boundary != "free":
        return None
    found = np.flatnonzero(h.ravel() > d)
    return found if found.size <= FEW else None


def _first_guess(space: HalfSpace, h: Array, d: float | None, total: float | None) -> Array:
    """Pressures to start from when nothing is known: the overlap of the bearing area."""
    if d is None:
        assert total is not None
        count = int(np.clip(total / space.shape[0] / space.shape[1] * 20 * h.size, 1, h.size))
        d = float(np.partition(h.ravel(), h.size - count)[h.size - count])
        return np.where(h >= d, h - d + 1e-3 * max(float(h.max()) - d, 1e-300), 0.0)
    overlap = np.maximum(h - d, 0.0)
    if np.count_nonzero(overlap) <= 4:
        return overlap / space.diagonal
    return np.maximum(space.precondition(overlap), 0.0) * (overlap > 0.0) + 1e-300 * (overlap > 0)


def _closed(space: HalfSpace, h: Array, total: float) -> State | None:
    """Full contact of a periodic surface, if the load suffices: closed form."""
    p = space.full_contact(h) + total / h.size
    if p.min() < 0.0:
        return None
    return State(p, np.zeros_like(h), 0.0, 0.0, 0.0, 0.0, 0)


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


def sweep(
    space: HalfSpace, h: Array, lowest: float, highest: float, per_decade: tuple[int, int],
    tolerance: float,
) -> list[Step]:  # fmt: skip
    """Press a surface from one touching pixel to a high load.

    Args:
        space: the half-space.
        h: heights over their mean [m], shape (nx, ny).
        lowest: first sum of pressures over E* [-].
        highest: sum to reach or pass [-].
        per_decade: steps per decade of load while few pixels touch and afterwards. Few touching
            pixels make a law of straight pieces with corners, and cost next to nothing.
        tolerance: of the certificate of each step [-].

    Returns:
        Steps of rising load.
    """
    steps: list[Step] = []
    touching = np.array([int(h.argmax())])
    fine, coarse = per_decade
    k, state = 0, None
    while True:
        target = lowest * 10.0 ** (k / fine)
        state = _dense_step(space, h, min(target, highest), touching)
        if state is None:
            break
        touching = np.flatnonzero(state.p)
        assert state.unit is not None
        steps.append(_step(state, state.unit))
        if target >= highest:
            return steps
        if touching.size > DENSE:
            break
        k += 1 if touching.size < 100 else max(1, fine // coarse)
    return steps + _pcg_steps(space, h, highest, coarse, tolerance, steps, state)


def _step(state: State, unit: Array) -> Step:
    """Record of a solution."""
    count = int(np.count_nonzero(state.p > 0.0))
    return Step(state.d, float(state.p.sum()), float(unit.sum()), count, state.gap)


def _dense_step(space: HalfSpace, h: Array, total: float, touching: Index) -> State | None:
    """One load with dense factors, the highest pixels as candidates while they suffice."""
    if space.boundary == "free":
        count = 4 * touching.size + 64
        if count <= FEW and count < h.size:
            flat = h.ravel()
            high = np.argpartition(flat, h.size - count)[h.size - count :]
            high = np.union1d(high, touching)
            state = active_set(space, h, None, total, touching, high)
            if state is not None and np.count_nonzero(flat > state.d) <= count:
                return state
    return active_set(space, h, None, total, touching)


def _pcg_steps(
    space: HalfSpace, h: Array, highest: float, per_decade: int, tolerance: float,
    steps: list[Step], state: State | None,
) -> list[Step]:  # fmt: skip
    """Continue a sweep with conjugate gradients, the separation chosen for even steps in load."""
    found: list[Step] = []
    p = np.zeros_like(h) if state is None else state.p
    unit = np.zeros_like(h) if state is None or state.unit is None else state.unit
    total = steps[-1].total if steps else 0.0
    while total < highest:
        target = total * 10.0 ** (1.0 / per_decade)
        s = (steps + found)[-1]
        # Load over approach curves upward: at constant d(log p)/dd the step would be this long.
        d = s.d - s.total / s.stiffness * np.log(target / total)
        guess = np.maximum(p + (s.d - d) * unit, 0.0)
        solved = projected_cg(space, h, float(d), None, guess, tolerance)
        unit = unit_answer(space, solved.p > 0.0, unit)
        found.append(_step(solved, unit))
        p, total = solved.p, found[-1].total
    return found
