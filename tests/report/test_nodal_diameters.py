"""Nodal diameters of rings whose motion is known."""

import numpy as np
import pytest

from brake_fenicsx.report.mode_fields import nodal_pattern

RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def ring():
    """Nodes of a disc of 75 to 144 mm radius, 20 mm thick, at random angles."""
    angle = 2 * np.pi * (np.arange(400) + 0.6 * RNG.random(400)) / 400
    radius, z = RNG.uniform(0.075, 0.144, 400), RNG.uniform(-0.01, 0.01, 400)
    rim = slice(0, None, 4)
    radius[rim] = 0.144
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


@pytest.mark.parametrize("n", [0, 1, 4, 9])
@pytest.mark.parametrize("travelling", [False, True])
def test_a_wave_around_the_disc_has_its_order(ring, n, travelling):
    """Standing or travelling, whatever its phase."""
    angle = np.arctan2(ring[:, 1], ring[:, 0])
    u = np.zeros(ring.shape, dtype=complex)
    u[:, 2] = np.exp(1j * (n * angle + 0.3)) if travelling else np.cos(n * angle - 0.4)
    found = nodal_pattern(ring, u * np.exp(0.7j))
    assert (found.diameters, found.direction) == (n, "out of plane")
    assert found.share == pytest.approx(1.0)


def test_the_strongest_direction_and_its_share_are_named(ring):
    """Radial with three waves, and a quarter of that square out of plane with five."""
    angle = np.arctan2(ring[:, 1], ring[:, 0])
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    u = radial * np.cos(3 * angle)[:, None]
    u[:, 2] = 0.5 * np.cos(5 * angle)
    found = nodal_pattern(ring, u)
    assert (found.diameters, found.direction) == (3, "in plane, radial")
    assert found.share == pytest.approx(0.8, abs=0.02)
    across = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros(len(angle))])
    assert nodal_pattern(ring, across).direction == "in plane, tangential"
    assert nodal_pattern(ring, across).diameters == 0


def test_what_is_no_ring_or_does_not_move_has_no_pattern(ring):
    angle = np.arctan2(ring[:, 1], ring[:, 0])
    half = ring[angle > 0]
    assert nodal_pattern(half, np.ones(half.shape)) is None
    assert nodal_pattern(ring, np.zeros(ring.shape)) is None
    assert nodal_pattern(np.zeros((0, 3)), np.zeros((0, 3))) is None
