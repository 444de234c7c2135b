"""Contact elements: exact gaps and slips of rigid, linear and quadratic motions; balance; cover."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.contact_elements import contact_elements, join
from brake_fenicsx.macro.contact_forces import Rotation, Translation, slip_frame
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh


def constant(v):
    return lambda x: np.asarray(v)[:, None] + 0 * x


def turn(omega, centre=(0.0, 0.0, 0.0)):
    return lambda x: np.cross(omega, (x.T - np.asarray(centre))).T


A = np.array([[1.0, -2.0, 0.3], [0.5, 0.2, 1.1], [-0.7, 0.9, 2.0]])
B = np.array([[0.1, 1.0, -0.3], [2.5, -0.2, 0.1], [0.4, -1.9, 1.0]])


def test_gap_and_cover_of_parallel_faces(two_blocks):
    """g0 is the distance; the areas are the pad's, once each."""
    s = two_blocks("loose")
    np.testing.assert_allclose(s.g0, 3e-4, rtol=1e-12)
    assert s.w.sum() == pytest.approx(12e-3 * 8e-3, rel=1e-12)
    assert s.contact.uncovered == pytest.approx(0.0, abs=1e-16)
    assert s.w.min() > 0
    np.testing.assert_allclose(s.contact.normal, np.tile([0, 0, 1.0], (s.w.size, 1)), atol=1e-14)
    np.testing.assert_allclose(s.w @ s.contact.points, [0, 0, 96e-6 * 3e-4], atol=1e-17)
    np.testing.assert_allclose(s.contact.speed, 2.0)


@pytest.mark.parametrize("scene", ["loose", "overhang"])
def test_linear_fields(two_blocks, scene):
    """Rigid motions and different gradients on the two sides, meshes that do not match, partial
    cover: exact at the elements' centres, pad minus disc."""
    s = two_blocks(scene)
    moved, other = np.array([0.3, -1.2, 0.7]), np.array([-0.4, 0.1, 0.6])
    u = s.field(pad=lambda x: A @ x + moved[:, None], plate=lambda x: B @ x + other[:, None])
    above = s.contact.points
    below = above - s.g0[:, None] * s.contact.normal
    jump = above @ A.T + moved - below @ B.T - other
    for X, d in ((s.N, s.contact.normal), (s.T, s.contact.s)):
        np.testing.assert_allclose(X @ u, np.sum(jump * d, axis=1), atol=1e-14)
    r = np.cross(s.contact.normal, s.contact.s)
    np.testing.assert_allclose(s.R @ u, np.sum(jump * r, axis=1), atol=1e-14)


def test_quadratic_field_integrates_exactly(two_blocks):
    """The sum of w N u is the integral of the opening; catches weights of edge nodes exchanged."""
    s = two_blocks("loose")
    z = np.zeros

    def bowl(x):
        return np.stack([z(x.shape[1]), z(x.shape[1]), x[0] ** 2 + 3 * x[0] * x[1] - x[1]])

    length = 12e-3
    for body, sign in (("pad", 1), ("plate", -1)):
        got = s.w @ (s.N @ s.field(**{body: bowl}))
        assert got == pytest.approx(sign * 8e-3 * length**3 / 12, rel=1e-11)


def test_partly_covered_face(two_blocks):
    """Only what lies above the plate counts; elements without partner are left out."""
    s = two_blocks("overhang")
    assert s.w.sum() == pytest.approx(12e-3 * 8e-3, rel=1e-10)
    assert s.contact.uncovered == pytest.approx(20e-3 * 14e-3 - 12e-3 * 8e-3, rel=1e-10)
    assert np.all(np.abs(s.contact.points[:, 0]) < 6e-3)
    assert np.all(np.abs(s.contact.points[:, 1]) < 4e-3)


def test_faces_without_partner_are_an_error(two_blocks):
    s = two_blocks("loose")
    sliding = Translation((1.0, 0, 0), 1.0)
    with pytest.raises(SceneError, match="do not oppose each other anywhere"):
        contact_elements(s.mesh, s.free, ("pad.top", "plate.top"), sliding)
    with pytest.raises(SceneError, match=r"no face 'pad.friction'.*pad.bottom"):
        contact_elements(s.mesh, s.free, ("pad.friction", "plate.top"), sliding)


def test_search_reaches_across_a_wide_gap(comm):
    """A gap of many facets is bridged when the scene says so, and not before."""
    from brake_fenicsx.geometry import block

    small = dict(length=4e-3, width=4e-3, height=2e-3, size=2e-3)
    parts = {
        "pad": (block, block.Block(**small, z=30e-3)),
        "plate": (block, block.Block(**small, z=-2e-3)),
    }
    mesh = build_mesh(parts, comm)
    steel = Material(isotropic(2e11, 0.3), 7800.0)
    free = assemble_elastic(mesh, dict.fromkeys(mesh.layers, steel), {}).free
    faces, sliding = ("pad.bottom", "plate.top"), Translation((1.0, 0, 0), 1.0)
    with pytest.raises(SceneError, match="do not oppose each other anywhere"):
        contact_elements(mesh, free, faces, sliding)
    found = contact_elements(mesh, free, faces, sliding, reach=30e-3)
    np.testing.assert_allclose(found.g0, 30e-3, rtol=1e-12)
    assert found.w.sum() == pytest.approx(16e-6, rel=1e-12)


def test_both_sides_of_a_disc(brake_contact):
    """Normals point from disc to pad, s along the disc's motion, slip of a turning disc is -r."""
    mesh, free, c = brake_contact
    side = np.sign(c.points[:, 2])
    assert set(side) == {-1.0, 1.0}
    np.testing.assert_allclose(c.normal, side[:, None] * [0, 0, 1], atol=1e-12)
    around = np.cross([0, 0, 1.0], c.points)
    radius = np.hypot(*c.points[:, :2].T)
    np.testing.assert_allclose(c.s, around / radius[:, None], atol=1e-12)
    np.testing.assert_allclose(c.speed, 5.0 * radius, rtol=1e-12)
    np.testing.assert_allclose(c.g0, 0.0, atol=1e-15)
    assert c.uncovered < 2e-3 * c.w.sum()

    def whole(layers, values):
        from dolfinx import fem

        u = fem.Function(free.V)
        for name in layers:
            u.interpolate(values, mesh.cell_tags.find(mesh.layers[name]))
        return u.x.array[free.local]

    u = whole(["disc.body"], turn([0, 0, 1.0]))
    np.testing.assert_allclose(c.T @ u, -radius, rtol=1e-10)
    assert abs(c.N @ u).max() < 1e-14
    assert abs(c.R @ u).max() < 1e-14
    up = whole(["pad.lining"], constant([0, 0, 1.0]))
    np.testing.assert_allclose(c.N @ up, side, rtol=1e-12)


@pytest.fixture(scope="module")
def brake_contact():
    from brake_fenicsx.geometry import disc, pad

    comm = MPI.COMM_WORLD
    parts = {
        "disc": (disc, disc.Disc(size=30e-3)),
        "pad": (pad, pad.Pad(size=14e-3, plate_size=14e-3)),
    }
    mesh = build_mesh(parts, comm)
    steel = Material(isotropic(2e11, 0.3), 7800.0)
    free = assemble_elastic(mesh, dict.fromkeys(mesh.layers, steel), {}).free
    contact = contact_elements(
        mesh, free, ("pad.friction", "disc.friction"), Rotation(5.0), comm=comm
    )
    return mesh, free, contact


def test_join_stacks_in_order(two_blocks):
    """Two interfaces as one: catches an order that differs between operators and areas."""
    s = two_blocks("loose")
    one, two = s.contact, contact_elements(
        s.mesh, s.free, ("plate.top", "pad.bottom"), Translation((0, 1.0, 0), 3.0)
    )  # fmt: skip
    both = join([one, two])
    n = one.w.size
    np.testing.assert_array_equal(both.interface, np.repeat([0, 1], [n, two.w.size]))
    u = s.field(pad=constant([0.1, 0.2, 0.3]))
    # Seen from the plate the normal is reversed, and so is the jump: the same opening.
    np.testing.assert_allclose(both.N @ u, 0.3, rtol=1e-12)
    np.testing.assert_allclose((both.T @ u)[n:], -0.2, rtol=1e-12)
    np.testing.assert_array_equal(both.w[n:], two.w)
    np.testing.assert_allclose(both.speed, np.repeat([2.0, 3.0], [n, two.w.size]))


def test_slip_frame_takes_out_the_normal_part_and_refuses_standstill():
    """On an inclined face the sliding direction lies in the face."""
    n = np.array([[0, np.sin(0.3), np.cos(0.3)]])
    s, r, V = slip_frame(Translation((0, 2.0, 0), 4.0), np.zeros((1, 3)), n)
    np.testing.assert_allclose(s, [[0, np.cos(0.3), -np.sin(0.3)]], atol=1e-15)
    np.testing.assert_allclose(np.cross(n, s), r)
    assert V[0] == pytest.approx(4 * np.cos(0.3))
    # A negative speed turns the direction, not the speed.
    s, _, V = slip_frame(Rotation(-2.0), np.array([[0.1, 0, 0]]), np.array([[0, 0, 1.0]]))
    np.testing.assert_allclose(s, [[0, -1, 0]])
    assert V[0] == pytest.approx(0.2)
    for still in (Rotation(0.0), Rotation(1.0)):
        with pytest.raises(SceneError, match="does not slide along its face"):
            slip_frame(still, np.zeros((1, 3)), np.array([[0, 0, 1.0]]))


@pytest.mark.together
def test_one_process_and_all_give_the_same_elements(two_blocks):
    """Areas, centres, gaps and gaps of a field: sharing the integrals changes nothing."""
    alone, together = (two_blocks("loose", alone=alone) for alone in (True, False))
    for name in ("w", "g0", "points", "normal", "s"):
        a, b = (getattr(s.contact, name) for s in (alone, together))
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-17)

    def wave(x):
        return np.stack([np.sin(300 * x[0]), np.cos(200 * x[1]), x[0] * x[1] + x[2] ** 2])

    for name in "NTR":
        a, b = (getattr(s, name) @ s.field(pad=wave, plate=wave) for s in (alone, together))
        np.testing.assert_allclose(a, b, atol=1e-14)
