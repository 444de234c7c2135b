"""Common part of pairs of triangles in a plane, in batches (Sutherland-Hodgman clipping)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A triangle cut by three half planes has six corners at most. Where corners coincide to rounding,
# edges may seem to cross a line more than twice: three cuts then make 4, 6 and 9 corners at most.
CORNERS = 9

# Middles of the edges of the reference triangle.
MIDDLES = (np.array([[0.5, 0.0], [0.5, 0.5], [0.0, 0.5]]), np.full(3, 1 / 6))


def clip_triangles(subject: Array, window: Array) -> tuple[Array, NDArray[np.int64]]:
    """Intersection polygon of each pair of triangles.

    Args:
        subject: corners of the first triangles, shape (pairs, 3, 2).
        window: corners of the second triangles, shape (pairs, 3, 2), either orientation.

    Returns:
        Polygon corners, shape (pairs, CORNERS, 2), and how many of them count, shape (pairs,);
        fewer than three: no common part.
    """
    pairs = len(subject)
    polygon: Array = np.zeros((pairs, CORNERS, 2))
    polygon[:, :3] = subject
    count: NDArray[np.int64] = np.full(pairs, 3)
    turn = np.sign(_cross(window[:, 1] - window[:, 0], window[:, 2] - window[:, 0]))
    for i in range(3):
        start, end = window[:, i], window[:, (i + 1) % 3]
        polygon, count = _cut(polygon, count, start, turn[:, None] * (end - start))
    return polygon, count


def polygon_triangles(polygon: Array, count: NDArray[np.int64]) -> tuple[Array, NDArray[np.intp]]:
    """Convex polygons cut into triangles about their first corner.

    Args:
        polygon: corners, shape (pairs, CORNERS, 2).
        count: corners that count, shape (pairs,).

    Returns:
        Triangles, shape (triangles, 3, 2), and the polygon of each, rising.
    """
    owner, fan = np.nonzero(np.arange(2, CORNERS) < count[:, None])
    return np.stack([polygon[owner, 0], polygon[owner, fan + 1], polygon[owner, fan + 2]], 1), owner


def triangle_quadrature(
    triangle: Array, rule: tuple[Array, Array] = MIDDLES
) -> tuple[Array, Array]:
    """Points and weights on triangles.

    Args:
        triangle: corners, shape (triangles, 3, 2).
        rule: points on the reference triangle, shape (q, 2), and weights of sum 1/2; edge middles
            if not given, exact for polynomials of degree two.

    Returns:
        Points, shape (triangles, q, 2), and weights, shape (triangles, q).
    """
    x, w = rule
    edges = triangle[:, 1:] - triangle[:, :1]
    twice = np.abs(_cross(edges[:, 0], edges[:, 1]))
    return triangle[:, :1] + x @ edges, np.asarray(twice[:, None] * w, float)


def barycentric(x: Array, triangle: Array) -> Array:
    """Barycentric coordinates of points in triangles.

    Args:
        x: points, shape (pairs, points, 2).
        triangle: corners, shape (pairs, 3, 2).

    Returns:
        Shape (pairs, points, 3).
    """
    a, b, c = (triangle[:, i, None] for i in range(3))
    twice = _cross(b - a, c - a)
    first = _cross(b - x, c - x) / twice
    second = _cross(c - x, a - x) / twice
    return np.stack([first, second, 1 - first - second], axis=2)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _cut(
    polygon: Array, count: NDArray[np.int64], start: Array, along: NDArray
) -> tuple[Array, NDArray[np.int64]]:
    """Keep what lies left of one line per pair."""
    pairs, slots = len(polygon), polygon.shape[1]
    index = np.arange(slots)
    following = np.where(index + 1 < count[:, None], index + 1, 0)
    nxt = np.take_along_axis(polygon, following[:, :, None], axis=1)
    side = _cross(along[:, None], polygon - start[:, None])
    side_nxt = np.take_along_axis(side, following, axis=1)
    alive = index < count[:, None]
    inside, inside_nxt = side >= 0, side_nxt >= 0
    with np.errstate(divide="ignore", invalid="ignore"):
        t = side / (side - side_nxt)
    crossing = polygon + np.where(inside != inside_nxt, t, 0.0)[:, :, None] * (nxt - polygon)
    keep = np.stack([alive & (inside != inside_nxt), alive & inside_nxt], axis=2)
    keep = keep.reshape(pairs, 2 * slots)
    corners = np.stack([crossing, nxt], axis=2).reshape(pairs, 2 * slots, 2)
    order = np.argsort(~keep, axis=1, kind="stable")[:, :CORNERS]
    return np.take_along_axis(corners, order[:, :, None], axis=1), keep.sum(axis=1)


def bilinear(x: Array, corner: Array) -> Array:
    """Reference coordinates of points in convex quadrilaterals, by Newton's iteration.

    Args:
        x: points, shape (rows, points, 2).
        corner: corners in cyclic order, shape (rows, 4, 2).

    Returns:
        Coordinates in the unit square, shape (rows, points, 2).
    """
    a, b, d = corner[:, :1], corner[:, 1:2] - corner[:, :1], corner[:, 3:] - corner[:, :1]
    twist = corner[:, :1] - corner[:, 1:2] + corner[:, 2:3] - corner[:, 3:]
    local = np.full_like(x, 0.5)
    for _ in range(20):
        r, t = local[..., :1], local[..., 1:]
        along, across = b + t * twist, d + r * twist
        miss = a + r * b + t * d + r * t * twist - x
        det = _cross(along, across)
        step = np.stack([_cross(miss, across) / det, _cross(along, miss) / det], axis=-1)
        local = np.clip(local - step, -1.0, 2.0)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return local
