"""Common part of pairs of triangles in a plane, in batches (Sutherland-Hodgman clipping)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A triangle cut by three half planes has six corners at most.
CORNERS = 6


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


def polygon_quadrature(polygon: Array, count: NDArray[np.int64]) -> tuple[Array, Array]:
    """Points and weights on convex polygons, exact for polynomials of degree two.

    Args:
        polygon: corners, shape (pairs, 6, 2).
        count: corners that count, shape (pairs,).

    Returns:
        Points, shape (pairs, 12, 2), and weights, shape (pairs, 12), zero where unused.
    """
    fan = np.arange(1, CORNERS - 1)
    a = np.repeat(polygon[:, :1], fan.size, axis=1)
    b, c = polygon[:, fan], polygon[:, fan + 1]
    area = 0.5 * np.abs(_cross(b - a, c - a)) * (fan + 1 < count[:, None])
    points = np.stack([0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)], axis=2)
    weights = np.repeat(area[:, :, None] / 3, 3, axis=2)
    shape = (len(polygon), 3 * fan.size)
    return points.reshape(*shape, 2), weights.reshape(shape)


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


def shape_functions(bary: Array) -> Array:
    """Quadratic Lagrange functions on a triangle: corners, then middles of edges 12, 02, 01.

    Args:
        bary: barycentric coordinates, shape (..., 3).

    Returns:
        Shape (..., 6).
    """
    corner = bary * (2 * bary - 1)
    edge = 4 * np.stack(
        [bary[..., 1] * bary[..., 2], bary[..., 0] * bary[..., 2], bary[..., 0] * bary[..., 1]],
        axis=-1,
    )
    return np.concatenate([corner, edge], axis=-1)


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
