"""Forces of contact elements: Coulomb's law, its tangent, and the rates of small vibrations."""

import numpy as np
import pytest

from brake_fenicsx.macro.contact_forces import SlidingFriction, patch_forces, sliding

V = np.array([2.0, 0.5])
MU, SLOPE = 0.4 + 0.1 * np.exp(-V), -0.1 * np.exp(-V)


def coefficient(speed):
    fall = 0.1 * np.exp(-speed)
    return 0.4 + fall, -fall


@pytest.fixture
def friction():
    return SlidingFriction(MU, SLOPE, V, np.array([True, False]))


def test_traction_opposes_the_slip_of_the_disc_past_the_pad(friction):
    """A pad that moves across at the sliding speed is dragged at 45 degrees; no jump at rest."""
    still, _ = friction.traction(np.zeros((2, 2)))
    np.testing.assert_allclose(still, sliding(MU, V), rtol=1e-15)
    across, _ = friction.traction(np.array([0 * V, V]))
    np.testing.assert_allclose(across, MU / np.sqrt(2) * np.array([[1.0], [-1.0]]), rtol=1e-14)
    faster, _ = friction.traction(np.array([3 * V, 0 * V]))
    np.testing.assert_allclose(faster, [-MU, 0 * V], atol=1e-15)


@pytest.mark.parametrize("law", [None, coefficient])
def test_derivatives_are_differences(friction, law):
    v, h = np.array([[0.3, -0.2], [0.4, 0.1]]), 1e-6
    _, slopes = friction.traction(v, law, smooth=1e-3)
    for j, step in enumerate(h * np.eye(2)[:, :, None]):
        ends = [friction.traction(v + side * step, law, smooth=1e-3)[0] for side in (1, -1)]
        np.testing.assert_allclose(slopes[:, j], (ends[0] - ends[1]) / (2 * h), rtol=1e-8)


def test_rates_of_small_vibrations_are_the_tangent_at_rest(friction):
    """What equilibrium, modes and limit cycles take is one law."""
    w, p, k = np.array([2e-6, 3e-6]), np.array([1e5, 0.0]), np.array([1e10, 2e10])
    traction, slopes = friction.traction(np.zeros((2, 2)), coefficient)
    forces = patch_forces(w, p, k, traction, slopes)
    along, across = friction.rates(p, turns=True, falls=True)
    np.testing.assert_allclose(forces.rate[1:], w * [[-along, 0 * p], [0 * p, -across]], atol=1e-18)
    np.testing.assert_allclose(forces.value, w * p * [1 + 0 * MU, MU, 0 * MU], atol=1e-18)
    np.testing.assert_allclose(forces.gap, -w * k * [1 + 0 * MU, MU, 0 * MU], rtol=1e-15)
    assert not np.any(friction.rates(p, turns=False, falls=False))
    np.testing.assert_array_equal(friction.equilibrium, [MU[0], 0.0])
