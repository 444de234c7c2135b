"""Static compliance of the contact elements, on springs that hold bodies which are free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from .component import AtPoint
from .moments import SIGMA, Rows
from .placed import Placed

Array = NDArray[np.float64]


def static_compliance(
    bodies: Sequence[Placed],
    views: Sequence[AtPoint],
    D0: Array,
    rows: Rows,
    omega: float,
) -> tuple[Array, Array, Array]:
    """N K0^-1 N', N K0^-1 T' and N K0^-1 F' of K0 = K + N' D0 N.

    With d = sqrt(D0) and H = I + d NN d, symmetric and positive definite, the gaps of the bodies
    without their kept modes are (I - H^-1) / d d', H^-1 d NT / d and H^-1 d NF / d; the kept modes,
    rigid ones among them, are held by the springs.

    Args:
        bodies: the bodies of the brake.
        views: each of them at a point of the box.
        D0: stiffness of the springs [N/m], shape (elements,), positive.
        rows: blocks of contact rows.
        omega: end of the band [rad/s].

    Returns:
        Shapes (elements, elements) twice and (elements, loads) [m/N].

    Raises:
        InaccurateResult: H is not positive definite.
    """
    n, size = D0.size, bodies[-1].modes.stop
    loads = bodies[0].component.body.loads.shape[1]
    NN, NT, NF = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, loads))
    A = np.zeros((size, size))
    # Gaps of the kept modes; forces on them along the gaps, along the slips, and of the loads.
    gaps, normal, slip, load = (np.zeros((k, size)) for k in (n, n, n, loads))
    # lambda = 0: z = sigma in kappa, z = -lambda_0 in lambda.
    z = -rows.shift if rows.damped else SIGMA
    for body, view in zip(bodies, views, strict=True):
        comp, at, modes = body.component, body.elements, body.modes
        m, f, g = at.size, len(rows.followed), len(rows.acting)
        D = np.tensordot(z ** np.arange(len(view.D)), view.D, 1)
        H = np.tensordot(z ** np.arange(len(view.modal)), view.modal, 1)
        last = D.shape[1] - loads
        NN[np.ix_(at, at)] += D[:m, :m]
        NT[np.ix_(at, at)] += D[:m, m : 2 * m]
        NF[at] += D[:m, last:]
        gaps[at, modes] += comp.followed[:m]
        normal[at, modes] += comp.acting[:m]
        slip[at, modes] += comp.acting[m : 2 * m]
        load[:, modes] += comp.loads
        if comp.coupled:
            X, first = slice(g * m, last), f * m
            H = H - D[first:, X]
            gaps[at, modes] -= D[:m, X]
            normal[at, modes] -= D[first:, :m].T
            slip[at, modes] -= D[first:, m : 2 * m].T
            load[:, modes] -= D[first:, last:].T
        A[modes, modes] += H
    d = np.sqrt(D0) / omega
    inverse = _inverse(0.5 * (NN + NN.T), d)
    P = inverse @ (gaps * d[:, None])
    S = P / d[:, None]
    small = A + (normal * d[:, None]).T @ P
    out = []
    for right, modal in ((NT, slip), (NF, load)):
        scaled = right * d[:, None]
        held = inverse @ scaled
        modal_force = modal.T - (normal * d[:, None]).T @ held
        out.append(held / d[:, None] + S @ np.linalg.solve(small, modal_force))
    NN0 = (np.eye(n) - inverse) / d / d[:, None]
    NN0 += S @ np.linalg.solve(small, ((inverse @ (normal * d[:, None])) / d[:, None]).T)
    scale = 1 / omega**2
    return 0.5 * scale * (NN0 + NN0.T), scale * out[0], scale * out[1]


def _inverse(A: Array, d: Array) -> Array:
    """(I + d A d)^-1 of a symmetric A."""
    H = A * d * d[:, None]
    H[np.diag_indices_from(H)] += 1.0
    L, failed = la.lapack.dpotrf(H, lower=1, overwrite_a=1)
    if not failed:
        half, failed = la.lapack.dpotri(L, lower=1, overwrite_c=1)
    if failed:
        raise InaccurateResult("the compliance of the bodies of a sample is not positive")
    lower = np.tril(half)
    return np.asarray(lower + np.tril(half, -1).T)
