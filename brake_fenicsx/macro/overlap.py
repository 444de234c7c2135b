"""Quadrature on the common part of two faces whose meshes need not match.

Facets are cut into triangles between their corners, pairs of triangles are clipped in the plane of
the first face's facet, and every quadrature point is carried to the second face along the true
normal. On plane facets with straight edges the parts are exact; on curved ones the points are,
and the borders of the parts follow the chords.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from brake_fenicsx import compat

from .clip import MIDDLES, barycentric, clip_triangles, polygon_quadrature
from .faces import Face
from .projection import EDGE, project, search

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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

    pad: Index
    disc: Index
    on_pad: Array
    on_disc: Array
    weight: Array
    x: Array
    n: Array
    gap: Array

    def rows(self, chosen: Index) -> Overlap:
        """Some of the pairs."""
        return Overlap(*(getattr(self, f.name)[chosen] for f in fields(self)))


def facing_pairs(pad: Face, disc: Face, reach: float | None) -> Index:
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


def rule(pad: Face, disc: Face, test_degree: int) -> tuple[Array, Array]:
    """Quadrature that integrates test times shape functions.

    Exactly on straight triangles and parallelograms; to 1e-11 on plane quadrilaterals that are
    neither, where the shape functions are not polynomials of the position.
    """
    plane = bool(pad.straight.all() and disc.straight.all())
    if pad.element.corners == 3 and plane and not test_degree:
        return MIDDLES
    affine = pad.element.corners == 3 or (_parallelograms(pad) and _parallelograms(disc))
    if plane and not affine:
        return compat.triangle_rule(16)
    return compat.triangle_rule(6 if plane else 8)


def _parallelograms(face: Face) -> bool:
    """Whether all quadrilaterals are parallelograms."""
    a, b, c, d = np.moveaxis(face.corners, 1, 0)
    away = np.linalg.norm(a + c - b - d, axis=1)
    return bool(np.all(away < 1e-9 * np.linalg.norm(c - a, axis=1)))


def overlap(
    pad: Face, disc: Face, pairs: Index, points: tuple[Array, Array]
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
    found = [
        _clipped(pad, disc, pairs, one, two, points)
        for one in pad.element.triangles
        for two in disc.element.triangles
    ]
    whole = Overlap(*(np.concatenate([getattr(o, f.name) for o in found]) for f in fields(Overlap)))
    order = np.lexsort([whole.disc, whole.pad])
    return _handed_over(disc, pairs, whole.rows(order))


def _clipped(
    pad: Face,
    disc: Face,
    pairs: Index,
    one: tuple[int, int, int],
    two: tuple[int, int, int],
    points: tuple[Array, Array],
) -> Overlap:
    """Points on the common part of one triangle of each facet of the pairs."""
    i, j = pairs[:, 0], pairs[:, 1]
    first = pad.corners[:, 1] - pad.corners[:, 0]
    first /= np.linalg.norm(first, axis=1)[:, None]
    axes = np.stack([first, np.cross(pad.normal, first)], axis=2)[i]
    origin = pad.corners[i, :1]
    flat_pad = (pad.corners[i][:, one] - origin) @ axes
    flat_disc = (disc.corners[j][:, two] - origin) @ axes
    polygon, count = clip_triangles(flat_pad, flat_disc)
    common = count > 2
    i, j, flat_pad, flat_disc = i[common], j[common], flat_pad[common], flat_disc[common]
    flat, weight = polygon_quadrature(polygon[common], count[common], points)
    on_pad = barycentric(flat, flat_pad) @ pad.element.nodes[list(one)]
    on_disc = barycentric(flat, flat_disc) @ disc.element.nodes[list(two)]
    straight = pad.straight[i]
    if pad.element.corners == 4 and straight.any():
        k = i[straight]
        x = pad.corners[k, :1] + flat[straight] @ np.swapaxes(axes[common][straight], 1, 2)
        n = np.repeat(pad.normal[k][:, None], x.shape[1], axis=1)
        on_pad[straight] = project(pad, k, x, n, on_pad[straight])[0]
    x, n, ratio = pad.surface(i, on_pad)
    twice = np.abs(np.cross(flat_pad[:, 1] - flat_pad[:, 0], flat_pad[:, 2] - flat_pad[:, 0]))
    weight = np.where(straight[:, None], weight, weight * ratio / twice[:, None])
    on_disc, gap = project(disc, j, x, n, on_disc)
    return Overlap(i, j, on_pad, on_disc, weight, x, -n, gap)


def _handed_over(disc: Face, pairs: Index, found: Overlap) -> tuple[Overlap, Overlap]:
    """Points that lie outside the facet below their chord go to the facet that they meet."""
    away = (disc.element.outside(found.on_disc) > EDGE) & (found.weight > 0)
    row, point = np.nonzero(away)
    x, n = found.x[row, point], -found.n[row, point]
    start = np.searchsorted(pairs[:, 0], found.pad[row], "left")
    count = np.searchsorted(pairs[:, 0], found.pad[row], "right") - start
    owner = np.repeat(np.arange(row.size), count)
    inner = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    facet, local, gap, _ = search(disc, x, n, owner, pairs[np.repeat(start, count) + inner, 1])
    moved = Overlap(
        found.pad[row], facet, found.on_pad[row, point][:, None], local[:, None],
        found.weight[row, point][:, None], x[:, None], -n[:, None], gap[:, None],
    )  # fmt: skip
    stay = Overlap(
        found.pad, found.disc, found.on_pad, found.on_disc, np.where(away, 0.0, found.weight),
        found.x, found.n, found.gap,
    )  # fmt: skip
    return stay, moved
