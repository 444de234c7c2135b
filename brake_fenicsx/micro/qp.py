"""The quadratic program of contact, min 1/2 p'Hp - p'u with p >= 0, and its certificate.

u = h - d is the overlap of the surface with the plane, w = Hp - u the gap. At the solution
p >= 0, w >= 0 and p'w = 0. Two solvers:

- ``active_set``: block pivoting on the set of touching pixels with dense Cholesky factors; exact,
  right for a few hundred touching pixels.
- ``projected_cg``: preconditioned conjugate gradients projected on p >= 0, products by FFT; right
  for the rest.

Both keep either the separation d or the sum of the pressures. Pressures are p / E*.

References: I. A. Polonsky, L. M. Keer, Wear 231 (1999) 206, doi:10.1016/S0043-1648(99)00113-1;
A. Bemporad, M. Paggi, Int. J. Solids Struct. 69-70 (2015) 421, doi:10.1016/j.ijsolstr.2015.06.005;
J. J. Judice, F. M. Pires, Comput. Oper. Res. 21 (1994) 587, doi:10.1016/0305-0548(94)90106-6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.micro.halfspace import Array, HalfSpace, Index, Mask


@dataclass(frozen=True, slots=True)
class State:
    """A solution of the program.

    Attributes:
        p: pressure over E* [-], shape (nx, ny).
        w: gap [m], shape (nx, ny).
        d: separation of the plane from the surface's undeformed mean plane [m].
        gap: duality gap over the work of the pressures [-].
        penetration: largest overlap left [m].
        complementarity: p'w over the work [-].
        iterations: sets tried or conjugate directions.
        unit: answer of the touching pixels to a unit approach, -dp/dd [1/m], or None.
    """

    p: Array
    w: Array
    d: float
    gap: float
    penetration: float
    complementarity: float
    iterations: int
    unit: Array | None = None


@dataclass(frozen=True, slots=True)
class Certificate:
    """Duality gap and its parts, all over the work p'Hp except the penetration [m]."""

    gap: float
    penetration: float
    complementarity: float


def certify(
    space: HalfSpace, h: Array, p: Array, w: Array, d: float, load_control: bool
) -> Certificate:
    """Bound on the distance from the optimum, whatever the solver.

    At a given load the Frank-Wolfe gap g'p - F min g bounds the energy above its minimum. With
    v the largest penetration it is p'w + v F. At a given separation the set of pressures is not
    bounded; a feasible point of the dual program does the same. Free boundary: q = p + v r, where
    r is a uniform pressure whose displacement is 1 or more everywhere, gives
    p'w + v F + v^2 sum(r) / 2. Periodic: q = (1 - t) p + t p_full with the full-contact pressure
    and t = v / (v + d) gives the value computed below.
    """
    work = float(np.vdot(p, w + h - d))
    v = max(0.0, -float(w.min()))
    slack = float(np.vdot(p, w))
    total = float(p.sum())
    if load_control or v == 0.0:
        gap = slack + v * total
    elif space.boundary == "free":
        gap = slack + v * total + 0.5 * v**2 * space.uniform_stiffness
    else:
        gap = slack + _periodic_excess(space, h, p, w, d, v)
    if work <= 0.0:
        return Certificate(0.0 if total == 0.0 and v == 0.0 else np.inf, v, 0.0)
    return Certificate(abs(gap) / work, v, abs(slack) / work)


def _periodic_excess(space: HalfSpace, h: Array, p: Array, w: Array, d: float, v: float) -> float:
    """(q'Hq - p'Hp) / 2 for the feasible dual point q = (1 - t) p + t p_full [m]."""
    if d <= 0.0:
        return float("inf")
    t = v / (v + d)
    full = space.full_contact(h)
    php, phf, fhf = (float(np.vdot(a, b)) for a, b in ((p, w + h - d), (p, h), (full, h)))
    return 0.5 * ((1.0 - t) ** 2 * php + 2.0 * t * (1.0 - t) * phf + t**2 * fhf - php)


def active_set(
    space: HalfSpace,
    h: Array,
    d: float | None,
    total: float | None,
    start: Index,
    candidates: Index | None = None,
    max_iterations: int = 60,
) -> State | None:
    """Solve by pivoting whole blocks of pixels in and out of contact.

    Args:
        space: the half-space.
        h: heights [m], shape (nx, ny).
        d: separation [m], or None for a given load.
        total: sum of the pressures over E* [-], or None for a given separation.
        start: flat indices of the pixels to start from, at least one.
        candidates: flat indices of all pixels that can touch, if they are few: then no FFT runs.
        max_iterations: sets tried at most.

    Returns:
        The solution, exact to round-off, or None if the pivoting cycles.
    """
    height = h.ravel()
    touching = np.zeros(h.size, dtype=bool)
    touching[start] = True
    fewest, patience = h.size + 1, 3
    for iteration in range(1, max_iterations + 1):
        points = np.flatnonzero(touching)
        if points.size == 0:
            return None
        x = _dense_solve(space, points, height)
        if x is None:
            return None
        at = float(x[:, 0].sum() - total) / float(x[:, 1].sum()) if d is None else d
        pressure = x[:, 0] - at * x[:, 1]
        gap = _gap(space, h, points, pressure, at, candidates)
        scale = 1e-13 * max(float(np.abs(height[points] - at).max()), 1e-300)
        leaving = points[pressure < 0.0]
        entering = np.flatnonzero((gap < -scale) & ~touching)
        wrong = leaving.size + entering.size
        if wrong == 0:
            return _dense_state(space, h, points, pressure, gap, at, x[:, 1], iteration, d is None)
        if wrong < fewest:
            fewest, patience = wrong, 3
        elif patience > 0:
            patience -= 1
        else:  # single exchange: slow but cannot cycle
            last = max(leaving.max(initial=-1), entering.max(initial=-1))
            leaving, entering = leaving[leaving == last], entering[entering == last]
        touching[leaving] = False
        touching[entering] = True
    return None


def _dense_solve(space: HalfSpace, points: Index, height: Array) -> Array | None:
    """Pressures that displace the points by their heights, and by one; shape (n, 2)."""
    rhs = np.stack([height[points], np.ones(points.size)], axis=1)
    try:
        factor = cho_factor(space.block(points, points), overwrite_a=True, check_finite=False)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(cho_solve(factor, rhs, overwrite_b=True, check_finite=False))


def _gap(
    space: HalfSpace, h: Array, points: Index, pressure: Array, d: float, candidates: Index | None
) -> Array:
    """Gap [m] of all pixels, flat; infinite where a pixel is no candidate."""
    if candidates is None:
        p = np.zeros(h.size)
        p[points] = pressure
        return np.asarray((space.apply(p.reshape(h.shape)) - h).ravel() + d)
    gap = np.full(h.size, np.inf)
    gap[candidates] = space.block(candidates, points) @ pressure - h.ravel()[candidates] + d
    return gap


def _dense_state(
    space: HalfSpace, h: Array, points: Index, pressure: Array, gap: Array, d: float,
    unit: Array, iterations: int, load_control: bool,
) -> State:  # fmt: skip
    """Put the solution on the grid and certify it on the pixels looked at."""
    p, answer = np.zeros(h.size), np.zeros(h.size)
    p[points] = pressure
    answer[points] = unit
    p, answer, w = (a.reshape(h.shape) for a in (p, answer, gap))
    finite = np.where(np.isfinite(w), w, 0.0)
    c = certify(space, h, p, finite, d, load_control)
    return State(p, w, d, c.gap, c.penetration, c.complementarity, iterations, answer)


def projected_cg(
    space: HalfSpace,
    h: Array,
    d: float | None,
    total: float | None,
    p: Array,
    tolerance: float,
    max_iterations: int = 2000,
) -> State:
    """Solve by projected preconditioned conjugate gradients.

    Args:
        space: the half-space.
        h: heights [m], shape (nx, ny).
        d: separation [m], or None for a given load.
        total: sum of the pressures over E* [-], or None for a given separation.
        p: pressures to start from [-], shape (nx, ny), not negative.
        tolerance: duality gap over the work at which to stop [-].
        max_iterations: directions at most.

    Raises:
        NotConverged: the certificate stays above the tolerance.
    """
    load_control = d is None
    p = _scaled(np.maximum(p, 0.0), total)
    g = space.apply(p) - h  # gap without d
    t, before, old, fresh = np.zeros_like(h), np.zeros_like(h), 0.0, True
    certificate = Certificate(np.inf, np.inf, np.inf)
    for iteration in range(max_iterations + 1):
        touching = p > 0.0
        if load_control:
            d = -float(g[touching].mean())
        assert d is not None
        w = g + d
        entering = ~touching & (w < 0.0)
        certificate = certify(space, h, p, w, d, load_control)
        if certificate.gap <= tolerance or (not touching.any() and not entering.any()):
            c = certificate
            return State(p, w, d, c.gap, c.penetration, c.complementarity, iteration)
        if entering.any():
            touching |= entering
            fresh = True
        r = np.where(touching, w, 0.0)
        z = np.where(touching, space.precondition(r), 0.0)
        if load_control:
            z = _without_load(space, z, touching)
        new = float(np.vdot(z, r))
        t = z if fresh else z + max(0.0, (new - float(np.vdot(z, before))) / old) * t
        before, old = r, new
        moved = space.apply(t)
        curvature = float(np.vdot(t, moved))
        if not curvature > 0.0:
            t, fresh = r, True
            moved = space.apply(t)
            curvature = float(np.vdot(t, moved))
        step = float(np.vdot(r, t)) / curvature
        p = p - step * t
        fresh = bool((p < 0.0).any())
        if fresh:
            p = _scaled(np.maximum(p, 0.0), total)
            g = space.apply(p) - h
        else:
            g = g - step * moved
    raise NotConverged(
        f"contact on {h.shape[0]} x {h.shape[1]} pixels: certificate {certificate.gap:.2g} after "
        f"{max_iterations} iterations, wanted {tolerance:.2g}; loosen 'tolerance'"
    )


def _scaled(p: Array, total: float | None) -> Array:
    """Pressures with the given sum, if one is given."""
    if total is None:
        return p
    found = float(p.sum())
    return p * (total / found) if found > 0.0 else np.full_like(p, total / p.size)


def _without_load(space: HalfSpace, z: Array, touching: Mask) -> Array:
    """Take from z what changes the sum, along the preconditioner's answer to a unit gap."""
    unit = np.where(touching, space.precondition(touching.astype(float)), 0.0)
    return np.asarray(z - float(z.sum()) / float(unit.sum()) * unit)


def unit_answer(space: HalfSpace, touching: Mask, x: Array, tolerance: float = 1e-2) -> Array:
    """Pressures -dp/dd [1/m] on fixed touching pixels that displace them by one.

    Their sum has the square of the error of x, so ``tolerance`` 1e-2 gives it to about 1e-4.

    Args:
        space: the half-space.
        touching: touching pixels, shape (nx, ny).
        x: guess [1/m], shape (nx, ny).
        tolerance: energy norm of the error over that of x, as the preconditioner measures it [-].
    """
    x = np.where(touching, x, 0.0)
    r = np.where(touching, 1.0 - space.apply(x), 0.0)
    t, old = np.zeros_like(x), 1.0
    for _ in range(200):
        z = np.where(touching, space.precondition(r), 0.0)
        new = float(np.vdot(z, r))
        if new <= tolerance**2 * float(x.sum()):
            return x
        t = z + new / old * t
        moved = np.where(touching, space.apply(t), 0.0)
        step = new / float(np.vdot(t, moved))
        x, r, old = x + step * t, r - step * moved, new
    raise NotConverged("stiffness of the touching pixels: 200 iterations were not enough")
