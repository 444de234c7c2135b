"""Hertz contact of a cylinder and of a sphere with a flat base, both elastic, curved facets.

Steel on steel, radius 50 mm, contact half-width 1.5 mm. The penalty is ten times E* / h, so that
it bends the pressure less than the mesh does.
"""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

import hertz_parts
from brake_fenicsx.macro.contact_elements import contact_elements
from brake_fenicsx.macro.contact_forces import EnrichedGap, Translation
from brake_fenicsx.macro.elasticity import assemble_elastic, unit_loads
from brake_fenicsx.macro.equilibrium import compliance, equilibrium
from brake_fenicsx.macro.faces import gather_face
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.micro import OneLaw, linear_law

E, NU, R, A = 210e9, 0.3, 50e-3, 1.5e-3
E_STAR = E / (2 * (1 - NU**2))


def pressed(parts, faces, supports, load, table, penalty, discretisation):
    """Solved contact pressures, with the face that carries them."""
    mesh = build_mesh(parts, MPI.COMM_SELF, table)
    steel = dict.fromkeys(mesh.layers, Material(isotropic(E, NU), 7800.0))
    elastic = assemble_elastic(mesh, steel, supports)
    f = sum(p * unit_loads(mesh, elastic.free, face) for face, p in load.items())
    sliding = Translation((0, 1.0, 0), 1.0)
    c = contact_elements(mesh, elastic.free, faces, sliding, discretisation)
    n = c.w.size
    seen = compliance(elastic.K, c.N, c.T, c.w, f, np.full(n, 1e14), MPI.COMM_SELF)
    laws = EnrichedGap(OneLaw(linear_law(penalty)), np.zeros(n, int), np.zeros(n))
    eq = equilibrium(SimpleNamespace(w=c.w, g0=c.g0, compliance=seen), laws)
    return c, eq, gather_face(mesh, elastic.free, faces[0])


def line(fine, discretisation="patch", penalty=1e17):
    """Cylinder on a base, a slice in plane strain: p0 = a E* / (2 R)."""
    p0 = A * E_STAR / (2 * R)
    depth = 5 * fine
    parts = {
        "cylinder": hertz_parts.cylinder(R, depth, 2e-3, fine),
        "plate": hertz_parts.slab(depth, fine=1.2 * fine),
    }
    supports = {
        "plate.bottom": ["x", "z"],
        "plate.symmetry_x": ["x"],
        "cylinder.symmetry_x": ["x"],
        "plate.sides": ["y"],
        "cylinder.sides": ["y"],
    }
    load = {"cylinder.top": np.pi * A * p0 / 4 / R}
    c, eq, _ = pressed(
        parts, ("cylinder.contact", "plate.contact"), supports, load,
        MeshSettings(cells="hexahedra", order=2), penalty, discretisation,
    )  # fmt: skip
    x = c.points[:, 0]
    # Vertical part of the pressure on the curved face: the load, to round-off of the geometry.
    up = c.w @ (eq.p * c.normal[:, 2]) / depth / (np.pi * A * p0 / 4)
    return c, eq, p0, p0 * np.sqrt(np.maximum(1 - (x / A) ** 2, 0)), up


def deviation(c, p, exact):
    return float(np.sqrt(c.w @ (p - exact) ** 2 / (c.w @ exact**2)))


def test_line_contact():
    """16,800 dofs, 15 facets over the half-width: peak within 0.1 %, profile within 0.3 % in L2."""
    errors = []
    for fine in (0.2e-3, 0.1e-3):
        c, eq, p0, exact, up = line(fine)
        assert up == pytest.approx(1, rel=1e-4)
        assert eq.p.max() == pytest.approx(p0, rel=1e-3)
        errors.append(deviation(c, eq.p, exact))
    assert errors[0] < 0.035
    assert errors[1] < 0.003


def test_line_contact_by_gauss_points():
    """The same with pressures linear on a facet: bounded by the facet that the edge crosses."""
    c, eq, p0, exact, up = line(0.1e-3, "quadrature")
    assert up == pytest.approx(1, rel=1e-4)
    assert eq.p.max() == pytest.approx(p0, rel=5e-3)
    assert deviation(c, eq.p, exact) < 0.025


@pytest.mark.hard
@pytest.mark.parametrize("penalty", [1e19, 1e21])
def test_penalty_far_stiffer_than_the_bodies(penalty):
    """1e4 and 1e6 times E / h on a curved face: found in a few iterations.

    And no better than 100 E / h: the mesh bounds the error.
    """
    _, eq, p0, *_ = line(0.2e-3, penalty=penalty)
    _, usual, *_ = line(0.2e-3)
    assert eq.iterations[0] <= 10
    np.testing.assert_allclose(eq.p, usual.p, atol=1e-2 * p0)
    assert eq.p.max() == pytest.approx(p0, rel=2e-3)


def sphere(fine):
    """A quarter of sphere and base: p0 = 2 a E* / (pi R)."""
    p0 = 2 * A * E_STAR / (np.pi * R)
    parts = {
        "sphere": hertz_parts.sphere(R, 1.8e-3, fine),
        "base": hertz_parts.base(contact=2e-3, fine=1.2 * fine),
    }
    supports = {"base.bottom": ["z"]}
    supports |= {f"{b}.symmetry_{x}": [x] for b in parts for x in "xy"}
    force = 2 / 3 * np.pi * A**2 * p0
    c, eq, face = pressed(
        parts, ("sphere.contact", "base.contact"), supports,
        {"sphere.top": force / (np.pi * R**2)}, MeshSettings(order=2), 10 * E_STAR / fine, "patch",
    )  # fmt: skip
    assert c.w @ (eq.p * c.normal[:, 2]) == pytest.approx(force / 4, rel=1e-3)
    return c, eq, p0, facet_means(face, p0)


def facet_means(face, p0):
    """Exact pressure, mean of each facet: what an element of one pressure can show."""
    s = (np.arange(16) + 0.5) / 16
    x, y = np.meshgrid(s, s, indexing="ij")
    points = np.stack([x, y], axis=-1)[x + y < 1]
    every = np.arange(len(face.nodes))
    at, _, ratio = face.surface(every, np.broadcast_to(points, (every.size, *points.shape)))
    r = np.hypot(at[..., 0], at[..., 1])
    p = p0 * np.sqrt(np.maximum(1 - (r / A) ** 2, 0))
    return np.sum(p * ratio, axis=1) / ratio.sum(axis=1)


@pytest.mark.parametrize(
    ("fine", "peak", "profile"),
    [(0.2e-3, 1.5e-2, 0.05), pytest.param(0.1e-3, 5e-3, 0.025, marks=pytest.mark.slow)],
)
def test_sphere_contact(fine, peak, profile):
    """18,500 and 37,800 dofs, 7 and 15 facets over the radius: peak, and profile in L2."""
    errors = []
    for size in (2 * fine, fine):
        c, eq, p0, exact = sphere(size)
        assert eq.p.size == exact.size
        errors.append(deviation(c, eq.p, exact))
    assert eq.p.max() == pytest.approx(p0, rel=peak)
    assert errors[1] < profile
    assert errors[1] < 0.7 * errors[0]
