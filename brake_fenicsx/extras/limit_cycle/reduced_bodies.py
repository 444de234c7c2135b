"""The reduced model of a brake as harmonic balance sees it, at any lambda.

What the kept modes leave out is a power series about the start of the band. Beyond the band, and
HELD of the way to its nearest pole, it keeps the value it has there: higher harmonics meet the kept
modes, and a local compliance that does not change any more.
"""

from __future__ import annotations

import numpy as np

from brake_fenicsx.stability.substructures import ReducedModel

from .bodies import Array, Bodies, Complex

HELD = 0.5


def reduced_bodies(model: ReducedModel, p: Array, mu: Array) -> Bodies:
    """The bodies of a sample, with all its contact elements.

    Args:
        model: the reduced model.
        p: the sample's point of the box.
        mu: friction coefficients of the elements. Where no force follows a rate, friction is mu
            times the normal force, and normal forces are the only acting rows.
    """
    f, g = len(model.rows.followed), len(model.rows.acting)
    size, views, c = model.bodies[-1].modes.stop, model.at(p), mu.size
    count = len(views[0].D)
    coupled = any(body.component.coupled for body in model.bodies)
    own = np.zeros((len(views[0].modal), size, size))
    coupling = np.zeros((count * coupled, size, size))
    lead: Array = np.zeros((count if coupled else 1, size, g * c))
    D: Array = np.zeros((count, f * c, g * c))
    source = np.zeros((len(lead), f * c, size))
    for body, view in zip(model.bodies, views, strict=True):
        comp, modes, m = body.component, body.modes, body.elements.size
        followed, acting = (
            (body.elements + c * np.arange(blocks)[:, None]).ravel() for blocks in (f, g)
        )
        own[:, modes, modes] += view.modal
        lead[0][modes, acting] += view.acting.T
        source[0][followed, modes] += view.followed
        for n, A in enumerate(view.D):
            D[n][np.ix_(followed, acting)] += A[: f * m, : g * m]
            if comp.coupled:
                X = slice(g * m, g * m + comp.W.shape[1])
                coupling[n, modes, modes] -= A[f * m :, X]
                lead[n][modes, acting] -= A[f * m :, : g * m]
                source[n][followed, modes] -= A[: f * m, X]
    if model.rows.followed == "N":
        lead, D = (A[..., :c] + mu * A[..., c:] for A in (lead, D))
    omega = 2 * np.pi * model.band[1]
    unit = omega**2
    end = np.abs(model.rows.variable(model.scaled(np.array(1j * omega))))
    reach = max(HELD * model.pole, float(end))

    def weights(lam: Complex) -> tuple[Complex, Complex]:
        w = model.rows.variable(model.scaled(lam))
        held = w * np.minimum(1.0, reach / np.abs(w))
        powers = held ** np.arange(count)[:, None]
        return np.concatenate([w ** np.arange(len(own))[:, None], powers]), powers

    lead, D = np.asarray(lead / unit, float), np.asarray(D / unit, float)
    return Bodies(np.concatenate([own, coupling]), lead, source, D, weights)
