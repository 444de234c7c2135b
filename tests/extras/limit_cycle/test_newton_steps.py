"""Newton's steps of harmonic balance against the solution of a dense Jacobian."""

from dataclasses import replace

import numpy as np
import pytest

from brake_fenicsx.extras.limit_cycle import harmonic_balance, newton_steps
from brake_fenicsx.extras.limit_cycle.harmonic_balance import HarmonicBalance, Tangent, Vibration
from oscillators import matrices

HARMONICS, PATCHES, COORDINATES = 3, 3, 4


def problem():
    """Four modes and three patches with a compliance of their own, cubic springs and friction."""
    draw = np.random.default_rng(3)
    out, acting = draw.normal(size=(2, PATCHES, COORDINATES))
    stiffness = np.diag([1.0, 4.2, 9.5, 30.0])
    given = matrices(np.eye(COORDINATES), 0.01 * stiffness, stiffness, out, acting)
    D = np.array([np.eye(PATCHES) + 0.1, 1e-3 * np.ones((PATCHES, PATCHES))])

    def weights(s):
        powers = s ** np.arange(3)[:, None]
        return powers, powers

    bodies = replace(given, D=D, weights=weights)

    def forces(y, v):
        tangent = -0.3 - 3 * y**2, np.full_like(y, 0.05)
        shape = 1, 1, *y.shape
        return -0.3 * y - y**3 + 0.05 * v, Tangent(*(t.reshape(shape) for t in tangent))

    return HarmonicBalance(bodies, forces, np.full(PATCHES, 1 / PATCHES), HARMONICS, 32)


def vibration(seed, size):
    draw = np.random.default_rng(seed)

    def harmonics(rows):
        x = draw.normal(size=(rows, HARMONICS + 1, 2)).view(complex)[..., 0]
        x[:, 0] = x[:, 0].real
        return size * x / (1 + np.arange(HARMONICS + 1)) ** 2

    return Vibration(harmonics(COORDINATES), harmonics(PATCHES), 0.05 + 1.3j, size)


def dense_step(problem, at, condition, kept, phase):
    """The step by a Jacobian of central differences; means are real."""
    count = COORDINATES + PATCHES

    def unpacked(u):
        z = u[:-2].view(complex).reshape(count, -1)
        s = complex(u[-2], u[-1])
        return Vibration(z[:COORDINATES], z[COORDINATES:], s, at.amplitude)

    def residual(u):
        v = unpacked(u)
        rest = problem.bodies.unbalanced(problem.lam(v), v.a, v.y, problem.contact(v)[0])
        two = condition(v.a, v.y, v.s) - kept, (phase @ v.y[:, 1]).imag
        return np.r_[rest.ravel().view(float), two]

    u = np.r_[np.vstack([at.a, at.y]).ravel().view(float), at.s.real, at.s.imag]
    steps = 1e-6 * np.eye(u.size)
    J = np.array([(residual(u + h) - residual(u - h)) / 2e-6 for h in steps]).T
    found = unpacked(np.linalg.lstsq(J, -residual(u), rcond=None)[0])
    return found.a, found.y, found.s


@pytest.mark.parametrize("stale", [False, True])
def test_a_step_is_that_of_a_dense_jacobian(stale, monkeypatch):
    """With factors of this vibration, and of one nearby with another amplitude."""
    monkeypatch.setattr(newton_steps, "LINEAR", 1e-6)
    monkeypatch.setattr(harmonic_balance, "DIFFERENCE", 1e-4)
    given, at = problem(), vibration(1, 0.3)
    phase = given.weights * at.y[:, 1].conj() / given.size(at.y[:, 1])
    to_y = np.zeros_like(at.y)
    to_y[:, 1] = phase.conj() / at.amplitude
    condition = harmonic_balance.Condition(0.1 * at.a, to_y, 0.2)
    kept = condition(at.a, at.y, at.s) + 0.01
    if stale:
        before = Vibration(0.9 * at.a, 0.9 * at.y, 0.98 * at.s, 0.9 * at.amplitude)
        assert given._step(before, condition, kept, phase)[1]
    step, fresh = given._step(at, condition, kept, phase)
    assert fresh != stale
    for found, expected in zip(step, dense_step(given, at, condition, kept, phase), strict=True):
        assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)
