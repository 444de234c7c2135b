"""From a rough surface to its law of pressure over separation: how it is pressed, and read.

At the pressures of braking few points touch, and each of them is a summit that only a fine grid
resolves; at high pressures many touch, and the long waves decide. So a fine surface is pressed on
its own grid until many pixels would touch on one of half as many along a side, from there on that
grid, and so on. Each coarser law is moved along the separation so that the pressure is continuous,
and its stiffness of vibrations, which lacks the shorter waves, is multiplied by the ratio of both
grids at the join.

The stiffness of small vibrations is a smooth function of the separation. While few pixels touch, a
law is a staircase: every pixel that comes into contact is a corner of
p(d), and its slope jumps there. The corners belong to the pixels: the summits of a facet of a brake
are rounded and come into contact gradually. The modes therefore read the slope of the local
regression line over a third of a decade of pressure, not the slope between two corners. Under a
hardness the stiffness of vibrations counts all touching pixels and is smooth by itself: only its
derivative needs the line.

Reference: W. S. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829, doi:10.1080/01621459.1979.10481038
(local regression).
"""

import logging
from dataclasses import dataclass
from math import ceil
from typing import Any, Literal

import numpy as np
import scipy.fft

from brake_fenicsx.arguments import Array, number, of_kind, one_of, positive
from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.micro.halfspace import Boundary, HalfSpace, half_space_of
from brake_fenicsx.micro.law import ComputedLaw, LawSteps, make_library
from brake_fenicsx.micro.sweep import Step, given, steps_per_decade, sweep
from brake_fenicsx.surface import hdf, topography

WIDTH = np.log(10.0) / 3.0  # of the regression over ln p
POINTS = 40  # of the even grid of ln p over one width
logger = logging.getLogger("brake_fenicsx")
STEPS_PER_DECADE = 40  # of load, while few pixels touch
CLOSED = 0.98  # share of the flat punch's stiffness from which roughness no longer counts
FOOT = 0.02  # the foot of a law is at most this share of S_q
COARSEST = 128  # pixels along a side that no grid of the cascade goes below
TOUCHING = 200  # pixels that touch on a grid when it takes over

BulkCompliance = Literal["remove", "keep"]
Grids = Literal["cascade", "one"]
PLASTIC = 0.1  # a law under a hardness ends at this share of it, unless a pressure is given
MOST_STEPS = 10_000


def plane_strain_modulus(E: float, nu: float) -> float:
    """E* = E / (1 - nu^2) [Pa], exact for an isotropic half-space.

    The paper takes it for the lining too, with E_z and nu_xz: 1983.3 MPa, 0.4054: 2373.4 MPa.

    Args:
        E: Young's modulus [Pa], positive.
        nu: Poisson's ratio [-], between -1 and 0.5.

    Example:
        >>> round(plane_strain_modulus(1983.3e6, 0.4054) / 1e6, 1)
        2373.4
    """
    positive(E=E)
    if not -1.0 < number("nu", nu) <= 0.5:
        raise SceneError(f"nu = {nu}: Poisson's ratio lies between -1 and 0.5")
    return E / (1.0 - nu**2)


def transversely_isotropic_modulus(C11: float, C13: float, C33: float, C44: float) -> float:
    """Modulus E* [Pa] of a half-space whose axis of isotropy is the surface normal, exact.

    A point load F sinks the surface by F / (pi E* r), as on an isotropic half-space.

    Args:
        C11: stiffness in the plane [Pa].
        C13: coupling of plane and axis [Pa].
        C33: stiffness along the axis [Pa].
        C44: shear stiffness of planes through the axis [Pa].

    Reference: A. Delafargue, F.-J. Ulm, Int. J. Solids Struct. 41 (2004) 7351,
    doi:10.1016/j.ijsolstr.2004.06.019.

    Example:
        >>> round(transversely_isotropic_modulus(5.94e9, 0.98e9, 2.27e9, 1.18e9) / 1e6, 1)
        2569.4
    """
    if not (C11 > 0.0 and C33 > 0.0 and C44 > 0.0 and C11 * C33 > C13**2):
        raise SceneError(f"""C11 = {C11}, C13 = {C13}, C33 = {C33}, C44 = {C44} Pa: not positive
            definite""")
    shear = 1.0 / C44 + 2.0 / (np.sqrt(C11 * C33) + C13)
    return float(2.0 * np.sqrt((C11 * C33 - C13**2) / C11 / shear))


@dataclass(frozen=True, slots=True)
class LawSettings:
    """Arguments of a law, checked when they are given.

    Attributes:
        E_star: composite modulus [Pa].
        max_pressure: mean pressure the law is computed to [Pa]; if not given 0.1 E*, and no more
            than 0.1 of the hardness.
        min_pressure: mean pressure of the first step [Pa]; 1e-6 E* if not given, less where the
            foot would be longer than 0.02 S_q.
        steps: number of steps, equal in the logarithm of the load; 40 per decade or more
            while fewer than three hundred pixels touch.
        boundary: ``"free"`` or ``"periodic"``.
        bulk_compliance: ``"remove"`` the sinking of the whole free patch, which the pad's finite
            elements already have, or ``"keep"`` it.
        tolerance: duality gap over the work of each step [-].
        hardness: pressure at which the surface yields [Pa]; None for an elastic surface.
        grids: ``"cascade"``: a periodic surface of 256 pixels or more along a side is pressed on
            coarser grids where many pixels touch; ``"one"``: on its own grid throughout.

    Raises:
        SceneError: a value without meaning, or a hardness that cannot carry the pressure.
    """

    E_star: float
    max_pressure: float | None = None
    min_pressure: float | None = None
    steps: int = 40
    boundary: Boundary = "free"
    bulk_compliance: BulkCompliance = "remove"
    tolerance: float = 1e-6
    hardness: float | None = None
    grids: Grids = "cascade"

    def __post_init__(self) -> None:
        one_of("boundary", self.boundary, Boundary)
        one_of("bulk_compliance", self.bulk_compliance, BulkCompliance)
        one_of("grids", self.grids, Grids)
        positive(E_star=self.E_star, steps=self.steps, tolerance=self.tolerance)
        for name in ("max_pressure", "min_pressure", "hardness"):
            if (value := getattr(self, name)) is not None:
                positive(**{name: value})
        if not (self.lowest < self.highest and 2 <= self.steps <= MOST_STEPS):
            raise SceneError(f"""law from {self.lowest:.4g} to {self.highest:.4g} Pa in {self.steps}
                steps; give rising pressures and 2 to {MOST_STEPS} steps""")
        if self.tolerance >= 1.0:
            raise SceneError(f"tolerance = {self.tolerance}; give less than 1, such as 1e-6")
        if self.hardness is not None and not self.highest < self.hardness:
            raise SceneError(f"""hardness = {self.hardness:.4g} Pa: a law up to {self.highest:.4g}
                Pa needs more; lower 'max_pressure'""")

    @property
    def highest(self) -> float:
        """Mean pressure that the law is computed to [Pa]."""
        if self.max_pressure is not None:
            return self.max_pressure
        elastic = 0.1 * self.E_star
        return elastic if self.hardness is None else min(elastic, PLASTIC * self.hardness)

    @property
    def lowest(self) -> float:
        """Mean pressure of the first step [Pa], before the foot is looked at."""
        if self.min_pressure is not None:
            return self.min_pressure
        return min(1e-6 * self.E_star, 1e-2 * self.highest)


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


def contact_law(surface: topography.Topography, E_star: float, **settings: Any) -> ComputedLaw:
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
    of_kind("surface", surface, topography.Topography, "a Topography, see surface.make_topography")
    law = make_library([law_steps(surface, LawSettings(E_star, **settings))])[0]
    for text in doubts(surface):
        logger.warning("%s", text)
    return law


def doubts(surface: topography.Topography) -> list[str]:
    """What is doubtful about a surface under a half-space model, one line each."""
    slope, _ = hdf.gradients(surface.heights, surface.pixel)
    steep = f"{surface.source}: rms slope {slope:.2g}; the half-space supposes small slopes"
    return [*surface.warnings, *([steep] if slope > 1.0 else [])]


def law_steps(
    surface: topography.Topography,
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
        loads = whole if only is None else given(only / E * h.size)
        ends, beyond = (first * h.size, highest / E * h.size), last * (1.0 - 1e-9) * h.size
        steps = sweep(space, h, *ends, loads, settings.tolerance, cap, stop, beyond)
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


def first_load(h: Array, surface: topography.Topography, settings: LawSettings) -> float:
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
