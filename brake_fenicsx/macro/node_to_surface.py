"""Node-to-surface contact: every node of the first face against its projection on the second."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .faces import Face
from .integrals import Integrals, facet_areas
from .projection import EDGE, search

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    sides: list[tuple[Index, Index, Array, Array]] = []
    for face, f, at in (
        (pad, facet[kept], pad.element.nodes[local[kept]]),
        (disc, met[kept], where[kept]),
    ):
        shape = face.element.shape(at)
        sides.append(
            (
                np.arange(kept.size, dtype=np.int64),
                face.columns[f],
                shape,
                shape[..., None] * n[:, None],
            )
        )
    uncovered = float(share.sum() - share[kept].sum())
    return Integrals(share[kept], gap[kept], x[kept], n, sides, uncovered)


def _tributaries(pad: Face) -> tuple[Index, Index, Array, Array]:
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
