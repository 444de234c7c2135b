"""Damped modes of a band with many modes below it: complex shifts, from one piece to the next.

Real PETSc cannot factor at a complex shift; SciPy's SuperLU does, for up to some ten thousand dofs.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse.linalg as spla

from brake_fenicsx.errors import NotConverged

from ..modes import Complex
from .quadratic_pencil import Pencil

# Eigenvalues that one shift is asked for first.
PER_SHIFT = 40


def covered_modes(
    p: Pencil, low: float, high: float, zeta_max: float
) -> tuple[Complex, Complex, Complex, int]:
    """Eigenvalues of a band from as many shifts as its pieces need.

    Args:
        p: the matrices.
        low: lowest omega [rad/s].
        high: highest omega [rad/s].
        zeta_max: largest damping ratio looked for.

    Returns:
        lambda [1/s], right and left vectors, and the number of shifts.

    Raises:
        NotConverged: ARPACK does not converge at a shift.
    """
    pieces, found, used = [(low, high, PER_SHIFT)], [], 0
    while pieces:
        a, b, wanted = pieces.pop()
        sigma = 0.5j * (a + b) * (1 + 1.234e-7) + 1e-9 * b
        reach = 1.001 * np.hypot(0.5 * (b - a), zeta_max * b)
        s, right, left = _nearest(p, sigma, wanted)
        used += 1
        covered = float(np.abs(s - sigma).max())
        if covered < reach and s.size < 2 * p.K.shape[0] - 2:
            # Halve the piece while it is its length that counts, then ask for more.
            middle = 0.5 * (a + b)
            longer = 0.5 * (b - a) > zeta_max * b
            more = int(1.2 * wanted * reach / covered) + 4
            pieces += [(a, middle, wanted), (middle, b, wanted)] if longer else [(a, b, more)]
            continue
        # Half-open pieces: what lies on a border belongs to the upper one.
        own = (s.imag >= a) & ((s.imag < b) | (b == high))
        found.append((s[own], right[:, own], left[:, own]))
    return (
        np.concatenate([f[0] for f in found]),
        np.hstack([f[1] for f in found]),
        np.hstack([f[2] for f in found]),
        used,
    )


def _nearest(p: Pencil, sigma: complex, wanted: int) -> tuple[Complex, Complex, Complex]:
    """The eigenvalues nearest to a shift, with right and left vectors."""
    lu = spla.splu(p.at(sigma))
    s, right = _arnoldi(p, lambda b: lu.solve(b), sigma, wanted)
    t, left = _arnoldi(p.transposed, lambda b: lu.solve(b, "T"), sigma, wanted)
    nearest = np.abs(s[:, None] - t[None, :]).argmin(axis=1)
    return s, right, left[:, nearest].conj()


def _arnoldi(p: Pencil, solve: object, sigma: complex, wanted: int) -> tuple[Complex, Complex]:
    """Eigenpairs of the linearisation [x, lambda x / |sigma|] nearest to sigma."""
    n, scale = p.K.shape[0], abs(sigma)
    damp = (p.C + sigma * p.M).tocsr()

    def apply(b: Complex) -> Complex:
        x = solve(-(damp @ b[:n]) - scale * (p.M @ b[n:]))  # type: ignore[operator]
        return np.concatenate([x, (b[:n] + sigma * x) / scale])

    operator = spla.LinearOperator((2 * n, 2 * n), matvec=apply, dtype=complex)
    rng = np.random.default_rng(0)
    k = min(wanted, 2 * n - 2)
    try:
        theta, x = spla.eigs(operator, k, v0=rng.standard_normal(2 * n) + 0j, ncv=min(2 * n, 3 * k))
    except spla.ArpackNoConvergence as error:
        raise NotConverged(f"damped modes near {abs(sigma) / 2 / np.pi:.0f} Hz: {error}") from error
    return sigma + 1 / theta, x[:n] / np.linalg.norm(x[:n], axis=0)
