"""What the reduced model leaves out of a damped mode: known terms, and a bound of the others.

Of the trial vectors behind a and z the full problem leaves r_a in the kept modes and r_z at
contact, by all G_n that are known; terms beyond the last are those of a series that falls by
(|lambda| / radius)^2, and are measured with G_10, which without damping has one sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..complex_columns import times
from ..modes import Complex
from .damped_sample import TOP, DampedSample

Array = NDArray[np.float64]

EVEN = 10


def left_out(sample: DampedSample, s: Complex, a: Complex) -> tuple[Complex, Complex]:
    """r_a of T a and r_z of E z = ..., of the powers beyond those that z has made zero.

    Args:
        sample: the sample.
        s: eigenvalues [1/s], shape (modes,).
        a: right vectors, shape (kept modes, modes).
    """
    z = sample.terms(s, a)
    r_a, r_z = np.zeros_like(a), np.zeros((sample.forces.rows, s.size), complex)
    for i in range(1, len(sample.basis.G)):
        part = s**i * sum(z[max(0, TOP + 1 - i) :])
        r_z -= times(sample.gaps_forced(i), part)
        r_a += times(sample.modes_forced(i), part)
        if i > TOP:
            r_z += s**i * times(sample.source(i), a)
            r_a += s**i * times(sample.own(i), a)
    return r_a, r_z


def beyond(
    sample: DampedSample,
    s: Complex,
    right: tuple[Complex, Complex],
    left: tuple[Complex, Complex],
    r: tuple[Complex, Complex],
) -> tuple[Array, Array]:
    """Bound of what the terms beyond the last G_n add to b^H T a, and the relative residual.

    Args:
        sample: the sample.
        s: eigenvalues [1/s], shape (modes,).
        right: coordinates a and forces J z of right vectors.
        left: coordinates b and y of left ones.
        r: r_a and r_z.

    Returns:
        The bound, and the residual of the full problem in the norm of K0^-1 over K0's of the mode.
    """
    b, size = sample.basis, np.abs(s)
    G = b.G
    odd = 1 + size * np.linalg.norm(G[EVEN + 1]) / np.linalg.norm(G[EVEN])
    ratio = (size / b.radius) ** 2
    acts = _weight(sample, s * right[0], right[1], forces=True)
    weighs = _weight(sample, s * left[0], left[1], forces=False)
    bound = acts * weighs * odd * size**EVEN * ratio / np.maximum(1 - ratio, 1e-3)
    n, wrong = sample.forces.n, sample.forces(s, r[1])
    norm = np.sqrt((1 / b.Lambda) @ np.abs(r[0]) ** 2)
    for i in range(sample.forces.columns // n):
        norm += np.sqrt(_form(b.answers["NTR"[i]], wrong[i * n : (i + 1) * n]))
    norm += acts * odd * size ** (EVEN + 2) / b.limit**3.5
    return bound, norm / np.sqrt(b.Lambda @ np.abs(right[0]) ** 2)


def _weight(sample: DampedSample, modal: Complex, contact: Complex, forces: bool) -> Array:
    """Square root of x^H |G_10| x, block by block, of loads on the modes and at contact.

    Args:
        sample: the sample.
        modal: loads through C Phi, shape (kept modes, modes).
        contact: loads on the rows of I (forces), or of O.
        forces: which of the two.
    """
    b, J, G = sample.basis, sample.forces, sample.basis.G[EVEN]
    out = np.sqrt(_form(G[J.rows :, J.columns :], modal))
    for i, name in enumerate("NTR"[: J.columns // J.n] if forces else b.names):
        x = contact[i * J.n : (i + 1) * J.n]
        if name in b.names:
            j, k = (names.index(name) * J.n for names in (b.names, "NTR"))
            out += np.sqrt(_form(G[j : j + J.n, k : k + J.n], x))
        else:
            P = b.forced[J.n : 2 * J.n]
            out += np.sqrt(_form(b.answers["T"] - (P / b.Lambda) @ P.T, x) / b.limit ** (EVEN / 2))
    return np.asarray(out)


def _form(A: Array, x: Complex) -> Array:
    """|x^H A x| of each column."""
    return np.asarray(np.abs(np.einsum("im,im->m", x.conj(), times(A, x))))
