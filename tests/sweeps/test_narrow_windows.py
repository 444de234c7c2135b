"""Windows of flutter of half a percent of the range, nine values: none is missed."""

import numpy as np
import pytest

from brake_fenicsx.sweeps.branches import follow
from sweep_models import solver

WIDE, WIDTH, PLACES = (0.0, 1e3), 0.005, np.linspace(0.0117, 0.9797, 18)


def pair(mean, d):
    """A block with the eigenvalues mean +- sqrt(d) / 2, modes far from orthogonal."""
    return np.array([[mean + 0.15, 1.0], [d / 4 - 0.15**2, mean - 0.15]])


def crossing(x0):
    """Two modes that merge, part and have changed their places."""
    return lambda x: np.array([[10 + 2 * (x - x0), WIDTH / 2], [-WIDTH / 2, 10.0]])


def touching(x0):
    """Two modes that approach, merge, split and part again."""
    return lambda x: pair(10.0, 1.5 * ((x - x0) ** 2 - (WIDTH / 2) ** 2) * (1 + 0.3 * x))


def beside(x0):
    """The same, while another pair grows at the value before."""
    other = touching(x0)

    def K(x):
        K = np.zeros((4, 4))
        K[:2, :2], K[2:, 2:] = other(x), pair(12.5, (x - x0 + 0.09) ** 2 - 0.06**2)
        return K

    return K


def third(x0):
    """A pair grows, splits, and one of its modes meets a third one within the same step."""

    def square(x):
        return 4.0 * ((x - x0 + 0.12) ** 2 - 0.08**2)

    w, V = np.linalg.eig(pair(10.0, square(x0)))
    low = int(np.argmin(w.real))
    right, left = V[:, low].real, np.linalg.inv(V)[low].real

    def K(x):
        K = np.zeros((3, 3))
        K[:2, :2], K[2, 2] = pair(10.0, square(x)), w[low].real + 3 * (x - x0)
        K[:2, 2], K[2, :2] = 1.5 * WIDTH * right, -1.5 * WIDTH * left
        return K

    return K


def changes(K):
    """How often the number of pairs rises and falls over the range, by eigenvalues alone."""
    kappa = np.linalg.eigvals(np.array([K(x) for x in np.linspace(0, 1, 4001)]))
    steps = np.diff(np.sum(np.abs(kappa.imag) > 1e-9, axis=1) // 2)
    return int(steps[steps > 0].sum()), -int(steps[steps < 0].sum())


@pytest.mark.long
@pytest.mark.parametrize("step", [1, -1])
@pytest.mark.parametrize("model", [crossing, touching, beside, third])
def test_narrow_windows_are_found(model, step):
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    for x0 in PLACES if model is not third else 0.2 + 0.8 * PLACES:
        K = model(x0)
        size = len(K(0.0))
        Q = np.linalg.qr(turn[:size, :size])[0]
        none = np.zeros((size, size))
        solve = solver(lambda x, K=K, Q=Q, none=none: (np.eye(len(none)), none, Q @ K(x) @ Q.T))
        found = follow(solve, np.linspace(0, 1, 9)[::step], WIDE)
        assert (len(found.merged), len(found.split)) == changes(K)[::step], x0
        assert len(found.states) < 40
