"""Equilibria beside a known one: to first order in loads and friction, and of changed bodies.

At fixed laws p = P(g), dp = -k dg; the condensed equilibrium (``equilibrium``) then gives dg from
one solution with the matrix of its last Newton step.

Of bodies whose stiffness differs from the factored one,
(K + dK) u = f + N'W p + mu T'W p is solved as K u = (f - dK u_before) + ...: the condensed
equilibrium under corrected loads, again and again. Nothing is factored. It contracts by the largest
|eigenvalue| of K^-1 dK, which materials within +-x of the reference keep below x, and converges to
the equilibrium of the changed bodies itself.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import NotConverged

from .condensation import Compliance
from .equilibrium import Condensed, Equilibrium, displacement, equilibrium
from .gap import EnrichedGap
from .sliding_friction import patch_forces, sliding


@dataclass(frozen=True, slots=True)
class EquilibriumChange:
    """Derivatives of an equilibrium to a parameter, shape (elements,).

    Attributes:
        p: of the pressures [Pa].
        k: of the stiffnesses of small vibrations [Pa/m].
    """

    p: Array
    k: Array


def equilibrium_change(
    compliance: Compliance,
    w: Array,
    laws: EnrichedGap,
    eq: Equilibrium,
    Nf: Array | None = None,
    mu: Array | None = None,
) -> EquilibriumChange:
    """Derivatives of an equilibrium to a load and to friction.

    Args:
        compliance: the bodies seen from the contact elements.
        w: areas [m^2], shape (elements,).
        laws: law and critical gap of every element.
        eq: the equilibrium.
        Nf: change of the loads, as ``Compliance.Nf`` [m]; none if None.
        mu: change of the friction coefficients, shape (elements,); none if None.

    Raises:
        NotConverged: the equilibrium is at a limit of its stability.
    """
    rhs = np.zeros(len(compliance.NT)) if Nf is None else Nf
    if mu is not None:
        rhs = rhs + compliance.NT @ (w * mu * eq.p)
    moved = Condensed(replace(compliance, Nf=rhs), w, np.zeros_like(w), eq.mu)
    g = moved.linear(1.0, np.zeros_like(w), eq.k)
    return EquilibriumChange(-eq.k * g, laws.vibration(eq.g)[1] * g)


@dataclass(frozen=True, slots=True)
class BodyOperators:
    """Operators of the bodies with the loads of one sample.

    Attributes:
        N: gap operator, shape (elements, dofs).
        T: slip operator.
        w: areas [m^2].
        g0: gaps of the undeformed bodies [m].
        f: loads [N], shape (dofs,).
        compliance: the reference bodies seen from the contact elements, under these loads.
    """

    N: sp.csr_matrix
    T: sp.csr_matrix
    w: Array
    g0: Array
    f: Array
    compliance: Compliance


def corrected_equilibrium(
    bodies: BodyOperators,
    change: sp.csr_matrix,
    laws: EnrichedGap,
    mu: float | Array = 0.0,
    steps: int = 1,
    tolerance: float = 1e-10,
    most: int = 60,
) -> Equilibrium:
    """Equilibrium of the changed bodies.

    Args:
        bodies: the reference bodies and the loads.
        change: dK [N/m], shape (dofs, dofs).
        laws: law and critical gap of every element.
        mu: friction coefficient, one or one per element.
        steps: equal load steps of each condensed equilibrium.
        tolerance: residual of each condensed equilibrium and of the changed bodies, relative to
            the contact forces.
        most: corrections allowed.

    Returns:
        The equilibrium with its displacement and the Newton iterations of each correction.

    Raises:
        NotConverged: the change is too large for corrections, or Newton's iteration stalls.
    """
    start = time.perf_counter()
    f, last, counts = bodies.f, np.inf, []
    for _ in range(most):
        seen = replace(bodies.compliance, Nf=bodies.N @ bodies.compliance.solve(f))
        eq = equilibrium(replace(bodies, compliance=seen), laws, mu, steps, tolerance)
        counts.append(sum(eq.iterations))
        u = displacement(bodies, eq, f)
        # What the changed bodies still lack: dK (u - u_before).
        corrected = bodies.f - change @ u
        normal, along, _ = patch_forces(bodies.w, eq.p, eq.k, sliding(mu, eq.p)).value
        push = bodies.N.T @ normal + bodies.T.T @ along
        defect = float(np.linalg.norm(corrected - f) / np.linalg.norm(push))
        if defect <= tolerance:
            residual, seconds = max(eq.residual, defect), time.perf_counter() - start
            return replace(eq, residual=residual, iterations=tuple(counts), seconds=seconds, u=u)
        if not defect < last:
            break
        f, last = corrected, defect
    raise NotConverged(
        f"equilibrium of changed bodies: corrections stall at a residual of {defect:.1e}; the"
        " materials are too far from those of the scene"
    )
