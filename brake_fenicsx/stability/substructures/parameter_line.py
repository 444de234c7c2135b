"""Modes of one sample along a parameter, on the vectors of a few of its values.

Along a line materials stay, and only the contact stiffness k and the friction of the contact
elements change. Values computed in full teach their vectors, right and left ones, one space for
both: a = V c, y = Y e. Those between are found on these by a projected problem of the form of the
whole one, with its quotient and its estimate. Contact forces J(x) y with the stiffness of the value
itself are exact in every element, also where the law has a kink; the test motions are those that do
work on them, (k Y)'. The residual r of the whole problem says what the projection costs: r' P^-1 r
over the slope, with the static compliance of springs and bodies in the contact elements, and in the
coordinates the distance to the next mode beyond the trial vectors (G. W. Stewart and J. Sun, Matrix
Perturbation Theory, 1990, section V.2, there for one symmetric matrix).

Whether no mode is missed is counted at the values computed in full. Between them every mode of the
trial space is found, and one that comes in from without shows in the residual of those it couples
with.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike

from brake_fenicsx.arguments import AnyArray, Array, Complex
from brake_fenicsx.errors import InaccurateResult

from ..eigensolvers.eigenpairs import on_parts
from ..modes import Count, Modes
from .contact_rows import SIGMA, ContactLinearisation
from .polynomials import Zeros, applied, whole, zeros
from .reduced_model import ReducedModel
from .sample import BlockMatrix, Corrected, Sample, corrected
from .sample_problem import Quotient, SampleProblem

# Values whose vectors are held at most; where so many in a row did not suffice, no more are tried.
HELD = 6

# Round-off of the coefficients in single precision, as a share of |z| (measured: a tenth of it).
SINGLE = 2e-8

# Trial coordinates and motions have at least these shares of the largest singular value of all,
# times the root of the tolerance: the error is of second order in what is left out. Measured at the
# demo brake, where two values then suffice for friction from 0 to 0.8.
KEPT, MOVING = 0.1, 0.1

# Elements below this share of the largest stiffness teach no motions.
LITTLE = 1e-12

# Bodies are symmetric up to this share of their matrices.
SYMMETRIC = 1e-10

# A stiffness of motions that work on no spring, over that of the others.
NO_FORCE = 1e-13

# So many coefficients tell the residual of the motions; those beyond are a ten-thousandth of D_0.
SEEN = 3

# Least distance to the modes beyond the trial vectors, in units of the band's end squared.
NEAREST = 1e-3

NEAR = Count("not counted", "found on the vectors of other values of the sample")


@dataclass(frozen=True, slots=True)
class Held:
    """What one value computed in full adds to the trial vectors.

    Attributes:
        a: right and left coordinates, real, shape (kept modes, columns).
        y: motions at all contact elements, zero in open ones, likewise.
        stiffness: w k in units of the band, shape (elements,).
        T: symmetric part of T(0).
        polynomials: what the errors of the polynomials may add to b' T a.
    """

    a: Array
    y: Array
    stiffness: Array
    T: Array
    polynomials: float


@dataclass(frozen=True, slots=True)
class TrialSpace:
    """The trial space.

    Attributes:
        V: of the coordinates, orthonormal, shape (kept modes, r).
        Y: of the motions, shape (elements, q).
        beyond: least kappa + sigma of what V leaves out.
        own: own(z) V.
        source: source(z) V.
        polynomials: what the errors of the polynomials may add to b' T a.
    """

    V: Array
    Y: Array
    beyond: float
    own: Array
    source: Array
    polynomials: float

    @classmethod
    def of(cls, held: list[Held], b: BlockMatrix, tolerance: float) -> "TrialSpace":
        """Of the vectors of some values."""
        value, U = la.eigh(sum(h.a @ h.a.T for h in held))
        kept = value > KEPT**2 * tolerance * value[-1]
        V, rest = U[:, kept], U[:, ~kept]
        stiffness = np.mean([h.stiffness for h in held], axis=0)
        weight = np.sqrt(np.maximum(stiffness, LITTLE * (stiffness.max(initial=0.0) or 1.0)))
        Y = np.hstack([h.y for h in held]) * weight[:, None]
        size, X = la.eigh(Y.T @ Y)
        chosen = size > MOVING**2 * tolerance * size[-1]
        Y = Y @ (X[:, chosen] / np.sqrt(size[chosen])) / weight[:, None]
        beyond = la.eigvalsh(rest.T @ held[-1].T @ rest)[0] if rest.shape[1] else np.inf
        polynomials = max(h.polynomials for h in held)
        own, source = (np.array([A @ V for A in every]) for every in (b.own, b.source))
        return cls(V, Y, float(beyond), own, source, polynomials)


class Basis:
    """Vectors of the values of a line computed in full, and the modes of others on them.

    Attributes:
        full: values that were computed in full.
        projected: values that were found on the vectors of these.
    """

    def __init__(self, tolerance: float):
        """Start a line.

        Args:
            tolerance: relative error of lambda that the projection may add.
        """
        self.full = self.projected = self._refused = 0
        self._tolerance = tolerance
        self._p: Array = np.zeros(0)
        self._held: list[Held] = []
        self._trial: TrialSpace | None = None

    def modes(
        self,
        model: ReducedModel,
        p: ArrayLike,
        contact: ContactLinearisation,
        zeta_max: float = 0.1,
    ) -> Modes:
        """Complex modes of a value: on the vectors held where these suffice, or else in full.

        Args:
            model: the reduced model; nothing is held where contact forces follow rates.
            p: as of ``ReducedModel.modes``, with the other arguments.
            contact: likewise.
            zeta_max: likewise.
        """
        start, x = time.perf_counter(), np.asarray(p, float)
        holds = model.rows.followed == "N"
        near = self._found(model, x, contact) if holds else None
        if near is not None:
            return model.listed_modes(near, zeta_max, start, NEAR)
        sample = model.sample(x, contact)
        found, q, interpolated = model.quotient(sample)
        if holds:
            stiffness: Array = np.asarray(model.areas(x) * contact.k / model.omega**2, float)
            self._learn(x, sample, stiffness, q, interpolated)
        return model.listed_modes(corrected(found, q, interpolated), zeta_max, start)

    def _learn(
        self, x: Array, sample: Sample, stiffness: Array, q: Quotient, interpolated: Array
    ) -> None:
        """Take the vectors of a value that was computed in full.

        Args:
            x: its point of the box.
            sample: its problem.
            stiffness: w k in units of the band, shape (elements,).
            q: its quotient.
            interpolated: errors of its zeros by the polynomials.
        """
        self.full += 1
        if self._held and not np.array_equal(x, self._p):
            self._held = []
        self._p, self._trial = x, None
        if not q.y.shape[1]:
            return
        closed = np.flatnonzero(stiffness > LITTLE * stiffness.max(initial=0.0))
        place = np.searchsorted(sample.closed.elements, closed)
        seen = q.left[: sample.closed.count]
        y = np.zeros((stiffness.size, 2 * q.y.shape[1]), complex)
        y[closed] = np.hstack([q.y[place], seen[place] / stiffness[closed, None]])
        a = np.hstack([q.right, q.left[sample.closed.count :]])
        T = 0.5 * (sample.T[0] + sample.T[0].T)
        polynomials = float(np.max(interpolated * np.abs(q.slope), initial=0.0))
        held = Held(_real_columns(a), _real_columns(y), stiffness, T, polynomials)
        self._held = [*self._held[1 - HELD :], held]

    def _found(
        self, model: ReducedModel, x: Array, contact: ContactLinearisation
    ) -> Corrected | None:
        """Zeros of a value on the vectors held; None where these do not suffice."""
        known = len(self._held) > 1 and np.array_equal(x, self._p)
        if not known or self._refused == HELD:
            return None
        b = model.blocks(x, keep=True)
        if self._trial is None:
            own = whole(b.own)
            if la.norm(own - own.transpose(0, 2, 1)) > SYMMETRIC * la.norm(own):
                self._refused = HELD  # a body turns: no residual is known
                return None
            self._trial = TrialSpace.of(self._held, b, self._tolerance)
        self._refused += 1
        try:
            projected = Projected(model, b, self._trial, contact, model.areas(x))
        except InaccurateResult:
            return None
        near = zeros(projected.problem.T, 2 if model.rows.rates else 1, *model.searched)
        q = projected.problem.quotient(near)
        left_out = projected.left_out(near, q) + SINGLE * np.abs(near.z)
        square = projected.square(near.z)
        wanted = self._tolerance * np.maximum(square, SIGMA)
        if not np.all((left_out <= wanted)[square <= 1.0]) or not near.z.size:
            return None
        self.projected, self._refused = self.projected + 1, 0
        out = corrected(near, q, (left_out + self._trial.polynomials) / np.abs(q.slope))
        found, V = out.zeros, self._trial.V
        near = Zeros(found.every, found.chosen, V @ found.right, V @ found.left)
        return Corrected(near, out.slope, out.error)


class Projected:
    """The problem of one value on a trial space, and what that leaves out.

    Attributes:
        problem: of the form of the whole one.
    """

    def __init__(
        self,
        model: ReducedModel,
        b: BlockMatrix,
        t: TrialSpace,
        contact: ContactLinearisation,
        areas: Array,
    ):
        """Project the problem.

        Args:
            model: of all samples.
            b: its bodies, seen from all contact elements.
            t: the trial space.
            contact: what acts in the contact elements at the value.
            areas: of the contact elements [m^2].
        """
        self._t, self._source, self._rows = t, b.source, model.rows
        c, unit = areas.size, (model.omega**2 / areas)[:, None]
        self._k, f = contact.k[:, None] / unit, contact.friction[:, None] / unit
        # Friction over stiffness: one matrix for both forces saves half of the products.
        mu = np.divide(f, self._k, out=np.zeros_like(f), where=self._k > 0).T
        self._D = [A[:, :c] + A[:, c : 2 * c] * mu.astype(A.dtype) for A in b.D]
        lead = whole(b.lead)
        self._lead: Array = lead[..., :c] + lead[..., c : 2 * c] * mu
        self._J: Array = self._k * t.Y
        self._E = _products(self._D, self._J)
        self._E[0] += t.Y
        self._forced: Array = self._lead @ self._J
        E = [self._J.T @ A for A in self._E]
        # Motions of open elements alone meet no force.
        E[0][np.diag_indices(len(E[0]))] += NO_FORCE
        source, forced, own = self._J.T @ t.source, t.V.T @ self._forced, t.V.T @ t.own
        self.problem = SampleProblem(E, source, forced, own, model.rows)

    def square(self, z: Complex) -> Array:
        """|lambda|^2 in units of the band's end."""
        shift = self._rows.shift
        return np.asarray(np.abs(z + shift) ** 2 if self._rows.rates else np.abs(z - SIGMA))

    def left_out(self, near: Zeros, q: Quotient) -> Array:
        """What the whole problem adds to b' T a of each zero: r' P^-1 r of both residuals."""
        t, z, a, b = self._t, near.z, near.right, near.left
        eta = q.left[: t.Y.shape[1]]
        right = self._work(
            z,
            applied(self._E[:SEEN], z, q.y) - applied(t.source, z, a),
            applied(t.own, z, a) + applied(self._forced, z, q.y),
        )
        # The bodies are symmetric: own' = own.
        seen = _products([A.T for A in self._D[:SEEN]], self._J)
        seen[0] += t.Y
        source = [np.asarray(A.T @ self._J) for A in self._source]
        met = [np.asarray(A.T @ t.V) for A in self._lead]
        left = self._work(
            z,
            applied(seen, z, eta) - applied(met, z, b),
            applied(t.own, z, b) + applied(source, z, eta),
        )
        return np.sqrt(right * left)

    def _work(self, z: Complex, motions: Complex, rest: Complex) -> Array:
        """Of missing motions against springs and bodies together, and of missing coordinates."""
        missing: AnyArray = (np.sqrt(self._k) * motions).astype(np.complex64)
        stood = on_parts(lambda x: la.solve_triangular(self._stiff, x, trans="T"), missing)
        distance = np.maximum(self._t.beyond - SIGMA - self.square(z), NEAREST)
        work = la.norm(stood, axis=0) ** 2 + la.norm(rest, axis=0) ** 2 / distance
        return np.asarray(work)

    @cached_property
    def _stiff(self) -> AnyArray:
        """Factor of 1 + k^1/2 D k^1/2: of the symmetric part, whose inverse bounds the whole's."""
        D, root = self._D[0], np.sqrt(self._k)
        D = (0.5 * root * (D + D.T) * root.T).astype(np.float32)
        return np.asarray(la.cholesky(np.eye(len(D), dtype=np.float32) + D, check_finite=False))


def _real_columns(X: Complex) -> Array:
    """Real and imaginary parts of columns, without those that are zero."""
    return np.hstack([X.real, X.imag[:, np.any(X.imag, axis=0)]])


def _products(A: Sequence[AnyArray], X: Array) -> list[Array]:
    """A X of some matrices, each in its own precision."""
    return [(B @ X.astype(B.dtype)).astype(float) for B in A]
