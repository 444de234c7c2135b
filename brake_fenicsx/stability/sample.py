"""One sample in the reduced model: the pencil, its correction, its residual and error.

With the basis of ``reduction`` and F = N' dD + mu T' D the problem in modal coordinates a is

    T(kappa) a = [Lambda - kappa + B (I + C(kappa))^-1 Phi_N] a = 0,
    B = Phi' F,   C(kappa) = N R(kappa) F = C0 + kappa C1 + kappa^2 C2 + ...

First a linear pencil from C0 and C1 (all eigenvalues at once), then for every mode near the band a
Newton step with C2. For the trial vectors phi = Phi a - R F g and psi' = b' Phi' - y' N R the full
residual has three parts, all of which the offline matrices measure:

    P(kappa) phi = M Phi r_a + F r_g + kappa^3 M R2 F g,
    r_a = (Lambda - kappa) a + B g,   r_g = Phi_N a - (I + C) g,

and psi' P phi / psi' M phi is the error of kappa to first order. The last part is bounded with
R_(j+1) <= R_j / limit, since the reference has no mode left below its limit.
"""

from __future__ import annotations

import time

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from .basis import Basis
from .completeness import Trapezium, count_zeros
from .modes import Complex, Count, Modes, undamped_rows

Array = NDArray[np.float64]

# Damping ratios up to this one are counted.
ZETA_MAX = 0.25


class Sample:
    """Reduced operators of one contact stiffness and one friction coefficient."""

    def __init__(self, basis: Basis, k: Array, mu: float | Array):
        """Factor the interface problem and expand it in kappa.

        Args:
            basis: offline result.
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
        """
        b = self.basis = basis
        self.dD, self.mD = b.w * (k - b.k0), mu * b.w * k
        self.C1, self.C2 = (self._residual_gap(j) for j in (1, 2))
        E = self._residual_gap(0)
        E[np.diag_indices_from(E)] += 1.0
        self._lu = la.lu_factor(E, overwrite_a=True, check_finite=False)
        self.B = b.Phi_N.T * self.dD + b.Phi_T.T * self.mD
        self.S = self._solve(b.Phi_N)
        self.S1 = self._solve(self.C1 @ self.S)
        self.S2 = self._solve(self.C1 @ self.S1 - self.C2 @ self.S)

    def _residual_gap(self, j: int) -> Array:
        """C_j = R_j,NN dD + mu R_j,NT D."""
        C = self.basis.NN[j] * self.dD
        if self.mD.any():
            C += self.basis.NT[j] * self.mD
        return C

    def _solve(self, x: Array, trans: int = 0) -> Array:
        return np.asarray(la.lu_solve(self._lu, x, trans=trans, check_finite=False))

    def gaps(self, a: Complex, kappa: Complex) -> Complex:
        """Gaps g = (I + C)^-1 Phi_N a, to second order in kappa, shape (elements, modes)."""
        S, S1, S2 = (_times(A, a) for A in (self.S, self.S1, self.S2))
        return S - kappa * S1 + kappa**2 * S2

    def modes(self, band: tuple[float, float], start: float) -> Modes:
        """Modes of the band with residuals and errors; the clock was started at ``start`` [s]."""
        Lambda = self.basis.Lambda
        K_r, M_r, Q_r = np.diag(Lambda) + self.B @ self.S, self.B @ self.S1, self.B @ self.S2
        M_r[np.diag_indices_from(M_r)] += 1.0
        far, *pairs = _linear_pencil(K_r, M_r, band)
        kappa, a, b = _newton(K_r, M_r, Q_r, *pairs)
        region = _region(band)
        # The corrected values: one that crosses the edge of the region turns the phase unseen.
        believed = np.concatenate([kappa, far])
        expected = count_zeros(lambda z: K_r - z * M_r + z**2 * Q_r, region, believed)
        found = int(region.holds(kappa).sum())
        if found != expected:
            raise InaccurateResult(
                f"reduced model: {found} modes found in the band, the winding number of the"
                f" determinant counts {expected}"
            )
        slope = np.einsum("im,im->m", b.conj(), M_r @ a - 2 * kappa * (Q_r @ a))
        first, tail, residual = self._errors(kappa, a, b, K_r, M_r, Q_r)
        kappa = _keep_real(kappa + first / slope, kappa)
        condition = np.linalg.norm(a, axis=0) * np.linalg.norm(b, axis=0) / np.abs(slope)
        second = np.abs(first / slope) ** 2 * condition / _separation(kappa)
        floor = 1e-14 * Lambda[-1] * condition
        error = tail / np.abs(slope) + second + floor
        order, lam, spread, real = undamped_rows(kappa, error, band)
        return Modes(
            lam, a[:, order], b[:, order], residual[order], spread, condition[order],
            Count(expected, "winding number of det T, on a basis complete by inertia"),
            0, time.perf_counter() - start, real,
        )  # fmt: skip

    def _errors(
        self, kappa: Complex, a: Complex, b: Complex, K_r: Array, M_r: Array, Q_r: Array
    ) -> tuple[Complex, Array, Array]:
        """First-order error psi' P phi, bound of its tail, and relative residual of each mode."""
        s = self.basis
        g = self.gaps(a, kappa)
        r_a = _times(K_r, a) - kappa * _times(M_r, a) + kappa**2 * _times(Q_r, a)
        # Of r_g only the terms beyond the expansion of ``gaps`` are left.
        S1a, S2a = _times(self.S1, a), _times(self.S2, a)
        cubic = _times(self.C1, S2a) - _times(self.C2, S1a)
        r_g = -(kappa**3) * cubic - kappa**4 * _times(self.C2, S2a)
        y = self._solve(self.B.T @ b.real, 1) + 1j * self._solve(self.B.T @ b.imag, 1)
        first = np.einsum("im,im->m", b.conj(), r_a) + np.einsum("im,im->m", y.conj(), r_g)
        v_N, v_T = self.dD[:, None] * g, self.mD[:, None] * g
        limit, size = s.limit, np.abs(kappa)
        inertia_N = _quadratic(s.NN[2], v_N)
        inertia_T = _quadratic(s.TT, v_T) / limit**2
        inertia_y = _quadratic(s.NN[2], y)
        rest = np.sqrt(inertia_N) + np.sqrt(inertia_T)
        tail = size**3 / np.maximum(limit - size, 1e-3 * limit) * np.sqrt(inertia_y) * rest
        f_N, f_T = self.dD[:, None] * r_g, self.mD[:, None] * r_g
        A_NN, A_NT, A_TT = s.compliance
        cross = 2 * np.einsum("im,im->m", f_N.conj(), _times(A_NT, f_T)).real
        forces = _quadratic(A_NN, f_N) + cross + _quadratic(A_TT, f_T)
        modal = (1 / s.Lambda) @ np.abs(r_a) ** 2
        norm = np.sqrt(modal) + np.sqrt(np.abs(forces)) + size**3 / limit**2 * rest
        return first, tail, norm / np.sqrt(s.Lambda @ np.abs(a) ** 2)


def _quadratic(A: Array, x: Complex) -> Array:
    """X' A x of each column, for symmetric semi-definite A."""
    return np.asarray(np.maximum(np.einsum("im,im->m", x.conj(), _times(A, x)).real, 0.0))


def _times(A: Array, x: Complex) -> Complex:
    """A x for real A: two real products on contiguous parts instead of a complex copy of A."""
    re, im = np.ascontiguousarray(x.real), np.ascontiguousarray(x.imag)
    return np.asarray(A @ re + 1j * (A @ im))


def _linear_pencil(
    K: Array, M: Array, band: tuple[float, float]
) -> tuple[Complex, Complex, Complex, Complex]:
    """Eigenvalues of K a = kappa M a: those far from the band; those near, with their vectors.

    Conjugate pairs stand side by side, the one of positive imaginary part first.
    """
    lu = la.lu_factor(M)
    kappa, left, right = la.eig(la.lu_solve(lu, K), left=True, right=True)
    highest = (2 * np.pi * 1.02 * band[1]) ** 2
    near = np.isfinite(kappa) & (kappa.real < highest) & (np.abs(kappa) < 2 * highest)
    chosen = np.flatnonzero(near)
    chosen = chosen[np.lexsort((-kappa[chosen].imag, kappa[chosen].real))]
    b = la.lu_solve(lu, left[:, chosen].astype(complex), trans=1)
    far = np.isfinite(kappa) & ~near
    return kappa[far], kappa[chosen], right[:, chosen].astype(complex), b


def _newton(
    K: Array, M: Array, Q: Array, kappa: Complex, a: Complex, b: Complex
) -> tuple[Complex, Complex, Complex]:
    """Eigenpairs of (K - kappa M + kappa^2 Q) a = 0 near those of the linear pencil.

    Two-sided quotient, one inverse iteration on either side, quotient again.
    """
    for m in range(kappa.size):
        if kappa[m].imag < 0:
            a[:, m], b[:, m], kappa[m] = a[:, m - 1].conj(), b[:, m - 1].conj(), kappa[m - 1].conj()
            continue
        real = kappa[m].imag == 0
        x, y = (v[:, m].real if real else v[:, m] for v in (a, b))
        z = kappa[m].real if real else kappa[m]
        z = _quotient(K, M, Q, z, x, y)
        # A shift on the eigenvalue itself is what inverse iteration wants.
        lu = la.lu_factor(K - z * (1 + 1e-12) * M + z**2 * Q, check_finite=False)
        x = la.lu_solve(lu, M @ x, check_finite=False)
        y = la.lu_solve(lu, M.T @ y, trans=2, check_finite=False)
        x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
        a[:, m], b[:, m], kappa[m] = x, y, _quotient(K, M, Q, z, x, y)
    return kappa, a, b


def _quotient(K: Array, M: Array, Q: Array, z: complex, x: NDArray, y: NDArray) -> complex:
    """One Newton step for z of y' (K - z M + z^2 Q) x = 0."""
    Kx, Mx, Qx = np.vdot(y, K @ x), np.vdot(y, M @ x), np.vdot(y, Q @ x)
    step: complex = (Kx - z * Mx + z**2 * Qx) / (Mx - 2 * z * Qx)
    return z + step


def _region(band: tuple[float, float]) -> Trapezium:
    """The band in the plane of kappa, with damping ratios up to ZETA_MAX.

    A hair wider than the band, so that a mode on its very edge is not on the contour.
    """
    low, high = ((2 * np.pi * f) ** 2 for f in band)
    bottom = low * (1 - 1e-7) if low > 0 else -0.02 * high
    return Trapezium(bottom, high * (1 + 1e-7), 2 * ZETA_MAX, 1e-3 * high)


def _keep_real(corrected: Complex, kappa: Complex) -> Complex:
    """A real eigenvalue of a real problem stays real."""
    return np.where(kappa.imag == 0, corrected.real + 0j, corrected)


def _separation(kappa: Complex) -> Array:
    """Distance of each eigenvalue from its nearest neighbour."""
    if kappa.size < 2:
        return np.full(kappa.size, np.inf)
    distance = np.abs(kappa[:, None] - kappa[None, :])
    np.fill_diagonal(distance, np.inf)
    return np.asarray(np.maximum(distance.min(axis=0), 1e-12 * np.abs(kappa).max()))
