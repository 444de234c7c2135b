"""Forces on a pad against closed forms: sector under uniform and tilted pressure, block, sides."""

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.contact_elements import Contact, pad_forces
from brake_fenicsx.macro.contact_forces import Rotation, Translation, slip_frame

INNER, OUTER, HALF = 96e-3, 140e-3, np.pi / 6


def elements(points, w, normal, motion, interface=None):
    s, _, speed = slip_frame(motion, points, normal)
    none = sp.csr_matrix((len(w), 0))
    which = np.zeros(len(w), int) if interface is None else interface
    return Contact(none, none, none, w, 0 * w, points, normal, s, speed, which, 0.0)


def sector(motion, sides=(1.0,), at=np.pi / 2):
    """A ring's sector of small elements on the faces of a disc 20 mm thick."""
    r = np.linspace(INNER, OUTER, 201)
    a = np.linspace(at - HALF, at + HALF, 201)
    r, a = 0.5 * (r[1:] + r[:-1]), 0.5 * (a[1:] + a[:-1])
    R, A = (v.ravel() for v in np.meshgrid(r, a, indexing="ij"))
    w = R * (OUTER - INNER) / 200 * 2 * HALF / 200
    parts = [np.stack([R * np.cos(A), R * np.sin(A), np.full(R.size, 10e-3 * z)], 1) for z in sides]
    normal = np.concatenate([np.tile([0, 0, z], (R.size, 1)) for z in sides])
    return elements(np.concatenate(parts), np.tile(w, len(sides)), normal, motion)


@pytest.mark.parametrize("speed", [5.0, -5.0])
def test_sector_under_uniform_pressure(speed):
    """The effective radius 2/3 (ro^3 - ri^3) / (ro^2 - ri^2), the torque mu N times that."""
    c, p, mu = sector(Rotation(speed)), 5e5, 0.4
    one = np.ones(c.w.size)
    (found,) = pad_forces(c, ["pad"], Rotation(speed), p * one, mu * one)
    area = HALF * (OUTER**2 - INNER**2)
    radius = 2 / 3 * (OUTER**3 - INNER**3) / (OUTER**2 - INNER**2)
    assert found.normal == pytest.approx(p * area, rel=1e-4)
    assert found.torque == pytest.approx(mu * p * area * radius, rel=1e-4)
    assert found.effective_radius == pytest.approx(radius, rel=1e-4)
    # Friction drags the pad along: in -x at the top of the disc where that turns anticlockwise.
    drag = mu * p * area * np.sin(HALF) / HALF
    np.testing.assert_allclose(
        found.friction, [-np.sign(speed) * drag, 0, 0], rtol=1e-4, atol=1e-9 * drag
    )
    assert found.area == found.nominal_area == pytest.approx(area, rel=1e-4)
    centre = radius * np.sin(HALF) / HALF
    np.testing.assert_allclose(found.centre, [0, centre, 10e-3], rtol=1e-4, atol=1e-12)
    assert found.towards_leading == pytest.approx(0.0, abs=1e-9)
    assert found.leading_share == pytest.approx(0.5, rel=1e-6)
    # The disc enters at the smaller angle where that grows with time.
    leading, trailing = (np.pi / 2 - np.sign(speed) * s * HALF for s in (1, -1))
    np.testing.assert_allclose(found.edges, [leading, trailing], atol=2e-2)


@pytest.mark.parametrize("at", [np.pi / 2, np.pi])
def test_pressure_that_leans_to_the_leading_edge(at):
    """p = p0 (1 - c theta), theta towards the trailing edge: all of it in closed form."""
    c = sector(Rotation(2.0), at=at)
    theta = np.angle((c.points[:, 0] + 1j * c.points[:, 1]) * np.exp(-1j * at))
    p = 1e6 * (1 - 0.8 * theta / HALF)
    (found,) = pad_forces(c, ["pad"], Rotation(2.0), p, np.full(p.size, 0.3))
    radius = np.hypot(*(c.w @ c.points[:, :2] / c.w.sum()))
    assert found.towards_leading == pytest.approx(0.8 * HALF / 3 * radius, rel=1e-3)
    assert found.leading_share == pytest.approx(0.5 + 0.8 / 4, rel=1e-3)
    assert found.largest_pressure == pytest.approx(1.8e6, rel=0.02)


def test_two_sides_and_two_interfaces_are_apart():
    """Each side of the disc by itself, named; an open half counts as area, not in contact."""
    c = sector(Rotation(1.0), sides=(1.0, -1.0))
    p = np.where(c.normal[:, 2] > 0, 1e5, 2e5) * (c.points[:, 0] > 0)
    upper, lower = pad_forces(c, ["pad"], Rotation(1.0), p, np.full(p.size, 0.5))
    assert (upper.name, lower.name) == ("pad, z > 0", "pad, z < 0")
    assert lower.normal == pytest.approx(2 * upper.normal)
    assert lower.torque == pytest.approx(2 * upper.torque)
    assert upper.area == pytest.approx(0.5 * upper.nominal_area)
    # It turns anticlockwise: the disc enters on the right, where the pressure is.
    assert upper.leading_share == pytest.approx(1.0)


def test_block_on_a_sliding_plate():
    """No torque; the leading edge lies against the motion of the plate."""
    x = (np.arange(20) + 0.5) * 2e-3
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    motion = Translation((-2.0, 0.0, 0.0), 3.0)
    c = elements(points, np.full(20, 4e-6), np.tile([0, 0, 1.0], (20, 1)), motion)
    p = 1e6 * x / x.max()
    (found,) = pad_forces(c, ["block"], motion, p, np.full(20, 0.25))
    np.testing.assert_allclose(found.friction, [-0.25 * found.normal, 0, 0], atol=1e-12)
    assert np.isnan(found.torque)
    assert found.towards_leading == pytest.approx(found.centre[0] - 20e-3)
    assert found.leading_share > 0.7
    assert found.edges == pytest.approx((-19e-3, 19e-3))


def test_no_pressure_at_all():
    c = sector(Rotation(1.0))
    (found,) = pad_forces(c, ["pad"], Rotation(1.0), 0 * c.w, 0 * c.w)
    assert found.normal == found.torque == found.area == 0.0
    assert np.isnan(found.centre).all()
    assert np.isnan([found.effective_radius, found.leading_share]).all()
