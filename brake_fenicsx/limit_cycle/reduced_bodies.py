"""The reduced model of a brake as harmonic balance sees it: some contact elements at any lambda.

What the kept modes leave out is a power series about the start of the band. Beyond HELD of the way
to its nearest pole it keeps the value it has there: higher harmonics meet the kept modes, and a
local compliance that does not change any more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.stability.substructures import ReducedModel
from brake_fenicsx.stability.substructures.sample import Closed

from .harmonic_balance import Response

Array = NDArray[np.float64]
Index = NDArray[np.intp]
HELD = 0.5


class ReducedBodies:
    """The bodies of one sample; see ``harmonic_balance.Bodies``."""

    def __init__(
        self, model: ReducedModel, p: Array, mu: Array, elements: Index,
        watched: Index | None = None,
    ):  # fmt: skip
        """Assemble some contact elements.

        Args:
            model: the reduced model.
            p: the sample's point of the box.
            mu: friction coefficients of all elements. Where no force follows a rate, friction is
                mu times the normal force, and normal forces are the only acting rows.
            elements: those that carry forces.
            watched: those whose motions are followed; the same if None.
        """
        self._model = model
        f, g = len(model.rows.followed), len(model.rows.acting)
        seen = elements if watched is None else watched
        size, views = model.bodies[-1].modes.stop, model.at(p)
        count, rows, columns = len(views[0].D), f * seen.size, g * elements.size
        self._own = np.zeros((len(views[0].modal), size, size))
        self._coupling = np.zeros((count, size, size))
        self._lead: Array = np.zeros((count, size, columns))
        self._source: Array = np.zeros((count, rows, size))
        self._D: Array = np.zeros((count, rows, columns))
        for body, view in zip(model.bodies, views, strict=True):
            comp, modes, m = body.component, body.modes, body.elements.size
            own, place = _shared(body.elements, seen).rows(f, m, seen.size)
            acting, there = _shared(body.elements, elements).rows(g, m, elements.size)
            self._own[:, modes, modes] += view.modal
            self._lead[0][modes, there] += comp.acting[acting].T
            self._source[0][place, modes] += comp.followed[own]
            for n, D in enumerate(view.D):
                self._D[n][np.ix_(place, there)] += D[np.ix_(own, acting)]
                if comp.coupled:
                    first, X = f * m, slice(g * m, g * m + comp.W.shape[1])
                    self._coupling[n, modes, modes] -= D[first:, X]
                    self._lead[n][modes, there] -= D[first:, acting]
                    self._source[n][place, modes] -= D[own, X]
        if model.rows.followed == "N":
            n = elements.size
            self._lead, self._D = (
                A[..., :n] + mu[elements] * A[..., n:] for A in (self._lead, self._D)
            )
        self._lead /= (2 * np.pi * model.band[1]) ** 2
        self._D /= (2 * np.pi * model.band[1]) ** 2
        self._held = HELD * model.pole

    def at(self, s: complex) -> Response:
        """The bodies at lambda = s [1/s]."""
        z = complex(self._model.scaled(np.array(s)))
        held = z * min(1.0, self._held / abs(z))
        powers = held ** np.arange(len(self._D))
        own, lead, source, D = (
            np.asarray(np.tensordot(powers, A, 1), complex)
            for A in (self._coupling, self._lead, self._source, self._D)
        )
        own = own + np.asarray(np.tensordot(z ** np.arange(len(self._own)), self._own, 1), complex)
        return Response(own, lead, source, D)


def _shared(of_body: Index, chosen: Index) -> Closed:
    """Chosen elements that lie on a body: their places among its own, and among the chosen."""
    at = np.full(int(max(of_body.max(initial=0), chosen.max(initial=0))) + 1, -1)
    at[of_body] = np.arange(of_body.size)
    on = np.flatnonzero(at[chosen] >= 0)
    return Closed(at[chosen[on]], on)
