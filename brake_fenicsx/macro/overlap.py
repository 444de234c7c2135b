"""Quadrature on the common part of two faces whose meshes need not match.

Facets are cut into triangles between their corners, pairs of triangles are clipped in the plane of
the first face's facet, and every quadrature point is carried to the second face along the true
normal. On plane facets with straight edges the parts are exact; on curved ones the points are,
and the borders of the parts follow the chords.

Common part of pairs of triangles in a plane, in batches (Sutherland-Hodgman clipping).
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from brake_fenicsx import compat
from brake_fenicsx.arguments import Array, Index, Ints

from .faces import EDGE, Face, project, search

# A triangle cut by three half planes has six corners at most. Where corners coincide to rounding,
# edges may seem to cross a line more than twice: three cuts then make 4, 6 and 9 corners at most.
CORNERS = 9
# Middles of the edges of the reference triangle.
MIDDLES = (np.array([[0.5, 0.0], [0.5, 0.5], [0.0, 0.5]]), np.full(3, 1 / 6))


def clip_triangles(subject: Array, window: Array) -> tuple[Array, Ints]:
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
    count: Ints = np.full(pairs, 3)
    turn: Array = np.sign(_cross(window[:, 1] - window[:, 0], window[:, 2] - window[:, 0]))
    for i in range(3):
        start, end = window[:, i], window[:, (i + 1) % 3]
        polygon, count = _cut(polygon, count, start, turn[:, None] * (end - start))
    return polygon, count


def polygon_triangles(polygon: Array, count: Ints) -> tuple[Array, Index]:
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


def _cut(polygon: Array, count: Ints, start: Array, along: Array) -> tuple[Array, Ints]:
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


@dataclass(frozen=True, slots=True)
class Overlap:
    """Quadrature points of pairs of facets.

    Attributes:
        pad: facet of the first face, shape (pairs,).
        disc: facet of the second face, shape (pairs,).
        on_pad: reference points on the first, shape (pairs, points, 2).
        on_disc: reference points on the second, shape (pairs, points, 2).
        weight: areas [m^2], shape (pairs, points).
        x: positions on the first face [m], shape (pairs, points, 3).
        n: unit normals from the second to the first face, shape (pairs, points, 3).
        gap: distances [m], positive where open, shape (pairs, points).
    """

    pad: Ints
    disc: Ints
    on_pad: Array
    on_disc: Array
    weight: Array
    x: Array
    n: Array
    gap: Array

    def rows(self, chosen: Ints) -> "Overlap":
        """Some of the pairs."""
        return Overlap(*(getattr(self, f.name)[chosen] for f in fields(self)))


def facing_pairs(pad: Face, disc: Face, reach: float | None) -> Ints:
    """Facet pairs that may overlap: close, and with opposite outward normals; shape (pairs, 2).

    Args:
        pad: the first face.
        disc: the second face.
        reach: largest gap [m]; the largest facet size if None.
    """
    size = pad.radius.max() + disc.radius.max()
    size += size if reach is None else reach
    near = cKDTree(disc.centre).query_ball_point(pad.centre, size, return_sorted=True)
    first = np.repeat(np.arange(len(near)), [len(n) for n in near])
    second = np.array([j for n in near for j in n], dtype=np.int64)
    opposite = np.einsum("ij,ij->i", pad.normal[first], disc.normal[second]) < -0.1
    return np.stack([first[opposite], second[opposite]], axis=1)


def rule(pad: Face, disc: Face, test_degree: int, distorted: int = 16) -> tuple[Array, Array]:
    """Quadrature that integrates test times shape functions.

    Exactly on straight triangles and parallelograms; to 1e-11 on plane quadrilaterals that are
    hardly distorted, where the shape functions are not polynomials of the position. On strongly
    distorted ones degree 16 reaches 1e-7, degree 24 1e-10.

    Args:
        pad: the first face.
        disc: the second face.
        test_degree: of the test functions.
        distorted: degree of the rule for plane quadrilaterals that are no parallelograms.
    """
    plane = bool(pad.straight.all() and disc.straight.all())
    if pad.element.corners == 3 and plane and not test_degree:
        return MIDDLES
    affine = pad.element.corners == 3 or (_parallelograms(pad) and _parallelograms(disc))
    if plane and not affine:
        return compat.triangle_rule(distorted)
    return compat.triangle_rule(6 if plane else 8)


def _parallelograms(face: Face) -> bool:
    """Whether all quadrilaterals are parallelograms."""
    a, b, c, d = np.moveaxis(face.corners, 1, 0)
    away = np.linalg.norm(a + c - b - d, axis=1)
    return bool(np.all(away < 1e-9 * np.linalg.norm(c - a, axis=1)))


def overlap(
    pad: Face, disc: Face, pairs: Ints, points: tuple[Array, Array]
) -> tuple[Overlap, Overlap]:
    """Quadrature points on the common part of pairs of facets.

    Args:
        pad: the first face.
        disc: the second face.
        pairs: facets, shape (pairs, 2).
        points: rule on the reference triangle.

    Returns:
        The points of pairs that overlap; and, one to a row, those that a curved second face
        hands to a neighbour of the facet below the chord.
    """
    plane = _Plane(pad, pairs[:, 0])
    flat = plane.flat(pad, pairs[:, 0]), plane.flat(disc, pairs[:, 1])
    found = [
        _clipped(pad, disc, pairs, flat, one, two, points)
        for one in pad.element.triangles
        for two in disc.element.triangles
    ]
    whole = Overlap(*(np.concatenate([getattr(o, f.name) for o in found]) for f in fields(Overlap)))
    order = np.lexsort([whole.disc, whole.pad])
    return _handed_over(disc, pairs, whole.rows(order))


def _clipped(
    pad: Face,
    disc: Face,
    pairs: Ints,
    seen: tuple[Array, Array],
    one: tuple[int, int, int],
    two: tuple[int, int, int],
    points: tuple[Array, Array],
) -> Overlap:
    """Points on the common part of one triangle of each facet, their corners seen in its plane."""
    flat_pad, flat_disc = seen
    polygon, count = clip_triangles(flat_pad[:, one], flat_disc[:, two])
    triangles, owner = polygon_triangles(polygon, count)
    flat, weight = triangle_quadrature(triangles, points)
    i, j = pairs[owner].T
    flat_pad, flat_disc = flat_pad[owner], flat_disc[owner]
    on_pad = _local(flat, flat_pad, pad, i, one)
    on_disc = _local(flat, flat_disc, disc, j, two)
    x, n, ratio = pad.surface(i, on_pad)
    bent = np.flatnonzero(~pad.straight[i])
    if bent.size:
        a, b, c = np.moveaxis(flat_pad[bent][:, one], 1, 0)
        twice = np.abs(_cross(b - a, c - a))
        weight[bent] *= ratio[bent] / twice[:, None]
    gap = np.einsum("fqc,fqc->fq", disc.surface(j, on_disc)[0] - x, n)
    # On plane facets the points lie above each other already.
    bent = np.flatnonzero(~pad.straight[i] | ~disc.straight[j])
    if bent.size:
        on_disc[bent], gap[bent] = project(disc, j[bent], x[bent], n[bent], on_disc[bent])
    return Overlap(i, j, on_pad, on_disc, weight, x, -n, gap)


class _Plane:
    """The planes through the corners of some facets."""

    def __init__(self, face: Face, facet: Ints):
        first = face.corners[:, 1] - face.corners[:, 0]
        first /= np.linalg.norm(first, axis=1)[:, None]
        self.axes = np.stack([first, np.cross(face.normal, first)], axis=2)[facet]
        self.origin = face.corners[facet, :1]

    def flat(self, face: Face, facet: Ints) -> Array:
        """Corners of other facets seen along the normal, shape (rows, corners, 2)."""
        return np.asarray((face.corners[facet] - self.origin) @ self.axes)


def _local(flat: Array, corners: Array, face: Face, facet: Ints, chosen: tuple[int, ...]) -> Array:
    """Reference points: exact on plane facets, by the chord triangle on curved ones."""
    three = list(chosen)
    by_chord = np.asarray(barycentric(flat, corners[:, three]) @ face.element.nodes[three])
    plane = np.flatnonzero(face.straight[facet])
    if face.element.corners == 4 and plane.size:
        by_chord[plane] = bilinear(flat[plane], corners[plane])
    return by_chord


def _handed_over(disc: Face, pairs: Ints, found: Overlap) -> tuple[Overlap, Overlap]:
    """Points that lie outside the facet below their chord go to the facet that they meet."""
    away = (disc.element.outside(found.on_disc) > EDGE) & (found.weight > 0)
    row, point = np.nonzero(away)
    x, n = found.x[row, point], -found.n[row, point]
    start = np.searchsorted(pairs[:, 0], found.pad[row], "left")
    count = np.searchsorted(pairs[:, 0], found.pad[row], "right") - start
    owner = np.repeat(np.arange(row.size), count)
    inner = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    facet, local, gap, _ = search(disc, x, n, owner, pairs[np.repeat(start, count) + inner, 1])
    values = found.on_pad[row, point], local, found.weight[row, point], x, -n, gap
    moved = Overlap(found.pad[row], facet, *(value[:, None] for value in values))
    return replace(found, weight=np.where(away, 0.0, found.weight)), moved
