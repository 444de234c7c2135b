"""Braking equilibrium with enriched contact and friction, condensed on the contact elements.

    K u = f + N'W p(g) + mu T'W p(g),   g = g0 + N u,

with q = p + k0 (g - g0):  u = K0^-1 (f + N'W q + mu T'W p), so that g alone is unknown. Newton's
step in g is the step of the full system. K0 = K + N'W k0 N is symmetric positive definite for a
reference stiffness k0 > 0. Its inverse, seen through N and T, is all that contact needs: exact,
dense, small. The solves run in blocks and are shared by the processes of a communicator, each of
which holds the factor.

Beside a known equilibrium others follow to first order in loads and friction: at fixed laws
p = P(g), dp = -k dg, and dg is one solution with the matrix of the last Newton step.

Of bodies whose stiffness differs from the factored one, (K + dK) u = f + N'W p + mu T'W p is solved
as K u = (f - dK u_before) + ...: the same equilibrium under corrected loads, again and again.
Nothing is factored. It contracts by the largest |eigenvalue| of K^-1 dK, which materials within
+-x of the reference keep below x, and converges to the equilibrium of the changed bodies itself.
"""

import time
import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Index, Mask
from brake_fenicsx.errors import NotConverged, SceneError
from brake_fenicsx.iteration import Steps, sizes

from .contact_forces import EnrichedGap, patch_forces, sliding
from .newton import Newton, State
from .solver import Factor, blocks, with_interface

# First and smallest step of the friction coefficient along which an equilibrium is followed, as a
# share of it; growth of a step after one that succeeded.
FIRST, SMALLEST, GROWTH = 0.25, 1e-3, 1.5

# Steps of iterative refinement, the relative error at which it ends, and up to which it is enough,
# before double precision takes over; a column of the matrix is left to the refinement where its
# diagonal differs from 1 by less than LITTLE, unless nearly all, MOST, would be taken anyway.
REFINEMENTS, REFINED, ENOUGH, LITTLE, MOST = 12, 1e-15, 1e-12, 1e-4, 0.9

# Rows of the matrix of a Newton step that are made at once: they fit the cache of a core.
ROWS = 64

# Elements among which a start is made better, over those that are closed there.
NEAR = 1.5


class Solves(Protocol):
    """A symmetric inverse, known by its products."""

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """Product with a block, sparse or not, shape (dofs, columns)."""


@dataclass(frozen=True, slots=True)
class Compliance:
    """The bodies seen from the contact elements: K0^-1, or K^-1 from a reduced model.

    Without springs a body may be held by contact alone. Its free motions then are coordinates r of
    their own, which follow the gaps. Under contact pressures a - k g both obey
    (1 + NN diag(w k, 1) + NT diag(mu w k)) [g; r] = [g0; 0] + Nf + NN w a + NT mu w a.

    Attributes:
        factor: factor of K0, on every process; None where a reduced model gave the matrices.
        k0: reference stiffness of each element [Pa/m], shape (elements,).
        NN: N K0^-1 N' [m/N], shape (elements, elements); with free coordinates (all, all).
        NT: N K0^-1 T' [m/N], shape (elements, elements); with free coordinates (all, elements).
        Nf: N K0^-1 f [m] of the full loads, shape (elements,) or (all,).
        carried: force [N] that the loads press the faces together with, where there are no springs
            k0 in these matrices; None where there are.
    """

    factor: Factor | None
    k0: Array
    NN: Array
    NT: Array
    Nf: Array
    carried: float | None = None

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """Product of K0^-1 with a block."""
        if self.factor is None:
            raise ValueError("a compliance without a factor")
        return self.factor.solve(b)


@dataclass(frozen=True, slots=True)
class UnitLoads:
    """The bodies seen from the contact elements under multiples of some loads.

    Attributes:
        bodies: under other loads.
        gaps: N K0^-1 of each load [m], shape (elements, loads), or (all, loads) with free
            coordinates.
        carried: forces that each presses the faces together with [N], as ``Compliance.carried``.
    """

    bodies: Compliance
    gaps: Array
    carried: Array | None = None

    def times(self, sizes: Array) -> Compliance:
        """The bodies under the loads times some sizes, shape (loads,)."""
        carried = None if self.carried is None else float(self.carried @ sizes)
        return replace(self.bodies, Nf=self.gaps @ sizes, carried=carried)


def reference_factor(K: sp.csr_matrix, N: sp.csr_matrix, w: Array, k0: Array) -> Factor:
    """Factor of K0 = K + N'W k0 N.

    Args:
        K: stiffness [N/m].
        N: gap operator.
        w: areas [m^2].
        k0: reference stiffness [Pa/m], shape (elements,), positive.

    Returns:
        The factor.

    Raises:
        InaccurateResult: K0 is singular: a part is neither supported nor in contact.
    """
    return Factor(with_interface(K, N, w * k0, N), "brake_compliance_")


def interface_compliance(
    factor: Solves, N: sp.csr_matrix, T: sp.csr_matrix, comm: MPI.Comm
) -> tuple[Array, Array]:
    """N K0^-1 N' and N K0^-1 T' [m/N], each of shape (elements, elements).

    Args:
        factor: factor of K0.
        N: gap operator, shape (elements, dofs).
        T: slip operator, shape (elements, dofs).
        comm: processes that share the columns.
    """
    n = N.shape[0]
    both = sp.vstack([N, T]).tocsr()
    columns = N.T.tocsc()
    ends = np.rint(n * np.arange(comm.size + 1) / comm.size).astype(int)
    share = np.arange(ends[comm.rank], ends[comm.rank + 1])
    out = np.empty((both.shape[0], share.size))
    for b in blocks(share.size):
        out[:, b] = both @ factor.solve(columns[:, share[b]])
    whole = np.hstack(comm.allgather(out))
    NN, TN = whole[:n], whole[n:]
    return 0.5 * (NN + NN.T), np.ascontiguousarray(TN.T)


def compliance(
    K: sp.csr_matrix,
    N: sp.csr_matrix,
    T: sp.csr_matrix,
    w: Array,
    f: Array,
    k0: Array,
    comm: MPI.Comm,
) -> Compliance:
    """Compliance of the bodies at the contact elements.

    Args:
        K: stiffness [N/m].
        N: gap operator, shape (elements, dofs).
        T: slip operator.
        w: areas [m^2].
        f: loads [N], all free dofs.
        k0: reference stiffness [Pa/m].
        comm: processes that share the work.

    Returns:
        The compliance and the factor behind it.

    Raises:
        SceneError: k0 is not positive everywhere.
    """
    if k0.shape != w.shape or not (np.all(np.isfinite(k0)) and np.all(k0 > 0)):
        raise SceneError("k0: positive finite values are needed, one for each contact element")
    factor = reference_factor(K, N, w, k0)
    NN, NT = interface_compliance(factor, N, T, comm)
    return Compliance(factor, k0, NN, NT, np.asarray(N @ factor.solve(f)))


@dataclass(frozen=True, slots=True, repr=False)
class Equilibrium:
    """Equilibrium of the contact elements.

    Attributes:
        g: gaps [m], shape (elements,).
        p: pressures [Pa].
        k: stiffnesses -dp/dg of loading [Pa/m].
        k_vibration: stiffnesses of small vibrations about the equilibrium [Pa/m]: ``k`` where
            no contact has yielded.
        mu: friction coefficient of the equilibrium, one or one per element (0: solved without
            friction).
        iterations: Newton iterations of each load step; those of a start are two, the first one of
            the elements near contact alone.
        residual: norm of the full residual relative to the contact forces, both in the norm of
            the interface compliance.
        history: residuals of the last load step, one per iteration.
        seconds: time [s].
        u: displacement on all free dofs [m], where it was asked for.
    """

    g: Array
    p: Array
    k: Array
    k_vibration: Array
    mu: float | Array
    iterations: tuple[int, ...]
    residual: float
    history: tuple[float, ...]
    seconds: float
    u: Array | None = None

    def __repr__(self) -> str:
        """One line."""
        closed = int(np.sum(self.p > 0))
        return (
            f"Equilibrium({closed} of {self.p.size} elements closed, residual {self.residual:.1e},"
            f" {sum(self.iterations)} iterations)"
        )


def equilibrium(
    ops: Any,
    laws: EnrichedGap,
    mu: float | Array = 0.0,
    steps: int = 1,
    tolerance: float = 1e-10,
    max_iterations: int = 60,
    start: Array | None = None,
) -> Equilibrium:
    """Balance of virtual work of contact and solids under the ramped loads, Eq. (11).

    Args:
        ops: anything with ``.w`` [m^2], ``.g0`` [m] and ``.compliance`` (Compliance).
        laws: law and critical gap of every element.
        mu: friction coefficient, one or one per element; 0 solves without friction, as section 2
            of the source does.
        steps: equal load steps.
        tolerance: relative residual of the last step.
        max_iterations: Newton iterations allowed in one step.
        start: gaps of an equilibrium nearby [m], shape (elements,), to start from under the full
            loads.

    Returns:
        The equilibrium with its residual.

    Raises:
        Separated: the loads pull the bodies apart.
        NotConverged: Newton's iteration stalls.
    """
    began = time.perf_counter()
    system = Condensed(ops.compliance, ops.w, ops.g0, mu)
    newton = Newton(system, laws, max_iterations)
    if start is None:
        return record(laws, mu, newton.ramp(steps, tolerance), began)
    before = list[int]()
    near = start - laws.first_touch()
    some = np.sort(np.argsort(near)[: int(NEAR * np.sum(near < 0))])
    if system.compliance.carried is not None and 0 < some.size < near.size:
        # Nearly all of the way, among the elements that are closed or nearly so.
        chosen = replace(laws, index=laws.index[some], g_cr=laws.g_cr[some])
        few = Newton(system.part(some), chosen, max_iterations)
        with suppress(NotConverged):
            (found, _), before, _ = few.at_once(start[some], tolerance**0.5)
            start = np.array(start)
            start[some] = found
    state, counts, history = newton.at_once(start, tolerance)
    return record(laws, mu, (state, before + counts, history), began)


def raised_friction(
    ops: Any, laws: EnrichedGap, mu: float | Array, error: NotConverged, tolerance: float = 1e-10
) -> Equilibrium:
    """Equilibrium that is followed from the one without friction, as friction grows.

    Each step starts from the straight line through the last two equilibria, and is halved where
    Newton's iteration fails from there.

    Args:
        ops: as in ``equilibrium``.
        laws: law and critical gap of every element.
        mu: friction coefficient at which none was found, one or one per element.
        error: how the equilibrium failed.
        tolerance: relative residual.

    Returns:
        The equilibrium at ``mu``, where it is reached.

    Raises:
        NotConverged: it is not: up to which friction it is; ``error`` where there is none without
            friction, or nothing rubs.
    """
    largest = float(np.max(np.abs(mu)))
    if largest == 0.0:
        raise error
    try:
        shares, found = [0.0], [equilibrium(ops, laws, 0.0, tolerance=tolerance)]
    except NotConverged:
        raise error from None
    step = FIRST
    while shares[-1] < 1.0 and step >= SMALLEST:
        share, start = min(shares[-1] + step, 1.0), found[-1].g
        if len(found) > 1:
            slope = (found[-1].g - found[-2].g) / (shares[-1] - shares[-2])
            start = start + (share - shares[-1]) * slope
        try:
            eq = equilibrium(ops, laws, share * np.asarray(mu), tolerance=tolerance, start=start)
        except NotConverged:
            step *= 0.5
            continue
        shares, found = [*shares[-1:], share], [*found[-1:], eq]
        step *= GROWTH
    if shares[-1] == 1.0:
        return replace(found[-1], mu=mu)
    raise NotConverged(f"""equilibrium: none was found at a friction coefficient of {largest:.3g};
        the one without friction was followed up to {shares[-1] * largest:.3g} and no further: more
        friction tips or locks a part; lower the friction, or change supports or loads""")


def record(
    laws: EnrichedGap,
    mu: float | Array,
    found: tuple[State, list[int], list[float]],
    start: float,
    u: Array | None = None,
) -> Equilibrium:
    """What a ramp found, as an equilibrium; the clock was started at ``start`` [s]."""
    (g, _), counts, history = found
    (p, k), v, steps = laws.loading(g), laws.vibration(g)[0], tuple(history)
    seconds = time.perf_counter() - start
    return Equilibrium(g, p, k, v, mu, tuple(counts), history[-1], steps, seconds, u)


def solved(J: Array, b: Array, elements: int) -> Array:
    """Solution of J x = b to double precision: in single precision, refined with the exact matrix.

    Columns of elements that hardly carry anything are left to the refinement: in rough contact most
    elements are open.

    Args:
        J: 1 and the compliance times stiffness, shape (rows, rows): elements, then free
            coordinates.
        b: shape (rows,).
        elements: number of elements.

    Raises:
        NotConverged: the matrix is singular.
    """
    size = np.abs(J.diagonal() - 1.0)
    chosen = size > LITTLE
    chosen[np.argmax(size)] = True
    chosen[elements:] = True
    chosen |= chosen.mean() > MOST
    try:
        with warnings.catch_warnings():
            # Nearly all elements open: the line search judges what the step is worth.
            warnings.simplefilter("ignore", la.LinAlgWarning)
            x = _refined(J, b, chosen)
            return x if x is not None else la.solve(J, b)
    except (la.LinAlgError, ValueError) as error:
        raise NotConverged("""equilibrium: all contact elements open during the iteration; raise the
            load steps""") from error


def _refined(J: Array, b: Array, chosen: Mask) -> Array | None:
    """Solution by refinement; None where it is not enough of a start."""
    own = (J if chosen.all() else J[chosen][:, chosen]).astype(np.float32, order="F")
    lu = la.lu_factor(own, overwrite_a=True, check_finite=False)
    x, r, steps = np.zeros_like(b), b, Steps(1, REFINED, REFINEMENTS)
    while steps.moving.any():
        dx = np.zeros_like(b)
        dx[chosen] = la.lu_solve(lu, r[chosen].astype(np.float32), check_finite=False)
        if not chosen.all():
            dx[~chosen] = (r - J @ dx)[~chosen]
        # Not finite: springs so soft that no element is among the chosen; a free body has none.
        if not steps.take(*sizes(dx[:, None], x[:, None])):
            return None
        x = x + dx
        r = b - J @ x
    return x if steps.left <= ENOUGH else None


@dataclass(frozen=True, slots=True)
class Condensed:
    """The bodies through the compliance of their contact elements; see ``newton.System``.

    Attributes:
        compliance: the bodies seen from the contact elements.
        w: areas [m^2], shape (elements,).
        g0: gaps of the undeformed bodies [m].
        mu: friction coefficient, one or one per element.
    """

    compliance: Compliance
    w: Array
    g0: Array
    mu: float | Array

    def carried(self) -> tuple[float, float]:
        """Force of the springs k0 under the loads [N], and their mean [Pa/m]."""
        c = self.compliance
        force = -float(np.sum(self.w * c.k0 * c.Nf)) if c.carried is None else c.carried
        return force, float(c.k0.mean())

    def linear(self, load: float, a: Array, k: Array) -> Array:
        """Gaps of the system whose contact pressures are a - k g."""
        c, n = self.compliance, self.w.size
        k0 = c.k0 if c.carried is None else 0.0
        pushed, stiffness, still = np.zeros_like(c.Nf), np.ones_like(c.Nf), load * c.Nf
        pushed[:n], stiffness[:n] = self.w * (a - k0 * self.g0), self.w * (k - k0)
        still[:n] += self.g0
        forces = patch_forces(self.w, a, k, sliding(self.mu, a))
        friction, along = forces.value[1], forces.gap[1]
        # Open elements only follow: nothing acts in them.
        acts = (stiffness != 0) | (pushed != 0)
        acts[:n] |= (along != 0) | (friction != 0)
        acts[:1] = True
        some, rubs = (slice(None) if A.all() else np.flatnonzero(A) for A in (acts, acts[:n]))
        NN, NT = c.NN[some][:, some], c.NT[some][:, rubs]
        J, x = np.empty(NN.shape), np.zeros_like(still)
        # Some rows at a time, which stay in the cache: each large array passes memory once.
        for rows in (slice(i, i + ROWS) for i in range(0, len(J), ROWS)):
            np.multiply(NN[rows], stiffness[some], out=J[rows])
            J[rows, : NT.shape[1]] -= NT[rows] * along[rubs]
        J[np.diag_indices_from(J)] += 1.0
        b = still[some] + NN @ pushed[some] + NT @ friction[rubs]
        x[some] = solved(J, b, NT.shape[1])
        followed = c.NN @ (pushed - stiffness * x) + c.NT @ (friction + along * x[:n])
        return np.where(acts, x, still + followed)[:n]

    def part(self, some: Index) -> "Condensed":
        """Some elements, where all others are open; no springs k0 are in the compliance."""
        c, n = self.compliance, self.w.size
        rows = np.r_[some, n : len(c.NN)]
        NN, NT = c.NN[rows][:, rows], c.NT[rows][:, some]
        seen = replace(c, k0=c.k0[some], NN=NN, NT=NT, Nf=c.Nf[rows])
        mu = np.broadcast_to(self.mu, n)[some]
        return Condensed(seen, self.w[some], self.g0[some], mu)

    def norm(self, pressure: Array) -> float:
        """Norm of the forces of some pressures, weighted with the compliance."""
        force = self.w * pressure
        return float(np.sqrt(abs(force @ self.compliance.NN[: force.size, : force.size] @ force)))


def displacement(ops: Any, eq: Equilibrium, f: Array) -> Array:
    """Displacement u_e of an equilibrium [m], on all free dofs.

    Args:
        ops: anything with ``.N``, ``.T``, ``.w``, ``.g0`` and ``.compliance``.
        eq: the equilibrium.
        f: loads [N], all free dofs.

    Returns:
        Shape (free dofs,).
    """
    normal, along, _ = patch_forces(ops.w, eq.p, eq.k, sliding(eq.mu, eq.p)).value
    springs = ops.w * ops.compliance.k0 * (eq.g - ops.g0)
    return ops.compliance.solve(f + ops.N.T @ (normal + springs) + ops.T.T @ along)


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
    raise NotConverged(f"""equilibrium of changed bodies: corrections stall at a residual of
        {defect:.1e}; the materials are too far from those of the scene""")
