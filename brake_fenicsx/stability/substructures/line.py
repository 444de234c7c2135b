"""Modes of one sample along a parameter, on the vectors of a few of its values.

Along a line materials stay, and only the contact stiffness k and the friction of the contact
elements change. Their bodies then stay too: with unit stiffness in every element, E = 1 + D J and
forced = L J hold D and L themselves, and these serve all values and all samples (``UnitContact``).

The trial vectors are a = V c, y = Y e: right and left vectors of the values that were computed in
full, one space for both, so that no oblique projection loses its footing. Contact forces
J(x) y with the stiffness of the value itself are exact in every element, also where the law has a
kink; the test motions are those that do work on them, (k Y)'. The projected problem has the form of
the whole one and is solved as such, its quotient and its estimate too (``problem``). The residual r
of the whole problem at what it finds says what the projection costs: r' P^-1 r over the slope,
with the static compliance of springs and bodies in the contact elements, and in the coordinates the
distance to the next mode beyond the trial vectors (G. W. Stewart and J. Sun, Matrix Perturbation
Theory, 1990, section V.2, there for one symmetric matrix).

Whether no mode is missed is counted at the values computed in full. Between them every mode of the
trial space is found, and one that comes in from without shows in the residual of those it couples
with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from brake_fenicsx.errors import InaccurateResult

from ..eigensolvers.arnoldi import on_parts
from ..modes import Complex
from .contact import ContactLinearisation
from .errors import Corrected, corrected
from .moments import SIGMA
from .polynomials import Zeros, applied
from .problem import Problem, Quotient
from .sample import Sample

if TYPE_CHECKING:
    from .model import ReducedModel

Array = NDArray[np.float64]

# Trial coordinates and motions have at least these shares of the largest singular value of all,
# times the root of the tolerance: the error is of second order in what is left out. Measured at the
# demo brake, where two values then suffice for friction from 0 to 0.8.
KEPT, MOVING = 0.1, 0.1

# Values whose vectors are held at most; where so many in a row did not suffice, no more are tried.
HELD = 6

# Elements below this share of the largest stiffness teach no motions; and a stiffness of motions
# that work on no spring, over that of the others.
LITTLE, NO_FORCE = 1e-12, 1e-13

# Round-off of the moments in single precision, as a share of |z| (measured: a tenth of it).
SINGLE = 2e-8

# So many moments tell the residual of the motions; those beyond are a ten-thousandth of the first.
SEEN = 3

# Bodies are symmetric up to this share of their matrices.
SYMMETRIC = 1e-10

# Least distance to the modes beyond the trial vectors, in units of the band's end squared.
NEAREST = 1e-3


@dataclass(frozen=True, slots=True)
class UnitContact:
    """The bodies as their contact elements see them, under unit stiffness in each.

    Attributes:
        normal: D of normal forces, shape (elements, elements) for each moment; those beyond the
            first in single precision: they are less than a thousandth of it.
        friction: D of friction forces, likewise.
        lead: L of both, shape (coefficients, kept modes, elements).
        source: see ``problem``.
        own: likewise.
        symmetric: whether the bodies are, as without rotation.
    """

    normal: list[NDArray[Any]]
    friction: list[NDArray[Any]]
    lead: tuple[Array, Array]
    source: Array
    own: Array
    symmetric: bool

    @classmethod
    def of(cls, model: ReducedModel, p: ArrayLike) -> UnitContact:
        """Assemble them for a point of the box."""
        unit, none = model.unit_stiffness, np.zeros_like(model.unit_stiffness)
        one = model.sample(p, ContactLinearisation.of(unit, 0.0))
        other = model.sample(p, ContactLinearisation(none, unit, none, none))
        D = []
        for sample in (one, other):
            sample.E[0][np.diag_indices(unit.size)] -= 1.0
            D.append([sample.E[0], *(E.astype(np.float32) for E in sample.E[1:])])
        lead = np.asarray(one.forced), np.asarray(other.forced)
        own = np.asarray(one.own)
        symmetric = bool(la.norm(own - own.transpose(0, 2, 1)) <= SYMMETRIC * la.norm(own))
        return cls(D[0], D[1], lead, np.asarray(one.source), own, symmetric)


@dataclass(frozen=True, slots=True)
class Held:
    """What one value computed in full adds to the trial vectors.

    Attributes:
        a: right and left coordinates, real, shape (kept modes, columns).
        y: motions at all contact elements, zero in open ones, likewise.
        stiffness: w k in units of the band, shape (elements,).
        T: symmetric part of T(0).
        moments: what the interpolation of the moments may add to b' T a.
    """

    a: Array
    y: Array
    stiffness: Array
    T: Array
    moments: float


@dataclass(frozen=True, slots=True)
class Trial:
    """The trial space.

    Attributes:
        V: of the coordinates, orthonormal, shape (kept modes, r).
        Y: of the motions, shape (elements, q).
        beyond: least kappa + sigma of what V leaves out.
        own: own(z) V.
        source: source(z) V.
        moments: what the interpolation of the moments may add to b' T a.
    """

    V: Array
    Y: Array
    beyond: float
    own: Array
    source: Array
    moments: float

    @classmethod
    def of(cls, held: list[Held], unit: UnitContact, tolerance: float) -> Trial:
        """Of the vectors of some values."""
        value, U = la.eigh(sum(h.a @ h.a.T for h in held))
        kept = value > KEPT**2 * tolerance * value[-1]
        V, rest = U[:, kept], U[:, ~kept]
        stiffness = np.mean([h.stiffness for h in held], axis=0)
        weight = np.sqrt(np.maximum(stiffness, LITTLE * stiffness.max(initial=0.0)))
        Y = np.hstack([h.y for h in held]) * weight[:, None]
        size, X = la.eigh(Y.T @ Y)
        chosen = size > MOVING**2 * tolerance * size[-1]
        Y = Y @ (X[:, chosen] / np.sqrt(size[chosen])) / weight[:, None]
        beyond = la.eigvalsh(rest.T @ held[-1].T @ rest)[0] if rest.shape[1] else np.inf
        moments = max(h.moments for h in held)
        return cls(V, Y, float(beyond), unit.own @ V, unit.source @ V, moments)


class Line:
    """Modes of one sample at values of a parameter, one after the other.

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
        self._p, self._held = np.zeros(0), list[Held]()
        self._trial: Trial | None = None

    def learn(
        self, p: ArrayLike, sample: Sample, stiffness: Array, q: Quotient, interpolated: Array
    ) -> None:
        """Take the vectors of a value that was computed in full.

        Args:
            p: its point of the box.
            sample: its problem.
            stiffness: w k in units of the band, shape (elements,).
            q: its quotient.
            interpolated: errors of its zeros by the interpolation of the moments.
        """
        self.full += 1
        x = np.asarray(p, float)
        if self._held and not np.array_equal(x, self._p):
            self._held = []
        self._p, self._trial = x, None
        closed = np.flatnonzero(stiffness > LITTLE * stiffness.max(initial=0.0))
        place = np.searchsorted(np.flatnonzero(stiffness), closed)
        seen = q.left[: sample.count]
        y = np.zeros((stiffness.size, 2 * q.y.shape[1]), complex)
        y[closed] = np.hstack([q.y[place], seen[place] / stiffness[closed, None]])
        a = np.hstack([q.right, q.left[sample.count :]])
        T = 0.5 * (sample.T[0] + sample.T[0].T)
        moments = float(np.max(interpolated * np.abs(q.slope), initial=0.0))
        self._held = [
            *self._held[1 - HELD :], Held(_real(a), _real(y), stiffness, T, moments)
        ]  # fmt: skip

    def found(
        self, model: ReducedModel, p: ArrayLike, contact: ContactLinearisation
    ) -> Corrected | None:
        """Zeros of a value on the vectors held; None where these do not suffice."""
        known = len(self._held) > 1 and np.array_equal(np.asarray(p, float), self._p)
        if not known or self._refused == HELD:
            return None
        unit = model.unit_contact(p)
        if not unit.symmetric:
            return None
        if self._trial is None:
            self._trial = Trial.of(self._held, unit, self._tolerance)
        self._refused += 1
        projected = _Projected(model, unit, self._trial, contact)
        try:
            zeros = projected.problem.zeros(*model.searched)
            q = projected.problem.quotient(zeros)
        except InaccurateResult:
            return None
        left_out = projected.left_out(zeros, q) + SINGLE * np.abs(zeros.z)
        square = projected.square(zeros.z)
        wanted = self._tolerance * np.maximum(square, SIGMA)
        if np.any((left_out > wanted)[square <= 1.0]) or not zeros.z.size:
            return None
        self.projected, self._refused = self.projected + 1, 0
        out = corrected(zeros, q, (left_out + self._trial.moments) / np.abs(q.slope))
        found, V = out.zeros, self._trial.V
        whole = Zeros(found.every, found.chosen, V @ found.right, V @ found.left)
        return Corrected(whole, out.slope, out.error)


class _Projected:
    """The problem of one value on a trial space, and what that leaves out."""

    def __init__(
        self, model: ReducedModel, unit: UnitContact, t: Trial, contact: ContactLinearisation
    ):
        self._t, self._unit, self._rows = t, unit, model.rows
        unit_k = model.unit_stiffness[:, None]
        self._k, f = contact.k[:, None] / unit_k, contact.friction[:, None] / unit_k
        # Friction over stiffness.
        self._mu: Array = np.divide(f, self._k, out=np.zeros_like(f), where=self._k > 0)
        self._J: Array = self._k * t.Y
        F: Array = f * t.Y
        self._pressed = _products(unit.normal, self._J)
        rubbed = _products(unit.friction, F)
        self._pressed[0] += t.Y
        self._E = [A + B for A, B in zip(self._pressed, rubbed, strict=True)]
        self._lead: Array = unit.lead[0] @ self._J + unit.lead[1] @ F
        E = [self._J.T @ A for A in self._E]
        # Motions of open elements alone meet no force.
        E[0][np.diag_indices(len(E[0]))] += NO_FORCE
        source, forced, own = self._J.T @ t.source, t.V.T @ self._lead, t.V.T @ t.own
        self.problem = Problem(E, source, forced, own, model.rows, model.pole)

    def square(self, z: Complex) -> Array:
        """|lambda|^2 in units of the band's end."""
        shift = self._rows.shift
        return np.asarray(np.abs(z + shift) ** 2 if self._rows.damped else np.abs(z - SIGMA))

    def left_out(self, zeros: Zeros, q: Quotient) -> Array:
        """What the whole problem adds to b' T a of each zero: r' P^-1 r of both residuals."""
        t, unit, z, a, b = self._t, self._unit, zeros.z, zeros.right, zeros.left
        eta = q.left[: t.Y.shape[1]]
        right = self._work(
            z,
            applied(self._E[:SEEN], z, q.y) - applied(t.source, z, a),
            applied(t.own, z, a) + applied(self._lead, z, q.y),
        )
        # The bodies are symmetric: own' = own and normal' = normal.
        slips = _products([A.T for A in unit.friction[:2]], self._J)
        seen = [A + self._mu * B for A, B in zip(self._pressed, slips, strict=False)]
        seen += self._pressed[2:SEEN]
        source = [np.asarray(A.T @ self._J) for A in unit.source]
        met = [
            np.asarray(A.T @ t.V + self._mu * (B.T @ t.V)) for A, B in zip(*unit.lead, strict=True)
        ]
        left = self._work(
            z,
            applied(seen, z, eta) - applied(met, z, b),
            applied(t.own, z, b) + applied(source, z, eta),
        )
        return np.sqrt(right * left)

    def _work(self, z: Complex, motions: Complex, rest: Complex) -> Array:
        """Of missing motions against springs and bodies together, and of missing coordinates."""
        missing: NDArray[Any] = (self._root * motions).astype(np.complex64)
        stood = on_parts(lambda x: la.solve_triangular(self._stiff, x, trans="T"), missing)
        distance = np.maximum(self._t.beyond - SIGMA - self.square(z), NEAREST)
        work = la.norm(stood, axis=0) ** 2 + la.norm(rest, axis=0) ** 2 / distance
        return np.asarray(work)

    @property
    def _root(self) -> Array:
        return np.asarray(np.sqrt(self._k))

    @cached_property
    def _stiff(self) -> NDArray[Any]:
        """Factor of 1 + k^1/2 D k^1/2: of the symmetric part, whose inverse bounds the whole's."""
        D = self._unit.normal[0] + self._unit.friction[0] * self._mu.T
        D = (0.5 * self._root * (D + D.T) * self._root.T).astype(np.float32)
        return np.asarray(la.cholesky(np.eye(len(D), dtype=np.float32) + D, check_finite=False))


def _products(A: Sequence[NDArray[Any]], X: Array) -> list[Array]:
    """A X of some matrices, each in its own precision."""
    return [(B @ X.astype(B.dtype)).astype(float) for B in A]


def _real(X: Complex) -> Array:
    """Real and imaginary parts of columns, without those that are zero."""
    return np.hstack([X.real, X.imag[:, np.any(X.imag, axis=0)]])
