"""Elasticity against closed forms: rates, constant strains, energies, mass, loads."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.macro.elasticity import assemble_elastic, face_area, unit_loads
from brake_fenicsx.macro.material import Material, rotate_about_z
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.meshing.brake_mesh import Mesh
from materials import ORTHOTROPIC, tensor

SIZES = np.array([1.0, 0.7, 0.5])
# All entries of an orthotropic material turned out of its axes, in units of 1 Pa.
TURNED = rotate_about_z(1e-9 * ORTHOTROPIC, 0.4)
FACES = {f"box.{c}{end}": 2 * i + end for i, c in enumerate("xyz") for end in (0, 1)}


def box(comm, n, everywhere=False):
    """A box of 6 n^3 tetrahedra, its faces named x0 ... z1, or all of them one face."""
    import dolfinx

    domain = dolfinx.mesh.create_box(comm, [np.zeros(3), SIZES], [n, n, n])
    cells = np.arange(domain.topology.index_map(3).size_local, dtype=np.int32)
    facets, values = [], []
    for face, tag in FACES.items():
        i, end = "xyz".index(face[-2]), int(face[-1])
        found = dolfinx.mesh.locate_entities_boundary(
            domain, 2, lambda x, i=i, end=end: np.isclose(x[i], end * SIZES[i])
        )
        facets.append(found)
        values.append(np.full(found.size, tag))
    facets, values = np.concatenate(facets), np.concatenate(values).astype(np.int32)
    order = np.argsort(facets)
    return Mesh(
        domain,
        dolfinx.mesh.meshtags(domain, 3, cells, np.zeros(cells.size, dtype=np.int32)),
        dolfinx.mesh.meshtags(
            domain, 2, facets[order].astype(np.int32), 0 * values if everywhere else values[order]
        ),
        {"box.body": 0},
        {"box.all": 0} if everywhere else FACES,
        1.0,
    )


def manufactured_error(comm, n):
    """L2 error of the displacement against a smooth field that vanishes on the boundary."""
    import ufl
    from dolfinx import fem

    mesh = box(comm, n, everywhere=True)
    solved = assemble_elastic(
        mesh, {"box.body": Material(TURNED, 1.0)}, {"box.all": ["x", "y", "z"]}
    )
    V = solved.free.V
    x = ufl.SpatialCoordinate(mesh.domain)
    bubble = 1.0
    for i in range(3):
        bubble = bubble * ufl.sin(np.pi * x[i] / SIZES[i])
    exact = bubble * ufl.as_vector([1 + x[1], ufl.exp(x[0]) - x[2], x[0] * x[1] + 0.5])
    # The body force from the tensor with four indices: nothing of the code's Voigt vectors.
    c = ufl.as_tensor(tensor(TURNED).tolist())
    i, j, k, l = ufl.indices(4)
    stress = ufl.as_tensor(c[i, j, k, l] * ufl.sym(ufl.grad(exact))[k, l], (i, j))
    v = ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 8})
    b = fem.petsc.assemble_vector(fem.form(-ufl.inner(ufl.div(stress), v) * dx))
    from petsc4py import PETSc

    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    factor = Factor(solved.K)
    u = fem.Function(V)
    u.x.array[:] = solved.free.expand(factor.solve(b.array_r[solved.free.local]))
    square = fem.assemble_scalar(fem.form(ufl.inner(u - exact, u - exact) * dx))
    return np.sqrt(comm.allreduce(square))


@pytest.mark.parametrize("cells", [(3, 6, 9), pytest.param((6, 12, 18), marks=pytest.mark.slow)])
def test_displacement_converges_with_order_three(comm, cells):
    """Catches a wrong shear factor or a missing entry of C: the error then does not fall."""
    e = np.array([manufactured_error(comm, n) for n in cells])
    rates = np.log(e[:-1] / e[1:]) / np.log(np.array(cells[1:]) / np.array(cells[:-1]))
    assert np.all(rates > 2.75), f"L2 rates {rates}, expected 3; errors {e}"


def linear(strain):
    """Displacement of a constant strain given as a Voigt vector."""
    e = np.array([[strain[0], strain[5] / 2, strain[4] / 2],
                  [strain[5] / 2, strain[1], strain[3] / 2],
                  [strain[4] / 2, strain[3] / 2, strain[2]]])  # fmt: skip
    return lambda x: e @ x


def free_vector(solved, values):
    from dolfinx import fem

    u = fem.Function(solved.free.V)
    u.interpolate(values)
    return np.concatenate(u.function_space.mesh.comm.allgather(u.x.array[solved.free.local]))


def translations(solved):
    """Free vectors of the unit motions along x, y and z."""
    return [free_vector(solved, lambda x, a=a: a[:, None] + 0 * x) for a in np.eye(3)]


@pytest.fixture(scope="module")
def unsupported():
    solved = assemble_elastic(box(MPI.COMM_WORLD, 2), {"box.body": Material(TURNED, 3.0)}, {})
    return solved, solved.K, solved.M


def test_energies_of_all_constant_strains_give_the_stiffness_back(unsupported):
    """u_a' K u_b = C_ab V for the six strains: all 21 constants, all shear factors."""
    solved, K, _ = unsupported
    U = np.stack([free_vector(solved, linear(e)) for e in np.eye(6)], axis=1)
    np.testing.assert_allclose(U.T @ (K @ U) / SIZES.prod(), TURNED, atol=1e-12 * TURNED.max())


def test_rigid_motions_cost_nothing_and_weigh_what_the_body_weighs(unsupported):
    """Catches a strain that sees rotation, and a mass without density or components mixed."""
    solved, K, M = unsupported
    turns = [free_vector(solved, lambda x, a=a: np.cross(a, x.T).T) for a in np.eye(3)]
    U = np.stack([*translations(solved), *turns], axis=1)
    assert np.abs(K @ U).max() < 1e-12 * np.abs(K).max()
    G = U.T @ (M @ U)
    weight = 3.0 * SIZES.prod()
    np.testing.assert_allclose(G[:3, :3], weight * np.eye(3), atol=1e-12)
    # Moments of inertia of a box about its corner.
    a, b, c = SIZES**2
    inertia = weight / 3 * np.array([b + c, a + c, a + b])
    np.testing.assert_allclose(np.diag(G)[3:], inertia, rtol=1e-12)


def test_pressure_pushes_inwards_with_its_full_force(comm):
    """Area of the face, and the force of the vector; catches the sign of the normal."""
    mesh = box(comm, 2)
    solved = assemble_elastic(mesh, {"box.body": Material(TURNED, 3.0)}, {})
    area = face_area(mesh, "box.z1")
    assert area == pytest.approx(SIZES[0] * SIZES[1], rel=1e-12)
    f = 2.0 * unit_loads(mesh, solved.free, "box.z1")
    for shift, force in zip(translations(solved), (0.0, 0.0, -2.0 * area), strict=True):
        assert f @ shift == pytest.approx(force, rel=1e-12, abs=1e-13)


def test_held_dofs_leave_no_eigenvalue_behind(comm):
    """The matrices are those of the free dofs alone, and positive definite."""
    solved = assemble_elastic(
        box(comm, 1), {"box.body": Material(TURNED, 1.0)}, {"box.x0": ["x", "y", "z"]}
    )
    assert solved.K.shape[0] == solved.free.size == 3 * (27 - 9)
    K, M = (A.toarray() for A in (solved.K, solved.M))
    assert np.linalg.eigvalsh(K)[0] > 0
    assert np.linalg.eigvalsh(M)[0] > 0
    assert abs(K - K.T).max() < 1e-14 * abs(K).max()


def test_supports_of_single_components_hold_these_only(comm):
    """Two faces that share an edge hold different components there; catches held = all three."""
    supports = {"box.x0": ["y"], "box.z1": ["x"]}
    solved = assemble_elastic(box(comm, 1), {"box.body": Material(TURNED, 1.0)}, supports)
    # 27 nodes of degree 2, nine on each face.
    assert solved.free.size == 81 - 9 - 9
    assert [shift.sum() for shift in translations(solved)] == [18, 18, 27]
