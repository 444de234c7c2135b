"""Contact elements between two faces whose meshes need not match: gap and slip as sparse operators.

Discretisation "patch": one element per facet of the first face (the pad). Gap and slip are means
over the part of the facet above the second face (the disc), integrated over the clipped
common triangles with the shape functions of both sides; a uniform pressure is passed exactly.

n points from disc to pad, a positive gap is open, and slip is pad minus disc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from brake_fenicsx.errors import SceneError

from .clip import barycentric, clip_triangles, polygon_quadrature, shape_functions
from .elasticity import FreeDofs
from .faces import Face, gather_face
from .friction import Motion, slip_frame
from .mesh import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact elements of one or several interfaces; the same on every process.

    Attributes:
        N: normal gap, g = g0 + N u, CSR, shape (elements, free dofs) [-].
        T: slip of pad minus disc along s, CSR.
        R: slip across s, CSR.
        w: areas [m^2], shape (elements,).
        g0: gap of the undeformed bodies [m], shape (elements,).
        points: centres of the elements [m], shape (elements, 3).
        normal: unit normals from disc to pad, shape (elements, 3).
        s: sliding directions, shape (elements, 3).
        speed: sliding speeds V [m/s], shape (elements,).
        interface: number of the interface of each element, shape (elements,).
        uncovered: area [m^2] of the first faces that has no partner.
    """

    N: sp.csr_matrix
    T: sp.csr_matrix
    R: sp.csr_matrix
    w: Array
    g0: Array
    points: Array
    normal: Array
    s: Array
    speed: Array
    interface: NDArray[np.int64]
    uncovered: float

    def gap(self, u: Array) -> Array:
        """Normal gap of a displacement, g = g0 + N u [m], Eq. (7)."""
        return np.asarray(self.g0 + self.N @ u)


def patch_contact(
    mesh: Mesh,
    free: FreeDofs,
    faces: tuple[str, str],
    motion: Motion,
    search: float | None = None,
) -> Contact:
    """Contact elements on the facets of the first face, the sum over elements of Eq. (15).

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs, degree 2.
        faces: names of the pad's and of the disc's face.
        motion: motion of the disc relative to the pad.
        search: largest gap at which facets are paired [m]; the largest facet size if not given.

    Returns:
        The contact elements.

    Raises:
        SceneError: unknown face, or faces that lie nowhere opposite to each other.
    """
    pad, disc = (gather_face(mesh, free, face) for face in faces)
    pairs = _facing_pairs(pad, disc, search)
    frame = _plane_axes(pad)
    comm = mesh.domain.comm
    share = np.array_split(np.arange(len(pairs)), comm.size)[comm.rank]
    parts = comm.allgather(_integrate_pairs(pad, disc, frame, pairs[share]))
    whole: list[NDArray] = [np.concatenate(column) for column in zip(*parts, strict=True)]
    element = whole[0]
    common, weight_pad, weight_disc, opening, where = whole[1:]
    if common.sum() <= 0:
        raise SceneError(
            f"contact: {faces[0]!r} and {faces[1]!r} lie nowhere opposite to each other"
        )
    area: Array = np.asarray(np.bincount(element, common, minlength=len(pad.corners)), float)
    kept = np.flatnonzero(area > 1e-6 * pad.area)
    number = np.full(len(pad.corners), -1)
    number[kept] = np.arange(kept.size)
    w = area[kept]

    def mean(values: Array) -> Array:
        return np.bincount(element, values, minlength=len(pad.corners))[kept] / w

    used = number[element] >= 0
    rows, partner = number[element][used], pairs[:, 1][used]
    jump = _jump_operators(
        rows, w, kept.size, free.size,
        ((pad.columns[element[used]], weight_pad[used]),
         (disc.columns[partner], -weight_disc[used])),
    )  # fmt: skip
    points = np.stack([mean(where[:, c]) for c in range(3)], axis=1)
    normal = -pad.normal[kept]
    s, r, speed = slip_frame(motion, points, normal)
    N, T, R = (sum(sp.diags(d[:, c]) @ jump[c] for c in range(3)).tocsr() for d in (normal, s, r))
    return Contact(
        N, T, R, w, mean(opening), points, normal, s, speed,
        np.zeros(kept.size, dtype=np.int64), float(pad.area.sum() - w.sum()),
    )  # fmt: skip


def join(contacts: Sequence[Contact]) -> Contact:
    """Contact elements of several interfaces as one, numbered in order."""
    names = ("w", "g0", "points", "normal", "s", "speed")
    parts: dict[str, Any] = {n: np.concatenate([getattr(c, n) for c in contacts]) for n in names}
    parts |= {n: sp.vstack([getattr(c, n) for c in contacts]).tocsr() for n in "NTR"}
    parts["interface"] = np.concatenate([np.full(len(c.w), i) for i, c in enumerate(contacts)])
    return Contact(**parts, uncovered=sum(c.uncovered for c in contacts))


def _plane_axes(pad: Face) -> tuple[Array, Array]:
    """Two unit vectors in the plane of each facet, shape (facets, 3) each."""
    first = pad.corners[:, 1] - pad.corners[:, 0]
    first = first / np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(pad.normal, first)


def _facing_pairs(pad: Face, disc: Face, search: float | None) -> NDArray[np.int64]:
    """Facet pairs that may overlap: close, and with opposite outward normals; shape (pairs, 2)."""
    reach = pad.radius.max() + disc.radius.max()
    reach += reach if search is None else search
    tree = cKDTree(disc.centre)
    near = tree.query_ball_point(pad.centre, reach, return_sorted=True)
    first = np.repeat(np.arange(len(near)), [len(n) for n in near])
    second = np.array([j for n in near for j in n], dtype=np.int64)
    opposite = np.einsum("ij,ij->i", pad.normal[first], disc.normal[second]) < -0.1
    return np.stack([first[opposite], second[opposite]], axis=1)


def _integrate_pairs(
    pad: Face, disc: Face, frame: tuple[Array, Array], pairs: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Array, Array, Array, Array, Array]:
    """Integrals over the common part of each pair, seen along the pad facet's normal.

    Returns:
        Pad facet, common area [m^2], integrals of the six pad and of the six disc shape functions
        [m^2], integral of the gap [m^3] and of the position on the pad [m^3], one row per pair.
    """
    i, j = pairs[:, 0], pairs[:, 1]
    origin, axes = pad.corners[i, :1], np.stack([frame[0][i], frame[1][i]], axis=2)
    flat_pad = (pad.corners[i] - origin) @ axes
    flat_disc = (disc.corners[j] - origin) @ axes
    polygon, count = clip_triangles(flat_pad, flat_disc)
    x, weight = polygon_quadrature(polygon, count)
    bary_pad, bary_disc = barycentric(x, flat_pad), barycentric(x, flat_disc)
    on_pad, on_disc = bary_pad @ pad.corners[i], bary_disc @ disc.corners[j]
    gap = -np.einsum("pqc,pc->pq", on_pad - on_disc, pad.normal[i])
    return (
        i,
        weight.sum(axis=1),
        np.einsum("pq,pqa->pa", weight, shape_functions(bary_pad)),
        np.einsum("pq,pqa->pa", weight, shape_functions(bary_disc)),
        np.einsum("pq,pq->p", weight, gap),
        np.einsum("pq,pqc->pc", weight, on_pad),
    )


def _jump_operators(
    rows: NDArray[np.int64],
    w: Array,
    elements: int,
    dofs: int,
    sides: Sequence[tuple[NDArray[np.int64], Array]],
) -> list[sp.csr_matrix]:
    """Mean displacement of pad minus disc, one operator per component x, y, z."""
    operators = []
    for c in range(3):
        total = sp.csr_matrix((elements, dofs))
        for columns, weights in sides:
            col = columns[:, :, c]
            row = np.repeat(rows, col.shape[1]).reshape(col.shape)
            held = col < 0
            values = weights / w[row]
            entries = (values[~held], (row[~held], col[~held]))
            total = total + sp.csr_matrix(entries, shape=(elements, dofs))
        operators.append(total)
    return operators
