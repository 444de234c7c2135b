"""From a rough surface to its law of pressure over separation.

At the pressures of braking few points touch, and each of them is a summit that only a fine grid
resolves; at high pressures many touch, and the long waves decide. So a fine surface is pressed on
its own grid until many pixels would touch on one of half as many along a side, from there on that
grid, and so on. Each coarser law is moved along the separation so that the pressure is continuous,
and its stiffness of vibrations, which lacks the shorter waves, is multiplied by the ratio of both
grids at the join.

Stiffness of small vibrations as a smooth function of the separation.

While few pixels touch, a law is a staircase: every pixel that comes into contact is a corner of
p(d), and its slope jumps there. The corners belong to the pixels: the summits of a facet of a brake
are rounded and come into contact gradually. The modes therefore read the slope of the local
regression line over a third of a decade of pressure, not the slope between two corners. Under a
hardness the stiffness of vibrations counts all touching pixels and is smooth by itself: only its
derivative needs the line.

Reference: W. S. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829, doi:10.1080/01621459.1979.10481038
(local regression).
"""

import logging
from math import ceil
from typing import Any

import numpy as np
import scipy.fft

from brake_fenicsx.arguments import Array, of_kind
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.micro.halfspace import HalfSpace, half_space_of
from brake_fenicsx.micro.law import ComputedLaw, LawSteps, make_library
from brake_fenicsx.micro.settings import LawSettings
from brake_fenicsx.micro.sweep import Step, given, steps_per_decade, sweep
from brake_fenicsx.surface.iso25178 import gradients
from brake_fenicsx.surface.topography import Topography

WIDTH = np.log(10.0) / 3.0  # of the regression over ln p
POINTS = 40  # of the even grid of ln p over one width
logger = logging.getLogger("brake_fenicsx")
STEPS_PER_DECADE = 40  # of load, while few pixels touch
CLOSED = 0.98  # share of the flat punch's stiffness from which roughness no longer counts
FOOT = 0.02  # the foot of a law is at most this share of S_q
COARSEST = 128  # pixels along a side that no grid of the cascade goes below
TOUCHING = 200  # pixels that touch on a grid when it takes over


def with_vibration(steps: LawSteps) -> LawSteps:
    """Steps of a law with the stiffness of vibrations that the modes read, and its slope.

    Args:
        steps: solved points; ``v`` under a hardness, none for an elastic surface.

    Returns:
        The same points with ``v`` and ``slope``: of an elastic surface v = p / c, where c is the
        slope of the line of d over -ln p; under a hardness v as it is. dv/dd is the slope of the
        line of ln v over that of d.
    """
    x = np.log(steps.p)
    if x.size < 3:  # too short for a line: one pixel, or a plateau
        v = steps.k if steps.v is None else steps.v
        return steps._replace(v=v, slope=np.zeros_like(v))
    # Of points at places that do not depend on where the law ends.
    grid = x[0] + WIDTH / POINTS * np.arange(max(3, ceil((x[-1] - x[0]) / WIDTH * POINTS) + 1))
    _, fall = local_lines(grid, _continued(grid, x, steps.d))
    compliance = np.maximum(-fall, 1e-12 * abs(steps.d[0]))  # -dd / d ln p [m]
    given = grid - np.log(compliance) if steps.v is None else _continued(grid, x, np.log(steps.v))
    level, rise = local_lines(grid, given)
    on_grid = given if steps.v is None else level
    slope = -np.exp(on_grid) * np.maximum(rise, 0.0) / compliance
    v = np.exp(np.interp(x, grid, given)) if steps.v is None else steps.v
    return steps._replace(v=v, slope=np.interp(x, grid, slope))


def _continued(grid: Array, x: Array, y: Array) -> Array:
    """Values between points, and on the line of the last two beyond them."""
    beyond = np.maximum(grid - x[-1], 0.0) * (y[-1] - y[-2]) / (x[-1] - x[-2])
    return np.interp(grid, x, y) + beyond


def local_lines(x: Array, y: Array) -> tuple[Array, Array]:
    """Values and slopes of the regression lines about every point of an even grid.

    Weighted least squares, the weights falling parabolically to zero half a width away.

    Args:
        x: even grid of ln p, shape (n,).
        y: values, shape (n,).
    """
    step = x[1] - x[0]
    reach = min(int(WIDTH / 2.0 / step), x.size - 1)
    t = np.arange(-reach, reach + 1) * step
    weight = np.maximum(1.0 - (2.0 * t / WIDTH) ** 2, 1e-9)

    def moment(n: int, values: Array) -> Array:
        """Sum of weight t^n values about every point."""
        kernel = (weight * t**n)[::-1]
        return np.convolve(values, kernel, mode="full")[reach : reach + x.size]

    ones = np.ones_like(x)
    s0, s1, s2 = (moment(n, ones) for n in range(3))
    r0, r1 = (moment(n, y) for n in range(2))
    determinant = s0 * s2 - s1**2
    return (r0 * s2 - r1 * s1) / determinant, (s0 * r1 - s1 * r0) / determinant


def contact_law(surface: Topography, E_star: float, **settings: Any) -> ComputedLaw:
    """Law p(d) of a rough surface under a rigid plane.

    Args:
        surface: rough surface without missing points.
        E_star: composite modulus [Pa].
        settings: the other attributes of ``LawSettings``: max_pressure [Pa], hardness [Pa],
            boundary, steps, tolerance, ...

    Raises:
        SceneError: an argument without meaning, or a hardness that cannot carry the pressure.
        SurfaceError: missing points or a flat surface.
        NotConverged: a step misses the tolerance.

    Example:
        >>> x = np.arange(64) / 64
        >>> wave = Topography(1e-6 * np.cos(2 * np.pi * x)[:, None] + 0 * x, (1e-3, 1e-3))
        >>> law = contact_law(wave, 2.4e9, boundary="periodic", max_pressure=5e6)
        >>> round(float(law.pressure(0.5e-6)) / 1e6, 1)  # [MPa] where the crests sink in by 0.5 um
        1.4
    """
    of_kind("surface", surface, Topography, "a Topography, see surface.make_topography")
    law = make_library([law_steps(surface, LawSettings(E_star, **settings))])[0]
    for text in doubts(surface):
        logger.warning("%s", text)
    return law


def doubts(surface: Topography) -> list[str]:
    """What is doubtful about a surface under a half-space model, one line each."""
    slope, _ = gradients(surface.heights, surface.pixel)
    steep = f"{surface.source}: rms slope {slope:.2g}; the half-space supposes small slopes"
    return [*surface.warnings, *([steep] if slope > 1.0 else [])]


def law_steps(
    surface: Topography,
    settings: LawSettings,
    pressure: float = np.inf,
    only: Array | None = None,
) -> LawSteps:
    """Solved points of the law of a rough surface.

    Args:
        surface: rough surface without missing points.
        settings: how it is pressed.
        pressure: mean pressure [Pa] up to which the law is wanted; by default to the highest of
            the settings. Up to it the shorter law is the longer one, digit for digit.
        only: mean pressures [Pa] that alone are solved, rising; by default those of a whole law.

    Raises:
        As ``contact_law``.

    Example:
        >>> x = np.arange(64) / 64
        >>> wave = Topography(1e-6 * np.cos(2 * np.pi * x)[:, None] + 0 * x, (1e-3, 1e-3))
        >>> steps = law_steps(wave, LawSettings(2.4e9, boundary="periodic", max_pressure=5e6))
        >>> round(float(steps.p[-1]) / 1e6, 2), bool(np.all(np.diff(steps.d) < 0))
        (5.0, True)
    """
    h = surface.heights - surface.heights.mean()
    if not np.isfinite(h).all():
        raise SurfaceError(f"{surface.source}: missing points; fill them before the contact")
    E, highest = settings.E_star, settings.highest
    if only is None:
        first, last = (
            first_load(h, surface, settings),
            min(highest, pressure * _beyond(settings)) / E,
        )
        coarse = max(1, round(settings.steps / np.log10(highest / settings.lowest)))
        whole = steps_per_decade(max(STEPS_PER_DECADE, coarse), coarse)
    else:
        first, last = float(only[0]) / E, float(only[-1]) / E
    table: Array = np.empty((5, 0))
    while True:
        coarser = h.shape[0] // 2, h.shape[1] // 2
        more = settings.grids == "cascade" and surface.periodic and min(coarser) >= COARSEST
        stop = round(TOUCHING * h.size / np.prod(coarser)) if more else None
        space = half_space_of(h, surface.size, settings.boundary)
        cap = None if settings.hardness is None else settings.hardness / E
        steps = sweep(
            space, h, first * h.size, highest / E * h.size,
            whole if only is None else given(only / E * h.size),
            settings.tolerance, cap, stop, last * (1.0 - 1e-9) * h.size,
        )  # fmt: skip
        rows = _without_bulk(steps, space, settings)
        if table.size:
            rows[0] += table[0, -1] - rows[0, 0]
            rows[3] *= table[3, -1] / rows[3, 0]
            rows = rows[:, 1:]
        table = np.concatenate([table, rows], axis=1)
        first = float(table[1, -1])
        if not more or first >= last * (1.0 - 1e-9):
            break
        h = low_passed(h, coarser)
    falls = np.concatenate([[True], np.diff(table[0]) < -1e-12 * abs(table[0, 0])])
    d, p, k, v, area = table[:, falls]
    v = None if settings.hardness is None else v * E
    return with_vibration(LawSteps(d, p * E, k * E, v, None, area))


def reach(steps: LawSteps, settings: LawSettings, pressure: float = np.inf) -> float:
    """Mean pressure [Pa] up to which steps made for a pressure are those of the whole law.

    Args:
        steps: the law.
        settings: how it was made.
        pressure: the pressure that ``law_steps`` was given [Pa].

    Returns:
        Infinite for a whole law: one that ends at the highest pressure of the settings, or where
        its surface closes.
    """
    margin = _beyond(settings)
    wanted = min(settings.highest, pressure * margin) * (1.0 - 1e-9)
    whole = steps.p[-1] < wanted or steps.p[-1] >= settings.highest * (1.0 - 1e-9)
    return np.inf if whole else float(min(steps.p[-1] / margin, steps.p[-2]))


def _beyond(settings: LawSettings) -> float:
    """How far beyond a pressure the regression lines at it reach, as a ratio [-].

    Half a width, and for an elastic surface, whose slope is that of a line through slopes, two.
    """
    halves = 2 if settings.hardness is None else 1
    return float(np.exp(WIDTH * (0.5 * halves + 3.0 / POINTS)))


def first_load(h: Array, surface: Topography, settings: LawSettings) -> float:
    """Mean pressure over E* of the first step [-]: one pixel, whose foot is short.

    One pixel of compliance c takes the sum of pressures 0.02 S_q / c over the foot.
    """
    space = half_space_of(h, surface.size, settings.boundary)
    first = min(settings.lowest / settings.E_star, FOOT * h.std() / (space.diagonal * h.size))
    if not first > 0.0:
        raise SurfaceError(f"{surface.source}: the surface is flat; use a linear law")
    return float(first)


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


def _without_bulk(steps: list[Step], space: HalfSpace, settings: LawSettings) -> Array:
    """Steps as rows d, p / E*, k / E*, v / E*, touching share; without the bulk's compliance."""
    pixels = space.shape[0] * space.shape[1]
    rows = np.array([(s.d, s.total, s.stiffness, s.vibration, s.touching) for s in steps]).T
    d, total, answers, touching = rows[0], rows[1], rows[2:4], rows[4]
    if settings.bulk_compliance == "remove" and space.boundary == "free":
        c = space.punch
        d = d + c * total
        closed = np.flatnonzero(c * answers[0] >= CLOSED)
        if closed.size:
            logger.debug("closed at p = %.2g E*; straight law beyond", total[closed[0]])
            kept = slice(closed[0] + 1)
            d, total, answers, touching = d[kept], total[kept], answers[:, kept], touching[kept]
        answers = answers / np.maximum(1.0 - c * answers, 1.0 - CLOSED)
    return np.stack([d, *(row / pixels for row in (total, *answers, touching))])
