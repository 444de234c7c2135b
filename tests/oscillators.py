"""Oscillators whose limit cycles are known, as bodies and forces of harmonic balance."""

import numpy as np

from brake_fenicsx.extras.limit_cycle.bodies import Bodies
from brake_fenicsx.extras.limit_cycle.harmonic_balance import Condition, HarmonicBalance, Tangent


def matrices(M, C, K, out, acting):
    """Bodies given by M, C and K, rows of motions and those that forces act along."""
    none = np.zeros((1, len(out), len(acting)))

    def weights(s):
        return s ** np.arange(3)[:, None], np.ones((1, s.size))

    return Bodies(np.array([K, C, M]), acting.T[None], out[None], none, weights)


def oscillator(force, to_x, to_v, c=0.0, harmonics=15, points=128):
    """x'' + c x' + x = force(x, x')."""
    one = np.ones((1, 1))

    def forces(y, v):
        shape = (1, 1, 1, -1)
        return force(y, v), Tangent(to_x(y, v).reshape(shape), to_v(y, v).reshape(shape))

    return HarmonicBalance(matrices(one, c * one, one, one, one), forces, one[0], harmonics, points)


def first_vibration(problem, s, amplitude):
    return problem.start(s, np.ones(1), np.ones(1), amplitude)


def no_growth(guess):
    """The condition that growth is that of a guess without any."""
    assert guess.s.real == 0
    return Condition(np.zeros_like(guess.a), np.zeros_like(guess.y), 1.0)


def van_der_pol(e, **more):
    return oscillator(
        lambda x, v: e * (1 - x**2) * v, lambda x, v: -2 * e * x * v, lambda x, v: e * (1 - x**2),
        **more,
    )  # fmt: skip
