"""Sound power by Rayleigh's integral against closed forms."""

import numpy as np
import pytest
from scipy.special import j1

from brake_fenicsx.extras.limit_cycle.cycles import DENSITY, SPEED, Nodes, decibels, sound_power


def piston(radius, rings, normal=1.0, z=0.0):
    """Nodes of a disc, ring by ring, equal areas."""
    r, turn = [], []
    for i in range(rings):
        n = 6 * i + 3
        r.append(np.full(n, radius * (i + 0.5) / rings))
        turn.append(2 * np.pi * (np.arange(n) + 0.37 * i) / n)
    r, turn = np.concatenate(r), np.concatenate(turn)
    place = np.column_stack([r * np.cos(turn), r * np.sin(turn), 0 * r + z])
    area = np.zeros_like(place)
    area[:, 2] = normal * np.pi * radius**2 / r.size
    return Nodes(np.arange(3 * r.size).reshape(-1, 3), place, area)


@pytest.mark.parametrize("ka", [0.1, 1.0, 3.0, 8.0])
def test_baffled_piston(ka):
    """P = rho c pi a^2 v^2 (1 - J1(2 k a) / (k a)) / 2."""
    a, v = 0.1, 2e-3
    omega = ka * SPEED / a
    nodes = piston(a, 24)
    velocity = np.zeros_like(nodes.place, complex)
    velocity[:, 2] = v
    exact = 0.5 * DENSITY * SPEED * np.pi * a**2 * v**2 * (1 - j1(2 * ka) / ka)
    assert nodes.power(velocity, omega) == pytest.approx(exact, rel=0.01)


def test_faces_that_look_apart_radiate_apart():
    """A disc that moves as a whole: each side as a piston of its own; harmonics add."""
    up, down = piston(0.1, 12, 1.0, 0.01), piston(0.1, 12, -1.0, -0.01)
    both = Nodes(
        np.vstack([up.columns, down.columns + up.columns.size]),
        np.vstack([up.place, down.place]), np.vstack([up.area, down.area]),
    )  # fmt: skip
    u = np.zeros((both.columns.size, 3), complex)
    u[2::3, 1], u[2::3, 2] = 1e-6, 0.5e-6
    omega = 2 * np.pi * 3e3
    one = sound_power(up, u[: up.columns.size], omega)
    assert sound_power(both, u, omega) == pytest.approx(2 * one, rel=1e-9)
    u[:, 2] = 0
    assert 0 < sound_power(up, u[: up.columns.size], omega) < one


def test_levels():
    """1 W is 120 dB re 1 pW; silence has no level, and no displacement of held nodes."""
    assert decibels(1.0) == pytest.approx(120)
    assert np.isnan(decibels(0.0))
    nodes = piston(0.1, 2)
    held = Nodes(np.full_like(nodes.columns, -1), nodes.place, nodes.area)
    assert sound_power(held, np.ones((3, 2), complex), 1e4) == 0
