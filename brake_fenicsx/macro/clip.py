"""Common part of pairs of triangles in a plane, in batches (Sutherland-Hodgman clipping)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A triangle cut by three half planes has six corners at most.
CORNERS = 6

# Middles of the edges of the reference triangle.
MIDDLES = (np.array([[0.5, 0.0], [0.5, 0.5], [0.0, 0.5]]), np.full(3, 1 / 6))


def clip_triangles(subject: Array, window: Array) -> tuple[Array, NDArray[np.int64]]:
    """Intersection polygon of each pair of triangles.

    Args:
        subject: corners of the first triangles, shape (pairs, 3, 2).
        window: corners of the second triangles, shape (pairs, 3, 2), either orientation.

    Returns:
        Polygon corners, shape (pairs, 6, 2), and how many of them count, shape (pairs,);
        fewer than three: no common part.
    """
    pairs = len(subject)
    polygon = np.zeros((pairs, CORNERS, 2))
    polygon[:, :3] = subject
    count = np.full(pairs, 3)
    turn = np.sign(_cross(window[:, 1] - window[:, 0], window[:, 2] - window[:, 0]))
    for i in range(3):
        start, end = window[:, i], window[:, (i + 1) % 3]
        polygon, count = _cut(polygon, count, start, turn[:, None] * (end - start))
    return polygon, count


def polygon_quadrature(
    polygon: Array, count: NDArray[np.int64], rule: tuple[Array, Array] = MIDDLES
) -> tuple[Array, Array]:
    """Points and weights on convex polygons, cut into triangles about their first corner.

    Args:
        polygon: corners, shape (pairs, 6, 2).
        count: corners that count, shape (pairs,).
        rule: points on the reference triangle, shape (q, 2), and weights of sum 1/2; edge middles
            if not given, exact for polynomials of degree two.

    Returns:
        Points, shape (pairs, 4 q, 2), and weights, shape (pairs, 4 q), zero where unused.
    """
    fan = np.arange(1, CORNERS - 1)
    a = np.repeat(polygon[:, :1], fan.size, axis=1)
    b, c = polygon[:, fan], polygon[:, fan + 1]
    twice = np.where(fan + 1 < count[:, None], np.abs(_cross(b - a, c - a)), 0.0)
    x, w = rule
    along, across = (v[:, :, None] for v in (b - a, c - a))
    points = a[:, :, None] + x[:, :1] * along + x[:, 1:] * across
    weights: Array = twice[:, :, None] * w
    shape = (len(polygon), fan.size * len(w))
    return np.asarray(points.reshape(*shape, 2), float), weights.reshape(shape)


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
