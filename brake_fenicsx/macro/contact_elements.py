"""Contact elements between two faces whose meshes need not match: gap and slip as sparse operators.

"patch": one element per facet of the first face (the pad). Gap and slip are means over the part of
the facet above the second face (the disc), integrated over the clipped common facets with the
shape functions of both sides; a uniform pressure is passed exactly.
"quadrature": one element per Gauss point of the facet; gap and slip are weighted with the Lagrange
functions of these points over the same common facets. A pressure linear on the facet is passed
exactly. A facet that the other face covers in part keeps one element.
"node": one element per node of the first face, projected on the second along the normal, with the
share of the area around the node. It does not pass a uniform pressure exactly.

n points from disc to pad, a positive gap is open, and slip is pad minus disc.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Ints, Mask
from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.brake_mesh import Mesh

from .elasticity import FreeDofs
from .faces import gather_face
from .integrals import Integrals, facet_integrals, node_integrals
from .projection import directions_across
from .sliding_friction import Motion, slip_frame


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact elements of one or several interfaces; the same on every process.

    Attributes:
        N: normal gap, g = g0 + N u, CSR, shape (elements, free dofs) [-].
        T: slip of pad minus disc along s, CSR; zero where the faces stick.
        R: slip across s, CSR; likewise.
        w: areas [m^2], shape (elements,).
        g0: gap of the undeformed bodies [m], shape (elements,).
        points: centres of the elements [m], shape (elements, 3).
        normal: unit normals from disc to pad, shape (elements, 3).
        s: sliding directions, shape (elements, 3).
        speed: sliding speeds V [m/s], shape (elements,); zero where the faces stick.
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
    interface: Ints
    uncovered: float

    def gap(self, u: Array) -> Array:
        """Normal gap of a displacement, g = g0 + N u [m], Eq. (8)."""
        return np.asarray(self.g0 + self.N @ u)


def contact_elements(
    mesh: Mesh,
    free: FreeDofs,
    faces: tuple[str, str],
    motion: Motion | None,
    discretisation: str = "patch",
    reach: float | None = None,
    comm: MPI.Comm | None = None,
) -> Contact:
    """Contact elements of two faces; virtual work of contact is the sum of w p N v, Eq. (12).

    Args:
        mesh: the tagged mesh.
        free: numbering of the free dofs.
        faces: names of the pad's and of the disc's face.
        motion: motion of the disc relative to the pad; None: none, s is any direction then.
        discretisation: "patch", "quadrature" or "node".
        reach: largest gap at which facets are paired [m]; the largest facet size if not given.
        comm: processes that share the integrals; this process alone if None.

    Returns:
        The contact elements, the same on every process.

    Raises:
        SceneError: unknown face, or faces that lie nowhere opposite to each other.
    """
    comm = MPI.COMM_SELF if comm is None else comm
    pad, disc = (gather_face(mesh, free, face) for face in faces)
    if discretisation == "node":
        parts = node_integrals(pad, disc, reach)
    else:
        parts = facet_integrals(pad, disc, reach, discretisation == "quadrature", comm)
    if not parts.w.size or parts.w.sum() <= 0:
        raise SceneError(
            f"contact: the faces {faces[0]!r} and {faces[1]!r} do not oppose each other anywhere"
        )
    return _elements(parts, free.size, motion)


def join(contacts: Sequence[Contact]) -> Contact:
    """Contact elements of several interfaces as one, numbered in order."""
    names = ("w", "g0", "points", "normal", "s", "speed")
    parts: dict[str, Any] = {n: np.concatenate([getattr(c, n) for c in contacts]) for n in names}
    parts |= {n: sp.vstack([getattr(c, n) for c in contacts]).tocsr() for n in "NTR"}
    parts["interface"] = np.concatenate([np.full(len(c.w), i) for i, c in enumerate(contacts)])
    return Contact(**parts, uncovered=sum(c.uncovered for c in contacts))


def restricted(contact: Contact, kept: Mask) -> Contact:
    """Some elements of an interface; the others count as uncovered.

    Args:
        contact: the interface.
        kept: which of its elements are kept, shape (elements,).
    """
    names = ("w", "g0", "points", "normal", "s", "speed", "interface", "N", "T", "R")
    parts: dict[str, Any] = {n: getattr(contact, n)[kept] for n in names}
    return Contact(**parts, uncovered=contact.uncovered + float(contact.w[~kept].sum()))


def _elements(parts: Integrals, dofs: int, motion: Motion | None) -> Contact:
    """Gap and slip operators."""
    n = parts.normal / np.linalg.norm(parts.normal, axis=1)[:, None]
    if motion is None:
        s, r = np.moveaxis(directions_across(n), 1, 0)
        speed: Array = np.zeros(len(n))
    else:
        s, r, speed = slip_frame(motion, parts.points, n)
    size = (parts.w.size, dofs)
    N, T, R = (sp.csr_matrix(size) for _ in range(3))
    for sign, (row, columns, weight, normal) in zip((1.0, -1.0), parts.sides, strict=True):
        for c in range(3):
            N = N + sign * _operator(size, row, columns[..., c], normal[..., c])
            jump = sign * _operator(size, row, columns[..., c], weight)
            T, R = T + sp.diags(s[:, c]) @ jump, R + sp.diags(r[:, c]) @ jump
    N, T, R = (A.tocsr() for A in (N, T, R))
    return Contact(
        N, T, R, parts.w, parts.g0, parts.points, n, s, speed,
        np.zeros(parts.w.size, dtype=np.int64), parts.uncovered,
    )  # fmt: skip


def _operator(size: tuple[int, int], row: Ints, columns: Ints, values: Array) -> sp.csr_matrix:
    """Sum of values at (row, column); held columns (-1) are left out."""
    held = columns < 0
    rows = np.repeat(row, columns.shape[1]).reshape(columns.shape)
    return sp.csr_matrix((values[~held], (rows[~held], columns[~held])), shape=size)
