"""Bodies at rest on springs at their contact elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Resting:
    """Bodies at rest as their contact elements see them, some soft modes apart.

    Attributes:
        NN: gaps under forces on the gaps without the soft modes [m/N], shape (elements, elements).
        NT: gaps under forces on the slips.
        Nf: gaps under the loads, shape (elements, loads).
        kappa: eigenvalues of the soft modes [1/s^2]; rigid ones have 0.
        Phi_N: their gaps, shape (elements, modes).
        Phi_T: their slips.
        Phi_f: the loads on them, shape (loads, modes).
    """

    NN: Array
    NT: Array
    Nf: Array
    kappa: Array
    Phi_N: Array
    Phi_T: Array
    Phi_f: Array


def on_springs(rest: Resting, D0: Array) -> tuple[Array, Array, Array]:
    """N K0^-1 N', N K0^-1 T' and N K0^-1 f of K0 = K + N' D0 N.

    With d = sqrt(D0) and H = I + d NN d, which is symmetric positive definite, the gaps of the
    bodies without their soft modes are (I - H^-1) / d d', H^-1 d NT / d and H^-1 d Nf / d.

    Args:
        rest: the bodies.
        D0: stiffness of the springs [N/m], shape (elements,), positive.

    Returns:
        Shapes (elements, elements) twice, (elements, loads).

    Raises:
        InaccurateResult: H is not positive definite.
    """
    d = np.sqrt(D0)
    inverse = _inverse(rest.NN * d, d)
    # g = inverse d (q - d a P') / d + ...: the soft modes push the springs too.
    P = rest.Phi_N * d[:, None]
    answer = inverse @ P
    small = P.T @ answer
    small[np.diag_indices_from(small)] += rest.kappa
    S = answer / d[:, None]
    out = []
    for right, modal in ((rest.NT, rest.Phi_T), (rest.Nf, rest.Phi_f)):
        scaled = right * d[:, None]
        gaps = inverse @ scaled
        gaps /= d[:, None]
        gaps += S @ np.linalg.solve(small, modal.T - answer.T @ scaled)
        out.append(gaps)
    NN = -inverse
    NN[np.diag_indices_from(NN)] += 1.0
    NN /= d
    NN /= d[:, None]
    NN += S @ np.linalg.solve(small, S.T)
    return NN, out[0], out[1]


def _inverse(A: Array, d: Array) -> Array:
    """(I + d A)^-1 of a symmetric d A; A is overwritten."""
    A *= d[:, None]
    A[np.diag_indices_from(A)] += 1.0
    # Symmetric: its transpose is what LAPACK takes without a copy.
    L, failed = la.lapack.dpotrf(A.T, lower=1, overwrite_a=1)
    if not failed:
        half, failed = la.lapack.dpotri(L, lower=1, overwrite_c=1)
    if failed:
        raise InaccurateResult("the compliance of the bodies of a sample is not positive")
    lower = np.tril(half)
    return np.asarray(lower + np.tril(half, -1).T)
