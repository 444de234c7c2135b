"""From a rough surface to its law of pressure over separation."""

from __future__ import annotations

import logging

import numpy as np

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.micro.halfspace import HalfSpace, half_space
from brake_fenicsx.micro.law import Array, ComputedLaw, make_library
from brake_fenicsx.micro.loading import rms_slope
from brake_fenicsx.micro.qp import unit_answer
from brake_fenicsx.micro.sweep import sweep
from brake_fenicsx.surface.topography import Topography

logger = logging.getLogger("brake_fenicsx")

FINE = 40  # steps per decade of load while few pixels touch
FULL = 0.98  # share of the flat punch's stiffness from which roughness no longer counts
FOOT = 0.02  # the foot of a law is at most this share of S_q


def contact_law(
    surface: Topography,
    E_star: float,
    max_pressure: float | None = None,
    min_pressure: float | None = None,
    steps: int = 40,
    boundary: str = "free",
    bulk_compliance: str = "remove",
    tolerance: float = 1e-6,
) -> ComputedLaw:
    """Law p(d) of a rough surface under a rigid plane.

    Args:
        surface: rough surface without missing points.
        E_star: composite modulus [Pa].
        max_pressure: mean pressure the law is computed to [Pa]; 0.1 E* if not given.
        min_pressure: mean pressure of the first step [Pa]; 1e-6 E* if not given, less where the
            foot would be longer than 0.02 S_q.
        steps: number of steps, equal in the logarithm of the load; 40 per decade or more
            while fewer than a hundred pixels touch.
        boundary: ``"free"`` or ``"periodic"``.
        bulk_compliance: ``"remove"`` the sinking of the whole free patch, which the pad's finite
            elements already have, or ``"keep"`` it.
        tolerance: duality gap over the work of each step [-].

    Raises:
        SurfaceError: missing points or a flat surface.
        NotConverged: a step misses the tolerance.
    """
    d, p, k = law_steps(
        surface, E_star, max_pressure, min_pressure, steps, boundary, bulk_compliance, tolerance
    )
    return make_library([(d, p, k)])[0]


def law_steps(
    surface: Topography,
    E_star: float,
    max_pressure: float | None = None,
    min_pressure: float | None = None,
    steps: int = 40,
    boundary: str = "free",
    bulk_compliance: str = "remove",
    tolerance: float = 1e-6,
) -> tuple[Array, Array, Array]:
    """Separations [m], pressures [Pa] and stiffnesses [Pa/m] of the steps of a law.

    Arguments as in ``contact_law``.
    """
    if bulk_compliance not in ("remove", "keep"):
        raise SceneError(f"bulk_compliance = {bulk_compliance!r}; choose 'remove' or 'keep'")
    high = 0.1 * E_star if max_pressure is None else max_pressure
    low = 1e-6 * E_star if min_pressure is None else min_pressure
    if not (E_star > 0.0 and 0.0 < low < high and steps >= 2):
        raise SceneError(f"law from {low} to {high} Pa in {steps} steps, E_star = {E_star} Pa")
    h = surface.heights - surface.heights.mean()
    if not np.isfinite(h).all():
        raise SurfaceError(f"{surface.source}: missing points; fill them before the contact")
    S_q = float(h.std())
    pixel = surface.pixel
    space = half_space(surface.shape, (float(pixel[0]), float(pixel[1])), boundary)
    # One pixel of compliance c takes the sum of pressures 0.02 S_q / c over the foot.
    first = min(low / E_star * h.size, FOOT * S_q / space.diagonal)
    if not first > 0.0:
        raise SurfaceError(f"{surface.source}: the surface is flat; use a linear law")
    slope = rms_slope(h, pixel)
    if slope > 1.0:
        logger.warning(
            "%s: rms slope %.2g; the half-space supposes small slopes", surface.source, slope
        )
    coarse = max(1, round(steps / np.log10(high / low)))
    found = sweep(space, h, first, high / E_star * h.size, max(FINE, coarse), coarse, tolerance)
    d, total, stiffness = np.array([(s.d, s.total, s.stiffness) for s in found]).T
    if bulk_compliance == "remove" and boundary == "free":
        c = bulk(space)
        d = d + c * total
        closed = np.flatnonzero(c * stiffness >= FULL)
        if closed.size:
            p = total[closed[0]] / h.size
            logger.debug("%s: closed at p = %.2g E*; straight law beyond", surface.source, p)
            d, total, stiffness = (a[: closed[0] + 1] for a in (d, total, stiffness))
        stiffness = stiffness / np.maximum(1.0 - c * stiffness, 1.0 - FULL)
    falls = np.concatenate([[True], np.diff(d) < -1e-12 * np.abs(d).max()])
    d, total, stiffness = (a[falls] for a in (d, total, stiffness))
    return d, total * E_star / h.size, stiffness * E_star / h.size


_BULK: dict[tuple[tuple[int, int], float, float], float] = {}


def bulk(space: HalfSpace) -> float:
    """Sinking of the whole free patch under a rigid flat punch, per sum of p / E* [m].

    The punch's force is F = 1.149208 E* L delta on 128 x 128 pixels of a square, so a mean
    pressure P sinks it by 0.8702 P L / E*.
    """
    key = (space.shape, float(space.pixel[0]), float(space.pixel[1]))
    if key not in _BULK:
        full = np.ones(space.shape, dtype=bool)
        x = unit_answer(space, full, space.precondition(full.astype(float)), 1e-6)
        _BULK[key] = 1.0 / float(x.sum())
    return _BULK[key]
