"""The reduced model of a brake as harmonic balance sees it: some contact elements at any lambda.

What the kept modes leave out is a power series about the start of the band. Beyond HELD of the way
to its nearest pole it keeps the value it has there: higher harmonics meet the kept modes, and a
local compliance that does not change any more.
"""

from __future__ import annotations

import numpy as np

from brake_fenicsx.stability.substructures import ReducedModel
from brake_fenicsx.stability.substructures.sample import Closed

from .bodies import Array, Bodies, Complex, Index

HELD = 0.5


def reduced_bodies(
    model: ReducedModel, p: Array, mu: Array, elements: Index, watched: Index | None = None
) -> Bodies:
    """Some contact elements of a sample.

    Args:
        model: the reduced model.
        p: the sample's point of the box.
        mu: friction coefficients of all elements. Where no force follows a rate, friction is mu
            times the normal force, and normal forces are the only acting rows.
        elements: those that carry forces.
        watched: those whose motions are followed; the same if None.
    """
    f, g = len(model.rows.followed), len(model.rows.acting)
    seen = elements if watched is None else watched
    size, views = model.bodies[-1].modes.stop, model.at(p)
    count, rows, columns = len(views[0].D), f * seen.size, g * elements.size
    coupled = any(body.component.coupled for body in model.bodies)
    terms = count if coupled else 1
    own = np.zeros((len(views[0].modal), size, size))
    coupling = np.zeros((count * coupled, size, size))
    lead: Array = np.zeros((terms, size, columns))
    D: Array = np.zeros((count, rows, columns))
    source = np.zeros((terms, rows, size))
    for body, view in zip(model.bodies, views, strict=True):
        comp, modes, m = body.component, body.modes, body.elements.size
        here, place = _shared(body.elements, seen).rows(f, m, seen.size)
        acting, there = _shared(body.elements, elements).rows(g, m, elements.size)
        own[:, modes, modes] += view.modal
        lead[0][modes, there] += view.acting[acting].T
        source[0][place, modes] += view.followed[here]
        for n, A in enumerate(view.D):
            D[n][np.ix_(place, there)] += A[np.ix_(here, acting)]
            if comp.coupled:
                first, X = f * m, slice(g * m, g * m + comp.W.shape[1])
                coupling[n, modes, modes] -= A[first:, X]
                lead[n][modes, there] -= A[first:, acting]
                source[n][place, modes] -= A[here, X]
    if model.rows.followed == "N":
        n = elements.size
        lead, D = (A[..., :n] + mu[elements] * A[..., n:] for A in (lead, D))
    unit = (2 * np.pi * model.band[1]) ** 2

    def weights(lam: Complex) -> tuple[Complex, Complex]:
        z = model.scaled(lam)
        held = z * np.minimum(1.0, HELD * model.pole / np.abs(z))
        powers = held ** np.arange(count)[:, None]
        return np.concatenate([z ** np.arange(len(own))[:, None], powers]), powers

    lead, D = np.asarray(lead / unit, float), np.asarray(D / unit, float)
    return Bodies(np.concatenate([own, coupling]), lead, source, D, weights)


def _shared(of_body: Index, chosen: Index) -> Closed:
    """Chosen elements that lie on a body: their places among its own, and among the chosen."""
    at = np.full(int(max(of_body.max(initial=0), chosen.max(initial=0))) + 1, -1)
    at[of_body] = np.arange(of_body.size)
    on = np.flatnonzero(at[chosen] >= 0)
    return Closed(at[chosen[on]], on)
