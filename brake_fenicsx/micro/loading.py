"""Contact of a rigid plane with a rough elastic half-space at one separation or load.

Separations are those of the plane from the surface's undeformed mean plane. With a free boundary
they contain the sinking of the whole half-space; only ``law.contact_law`` corrects for it.

With a hardness the pressure of a pixel goes no further: it yields, and what the plane then overlaps
of it is plastic penetration (perfect plasticity of each pixel; the loading only rises).
"""

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from brake_fenicsx.arguments import Array, number, one_of, positive, real
from brake_fenicsx.errors import NotConverged, SceneError, SurfaceError
from brake_fenicsx.micro import active, halfspace
from brake_fenicsx.micro.qp import ContactState, certify, projected_cg
from brake_fenicsx.surface.hdf import gradients

Solver = Literal["auto", "active-set", "pcg"]

FEW = 1000  # candidates up to which their dense influence is faster than FFT products


@dataclass(frozen=True, slots=True)
class ContactSolution:
    """Pressures under a rigid plane, with the proof of how good they are.

    Attributes:
        pressure: contact pressure [Pa], shape (nx, ny).
        gap: distance of the deformed surface from the plane [m], shape (nx, ny); negative where
            the surface yields: the plastic penetration.
        separation: plane over the undeformed mean plane of the surface [m].
        load: resultant [N].
        mean_pressure: load over the area of the patch [Pa].
        area_fraction: share of the pixels that touch [-].
        residual: duality gap over the work of the pressures [-]; ``tol`` is its limit.
        gap_residual: the same duality gap over the load times S_q [-]: the mean gap that may be
            left under the pressures, in the measure of other programs. Pressed on a free
            half-space a few times the residual.
        penetration: largest overlap left where the surface does not yield [m].
        complementarity: pressure, or what lacks to the hardness, times gap, over the work [-].
        solver: ``"active-set"``, ``"pcg"`` or ``"none"`` where nothing touches.
        iterations: of the solver.
        seconds: wall-clock time [s].
        rms_slope: of the undeformed surface; beyond 1 small strains no longer hold [-].
        plastic_fraction: share of the pixels at the hardness [-].
        plastic_depth: largest plastic penetration [m].
    """

    pressure: Array
    gap: Array
    separation: float
    load: float
    mean_pressure: float
    area_fraction: float
    residual: float
    gap_residual: float
    penetration: float
    complementarity: float
    solver: str
    iterations: int
    seconds: float
    rms_slope: float
    plastic_fraction: float
    plastic_depth: float


def solve_contact(
    heights: Array,
    size: Array | tuple[float, float],
    E_star: float,
    separation: float | None = None,
    load: float | None = None,
    boundary: halfspace.Boundary = "free",
    tol: float = 1e-8,
    solver: Solver = "auto",
    start: Array | None = None,
    max_iterations: int = 2000,
    hardness: float | None = None,
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
        hardness: pressure at which a pixel yields [Pa]; None for an elastic surface.

    Raises:
        SceneError: an argument without meaning, or a load that the hardness cannot carry.
        SurfaceError: missing or infinite heights.
        NotConverged: the certificate stays above ``tol``.

    Example:
        >>> x = np.arange(64) / 64
        >>> wave = 1e-6 * np.cos(2 * np.pi * x)[:, None] + 0 * x
        >>> full = np.pi * 2.4e9 * 1e-6 / 1e-3  # pi E* amplitude / length closes it [Pa]
        >>> half = solve_contact(wave, (1e-3, 1e-3), 2.4e9, load=full / 2e6, boundary="periodic")
        >>> round(half.area_fraction, 1)  # Westergaard: 2 / pi asin(sqrt(p / full))
        0.5
    """
    began = time.perf_counter()
    h, lengths = _checked(heights, size)
    one_of("solver", solver, Solver)
    one_of("boundary", boundary, halfspace.Boundary)
    positive(E_star=E_star, tol=tol, max_iterations=max_iterations)
    if (separation is None) == (load is None):
        raise SceneError("solve_contact: give either 'separation' or 'load'")
    if load is not None and number("load", load, "N") < 0.0:
        raise SceneError(f"load = {load} N; a contact only pushes, give zero or more")
    if separation is not None:
        number("separation", separation, "m")
    if boundary == "periodic" and separation is not None and separation <= 0.0:
        raise SceneError(f"""separation = {separation} m: a periodic surface is flat at 0 and the
            pressure is not defined; give 'load'""")
    pixel = lengths / np.array(h.shape)
    space = halfspace.half_space_of(h, lengths, boundary)
    area = float(np.prod(pixel))
    total = None if load is None else load / (E_star * area)
    cap = _cap(hardness, E_star, load, area * h.size)
    guess = None if start is None else np.asarray(_guess(start, h.shape) / E_star, float)
    most = int(max_iterations)
    state, name = solve(space, h, separation, total, guess, tol, solver, most, cap)
    found = float(state.p.sum())
    plastic = state.p >= cap
    return ContactSolution(
        state.p * E_star, state.w, state.d, found * E_star * area, found * E_star / h.size,
        float(np.mean(state.p > 0.0)), state.gap, _gap_residual(h, state), state.penetration,
        state.complementarity,
        name, state.iterations, time.perf_counter() - began, gradients(h, pixel)[0],
        float(np.mean(plastic)), max(0.0, -float(state.w.min(initial=0.0, where=plastic))),
    )  # fmt: skip


def solve(
    space: halfspace.HalfSpace, h: Array, d: float | None, total: float | None, guess: Array | None,
    tolerance: float, solver: Solver = "auto", max_iterations: int = 2000, cap: float = np.inf,
) -> tuple[ContactState, str]:  # fmt: skip
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
        cap: hardness over E* [-]; infinite for an elastic surface.

    Returns:
        The solution and the name of the solver.
    """
    highest = float(h.max())
    if total == 0.0 or (d is not None and d >= highest):
        at = highest if d is None else d
        return ContactState(np.zeros_like(h), at - h, at, 0.0, 0.0, 0.0, 0), "none"
    if total is not None and space.boundary == "periodic":
        closed = _closed(space, h, total)
        if closed is not None and closed.p.max() <= cap:
            return closed, "none"
    if guess is None or not (guess > 0.0).any():
        guess = first_guess(space, h, d, total, cap)
    most = dense(h.size)
    few = np.count_nonzero(guess) <= most
    if solver == "active-set" or (solver == "auto" and few):
        state = _by_active_set(
            space, h, d, total, guess, None if solver == "active-set" else 2 * most, cap
        )
        if state is not None and state.gap <= tolerance:
            return state, "active-set"
        if solver == "active-set":
            raise NotConverged("active set: the pivoting does not settle; use solver = 'pcg'")
    return projected_cg(space, h, d, total, guess, tolerance, max_iterations, cap), "pcg"


def dense(size: int) -> int:
    """Touching pixels up to which dense factors serve; beyond, products by FFT cost less.

    A factor takes n^3 / 3 operations, a dozen conjugate directions a multiple of the pixels.
    """
    return round(10.0 * size ** (1.0 / 3.0))


def _checked(heights: Array, size: Array | tuple[float, float]) -> tuple[Array, Array]:
    """Heights over their mean and the patch lengths, or a named error."""
    h, lengths = real("heights", heights), np.array(size, dtype=object)
    if h.ndim != 2 or min(h.shape) < 2:
        raise SurfaceError(f"""heights of shape {h.shape}; a patch has two dimensions, of two pixels
            or more""")
    if not np.isfinite(h).all():
        raise SurfaceError(f"""heights: {np.count_nonzero(~np.isfinite(h))} points are missing; fill
            them first""")
    if lengths.shape != (2,):
        raise SceneError(f"size = {size} m; give two positive lengths")
    return h - h.mean(), np.array([number("size", length, "m", 0.0) for length in lengths])


def _by_active_set(
    space: halfspace.HalfSpace, h: Array, d: float | None, total: float | None, guess: Array,
    most: int | None, cap: float,
) -> ContactState | None:  # fmt: skip
    """Active set on the whole grid, or on the pixels above the plane where they are few."""
    flat, start = h.ravel(), guess.ravel()
    high = np.flatnonzero(flat > d) if d is not None and space.boundary == "free" else None
    pixels: active.Pixels
    if high is None or high.size > FEW:
        high, pixels = np.arange(h.size), active.AllPixels(space, h)
    else:
        pixels = active.HighPixels(space, h, high)
    held = np.flatnonzero(start[high] >= cap)
    touching = np.flatnonzero(start[high] > 0.0)
    touching = touching if touching.size else np.array([0])
    contact = active.active_set(pixels, d, total, touching, most, cap=cap, held=held)
    if contact is None:
        return None
    pressure = np.zeros(h.size)
    pressure[high[contact.points]] = contact.pressure
    p: Array = pressure.reshape(h.shape)
    every = isinstance(pixels, active.AllPixels)
    w = contact.gap.reshape(h.shape) if every else space.apply(p) - h + contact.d
    certificate = certify(space, h, p, w, contact.d, total is not None, cap)
    return ContactState(p, w, contact.d, *certificate, contact.iterations)


def _gap_residual(h: Array, state: ContactState) -> float:
    """Duality gap over load and rms height [-]; zero without load, infinite if flat."""
    gap = state.gap * float(np.vdot(state.p, state.w + h - state.d))
    span = float(state.p.sum() * h.std())
    return gap / span if span > 0.0 else 0.0 if gap <= 0.0 else float("inf")


def _guess(start: Array, shape: tuple[int, ...]) -> Array:
    """Pressures to start from [Pa]; undefined ones are none."""
    p = real("start", start)
    if p.shape != shape:
        raise SceneError(f"start of shape {p.shape}; give pressures of shape {shape}, or none")
    return np.where(np.isfinite(p), p, 0.0)


def _cap(hardness: float | None, E_star: float, load: float | None, area: float) -> float:
    """Hardness over E*, infinite if there is none."""
    if hardness is None:
        return float("inf")
    positive(hardness=hardness)
    if load is not None and load >= hardness * area:
        raise SceneError(f"""load = {load} N: the mean pressure {load / area:.4g} Pa is not below
            the hardness {hardness:.4g} Pa; give less than {hardness * area:.4g} N""")
    return hardness / E_star


def first_guess(
    space: halfspace.HalfSpace, h: Array, d: float | None, total: float | None, cap: float = np.inf
) -> Array:
    """Pressures to start from when nothing is known: the overlap of the bearing area."""
    if d is None:
        assert total is not None
        count = int(np.clip(max(20.0 * total, 1.1 * total / cap), 1, h.size))
        d = float(np.partition(h.ravel(), h.size - count)[h.size - count])
        least = 1e-3 * (float(h.max()) - d) or 1.0
        return np.where(h >= d, h - d + least, 0.0)
    overlap = np.maximum(h - d, 0.0)
    if np.count_nonzero(overlap) <= 4:
        return overlap / space.diagonal
    return np.where(overlap > 0.0, np.maximum(space.precondition(overlap), 0.0), 0.0)


def _closed(space: halfspace.HalfSpace, h: Array, total: float) -> ContactState | None:
    """Full contact of a periodic surface, if the load suffices: closed form."""
    p = space.full_contact(h) + total / h.size
    if p.min() < 0.0:
        return None
    return ContactState(p, np.zeros_like(h), 0.0, 0.0, 0.0, 0.0, 0)
