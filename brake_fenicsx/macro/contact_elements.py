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

Faces of an interface may stick. The law of the contact then acts along the normal, as everywhere,
and tangential springs before slip along the faces: every contact element of area w has the traction
k_t times its slip, that of the first face less that of the second,

    K <- K + sum w k_t (T'T + R'R),

in the equilibrium and in the modes, whether the element is open or not and however large its slip:
the state at equilibrium says where that is wrong, |k_t slip| > mu p (Coulomb) or p = 0.

Forces on each pad are the normal force, friction and torque of the equilibrium, and where they act.
The disc's material enters beneath the pad at the leading edge and leaves at the trailing one: the
sliding direction s, the disc's velocity relative to the pad, points from the first to the second.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Ints, Mask
from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.brake_mesh import Mesh

from .contact_forces import Motion, Rotation, slip_frame
from .elasticity import FreeDofs
from .faces import directions_across, gather_face
from .integrals import Integrals, facet_integrals, node_integrals


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
        raise SceneError(f"""contact: the faces {faces[0]!r} and {faces[1]!r} do not oppose each
            other anywhere""")
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
    one = np.zeros(parts.w.size, dtype=np.int64)
    return Contact(N, T, R, parts.w, parts.g0, parts.points, n, s, speed, one, parts.uncovered)


def _operator(size: tuple[int, int], row: Ints, columns: Ints, values: Array) -> sp.csr_matrix:
    """Sum of values at (row, column); held columns (-1) are left out."""
    held = columns < 0
    rows = np.repeat(row, columns.shape[1]).reshape(columns.shape)
    return sp.csr_matrix((values[~held], (rows[~held], columns[~held])), shape=size)


@dataclass(frozen=True, slots=True)
class Stuck:
    """Tangential springs of one interface.

    Attributes:
        T: slip along the first direction, CSR, shape (elements, free dofs).
        R: slip along the second one.
        contact: the elements; of their own T and R nothing is left.
        stiffness: k_t [Pa/m].
    """

    T: sp.csr_matrix
    R: sp.csr_matrix
    contact: Contact
    stiffness: float

    def matrix(self) -> sp.csr_matrix:
        """Stiffness of the springs on the free dofs [N/m]."""
        springs = sp.diags(self.contact.w * self.stiffness)
        return sum(A.T.tocsr() @ springs @ A for A in (self.T, self.R)).tocsr()

    def state(self, u: Array, p: Array, limit: float | None = None) -> "StuckState":
        """What the faces do at an equilibrium.

        Args:
            u: displacement [m], shape (free dofs,).
            p: pressures of these elements [Pa], shape (elements,).
            limit: friction coefficient up to which faces stick; None: none is known.
        """
        c, n = self.contact, self.contact.normal
        along, across = (-self.stiffness * (A @ u) for A in (self.T, self.R))
        traction = along[:, None] * c.s + across[:, None] * np.cross(n, c.s)
        is_open, beyond = p <= 0, np.zeros(p.shape, dtype=bool)
        if limit is not None:
            beyond = ~is_open & (np.hypot(along, across) > limit * p)
        return StuckState(is_open, beyond, c.w, (c.w * p) @ n, c.w @ traction)


@dataclass(frozen=True, slots=True)
class StuckState:
    """State of an interface whose faces stick.

    Attributes:
        is_open: whether an element carries no pressure, shape (elements,).
        beyond: whether a closed one has more than the friction coefficient times the pressure along
            the faces.
        w: areas [m^2].
        normal: normal force on the first face [N], shape (3,).
        tangential: force along the faces on it [N], shape (3,).
    """

    is_open: Mask
    beyond: Mask
    w: Array
    normal: Array
    tangential: Array

    def share(self, chosen: Mask) -> float:
        """Share of some elements in the area [-]."""
        return float(self.w[chosen].sum() / self.w.sum())


def stick(contact: Contact, stiffness: float) -> tuple[Contact, Stuck]:
    """An interface without slip operators, and the springs in their place.

    Args:
        contact: the interface, of faces without motion.
        stiffness: k_t [Pa/m].
    """
    none = sp.csr_matrix(contact.T.shape)
    bare = replace(contact, T=none, R=none)
    return bare, Stuck(contact.T, contact.R, bare, stiffness)


@dataclass(frozen=True, slots=True)
class PadForces:
    """What one pad carries.

    Attributes:
        name: the interface, and the side where it has two.
        normal: normal force [N].
        friction: friction force on the pad [N], shape (3,); its size is that of this vector.
        torque: moment of the friction on the disc about its axis against the rotation [N m]; nan
            without a rotation.
        effective_radius: torque over the sum of mu w p [m]; nan likewise.
        area: area of the elements in contact [m^2].
        nominal_area: area of all elements [m^2].
        largest_pressure: of an element [Pa].
        centre: centre of pressure [m], shape (3,).
        towards_leading: its distance from the middle of the face against s [m].
        leading_share: share of the normal force on the leading half of the face [-].
        edges: angle about the axis of leading and trailing edge [rad], or place along s [m].
    """

    name: str
    normal: float
    friction: Array
    torque: float
    effective_radius: float
    area: float
    nominal_area: float
    largest_pressure: float
    centre: Array
    towards_leading: float
    leading_share: float
    edges: tuple[float, float]


def pad_forces(
    contact: Contact, names: Sequence[str], motion: Motion, p: Array, mu: Array
) -> list[PadForces]:
    """Forces of an equilibrium, for each interface and side of the disc.

    Args:
        contact: contact elements of all interfaces.
        names: names of the interfaces.
        motion: of the disc.
        p: pressures [Pa], shape (elements,).
        mu: friction coefficients, shape (elements,).
    """
    forces = []
    for i, name in enumerate(names):
        # Faces that stick have no sliding direction, nor edges.
        sliding = (contact.interface == i) & (contact.speed > 0)
        axis = motion.frame[2] if isinstance(motion, Rotation) else np.eye(3)[2]
        top, name_of = contact.normal @ axis > 0, "z" if axis[2] == 1 else "axis"
        sides = [(f"{name_of} > 0", sliding & top), (f"{name_of} < 0", sliding & ~top)]
        two = all(side.any() for _, side in sides)
        for side, chosen in sides:
            if chosen.any():
                label = f"{name}, {side}" if two else name
                forces.append(_forces(contact, label, chosen, motion, p, mu))
    return forces


def _forces(
    contact: Contact, name: str, chosen: Mask, motion: Motion, p: Array, mu: Array
) -> PadForces:
    x, s, w = contact.points[chosen], contact.s[chosen], contact.w[chosen]
    force = w * p[chosen]
    drag = mu[chosen] * force
    total, middle = float(force.sum()), w @ x / w.sum()
    torque, radius = np.nan, np.nan
    if isinstance(motion, Rotation):
        sense, at, slip = np.sign(motion.speed), motion.local(x), s @ motion.frame.T
        torque = sense * float(drag @ (at[:, 0] * slip[:, 1] - at[:, 1] * slip[:, 0]))
        radius = torque / drag.sum() if drag.any() else np.nan
        # Arcs of the middle's radius, from the middle towards the trailing edge.
        one, two, _ = w @ at / w.sum()
        turn = np.angle((at[:, 0] + 1j * at[:, 1]) / (one + 1j * two))
        along = sense * turn * np.hypot(one, two)
        angles = turn + np.arctan2(two, one)
        edges = angles[along.argmin()], angles[along.argmax()]
    else:
        along = (x - middle) @ (w @ s / np.linalg.norm(w @ s))
        edges = along.min(), along.max()
    # Without pressure there is no centre of it.
    centre: Array = np.full(3, np.nan)
    towards, leading = np.nan, np.nan
    if total > 0:
        centre = np.asarray(force @ x / total, dtype=float)
        towards = -float(force @ along) / total
        leading = float(force[along < 0].sum() + 0.5 * force[along == 0].sum()) / total
    area, pressure = float(w[p[chosen] > 0].sum()), float(p[chosen].max())
    acting = name, total, drag @ s, float(torque), float(radius), area, float(w.sum()), pressure
    return PadForces(*acting, centre, towards, leading, (float(edges[0]), float(edges[1])))
