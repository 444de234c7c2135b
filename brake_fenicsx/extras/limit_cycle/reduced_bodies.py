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
    b, c, views = model.blocks(p), mu.size, model.at(p)
    lead, n = b.lead, len(views[0].modal)
    D: Array = np.array(b.D, float)
    # The kept modes follow any lambda, what they leave out does not.
    kept, coupling = np.zeros((n, *b.own.shape[1:])), np.array(b.own)
    for body, view in zip(model.bodies, views, strict=True):
        kept[:, body.modes, body.modes] = view.modal
    coupling[:n] -= kept
    if model.rows.followed == "N":
        lead, D = lead[..., :c] + mu * lead[..., c:], D[..., :c] + mu * D[..., c:]
    omega = 2 * np.pi * model.band[1]
    unit = omega**2
    end = np.abs(model.rows.variable(model.scaled(np.array(1j * omega))))
    reach = max(HELD * model.pole, float(end))

    def weights(lam: Complex) -> tuple[Complex, Complex]:
        w = model.rows.variable(model.scaled(lam))
        held = w * np.minimum(1.0, reach / np.abs(w))
        powers = held ** np.arange(len(D))[:, None]
        return np.concatenate([w ** np.arange(n)[:, None], powers]), powers

    lead, D = np.asarray(lead / unit, float), np.asarray(D / unit, float)
    return Bodies(np.concatenate([kept, coupling]), lead, b.source, D, weights)
