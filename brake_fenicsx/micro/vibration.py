"""Stiffness of small vibrations as a smooth function of the separation.

While few pixels touch, a law is a staircase: every pixel that comes into contact is a corner of
p(d), and its slope jumps there. The corners belong to the pixels: the summits of a facet of a brake
are rounded and come into contact gradually. The modes therefore read the slope of the local
regression line over a third of a decade of pressure, not the slope between two corners. Under a
hardness the stiffness of vibrations counts all touching pixels and is smooth by itself: only its
derivative needs the line.

Reference: W. S. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829, doi:10.1080/01621459.1979.10481038
(local regression).
"""

from __future__ import annotations

import numpy as np

from brake_fenicsx.micro.law import Array, LawSteps

WIDTH = np.log(10.0) / 3.0  # of the regression over ln p
POINTS = 40  # of the even grid of ln p over one width


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
    grid = np.linspace(x[0], x[-1], max(3, round((x[-1] - x[0]) / WIDTH * POINTS)))
    _, fall = local_lines(grid, np.interp(grid, x, steps.d))
    compliance = np.maximum(-fall, 1e-12 * (steps.d[0] - steps.d[-1]))  # -dd / d ln p [m]
    given = grid - np.log(compliance) if steps.v is None else np.interp(grid, x, np.log(steps.v))
    level, rise = local_lines(grid, given)
    on_grid = given if steps.v is None else level
    slope = -np.exp(on_grid) * np.maximum(rise, 0.0) / compliance
    v = np.exp(np.interp(x, grid, given)) if steps.v is None else steps.v
    return steps._replace(v=v, slope=np.interp(x, grid, slope))


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
