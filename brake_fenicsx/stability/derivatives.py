"""What drives a mode: derivatives of its eigenvalue, and the work that friction does in it.

P(lambda) phi = 0 and psi^H P(lambda) = 0, P = lambda^2 M + lambda C + K and the contact. To first
order a simple eigenvalue moves with a parameter p by

    d lambda / dp = - psi^H (dP/dp) phi / (psi^H P'(lambda) phi)

(Murthy and Haftka, Int. J. Numer. Meth. Eng. 26, 1988, doi:10.1002/nme.1620260202; with damping
Adhikari, AIAA J. 37, 1999). Contact enters P element by element, as

    N' w k N + T' w mu k N + lambda (T' w a T + R' w c R),   a = p mu'(V),  c = mu p / V,

so that the motions of both vectors at the element are all that its derivatives need.

Work of friction. At constant amplitude, phi e^(i omega t), the tractions of an element on the pad
along and across do over one period the work

    W = -pi Im(conj(T phi) w mu k N phi) - pi omega w (a |T phi|^2 + c |R phi|^2).

phi^H P phi = 0 has the imaginary part 2 alpha omega phi^H M phi = (sum W - D) / pi, with the energy
E = omega^2 phi^H M phi / 2 of that motion and the loss D = pi omega phi^H C phi of the bodies:

    sum W / E = 4 pi alpha / |omega| + D / E,     exactly, without gyroscopic terms

(feed-in energy: Guan and Huang, J. Sound Vib. 261, 2003).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex, Mask

from .eigensolvers.eigenpairs import QuadraticPencil, inner
from .substructures import contact_rows, vectors

# A derivative is trusted if a change by its step leads at most half way to a merging point.
HALF_WAY = 0.25


def motions_of_vectors(
    rows: Mapping[str, sp.csr_matrix],
    pencil: QuadraticPencil,
    s: Complex,
    right: Complex,
    left: Complex,
) -> vectors.ContactMotions:
    """Motions of modes at the contact elements, from displacements.

    Args:
        rows: gap operator "N", slip operators "T" and "R", shape (elements, dofs).
        pencil: M and C of the brake; its stiffness is not used.
        s: eigenvalues lambda [1/s], shape (modes,).
        right: right vectors, shape (dofs, modes).
        left: left vectors, likewise.
    """
    seen = {name: np.asarray(A @ right) for name, A in rows.items()}
    met = {name: np.asarray(A @ left.conj()) for name, A in rows.items()}
    slope = inner(left, pencil.slope(s, right))
    return vectors.ContactMotions(s, slope, seen, met, np.zeros(s.size))


@dataclass(frozen=True, slots=True)
class ContactDerivatives:
    """Derivatives of lambda to what acts in each contact element, shape (elements, modes).

    Attributes:
        k: to the contact stiffness at a given friction coefficient [1/s per Pa/m].
        friction: to the friction coefficient of k, mu k [1/s].
        along: to p mu'(V) [1/s per Pa s/m]; zero where no force follows that motion.
        across: to mu p / V, likewise.
    """

    k: Complex
    friction: Complex
    along: Complex
    across: Complex

    def chain(self, k: Array, mu: Array, along: Array, across: Array) -> Complex:
        """Derivative of lambda to a parameter, from those of all elements, shape (modes,)."""
        total = k @ self.k + mu @ self.friction + along @ self.along + across @ self.across
        return np.asarray(total)


def contact_derivatives(
    m: vectors.ContactMotions, contact: contact_rows.ContactLinearisation, mu: Array, w: Array
) -> ContactDerivatives:
    """Derivatives of lambda to what acts in each contact element.

    Args:
        m: motions of the modes.
        contact: what acts there.
        mu: friction coefficients, shape (elements,).
        w: areas [m^2], shape (elements,).
    """
    factor = -w[:, None] / m.slope
    gap = factor * m.right["N"]
    normal, slip = m.left["N"], m.left["T"]
    rate = {
        name: m.s * factor * m.left[name] * m.right[name] if name in m.right else np.zeros_like(gap)
        for name in "TR"
    }
    return ContactDerivatives(
        (normal + mu[:, None] * slip) * gap, contact.k[:, None] * slip * gap, rate["T"], rate["R"]
    )


def bilinear(A: Any, right: Complex, left: Complex, slope: Complex) -> Complex:
    """-psi^H A phi / (psi^H P' phi): derivative of lambda where A is added to P, shape (modes,)."""
    return np.asarray(-inner(left, A @ right) / slope)


def friction_work(
    m: vectors.ContactMotions, contact: contact_rows.ContactLinearisation, w: Array, inertia: Array
) -> Array:
    """Work of friction over a period, in each contact element, over the energy of the mode.

    Args:
        m: motions of the modes, of all rows that friction acts along.
        contact: what acts in the elements.
        w: areas [m^2], shape (elements,).
        inertia: phi^H M phi of each mode, shape (modes,).

    Returns:
        Shape (elements, modes) [-]; positive where friction feeds energy in.
    """
    omega, seen = m.s.imag, m.right
    work = -np.imag(np.conj(seen["T"]) * (w * contact.friction)[:, None] * seen["N"])
    for rate, name in ((contact.along, "T"), (contact.across, "R")):
        if np.any(rate):
            work = work - omega * (w * rate)[:, None] * np.abs(seen[name]) ** 2
    return np.asarray(2 * np.pi * work / (omega**2 * inertia))


def trusted(
    s: Complex, derivatives: Complex, steps: Array, neighbours: Mapping[int, list[int]]
) -> Mask:
    """Where the eigenvalue is far enough from merging for its derivative to mean something.

    Two modes that merge at p = p* have (lambda_1 - lambda_2)^2 = c (p - p*), so that with the
    difference d of the eigenvalues and d' of their derivatives p* lies |d / 2 d'| away. A change of
    p by its step shall lead at most half way there: |d'| step <= |d| / 4; the first order then is
    off by a sixth at most.

    Args:
        s: eigenvalues lambda [1/s], shape (modes,).
        derivatives: d lambda / dp, shape (parameters, modes).
        steps: change of each parameter, shape (parameters,).
        neighbours: mode -> modes that it may merge with.

    Returns:
        Shape (parameters, len(neighbours)), in their order.
    """
    out = np.ones((len(derivatives), len(neighbours)), dtype=bool)
    for column, (i, others) in enumerate(neighbours.items()):
        for j in others:
            moved = np.abs(derivatives[:, i] - derivatives[:, j]) * steps
            out[:, column] &= moved <= HALF_WAY * abs(s[i] - s[j])
    return out
