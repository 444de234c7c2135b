"""Receptances of a body: a few vectors for all frequencies, and the error against full order.

(K - omega^2 M + i omega C) u = f is projected on all real modes up to a frequency beyond the band,
rigid-body motions included, and on the static answers to the forces and at the points seen
(residual vectors: MacNeal, Comput. Struct. 1 (1971) 581). The equation is then solved as it stands
where its residual is largest. That tells the error; where it is too large, the solution joins the
vectors.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.stability.eigensolvers.symmetric import shifted_factor, symmetric_modes

# Modes reach this multiple of the band; vectors that others hold up to this share are left out.
BEYOND, SMALL = 1.5, 1e-7
# Error that is small enough, and the most solutions at full order.
ENOUGH, ROUNDS = 1e-4, 6


@dataclass(frozen=True, slots=True)
class Receptances:
    """Displacement over force.

    Attributes:
        H: receptances [m/N], shape (frequencies, seen, forces).
        error: of the entry of H that is worst at the frequency below, over the largest modulus of
            that entry in the band.
        worst: frequency at which the residual was largest and full order was solved last [Hz].
        modes: number of modes projected on.
    """

    H: Complex
    error: float
    worst: float
    modes: int


@dataclass(frozen=True, slots=True)
class Damped:
    """A body with damping.

    Attributes:
        K: stiffness [N/m], symmetric.
        M: mass [kg].
        C: damping [N s/m]; zero where there is none.
        W: M-orthonormal modes with damping ratios of their own, shape (dofs, modes).
        ratio: 2 zeta omega of each [1/s], shape (modes,).
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    C: sp.csr_matrix
    W: Array
    ratio: Array

    def answer(self, omega: float, forces: Array) -> Complex:
        """Displacements at full order to forces with the angular frequency omega [rad/s].

        In real numbers, [[A, -B], [-B, -A]] of the real and the imaginary part; symmetric if B is.
        """
        A, B = self.K - omega**2 * self.M, omega * self.C
        both = sp.bmat([[A, -B], [-B, -A]]).tocsr()
        even = abs(B - B.T).max() <= 1e-12 * abs(B).max()
        factor = Factor(both, "brake_response_", symmetric=bool(even))
        MW = self.M @ self.W
        right = np.hstack([forces, MW])
        x = factor.solve(np.vstack([right, 0 * right]))
        factor.destroy()
        u = x[: len(right)] + 1j * x[len(right) :]
        u, Z = u[:, : forces.shape[1]], u[:, forces.shape[1] :]
        # (A + iB + i omega MW d W'M)^-1 by Woodbury's formula.
        d = 1j * omega * self.ratio[:, None]
        inner = np.eye(len(d)) + d * (MW.T @ Z)
        return np.asarray(u - Z @ np.linalg.solve(inner, d * (MW.T @ u)))


def real_modes(
    K: sp.csr_matrix, M: sp.csr_matrix, highest: float, forces: Array
) -> tuple[Array, Array, Array]:
    """All real modes below a frequency, counted, and static answers.

    Args:
        K: stiffness [N/m].
        M: mass [kg].
        highest: end of the modes [Hz].
        forces: shape (dofs, forces).

    Returns:
        M-orthonormal shapes with rigid-body modes, angular frequencies [rad/s], and the forces
        times the inverse of K - sigma M with a small negative shift.

    Raises:
        InaccurateResult: the stiffness is indefinite.
    """
    end = (2 * np.pi * highest) ** 2
    shifted = shifted_factor(K, M, end)
    if shifted is None:
        raise InaccurateResult("its stiffness is indefinite")
    found = symmetric_modes(K, M, *shifted, end)
    static = shifted[0].solve(forces)
    shifted[0].destroy()
    return found.Phi, np.sqrt(np.maximum(found.kappa, 0.0)), static


def receptances(
    body: Damped, modes: Array, static: Array, forces: Array, seen: sp.csr_matrix, frequency: Array
) -> Receptances:
    """Receptances on modes, static answers, and solutions at full order where these fall short.

    Args:
        body: the body.
        modes: real modes, shape (dofs, modes).
        static: static answers to the forces and at the points seen, shape (dofs, vectors).
        forces: shape (dofs, forces).
        seen: displacements that are measured, shape (seen, dofs).
        frequency: rising [Hz], shape (frequencies,).
    """
    omega, V = 2 * np.pi * frequency, _orthonormal(body.M, modes, static)
    error = np.inf
    for _ in range(ROUNDS):
        H, residual = _projected(body, V, forces, seen, omega)
        worst = int(np.argmax(residual))
        exact = body.answer(float(omega[worst]), forces)
        largest = np.maximum(np.abs(H).max(axis=0), 1e-300)
        error = float((np.abs(seen @ exact - H[worst]) / largest).max())
        if error <= ENOUGH:
            break
        V = _orthonormal(body.M, V, np.hstack([exact.real, exact.imag]))
    return Receptances(H, error, float(frequency[worst]), modes.shape[1])


def _orthonormal(M: sp.csr_matrix, V: Array, more: Array) -> Array:
    """M-orthonormal vectors with further ones, but for what they hold already."""
    size = np.sqrt(np.einsum("nm,nm->m", more, M @ more))
    more = more[:, size > 0] / size[size > 0]
    for _ in range(2):
        more = more - V @ (V.T @ (M @ more))
    values, turn = la.eigh(more.T @ (M @ more))
    kept = values > SMALL**2
    return np.hstack([V, (more @ turn[:, kept]) / np.sqrt(values[kept])])


def _projected(
    body: Damped, V: Array, forces: Array, seen: sp.csr_matrix, omega: Array
) -> tuple[Complex, Array]:
    """H on vectors V at every frequency, and its residual over the forces, shape (frequencies,)."""
    mass = body.M @ V
    modal = (body.M @ body.W) @ (body.ratio[:, None] * (body.W.T @ mass))
    images = [body.K @ V, mass, body.C @ V + modal]
    K, M, C = (V.T @ image for image in images)
    # The residual lies in the span of the forces and these images: its norm by their triangle.
    triangle = np.linalg.qr(np.hstack([forces, *images]), mode="r")
    inside, out = V.T @ forces, seen @ V
    H = np.empty((omega.size, out.shape[0], forces.shape[1]), complex)
    residual = np.empty(omega.size)
    for i, w in enumerate(omega):
        x = np.linalg.solve(K - w**2 * M + 1j * w * C, inside)
        H[i] = out @ x
        rest = np.vstack([np.eye(forces.shape[1]), -x, w**2 * x, -1j * w * x])
        residual[i] = np.linalg.norm(triangle @ rest)
    return H, residual / np.linalg.norm(forces)


def frac(test: Complex, model: Complex) -> float:
    """Frequency response assurance criterion, 1 for the same response but for a complex factor.

    Args:
        test: measured response, shape (frequencies,).
        model: computed one.

    Reference: W. Heylen and S. Lammens, Identification in Engineering Systems (Swansea, 1996) 48.
    """
    scale = np.vdot(test, test).real * np.vdot(model, model).real
    return float(abs(np.vdot(test, model)) ** 2 / scale) if scale > 0 else 0.0
