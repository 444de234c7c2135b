"""Modes of one sample along a parameter, on the vectors of a few of its values.

Along a line materials stay, and only the contact stiffness k and the friction of the contact
elements change. Values computed in full teach their vectors (``trial``); those between are found on
these by a projected problem of the form of the whole one, with its quotient and its estimate too,
and the residual of the whole problem is added to that (``projected``).

Whether no mode is missed is counted at the values computed in full. Between them every mode of the
trial space is found, and one that comes in from without shows in the residual of those it couples
with.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from brake_fenicsx.errors import InaccurateResult

from .contact_linearisation import ContactLinearisation
from .contact_rows import SIGMA
from .error_estimates import Corrected, corrected
from .polynomials import Zeros
from .projected import Projected
from .sample import Sample
from .sample_problem import Quotient
from .trial import LITTLE, Held, TrialSpace, real_columns

if TYPE_CHECKING:
    from .reduced_model import ReducedModel

Array = NDArray[np.float64]

# Values whose vectors are held at most; where so many in a row did not suffice, no more are tried.
HELD = 6

# Round-off of the coefficients in single precision, as a share of |z| (measured: a tenth of it).
SINGLE = 2e-8


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

    def learn(
        self, p: ArrayLike, sample: Sample, stiffness: Array, q: Quotient, interpolated: Array
    ) -> None:
        """Take the vectors of a value that was computed in full.

        Args:
            p: its point of the box.
            sample: its problem.
            stiffness: w k in units of the band, shape (elements,).
            q: its quotient.
            interpolated: errors of its zeros by the polynomials.
        """
        self.full += 1
        x = np.asarray(p, float)
        if self._held and not np.array_equal(x, self._p):
            self._held = []
        self._p, self._trial = x, None
        if not q.y.shape[1]:
            return
        closed = np.flatnonzero(stiffness > LITTLE * stiffness.max(initial=0.0))
        place = np.searchsorted(np.flatnonzero(stiffness), closed)
        seen = q.left[: sample.closed.count]
        y = np.zeros((stiffness.size, 2 * q.y.shape[1]), complex)
        y[closed] = np.hstack([q.y[place], seen[place] / stiffness[closed, None]])
        a = np.hstack([q.right, q.left[sample.closed.count :]])
        T = 0.5 * (sample.T[0] + sample.T[0].T)
        polynomials = float(np.max(interpolated * np.abs(q.slope), initial=0.0))
        held = Held(real_columns(a), real_columns(y), stiffness, T, polynomials)
        self._held = [*self._held[1 - HELD :], held]

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
            self._trial = TrialSpace.of(self._held, unit, self._tolerance)
        self._refused += 1
        projected = Projected(model, unit, self._trial, contact)
        try:
            zeros = projected.problem.zeros(*model.searched)
            q = projected.problem.quotient(zeros)
        except InaccurateResult:
            return None
        left_out = projected.left_out(zeros, q) + SINGLE * np.abs(zeros.z)
        square = projected.square(zeros.z)
        wanted = self._tolerance * np.maximum(square, SIGMA)
        if not np.all((left_out <= wanted)[square <= 1.0]) or not zeros.z.size:
            return None
        self.projected, self._refused = self.projected + 1, 0
        out = corrected(zeros, q, (left_out + self._trial.polynomials) / np.abs(q.slope))
        found, V = out.zeros, self._trial.V
        whole = Zeros(found.every, found.chosen, V @ found.right, V @ found.left)
        return Corrected(whole, out.slope, out.error)
