"""What the pencil of an undamped sample leaves out of a mode: known terms, a bound of the others.

For the trial vectors phi = Phi a - R F g and psi' = b' Phi' - y' N R, with R to second order, the
full residual has three parts, all of which the offline matrices measure:

    P(kappa) phi = M Phi r_a + F r_g + kappa^3 M R2 F g,
    r_a = (Lambda - kappa) a + B g,   r_g = Phi_N a - (I + C) g,

and psi' P phi / psi' M phi is the error of kappa to first order. Of the last part

    psi' kappa^3 M R2 F g = - y' (kappa^3 C3 + kappa^4 C4 + kappa^5 C5) g,

what the basis knows is taken off, the rest bounded with R_(j+1) <= R_j / limit, since the reference
has no mode left below its limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..complex_columns import times
from ..modes import Complex
from .correction import Deeper
from .sample import ANSWERS, ROUNDING, Sample

Array = NDArray[np.float64]

# What the error of a basis may be elsewhere, over that where it was checked.
DOUBT = 4.0

# Relative error of kappa that is stated at the least: round-off of a body's rigid modes.
DIGITS = 1e-9

# The same where bodies are interpolated between anchors: their errors are measured at a few points
# of the box only, and elsewhere they were up to 30 times a stated error below this floor.
INTERPOLATED = 2e-7


@dataclass(frozen=True, slots=True)
class LeftOut:
    """What the pencil leaves out of some modes.

    Attributes:
        rest: of T a, all that the basis knows; b' of it is psi' P phi, shape (kept modes, modes).
        tail: bound of what else psi' P phi holds [1/s^2], but for the basis' own errors.
        rounding: what round-off may have added to it [1/s^2].
        residual: of the full problem in the norm of K0^-1, over the mode's in that of K0.
        v_N: normal forces on the elements [N], shape (elements, modes).
        v_T: tangential ones.
        y: gap multipliers of the left vectors.
        r_g: what is left out at the gaps, of all orders.
        h: the gaps' answer to it.
        r_a: what is left out in the kept modes.
    """

    rest: Complex
    tail: Array
    rounding: Array
    residual: Array
    v_N: Complex
    v_T: Complex
    y: Complex
    r_g: Complex
    h: Complex
    r_a: Complex


def left_out(s: Sample, kappa: Complex, a: Complex, b: Complex) -> LeftOut:
    """What the pencil of a sample leaves out of some modes.

    Args:
        s: the sample.
        kappa: eigenvalues [1/s^2], shape (modes,).
        a: right vectors, shape (kept modes, modes).
        b: left ones.
    """
    K_r, M_r, Q_r = s.operators
    basis, top = s.basis, len(s.basis.NN) - 1
    C1, C2 = s.C
    S1a, S2a = times(s.S1, a), times(s.S2, a)
    g = times(s.S, a) - kappa * S1a + kappa**2 * S2a
    y = s.solves(times(s.B.T, b), 1)
    y -= s.solves(times(C1.T, kappa.conj() * y), 1)
    r_a = times(K_r, a) - kappa * times(M_r, a) + kappa**2 * times(Q_r, a)
    # Of r_g only the terms beyond the expansion of ``gaps`` are left.
    r_g: Complex = kappa**3 * (times(C2, S1a - kappa * S2a) - times(C1, S2a))
    v_N, v_T = s.dD[:, None] * g, s.mD[:, None] * g
    every, last = r_g.copy(), times(basis.NN[top], v_N)
    for j in range(3, top + 1):
        C_j = last if j == top else times(basis.NN[j], v_N)
        every -= kappa**j * (C_j + times(basis.NT[j], v_T))
    h = s.answer(kappa, every)
    limit, size = basis.limit, np.abs(kappa)
    normal = _norm(basis.NN[top], v_N, last)
    slip = _norm(basis.TT, v_T) / limit ** (top / 2)
    tail = _norm(basis.NN[top], y) * (normal + slip)
    tail *= size ** (top + 1) / np.maximum(limit - size, 1e-3 * limit)
    A_NN, _, A_TT = basis.compliance
    forces = _norm(A_NN, s.dD[:, None] * r_g) + _norm(A_TT, s.mD[:, None] * r_g)
    modal = np.sqrt((1 / basis.Lambda) @ np.abs(r_a) ** 2)
    norm = modal + forces + size**3 * limit ** (top / 2 - 3) * (normal + slip)
    norm = norm / np.sqrt(basis.Lambda @ np.abs(a) ** 2)
    first, second = (np.abs(times(x, a)) for x in s.sources)
    rounded = s.rounding * (np.abs(every) + size * first + size**2 * second)
    rounding = np.einsum("im,im->m", np.abs(y), rounded)
    return LeftOut(r_a + times(s.B, h), tail, rounding, norm, v_N, v_T, y, every, h, r_a)


def corrected(
    s: Sample, deeper: Deeper, kappa: Complex, b: Complex, known: LeftOut, which: NDArray[np.bool_]
) -> tuple[Complex, Array]:
    """Psi' P phi of some modes with all that the full problem adds, and its new bound.

    The gaps' answer h to what is left out is itself left out by C_3 and what follows: taken off
    to first order, and its size kept as part of the bound.

    Args:
        s: the sample.
        deeper: the full problem.
        kappa: eigenvalues [1/s^2], shape (modes,).
        b: left vectors.
        known: what is known to be left out of them.
        which: the modes to correct.
    """
    names = (known.v_N, known.v_T, known.r_g, known.r_a, known.h)
    v_N, v_T, r_g, r_a, h = (x[:, which] for x in names)
    z, top = kappa[which], len(s.basis.NN) - 1
    y = s.answer(z.conj(), times(s.B.T, b[:, which]), 1, 2 * ANSWERS)
    part, bound = deeper(z, y, v_N, v_T, top)
    part = part + np.einsum("im,im->m", b[:, which].conj(), r_a)
    part += np.einsum("im,im->m", y.conj(), r_g)
    C_h = times(s.basis.NN[3], s.dD[:, None] * h)
    C_h += times(s.basis.NT[3], s.mD[:, None] * h)
    answer = z**3 * np.einsum("im,im->m", y.conj(), C_h)
    return part - answer, bound + np.abs(answer)


def doubted(s: Sample, kappa: Complex, known: LeftOut) -> Array:
    """Error of psi' P phi under the typical errors of the basis, all added up [1/s^2].

    A mode that they happen to leave alone shares the doubt of the others.

    Args:
        s: the sample.
        kappa: eigenvalues of all modes [1/s^2], shape (modes,).
        known: what is known to be left out of them.
    """
    total = np.zeros(kappa.size)
    for errors in s.doubt:
        first = sum(
            kappa**j
            * np.einsum("im,im->m", known.y.conj(), times(NN, known.v_N) + times(NT, known.v_T))
            for j, (NN, NT) in enumerate(errors)
        )
        total += DOUBT * np.abs(first)
    # Of modes that no contact moves nothing is doubted but the digits of their bodies.
    size = np.abs(kappa) * bool(len(s.doubt))
    shared = float(np.median(total / np.abs(kappa))) if size.any() else 0.0
    return np.maximum(total, max(shared, INTERPOLATED) * size)


def doubted_poles(doubt: Array | float, a: Complex, b: Complex) -> Array:
    """Error of psi' P phi under typical errors of the eigenvalues of the basis [1/s^2].

    Args:
        doubt: those errors [1/s^2], one or one per kept mode.
        a: right vectors, shape (kept modes, modes).
        b: left ones.
    """
    each = np.broadcast_to(doubt, (len(a),))
    return np.asarray(DOUBT * (each @ (np.abs(a) * np.abs(b))))


def _norm(A: Array, x: Complex, Ax: Complex | None = None) -> Array:
    """Root of x^H A x of each column for a positive semi-definite matrix, never too small."""
    product = times(A, x) if Ax is None else Ax
    square = np.einsum("im,im->m", x.conj(), product).real
    # |A_ij| <= sqrt(A_ii A_jj).
    most = np.sqrt(np.maximum(np.diag(A), 0.0)) @ np.abs(x)
    return np.asarray(np.sqrt(np.maximum(square, 0.0) + ROUNDING * most**2))
