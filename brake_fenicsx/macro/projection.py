"""Normal search: where the ray along a normal meets a face, exact for facets of degree two."""

import numpy as np

from brake_fenicsx.arguments import Array, Ints

from .faces import Face

# Reference coordinates of a point inside a facet, up to this.
EDGE = 1e-8


def directions_across(n: Array) -> Array:
    """Unit vectors s and n x s perpendicular to each n, shape (..., 3) to (..., 2, 3)."""
    axis = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    first = np.cross(n, axis)
    first /= np.linalg.norm(first, axis=-1)[..., None]
    return np.stack([first, np.cross(n, first)], axis=-2)


def project(face: Face, facet: Ints, x: Array, n: Array, start: Array) -> tuple[Array, Array]:
    """Reference points at which rays meet given facets, by Newton's iteration.

    Args:
        face: the face.
        facet: a facet for each row, shape (rows,).
        x: origins of the rays [m], shape (rows, points, 3).
        n: unit directions, same shape.
        start: first guess, shape (rows, points, 2).

    Returns:
        Reference points, shape (rows, points, 2), which may lie outside the facet, and distances
        along n [m], shape (rows, points).
    """
    across = directions_across(n)
    nodes, local = face.nodes[facet], start.copy()
    for _ in range(30):
        away = np.einsum("fqa,fac->fqc", face.element.shape(local), nodes) - x
        tangent = np.einsum("fqad,fac->fqcd", face.element.gradient(local), nodes)
        J, r = across @ tangent, np.einsum("fqkc,fqc->fqk", across, away)
        det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
        det = np.where(det == 0.0, np.inf, det)
        step = np.stack(
            [
                J[..., 1, 1] * r[..., 0] - J[..., 0, 1] * r[..., 1],
                J[..., 0, 0] * r[..., 1] - J[..., 1, 0] * r[..., 0],
            ],
            axis=-1,
        )
        # A ray that misses the facet by far needs no more than to stay outside.
        step = np.clip(step / det[..., None], -0.5, 0.5)
        local = np.clip(local - step, -1.0, 2.0)
        inside = face.element.outside(local) < 0.5
        if np.abs(step[inside]).max(initial=0.0) < 1e-13:
            break
    away = np.einsum("fqa,fac->fqc", face.element.shape(local), nodes) - x
    return local, np.asarray(np.einsum("fqc,fqc->fq", away, n))


def search(
    face: Face, x: Array, n: Array, point: Ints, facet: Ints
) -> tuple[Ints, Array, Array, Array]:
    """The facet of each point's candidates that its ray meets.

    Args:
        face: the face.
        x: points [m], shape (points, 3).
        n: unit directions of the rays, same shape.
        point: a point for each candidate, shape (candidates,).
        facet: the candidate.

    Returns:
        For each point its facet (-1: no candidate), reference points, shape (points, 2), distances
        [m], and how far outside the facet the ray passes, in reference coordinates.
    """
    middle = face.element.nodes[: face.element.corners].mean(axis=0)
    start = np.broadcast_to(middle, (point.size, 1, 2))
    local, gap = project(face, facet, x[point][:, None], n[point][:, None], start)
    local, gap = local[:, 0], gap[:, 0]
    outside = face.element.outside(local)
    # Of those met take the nearest, of those missed the least missed.
    miss = np.where(outside <= EDGE, 0.0, outside)
    order = np.lexsort([facet, np.abs(gap), miss, point])
    first = order[np.unique(point[order], return_index=True)[1]]
    found = np.full(len(x), -1, dtype=np.int64)
    where, distance, missed = np.zeros((len(x), 2)), np.zeros(len(x)), np.full(len(x), np.inf)
    hit = point[first]
    found[hit], where[hit], distance[hit] = facet[first], local[first], gap[first]
    missed[hit] = outside[first]
    return found, where, distance, missed
