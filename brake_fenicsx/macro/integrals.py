"""Means of gap and slip over the common part of two faces, as weights of their nodes.

Or, node to surface: every node of the first face against its projection on the second.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import roots_sh_legendre

from brake_fenicsx.arguments import Array, Ints, Mask

from .faces import EDGE, Face, search
from .overlap import Overlap, facing_pairs, overlap, rule

# Gauss points of the pressure on a facet.
GAUSS = {
    3: np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]]),
    4: 0.5 + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(12),
}


@dataclass(frozen=True, slots=True)
class Integrals:
    """What the contact elements measure, before the sliding direction is known.

    Attributes:
        w: areas [m^2], shape (elements,).
        g0: mean gaps [m].
        points: mean positions on the first face [m], shape (elements, 3).
        normal: sums of normals from the second to the first face, any length.
        sides: for each face (element, columns, weights, weights times normal) of the mean
            displacement, shapes (rows,), (rows, nodes, 3), (rows, nodes), (rows, nodes, 3).
        uncovered: area [m^2] of the first face that has no partner.
    """

    w: Array
    g0: Array
    points: Array
    normal: Array
    sides: list[tuple[Ints, Ints, Array, Array]]
    uncovered: float


def facet_integrals(
    pad: Face, disc: Face, reach: float | None, linear: bool, comm: MPI.Comm
) -> Integrals:
    """One element per facet of the first face, or one per Gauss point of the facet.

    Args:
        pad: the first face.
        disc: the second face.
        reach: largest gap at which facets are paired [m]; the largest facet size if None.
        linear: pressures linear on a facet, given by their values at its Gauss points.
        comm: processes that share the facets of the first face.

    Returns:
        The integrals, the same on every process.
    """
    pairs = facing_pairs(pad, disc, reach)
    count = len(pad.nodes)
    # All partners of a facet together: a point may be handed from one to another.
    ends = np.searchsorted(pairs[:, 0], np.linspace(0, count, comm.size + 1).round())
    points = rule(pad, disc, int(linear))
    batches = overlap(pad, disc, pairs[ends[comm.rank] : ends[comm.rank + 1]], points)
    own = sum(np.bincount(o.pad, o.weight.sum(axis=1), minlength=count) for o in batches)
    covered = np.sum(comm.allgather(own), axis=0)
    area = facet_areas(pad)
    tests = _Tests(pad, linear, covered > (1 - 1e-9) * area)
    found = comm.allgather([_integrate(pad, disc, o, tests) for o in batches])
    flat = [part[k] for k in range(len(batches)) for part in found]
    row, w, opening, where, normal, *rest = map(np.concatenate, zip(*flat, strict=True))
    on_pad, pad_normal, on_disc, disc_normal, facet_pad, facet_disc = rest
    size = count * tests.functions

    def total(values: Array) -> Array:
        return np.asarray(np.bincount(row, values, minlength=size), float)

    whole = total(w)
    kept = np.flatnonzero(whole > 1e-6 * np.repeat(area, tests.functions))
    number = np.full(size, -1)
    number[kept] = np.arange(kept.size)
    used = number[row] >= 0
    element, scale = number[row[used]], 1 / whole[row[used]][:, None]
    both = (pad, facet_pad, on_pad, pad_normal), (disc, facet_disc, on_disc, disc_normal)
    sides = [
        (element, face.columns[facet[used]], v[used] * scale, m[used] * scale[..., None])
        for face, facet, v, m in both
    ]
    mean = [np.stack([total(v[:, c])[kept] for c in range(3)], axis=1) for v in (where, normal)]
    w = whole[kept]
    left = float(area.sum() - w.sum())
    return Integrals(w, total(opening)[kept] / w, mean[0] / w[:, None], mean[1], sides, left)


def node_integrals(pad: Face, disc: Face, reach: float | None) -> Integrals:
    """One element per node of the first face that meets the second along its normal.

    Args:
        pad: the first face.
        disc: the second face.
        reach: largest gap [m]; the largest facet size if None.

    Returns:
        Values at the nodes in the place of means; the areas are the nodes' shares.
    """
    facet, local, share, normal = _tributaries(pad)
    x = pad.nodes[facet, local]
    size = disc.radius.max() + (2 * pad.radius.max() if reach is None else reach)
    near = cKDTree(disc.centre).query_ball_point(x, size, return_sorted=True)
    point = np.repeat(np.arange(len(x)), [len(c) for c in near])
    candidate = np.array([j for c in near for j in c], dtype=np.int64)
    facing = np.einsum("ij,ij->i", normal[point], disc.normal[candidate]) < -0.1
    met, where, gap, miss = search(disc, x, normal, point[facing], candidate[facing])
    kept = np.flatnonzero((met >= 0) & (miss <= 100 * EDGE))
    n = -normal[kept]
    sides: list[tuple[Ints, Ints, Array, Array]] = []
    for face, f, at in (
        (pad, facet[kept], pad.element.nodes[local[kept]]),
        (disc, met[kept], where[kept]),
    ):
        shape, row = face.element.shape(at), np.arange(kept.size)
        sides.append((row, face.columns[f], shape, shape[..., None] * n[:, None]))
    uncovered = float(share.sum() - share[kept].sum())
    return Integrals(share[kept], gap[kept], x[kept], n, sides, uncovered)


def _tributaries(pad: Face) -> tuple[Ints, Ints, Array, Array]:
    """Every node once: a facet that holds it, its place there, its area [m^2], mean normal."""
    places = pad.element.nodes
    _, n, _ = pad.everywhere(places)
    area = facet_areas(pad)[:, None] * pad.element.tributary
    _, first, inverse = np.unique(pad.number, return_index=True, return_inverse=True)
    # In the order of the facets.
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    node = rank[inverse.reshape(-1)]
    share: Array = np.bincount(node, area.reshape(-1)).astype(float)
    weighted = (area[..., None] * n).reshape(-1, 3)
    normal = np.stack([np.bincount(node, weighted[:, c]) for c in range(3)], axis=1)
    facet, local = np.divmod(first[order], len(places))
    return facet, local, share, normal / np.linalg.norm(normal, axis=1)[:, None]


def facet_rule(corners: int) -> tuple[Array, Array]:
    """Points on a reference facet, shape (points, 2), and weights, for what is no polynomial."""
    x, w = roots_sh_legendre(8)
    grid: Array = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    weight: Array = np.outer(w, w).reshape(-1)
    if corners == 3:
        weight = weight * (1 - grid[:, 0])
        grid = np.stack([grid[:, 0], grid[:, 1] * (1 - grid[:, 0])], axis=1)
    return grid, weight


def facet_areas(face: Face) -> Array:
    """True areas of the facets [m^2], shape (facets,)."""
    if face.element.corners == 3 and face.straight.all():
        one, two = (face.corners[:, k] - face.corners[:, 0] for k in (1, 2))
        return 0.5 * np.linalg.norm(np.cross(one, two), axis=1)
    grid, weight = facet_rule(face.element.corners)
    return np.asarray(face.everywhere(grid)[2] @ weight)


@dataclass(frozen=True, slots=True)
class _Tests:
    """Functions that gap and slip are weighted with: a constant, or Lagrange at Gauss points."""

    pad: Face
    linear: bool
    whole: Mask

    @property
    def functions(self) -> int:
        """Elements per facet."""
        return self.pad.element.corners if self.linear else 1

    def __call__(self, facet: Ints, x: Array) -> Array:
        """Values at reference points x, shape (pairs, points, functions)."""
        if not self.linear:
            return np.ones((*x.shape[:2], 1))
        x0, corners = GAUSS[self.pad.element.corners], self.pad.element.corners
        powers = [np.ones_like(x[..., 0]), x[..., 0], x[..., 1], x[..., 0] * x[..., 1]][:corners]
        at = np.stack([np.ones(corners), x0[:, 0], x0[:, 1], x0[:, 0] * x0[:, 1]][:corners])
        values = np.stack(powers, axis=-1) @ np.linalg.inv(at.T)
        values[~self.whole[facet]] = np.eye(corners)[0]
        return values


def _integrate(pad: Face, disc: Face, o: Overlap, tests: _Tests) -> tuple[Any, ...]:
    """Integrals over each pair and test function, one row each.

    Returns:
        Row, area [m^2], integrals of gap, position and normal, of the shape functions of both
        sides and of the same times the normal, and both facets.
    """
    psi = o.weight[..., None] * tests(o.pad, o.on_pad)
    a = tests.functions
    rows = (o.pad[:, None] * a + np.arange(a)).reshape(-1)
    both = []
    for face, x in ((pad, o.on_pad), (disc, o.on_disc)):
        weighted = np.einsum("pqa,pqm->pqam", psi, face.element.shape(x))
        both += [weighted.sum(axis=1), np.einsum("pqam,pqc->pamc", weighted, o.n)]
    vectors = [np.einsum("pqa,pqc->pac", psi, v) for v in (o.x, o.n)]
    integrals = [psi.sum(axis=1), np.einsum("pqa,pq->pa", psi, o.gap), *vectors, *both]
    flat = [v.reshape(rows.size, *v.shape[2:]) for v in integrals]
    return rows, *flat, np.repeat(o.pad, a), np.repeat(o.disc, a)
