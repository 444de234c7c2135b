"""The quadratic program of contact, min 1/2 p'Hp - p'u with p >= 0, and its certificate.

u = h - d is the overlap of the surface with the plane, w = Hp - u the gap. At the solution
p >= 0, w >= 0 and p'w = 0. Here stands the solver for many touching pixels: preconditioned
conjugate gradients projected on p >= 0, products by FFT. It keeps either the separation d or the
sum of the pressures. Pressures are p / E*. ``active.py`` holds the solver for few.

Reference: I. A. Polonsky, L. M. Keer, Wear 231 (1999) 206, doi:10.1016/S0043-1648(99)00113-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.micro.halfspace import Array, HalfSpace, Mask


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
    """

    p: Array
    w: Array
    d: float
    gap: float
    penetration: float
    complementarity: float
    iterations: int


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
    t, before, old = np.zeros_like(h), np.zeros_like(h), 0.0
    certificate, watch = Certificate(np.inf, np.inf, np.inf), _Watch()
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
        if watch.stalls(certificate.gap):
            p = _scaled(np.maximum(p - w / space.largest, 0.0), total)
            g, old = space.apply(p) - h, 0.0
            continue
        touching |= entering
        r = np.where(touching, w, 0.0)
        z = np.where(touching, space.precondition(r), 0.0)
        if load_control:
            z = _without_load(space, z, touching)
        new = float(np.vdot(z, r))
        # Polak-Ribiere: forgets the last direction by itself where the touching set changes.
        keep = max(0.0, (new - float(np.vdot(z, before))) / old) if old > 0.0 else 0.0
        t = z + keep * np.where(touching, t, 0.0)
        if load_control:
            t = _without_load(space, t, touching)
        before, old = r, new
        moved = space.apply(t)
        curvature = float(np.vdot(t, moved))
        slope = float(np.vdot(r, t))
        if not (curvature > 0.0 and slope > 0.0):
            watch.force()
            continue
        step = slope / curvature
        p = p - step * t
        if p.min() < 0.0:
            p = _scaled(np.maximum(p, 0.0), total)
            g = space.apply(p) - h
        else:
            g = g - step * moved
    raise NotConverged(
        f"contact on {h.shape[0]} x {h.shape[1]} pixels: certificate {certificate.gap:.2g} after "
        f"{max_iterations} iterations, wanted {tolerance:.2g}; loosen 'tolerance'"
    )


class _Watch:
    """Sees when the certificate no longer falls; then safe steps are taken.

    A step along the gap no longer than the inverse of the largest eigenvalue of H, projected,
    always lowers the energy: the method cannot cycle.
    """

    def __init__(self, patience: int = 40, safe: int = 10):
        self.best, self.since, self.left = np.inf, 0, 0
        self.patience, self.safe = patience, safe

    def force(self) -> None:
        """Ask for safe steps now."""
        self.left = self.safe

    def stalls(self, gap: float) -> bool:
        """Whether the next step must be a safe one."""
        self.since += 1
        if gap < 0.9 * self.best:
            self.best, self.since = gap, 0
        if self.since >= self.patience:
            self.since, self.left = 0, self.safe
        self.left -= 1
        return self.left >= 0


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
