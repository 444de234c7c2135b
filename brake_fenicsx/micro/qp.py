"""The quadratic program of contact, min 1/2 p'Hp - p'u with 0 <= p <= c, and its certificate.

u = h - d is the overlap of the surface with the plane, w = Hp - u the gap. At the solution w = 0
where 0 < p < c, w >= 0 where p = 0, and w <= 0 where p = c: there the material yields under its
hardness and the overlap left is plastic penetration. An elastic surface has no bound c. Here
stands the solver for many touching pixels: preconditioned conjugate gradients projected on the
bounds, products by FFT. It keeps either the separation d or the sum of the pressures. Pressures
are p / E*. ``active.py`` holds the solver for few.

References: I. A. Polonsky, L. M. Keer, Wear 231 (1999) 206, doi:10.1016/S0043-1648(99)00113-1;
with the hardness X. Tian, B. Bhushan, J. Tribology 118 (1996) 33, doi:10.1115/1.2837089, and
A. Almqvist, F. Sahlin, R. Larsson, S. Glavatskih, Tribology International 40 (2007) 574,
doi:10.1016/j.triboint.2005.11.008.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.micro.halfspace import HalfSpace, add_to

ROUND_OFF = 1e-12  # of sums over all pixels, relative to their largest parts
RENEW = 0.1  # share of the free pixels that have changed when their answer is computed anew


@dataclass(frozen=True, slots=True)
class ContactState:
    """A solution of the program.

    Attributes:
        p: pressure over E* [-], shape (nx, ny).
        w: gap [m], shape (nx, ny).
        d: separation of the plane from the surface's undeformed mean plane [m].
        gap: duality gap over the work of the pressures [-].
        penetration: largest overlap left where no pixel yields [m].
        complementarity: pressure, or what lacks to the hardness, times gap, over the work [-].
        iterations: sets tried or conjugate directions.
    """

    p: Array
    w: Array
    d: float
    gap: float
    penetration: float
    complementarity: float
    iterations: int


class Certificate(NamedTuple):
    """Duality gap and its parts, all over the work p'Hp except the penetration [m]."""

    gap: float
    penetration: float
    complementarity: float


def certify(
    space: HalfSpace, h: Array, p: Array, w: Array, d: float, load_control: bool,
    cap: float = np.inf,
) -> Certificate:  # fmt: skip
    """Upper bound on the energy above its minimum, whatever the solver.

    v is the largest penetration, F the sum of the pressures. Each case bounds by an admissible q:

    - Given load: g'p - min g'q over all q of the same sum (the gap of Frank and Wolfe), which
      is p'w + v F for an elastic surface.
    - Given separation: the pressures have no bound, so q is a feasible point of the dual program.
      Free boundary: q = p + v r with a uniform r that displaces every pixel by one to c < 2; the
      bound is p'w + c (v F + v^2 sum(r) / 2). Periodic: q = (1 - t) p + t p_full with the pressure
      of full contact and t = v / (v + d), see ``_excess``.
    - Hardness c: as before plus c times the penetrations that q leaves, or q = p itself with the
      bound sum of p max(w, 0) + (c - p) max(-w, 0); the smallest counts.

    A bound cannot be negative but for rounding errors: one below minus the rounding errors of its
    parts is an error of the products and counts as infinite.
    """
    slack, total = float(np.vdot(p, w)), float(p.sum())
    high = float(np.vdot(p, h))
    work = slack + high - d * total
    if work < 1e-6 * abs(high):  # the plane hardly overlaps: without the rounding errors of d
        work = slack + float(np.vdot(p, h - d))
    bounded = np.isfinite(cap)
    # The overlap of yielding pixels is no error.
    below = np.where(p < cap, w, 0.0) if bounded else w
    v = max(0.0, -float(below.min()))
    if bounded:
        gap = _bounded_gap(space, h, p, w, d, load_control, cap, v)
        slack = float(np.vdot(p, np.where(p < cap, w, np.maximum(w, 0.0))))
    elif load_control or v == 0.0:
        gap = slack + v * total
    else:
        gap = slack + _excess(space, h, p, w, d, v)[0]
    if work <= 0.0:
        return Certificate(0.0 if total == 0.0 and v == 0.0 else np.inf, v, 0.0)
    wrong = gap < -ROUND_OFF * (work + abs(high) + abs(d * total))
    return Certificate(np.inf if wrong else abs(gap) / work, v, abs(slack) / work)


def _excess(
    space: HalfSpace, h: Array, p: Array, w: Array, d: float, v: float
) -> tuple[float, Array]:
    """(q'Hq - p'Hp) / 2 of a dual point q [m], bounded from above, and its gap [m]."""
    if space.boundary == "free":
        stiffness, most = space.uniform_stiffness
        return most * (v * float(p.sum()) + 0.5 * v**2 * stiffness), w + v
    if d <= 0.0:
        return float("inf"), w
    t = v / (v + d)
    full = space.full_contact(h)
    php, phf, fhf = (float(np.vdot(a, b)) for a, b in ((p, w + h - d), (p, h), (full, h)))
    excess = 0.5 * ((1.0 - t) ** 2 * php + 2.0 * t * (1.0 - t) * phf + t**2 * fhf - php)
    return excess, (1.0 - t) * w + t * d


def _bounded_gap(
    space: HalfSpace, h: Array, p: Array, w: Array, d: float, load_control: bool, cap: float,
    v: float,
) -> float:  # fmt: skip
    """Smallest of the bounds on the energy above its minimum [m] under the hardness ``cap``."""
    bounds = [float(np.vdot(p, np.maximum(w, 0.0)) + np.vdot(cap - p, np.maximum(-w, 0.0)))]
    if load_control:
        total = float(p.sum())
        full = min(int(total / cap), w.size - 1)
        lowest = np.partition(w, full, axis=None)[: full + 1]
        least = cap * float(lowest[:-1].sum()) + (total - full * cap) * float(lowest[-1])
        bounds.append(float(np.vdot(p, w)) - least)
    elif v > 0.0:
        excess, gap = _excess(space, h, p, w, d, v)
        left = cap * float(np.maximum(-gap, 0.0).sum())
        bounds.append(float(np.vdot(p, w)) + excess + left)
    return min(bounds)


def projected_cg(
    space: HalfSpace,
    h: Array,
    d: float | None,
    total: float | None,
    p: Array,
    tolerance: float,
    max_iterations: int = 2000,
    cap: float = np.inf,
) -> ContactState:
    """Solve by projected preconditioned conjugate gradients.

    Args:
        space: the half-space.
        h: heights [m], shape (nx, ny).
        d: separation [m], or None for a given load.
        total: sum of the pressures over E* [-], or None for a given separation.
        p: pressures to start from [-], shape (nx, ny), not negative.
        tolerance: duality gap over the work at which to stop [-].
        max_iterations: directions at most.
        cap: hardness over E* [-]; infinite for an elastic surface.

    Raises:
        NotConverged: the certificate stays above the tolerance.
    """
    load_control, bounded = d is None, bool(np.isfinite(cap))
    h = np.ascontiguousarray(h)
    # A new array, changed in place below.
    p = np.ascontiguousarray(_within(np.maximum(p, 0.0), total, cap))
    g, old = space.apply(p), 0.0
    g -= h  # gap without d
    # Work arrays: what is allocated anew in every iteration has to be paged in anew.
    w = np.empty_like(h)
    r, before, z, t, moved, mask, answer, unit = np.zeros((8, *h.shape))
    certificate, watch = Certificate(np.inf, np.inf, np.inf), _Watch()
    among = answered = np.zeros(h.shape, dtype=bool)  # the free pixels
    # At a given load the answer of about these pixels to a unit gap, that of the free ones alone
    # and its sum: any directions of zero sum will do, as the next one forgets the last by itself.
    push = 1.0
    for iteration in range(max_iterations + 1):
        touching = p > 0.0
        top = p >= cap if bounded else None
        elastic = touching if top is None else touching & ~top
        if load_control:
            np.copyto(moved, elastic)
            d = -_level(g, elastic, top, moved)
        assert d is not None
        np.add(g, d, out=w)
        entering = (w < 0.0) > touching
        if top is not None:
            entering |= top & (w > 0.0)
        certificate = certify(space, h, p, w, d, load_control, cap)
        if certificate.gap <= tolerance or not (elastic.any() or entering.any()):
            return ContactState(p, w, d, *certificate, iteration)
        if watch.stalls(certificate.gap):
            p = _safe_step(p, np.asarray(w / space.largest, float), total, cap)
            g, old = space.apply(p, g), 0.0
            g -= h
            continue
        free = elastic | entering
        if not np.array_equal(free, among):
            among = free
            np.copyto(mask, free)
            t *= mask
            if load_control:
                if np.count_nonzero(free ^ answered) > RENEW * np.count_nonzero(free):
                    answered = free
                    space.precondition(mask, answer)
                np.multiply(mask, answer, out=unit)
                push = float(unit.sum())
                add_to(t, -float(t.sum()) / push, unit)
        np.multiply(mask, w, out=r)
        space.precondition(r, z)
        z *= mask
        if load_control:
            add_to(z, -float(z.sum()) / push, unit)
        new = float(np.vdot(z, r))
        # Polak-Ribiere: forgets the last direction by itself where the touching set changes.
        t *= max(0.0, (new - float(np.vdot(z, before))) / old) if old > 0.0 else 0.0
        t += z
        slope, curvature = float(np.vdot(r, t)), float(np.vdot(t, space.apply(t, moved)))
        before, r, old = r, before, new
        if not (curvature > 0.0 and slope > 0.0):
            watch.force()
            continue
        step = slope / curvature
        add_to(p, -step, t)
        if p.min() < 0.0 or (bounded and p.max() > cap):
            p = _projected(p, total, cap, free)
            space.apply(p, g)
            g -= h
        else:
            add_to(g, -step, moved)
    raise NotConverged(f"""contact on {h.shape[0]} x {h.shape[1]} pixels: certificate
        {certificate.gap:.2g} after {max_iterations} iterations, wanted {tolerance:.2g}; loosen
        'tolerance'""")


class _Watch:
    """Sees when the certificate no longer falls; then safe steps are taken.

    A step along the gap no longer than the inverse of the largest eigenvalue of H, projected,
    always lowers the energy. Each time the certificate stalls twice as many follow: the method
    cannot cycle for ever.
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
            self.safe *= 2
        self.left -= 1
        return self.left >= 0


def _within(p: Array, total: float | None, cap: float) -> Array:
    """Admissible pressures near p, which is not negative."""
    if np.isfinite(cap):
        p = np.minimum(p, cap)
        if total is None:
            return p
        among = p > 0.0
        if total >= 0.9 * cap * np.count_nonzero(among):
            among = np.ones_like(among)
        return _shifted(p, total, cap, among)
    return _scaled(p, total)


def _scaled(p: Array, total: float | None) -> Array:
    """Pressures with the given sum, if one is given, in place."""
    if total is None:
        return p
    now = float(p.sum())
    if now > 0.0:
        p *= total / now
    else:
        p[:] = total / p.size
    return p


def _projected(p: Array, total: float | None, cap: float, free: Mask) -> Array:
    """Pressures brought back between the bounds; only the free ones change."""
    if not np.isfinite(cap):
        return _scaled(np.maximum(p, 0.0, out=p), total)
    return np.clip(p, 0.0, cap) if total is None else _shifted(p, total, cap, free)


def _safe_step(p: Array, step: Array, total: float | None, cap: float) -> Array:
    """Step of the projected gradient."""
    if not np.isfinite(cap):
        return _scaled(np.maximum(p - step, 0.0), total)
    return _projected(p - step, total, cap, np.ones(p.shape, dtype=bool))


def _shifted(p: Array, total: float, cap: float, free: Mask) -> Array:
    """Nearest admissible pressures with the given sum: min(max(p - s, 0), c) on the free pixels.

    The sum falls with s along straight pieces: Newton's method, kept inside a bracket.
    """
    x = p[free]
    wanted = total - float(p[~free].sum())
    low, high = float(x.min()) - cap, float(x.max())
    s = 0.0
    for _ in range(100):
        q = np.clip(x - s, 0.0, cap)
        excess = float(q.sum()) - wanted
        if abs(excess) <= 1e-14 * total:
            break
        low, high = (s, high) if excess > 0.0 else (low, s)
        between = np.count_nonzero((q > 0.0) & (q < cap))
        s = s + excess / between if between else low
        if not low < s < high:
            s = 0.5 * (low + high)
    p = p.copy()
    p[free] = q
    return p


def _level(g: Array, elastic: Mask, top: Mask | None, weight: Array) -> float:
    """Value [m] that the plane takes from the gaps without d: their mean where pixels give way.

    Where all touching pixels yield, any value between their gaps and those of the others.
    """
    if top is None or elastic.any():
        return float(np.vdot(g, weight)) / np.count_nonzero(elastic)
    return 0.5 * (float(g[top].max()) + float(g[~top].min()))
