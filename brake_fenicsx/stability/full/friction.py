"""All modes of a large undamped problem with friction, and their number on the interface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.memory import give_back

from ..interface import MORE_ORDERS, Inverse, moments
from ..vectors import RIM, matched, with_conjugates
from .arnoldi import nearest_modes
from .completeness import opening
from .problem import MARGIN, Found, Problem, agree, search_region
from .symmetric import shifted_factor, symmetric_modes
from .winding import Seen, prove, seen_modes

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# The frictionless modes are complete up to this multiple of the band's highest frequency.
CUTOFF = 1.6

# Interface columns of process 0, which also finds the frictionless modes, relative to the others'.
FIRST_SHARE = 0.1


def friction_modes(p: Problem, low: float, high: float, zeta_max: float) -> Found | None:
    """Block Arnoldi from either side, and the proof.

    Args:
        p: the problem; its friction is an interface.
        low: lower end of the band [1/s^2].
        high: upper end [1/s^2].
        zeta_max: largest damping ratio looked for.

    Returns:
        The modes of the band and a little more; None where the method does not apply.

    Raises:
        NotConverged: an iteration fails.
        InaccurateResult: left and right eigenvalues or the count differ.
    """
    shifted = shifted_factor(p.smooth, p.M, high)
    face = p.face
    if shifted is None or face is None:
        return None
    factor, sigma = shifted
    smooth: Seen | BrakeError | None = None
    if p.comm.rank == 0:
        # Meanwhile the other processes begin with the interface.
        try:
            modes = symmetric_modes(p.smooth, p.M, factor, sigma, CUTOFF**2 * high)
            smooth = None if modes is None else seen_modes(modes, face)
        except BrakeError as error:
            smooth = error
    seen = moments(factor, p.M, face, p.comm, FIRST_SHARE if p.comm.size > 1 else 1.0)
    smooth = p.comm.bcast(smooth)
    if smooth is None:
        return None
    if isinstance(smooth, BrakeError):
        raise smooth
    inverse = Inverse(factor, face, seen.RL[0])
    reach = (1 + MARGIN) * high * np.hypot(1, opening(zeta_max) * (1 + MARGIN)) + 3e-3 * high
    kappa, right, left, steps = _both_sides(p, inverse, smooth, reach)
    region = search_region(kappa, low, high, zeta_max)
    proof = prove(smooth, face, seen, region, kappa, p.comm)
    if not proof.rest < 1:
        # Stiff contact: more of what the kept modes leave out is needed.
        seen = moments(factor, p.M, face, p.comm, orders=MORE_ORDERS)
        proof = prove(smooth, face, seen, region, kappa, p.comm)
    factor.destroy()
    agree(int(region.holds(kappa).sum()), proof.count, high, "the winding number")
    proven = "" if proof.rest < 1 else "; not proven, it should be below 1"
    how = (
        f"inertia without friction, winding number of {face.rank} contact elements"
        f" (rest {proof.rest:.1g}{proven})"
    )
    return Found(kappa, right, left, how, steps)


def _both_sides(
    p: Problem, inverse: Inverse, smooth: Seen, reach: float
) -> tuple[Complex, Complex, Complex, int]:
    """Right and left eigenpairs, conjugates included; on two processes side by side."""
    expected = int(np.sum(smooth.kappa <= reach)) + 1
    sides = []
    for side in (False, True):
        if p.comm.size == 1 or p.comm.rank == int(side):
            apply = lambda b, side=side: inverse(p.M @ b, side)  # noqa: E731
            sides.append(nearest_modes(apply, p.M.shape[0], smooth.sigma, RIM * reach, expected))
            give_back()
    if p.comm.size > 1:
        sides = [p.comm.bcast(sides[0] if p.comm.rank == i else None, root=i) for i in (0, 1)]
    (kappa, right, steps), (other, left, more) = sides
    # Both of each pair: round-off splits a true doublet into a pair on one side alone.
    (kappa, right), (other, left) = with_conjugates(kappa, right), with_conjugates(other, left)
    i, j = matched(kappa, other, smooth.sigma, reach)
    return kappa[i], right[:, i], left[:, j].conj(), steps + more
