"""Oscillators whose limit cycles are known, as bodies and forces of harmonic balance."""

from dataclasses import dataclass

import numpy as np

from brake_fenicsx.limit_cycle import HarmonicBalance, Response, Tangent


@dataclass
class Matrices:
    """Bodies given by M, C and K, forces along the rows I and motions along the rows O."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    out: np.ndarray
    acting: np.ndarray

    def at(self, s):
        own = s**2 * self.M + s * self.C + self.K + 0j
        return Response(own, self.acting.T, self.out, np.zeros((len(self.out), len(self.acting))))


def oscillator(force, to_x, to_v, c=0.0, harmonics=15, points=128):
    """x'' + c x' + x = force(x, x')."""
    one = np.ones((1, 1))

    def forces(y, v):
        shape = (1, 1, 1, -1)
        return force(y, v), Tangent(to_x(y, v).reshape(shape), to_v(y, v).reshape(shape))

    return HarmonicBalance(Matrices(one, c * one, one, one, one), forces, one[0], harmonics, points)


def first_vibration(problem, s, amplitude):
    return problem.start(s, np.ones(1), np.ones(1), amplitude)


def at(amplitude):
    return lambda v: (v.amplitude - amplitude, 0.0, 1.0)


def no_growth(v):
    return v.s.real, 1.0, 0.0


def van_der_pol(e, **more):
    return oscillator(
        lambda x, v: e * (1 - x**2) * v, lambda x, v: -2 * e * x * v, lambda x, v: e * (1 - x**2),
        **more,
    )  # fmt: skip
