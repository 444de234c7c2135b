"""Forces of the braking equilibrium on each pad: normal force, friction, torque, where they act.

The disc's material enters beneath the pad at the leading edge and leaves at the trailing one: the
sliding direction s, the disc's velocity relative to the pad, points from the first to the second.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brake_fenicsx.arguments import Array, Mask

from .contact_elements import Contact
from .sliding_friction import Motion, Rotation


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
    return PadForces(
        name, total, drag @ s, float(torque), float(radius), float(w[p[chosen] > 0].sum()),
        float(w.sum()), float(p[chosen].max()), centre, towards, leading,
        (float(edges[0]), float(edges[1])),
    )  # fmt: skip
