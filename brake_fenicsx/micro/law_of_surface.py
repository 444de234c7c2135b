"""From a rough surface to its law of pressure over separation.

At the pressures of braking few points touch, and each of them is a summit that only a fine grid
resolves; at high pressures many touch, and the long waves decide. So a fine surface is pressed on
its own grid up to where many pixels touch, and beyond on a coarse grid that holds its long waves.
The coarse law is moved along the separation so that the pressure is continuous.
"""

from __future__ import annotations

import logging

import numpy as np
import scipy.fft

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.micro.halfspace import HalfSpace, half_space
from brake_fenicsx.micro.law import Array, ComputedLaw, make_library
from brake_fenicsx.micro.loading import rms_slope
from brake_fenicsx.micro.qp import unit_answer
from brake_fenicsx.micro.sweep import Step, sweep
from brake_fenicsx.surface.topography import Topography

logger = logging.getLogger("brake_fenicsx")

FINE = 40  # steps per decade of load while few pixels touch
FULL = 0.98  # share of the flat punch's stiffness from which roughness no longer counts
FOOT = 0.02  # the foot of a law is at most this share of S_q
COARSE = 128  # pixels of the coarse grid along a side
FINER = 1.5  # ratio of the pixels from which two grids are worth their join
# Touching pixels from which the coarse grid serves: elastic, and under a hardness; on finer grids
# a summit has more of them.
JOIN, JOIN_PLASTIC = 100, 300
PLASTIC = 0.1  # a law under a hardness ends at this share of it, unless a pressure is given


def contact_law(
    surface: Topography,
    E_star: float,
    max_pressure: float | None = None,
    min_pressure: float | None = None,
    steps: int = 40,
    boundary: str = "free",
    bulk_compliance: str = "remove",
    tolerance: float = 1e-6,
    hardness: float | None = None,
    grids: str = "two",
) -> ComputedLaw:
    """Law p(d) of a rough surface under a rigid plane.

    Args:
        surface: rough surface without missing points.
        E_star: composite modulus [Pa].
        max_pressure: mean pressure the law is computed to [Pa]; if not given 0.1 E*, and no more
            than 0.1 of the hardness.
        min_pressure: mean pressure of the first step [Pa]; 1e-6 E* if not given, less where the
            foot would be longer than 0.02 S_q.
        steps: number of steps, equal in the logarithm of the load; 40 per decade or more
            while fewer than a hundred pixels touch.
        boundary: ``"free"`` or ``"periodic"``.
        bulk_compliance: ``"remove"`` the sinking of the whole free patch, which the pad's finite
            elements already have, or ``"keep"`` it.
        tolerance: duality gap over the work of each step [-].
        hardness: pressure at which the surface yields [Pa]; None for an elastic surface.
        grids: ``"two"``: a periodic surface of many more than 128 pixels along a side is pressed on
            the coarse grid where many pixels touch; ``"one"``: on its own grid throughout.

    Raises:
        SceneError: an argument without meaning, or a hardness that cannot carry the pressure.
        SurfaceError: missing points or a flat surface.
        NotConverged: a step misses the tolerance.
    """
    return make_library([
        law_steps(
            surface, E_star, max_pressure, min_pressure, steps, boundary, bulk_compliance,
            tolerance, hardness, grids,
        )
    ])[0]  # fmt: skip


def law_steps(
    surface: Topography,
    E_star: float,
    max_pressure: float | None = None,
    min_pressure: float | None = None,
    steps: int = 40,
    boundary: str = "free",
    bulk_compliance: str = "remove",
    tolerance: float = 1e-6,
    hardness: float | None = None,
    grids: str = "two",
) -> tuple[Array, Array, Array, Array]:
    """Separations [m], pressures [Pa] and stiffnesses [Pa/m] of loading and vibration of a law.

    Arguments as in ``contact_law``.
    """
    for name, value, choices in (
        ("bulk_compliance", bulk_compliance, ("remove", "keep")), ("grids", grids, ("two", "one")),
    ):  # fmt: skip
        if value not in choices:
            raise SceneError(f"{name} = {value!r}; choose {choices[0]!r} or {choices[1]!r}")
    high = highest_pressure(E_star, hardness) if max_pressure is None else max_pressure
    low = min(1e-6 * E_star, 1e-2 * high) if min_pressure is None else min_pressure
    if not (E_star > 0.0 and 0.0 < low < high and steps >= 2):
        raise SceneError(f"law from {low} to {high} Pa in {steps} steps, E_star = {E_star} Pa")
    if hardness is not None and not high < hardness:
        raise SceneError(
            f"hardness = {hardness:.4g} Pa: a law up to {high:.4g} Pa needs more; lower"
            " 'max_pressure'"
        )
    h = surface.heights - surface.heights.mean()
    if not np.isfinite(h).all():
        raise SurfaceError(f"{surface.source}: missing points; fill them before the contact")
    slope = rms_slope(h, surface.pixel)
    if slope > 1.0:
        logger.warning(
            "%s: rms slope %.2g; the half-space supposes small slopes", surface.source, slope
        )
    coarse = max(1, round(steps / np.log10(high / low)))
    cap = None if hardness is None else hardness / E_star
    space = _space(h, surface.size, boundary)
    # One pixel of compliance c takes the sum of pressures 0.02 S_q / c over the foot.
    first = min(low / E_star * h.size, FOOT * float(h.std()) / space.diagonal)
    if not first > 0.0:
        raise SurfaceError(f"{surface.source}: the surface is flat; use a linear law")
    finer = max(h.shape) / COARSE
    many = (JOIN if hardness is None else JOIN_PLASTIC) * max(1.0, finer / 3.0)
    two = grids == "two" and surface.periodic and finer >= FINER
    rates = max(FINE, coarse), coarse, tolerance, cap
    last = high / E_star * h.size
    found = _table(
        sweep(space, h, first, last, *rates, round(many) if two else None), space, bulk_compliance
    )
    if two and found[1, -1] < high / E_star * (1.0 - 1e-9):
        shape = (max(round(h.shape[0] / finer), 2), max(round(h.shape[1] / finer), 2))
        smooth = low_passed(h, shape)
        space = _space(smooth, surface.size, boundary)
        first, last = found[1, -1] * smooth.size, high / E_star * smooth.size
        rest = _table(sweep(space, smooth, first, last, *rates), space, bulk_compliance)
        rest[0] += found[0, -1] - rest[0, 0]
        found = np.concatenate([found, rest[:, 1:]], axis=1)
    falls = np.concatenate([[True], np.diff(found[0]) < -1e-12 * np.abs(found[0]).max()])
    d, p, k, v = found[:, falls]
    return d, p * E_star, k * E_star, v * E_star


def highest_pressure(E_star: float, hardness: float | None) -> float:
    """Mean pressure to which a law is computed where none is given [Pa].

    Args:
        E_star: composite modulus [Pa].
        hardness: pressure at which the surface yields [Pa]; None for an elastic surface.
    """
    return 0.1 * E_star if hardness is None else min(0.1 * E_star, PLASTIC * hardness)


def low_passed(h: Array, shape: tuple[int, int]) -> Array:
    """Periodic heights [m] on a coarser grid: the waves that it resolves, the others left out.

    Args:
        h: heights [m], shape (nx, ny).
        shape: pixels of the coarse grid, fewer than those of ``h``.
    """
    waves = scipy.fft.fftshift(scipy.fft.fft2(h))
    parts = [
        slice(n // 2 - m // 2, n // 2 - m // 2 + m) for n, m in zip(h.shape, shape, strict=True)
    ]
    kept = scipy.fft.ifftshift(waves[parts[0], parts[1]])
    return np.asarray(scipy.fft.ifft2(kept).real * (shape[0] * shape[1] / h.size))


def _space(h: Array, size: Array, boundary: str) -> HalfSpace:
    """Half-space on the grid of the heights."""
    return half_space(h.shape, (float(size[0] / h.shape[0]), float(size[1] / h.shape[1])), boundary)


def _table(steps: list[Step], space: HalfSpace, bulk_compliance: str) -> Array:
    """Steps as rows d [m], p / E* [-], stiffnesses / E* [1/m], without the bulk's compliance."""
    rows = np.array([(s.d, s.total, s.stiffness, s.vibration) for s in steps]).T
    d, total, answers = rows[0], rows[1], rows[2:]
    if bulk_compliance == "remove" and space.boundary == "free":
        c = bulk(space)
        d = d + c * total
        closed = np.flatnonzero(c * answers[0] >= FULL)
        if closed.size:
            logger.debug("closed at p = %.2g E*; straight law beyond", total[closed[0]])
            kept = slice(closed[0] + 1)
            d, total, answers = d[kept], total[kept], answers[:, kept]
        answers = answers / np.maximum(1.0 - c * answers, 1.0 - FULL)
    return np.stack([d, *(row / (space.shape[0] * space.shape[1]) for row in (total, *answers))])


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
