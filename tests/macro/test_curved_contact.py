"""Contact of curved facets of degree two: exact normal search, balance of forces and moments."""

from functools import cache

from mpi4py import MPI

import numpy as np
import pytest

import hertz_parts
from brake_fenicsx.macro.contact_elements import contact_elements
from brake_fenicsx.macro.contact_forces import Translation
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings

R = 50e-3
SLIDING = Translation((0.2, 1.0, 0.0), 1.0)


@cache
def bodies(cells, fine):
    """A round body on a flat one, nothing held: hexahedra a cylinder, tetrahedra a sphere."""
    if cells == "hexahedra":
        upper = hertz_parts.cylinder(R, fine, 2e-3, fine)
        lower = hertz_parts.slab(fine, fine=0.7 * fine)
    else:
        upper = hertz_parts.sphere(R, 2e-3, fine)
        lower = hertz_parts.base(fine=0.7 * fine)
    table = MeshSettings(cells=cells, order=2)
    mesh = build_mesh({"upper": upper, "lower": lower}, MPI.COMM_WORLD, table)
    steel = Material(isotropic(2e11, 0.3), 7800.0)
    return mesh, assemble_elastic(mesh, dict.fromkeys(mesh.layers, steel), {}).free


def elements(cells, discretisation, faces=("upper.contact", "lower.contact"), fine=0.4e-3):
    return contact_elements(*bodies(cells, fine), faces, SLIDING, discretisation)


def field(cells, body, values):
    from dolfinx import fem

    mesh, free = bodies(cells, 0.4e-3)
    u = fem.Function(free.V)
    u.interpolate(values, mesh.cell_tags.find(mesh.layers[f"{body}.body"]))
    return u.x.array[free.local]


CASES = [(c, d) for c in ("tetrahedra", "hexahedra") for d in ("patch", "quadrature", "node")]


@pytest.mark.parametrize("cells, discretisation", CASES)
def test_normal_forces_balance_in_sum_and_moment(cells, discretisation):
    """Pressures at random: forces of both faces cancel to 1e-12, moments to 1e-10.

    A projection that is not along the normal of the point leaves a moment; one normal for a whole
    curved facet leaves a force.
    """
    c = elements(cells, discretisation)
    force = c.N.T @ (c.w * np.random.default_rng(0).uniform(0, 1e9, c.w.size))
    total = np.linalg.norm([field(cells, "upper", moved(d)) @ force for d in np.eye(3)])
    assert total > 0
    for d in np.eye(3):
        both = field(cells, "upper", moved(d)) + field(cells, "lower", moved(d))
        assert abs(both @ force) < 1e-12 * total
        both = field(cells, "upper", turned(d)) + field(cells, "lower", turned(d))
        assert abs(both @ force) < 1e-10 * total * 2e-3


def moved(d):
    return lambda x: d[:, None] + 0 * x


def turned(d):
    return lambda x: np.cross(d, x.T).T


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_gap_to_a_plane_is_the_way_along_the_normal(cells):
    """From a point x of the round face along its normal n to z = 0: z / -n_z, to round-off."""
    c = elements(cells, "node")
    np.testing.assert_allclose(c.g0, c.points[:, 2] / c.normal[:, 2], atol=1e-16, rtol=1e-10)


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_search_on_the_curved_face_converges_with_its_geometry(cells):
    """From the plane up to the round face: the sagitta R - sqrt(R^2 - r^2), error of order three or
    more; by chords it would be of order two and never below h^2 / 8 R."""
    errors = []
    for fine in (0.4e-3, 0.2e-3):
        c = elements(cells, "node", ("lower.contact", "upper.contact"), fine)
        x, y, _ = c.points.T
        r = np.abs(x) if cells == "hexahedra" else np.hypot(x, y)
        exact = R - np.sqrt(R**2 - r**2)
        np.testing.assert_allclose(c.normal, np.tile([0, 0, -1.0], (r.size, 1)), atol=1e-9)
        errors.append(np.abs(c.g0 - exact).max())
    assert errors[0] < 0.05 * 0.4e-3**2 / (8 * R)
    assert errors[1] < errors[0] / 6


@pytest.mark.parametrize("discretisation", ["patch", "quadrature", "node"])
def test_friction_balances_where_the_faces_coincide(two_blocks, discretisation):
    """Forces and moments of tractions along s, on plane faces in touch."""
    s = two_blocks("overhang", discretisation=discretisation)
    q = s.w * np.random.default_rng(1).uniform(0, 1e6, s.w.size)
    force = s.N.T @ q + 0.4 * s.T.T @ q
    for d in np.eye(3):
        assert abs(s.field(pad=moved(d), plate=moved(d)) @ force) < 1e-12 * q.sum()
        assert abs(s.field(pad=turned(d), plate=turned(d)) @ force) < 1e-10 * q.sum() * 12e-3


def test_areas_are_those_of_the_curved_face():
    """Patches of the sphere's cap: 2 pi R h / 4; a polygon's edge would miss half a percent."""
    c = elements("tetrahedra", "patch")
    rise = R - np.sqrt(R**2 - 2e-3**2)
    assert c.w.sum() == pytest.approx(0.5 * np.pi * R * rise, rel=2e-4)
    assert c.w.sum() + c.uncovered == pytest.approx(0.5 * np.pi * R * rise, rel=1e-5)
