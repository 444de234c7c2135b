"""Contact of a rigid plane with a rough elastic half-space at one separation or load.

Separations are those of the plane from the surface's undeformed mean plane. With a free boundary
they contain the sinking of the whole half-space; only ``law.contact_law`` corrects for it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from brake_fenicsx.errors import NotConverged, SceneError, SurfaceError
from brake_fenicsx.micro.active import AllPixels, HighPixels, Touching, active_set
from brake_fenicsx.micro.halfspace import Array, HalfSpace, half_space
from brake_fenicsx.micro.qp import State, certify, projected_cg

DENSE = 500  # touching pixels up to which dense factors serve; at 128^2 FFTs then cost the same
FEW = 1000  # candidates up to which their dense influence is faster than FFT products


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
        rms_slope: of the undeformed surface; beyond 1 small strains no longer hold [-].
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
    rms_slope: float


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
        name, state.iterations, time.perf_counter() - began, rms_slope(h, pixel),
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
    few = np.count_nonzero(guess) <= DENSE
    if solver == "active-set" or (solver == "auto" and few):
        state = _by_active_set(
            space, h, d, total, guess, None if solver == "active-set" else 2 * DENSE
        )
        if state is not None and state.gap <= tolerance:
            return state, "active-set"
        if solver == "active-set":
            raise NotConverged("active set: the pivoting does not settle; use solver = 'pcg'")
    return projected_cg(space, h, d, total, guess, tolerance, max_iterations), "pcg"


def rms_slope(h: Array, pixel: Array) -> float:
    """Root-mean-square slope of the surface, from differences of neighbouring pixels [-]."""
    squares = [float(np.mean((np.diff(h, axis=a) / pixel[a]) ** 2)) for a in (0, 1)]
    return float(np.sqrt(sum(squares)))


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


def _by_active_set(
    space: HalfSpace, h: Array, d: float | None, total: float | None, guess: Array,
    most: int | None,
) -> State | None:  # fmt: skip
    """Active set on the whole grid, or on the pixels above the plane where they are few."""
    flat = h.ravel()
    high = np.flatnonzero(flat > d) if d is not None and space.boundary == "free" else None
    if high is None or high.size > FEW:
        found = active_set(AllPixels(space, h), d, total, np.flatnonzero(guess.ravel() > 0.0), most)
        return None if found is None else _on_grid(space, h, found, total is not None)
    pixels = HighPixels(space, h, high)
    start = np.flatnonzero(guess.ravel()[high] > 0.0)
    found = active_set(pixels, d, total, start if start.size else np.array([0]), most)
    if found is None:
        return None
    p = np.zeros(h.size)
    p[high[found.points]] = found.pressure
    w = space.apply(p.reshape(h.shape)) - h + found.d
    return _certified(space, h, p.reshape(h.shape), w, found, total is not None)


def _on_grid(space: HalfSpace, h: Array, found: Touching, load_control: bool) -> State:
    """Solution on all pixels as a certified state."""
    p = np.zeros(h.size)
    p[found.points] = found.pressure
    return _certified(space, h, p.reshape(h.shape), found.gap.reshape(h.shape), found, load_control)


def _certified(
    space: HalfSpace, h: Array, p: Array, w: Array, found: Touching, load_control: bool
) -> State:
    """State with the certificate of pressures and gaps."""
    c = certify(space, h, p, w, found.d, load_control)
    return State(p, w, found.d, c.gap, c.penetration, c.complementarity, found.iterations)


def _first_guess(space: HalfSpace, h: Array, d: float | None, total: float | None) -> Array:
    """Pressures to start from when nothing is known: the overlap of the bearing area."""
    if d is None:
        assert total is not None
        count = int(np.clip(total / space.shape[0] / space.shape[1] * 20 * h.size, 1, h.size))
        d = float(np.partition(h.ravel(), h.size - count)[h.size - count])
        least = 1e-3 * (float(h.max()) - d) or 1.0
        return np.where(h >= d, h - d + least, 0.0)
    overlap = np.maximum(h - d, 0.0)
    if np.count_nonzero(overlap) <= 4:
        return overlap / space.diagonal
    return np.where(overlap > 0.0, np.maximum(space.precondition(overlap), 0.0), 0.0)


def _closed(space: HalfSpace, h: Array, total: float) -> State | None:
    """Full contact of a periodic surface, if the load suffices: closed form."""
    p = space.full_contact(h) + total / h.size
    if p.min() < 0.0:
        return None
    return State(p, np.zeros_like(h), 0.0, 0.0, 0.0, 0.0, 0)
