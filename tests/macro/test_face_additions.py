"""Springs to the ground and masses on faces: totals, the six modes of a rigid box, statics."""

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from brake_fenicsx.build.bodies import added_to_face
from brake_fenicsx.build.brake import assemble_brake, check_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.elasticity import FaceAddition, assemble_elastic, unit_loads
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.scene import read_scene
from places import BLOCK

COARSE = ["parts.block.size='20 mm'", "parts.plate.size='30 mm'"]

SIDES = np.array([1.0, 0.7, 0.5])
RHO, MASS, ADDED = 2.0, 2.0 * 1.0 * 0.7 * 0.5, 0.3
K = np.array([5.0, 7.0, 11.0])


def box():
    """A box of tetrahedra, its faces z0 and z1 named."""
    domain = dolfinx.mesh.create_box(MPI.COMM_SELF, [-0.5 * SIDES, 0.5 * SIDES], [2, 2, 2])
    cells = np.arange(domain.topology.index_map(3).size_local, dtype=np.int32)
    ends = [
        dolfinx.mesh.locate_entities_boundary(
            domain, 2, lambda x, z=z: np.isclose(x[2], z * SIDES[2])
        )
        for z in (-0.5, 0.5)
    ]
    facets = np.concatenate(ends).astype(np.int32)
    values = np.repeat(np.arange(2, dtype=np.int32), [e.size for e in ends])
    order = np.argsort(facets)
    return Mesh(
        domain, dolfinx.mesh.meshtags(domain, 3, cells, np.zeros(cells.size, dtype=np.int32)),
        dolfinx.mesh.meshtags(domain, 2, facets[order], values[order]),
        {"box.body": 0}, {"box.bottom": 0, "box.top": 1}, 1.0,
    )  # fmt: skip


def assembled(stiff=1e7, mesh=None):
    """A box far stiffer than its springs, half of them and of the added mass on either end."""
    added = [FaceAddition(f"box.{end}", np.diag(K) / 2, ADDED / 2) for end in ("bottom", "top")]
    material = Material(isotropic(stiff, 0.3), RHO)
    return assemble_elastic(mesh or box(), {"box.body": material}, {}, 2, added)


def test_totals_are_what_was_asked_for():
    elastic = assembled()
    for A, total in ((elastic.K, K), (elastic.M, [MASS + ADDED] * 3)):
        for i, value in enumerate(total):
            shift = np.tile(np.eye(3)[i], A.shape[0] // 3)
            assert shift @ (A @ shift) == pytest.approx(value, rel=1e-6)


def test_six_modes_of_a_rigid_box():
    """Three translations, three rotations: sums over the springs and masses of both ends."""
    elastic = assembled()
    found = la.eigh(elastic.K.toarray(), elastic.M.toarray(), eigvals_only=True)[:6]
    # Mean squares of x and y over an end and over the box, and of z at the ends.
    x, y, z = SIDES**2 / 12
    end = SIDES[2] ** 2 / 4
    moments = [
        (K[1] * end + K[2] * y, MASS * (y + z) + ADDED * (y + end)),
        (K[0] * end + K[2] * x, MASS * (x + z) + ADDED * (x + end)),
        (K[0] * y + K[1] * x, (MASS + ADDED) * (x + y)),
    ]
    expected = [*(K / (MASS + ADDED)), *(k / m for k, m in moments)]
    np.testing.assert_allclose(found, np.sort(expected), rtol=1e-4)


def test_a_pressed_box_sinks_by_force_over_stiffness():
    mesh = box()
    elastic = assembled(mesh=mesh)
    f = 3.0 * unit_loads(mesh, elastic.free, "box.top")
    u = la.solve(elastic.K.toarray(), f, assume_a="pos")
    sinks = u @ (elastic.M @ np.tile([0.0, 0.0, 1.0], u.size // 3)) / (MASS + ADDED)
    assert sinks == pytest.approx(-3.0 * SIDES[0] * SIDES[1] / K[2], rel=1e-4)


def test_springs_follow_the_axes_of_their_part():
    changes = ['springs={ "block.top" = { stiffness = ["1 kN/mm", "4 kN/mm", 0] } }']
    scene = read_scene(BLOCK, [*changes, "parts.block.axis='30 deg'"])
    k = added_to_face(scene, "block.top").stiffness
    along = np.array([np.sqrt(0.75), 0.5, 0.0])
    across = np.array([-0.5, np.sqrt(0.75), 0.0])
    np.testing.assert_allclose(k @ along, 1e6 * along, rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(k @ across, 4e6 * across, rtol=1e-12, atol=1e-6)


def test_stiff_springs_are_a_support():
    """A million times stiffer than the plate: the static compliance is that of the clamped one."""
    stiff = 'springs={ "plate.bottom" = { stiffness = ["1e9 kN/mm", "1e9 kN/mm", "1e9 kN/mm"] } }'
    held, sprung = (
        assemble_brake(read_scene(BLOCK, [*COARSE, *more]), MPI.COMM_SELF)
        for more in ([], ["supports={ 'block.top' = ['x', 'y'] }", stiff])
    )
    work = []
    for brake in (held, sprung):
        # The bodies under a unit pressure at the contact elements of the plate.
        A, load = brake.K, brake.N.T @ brake.w
        A = A + 1e10 * brake.N.T @ sp.diags(brake.w) @ brake.N
        work.append(load @ spsolve(A.tocsc(), load))
    assert work[1] == pytest.approx(work[0], rel=1e-5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('springs={ "block.top" = { stiffness = ["1 kN/mm", 0] } }', "write three"),
        ('springs={ "block.top" = { stiffness = [0, 0, 0] } }', "write three"),
        ('springs={ "block.top" = { stiffness = [1.0, 0, 0] } }', "unit is missing"),
        ('springs={ "block.top" = { stiffness = ["1 kg", 0, 0] } }', "wrong unit"),
        ('springs={ "block.side" = { stiffness = ["1 N/m", 0, 0] } }', "block.side"),
        ('masses={ "block.top" = { mass = "0 kg" } }', "positive"),
        ('masses={ "none.top" = { mass = "1 g" } }', "none.top"),
    ],
)
def test_mistakes_are_one_line(change, said):
    with pytest.raises(SceneError) as error:
        check_brake(read_scene(BLOCK, [change]), MPI.COMM_SELF)
    assert said in str(error.value)


def test_a_mass_beside_the_gyroscopic_term_is_refused():
    turning = [
        "motion={ axis='z', speed='40 rad/s' }", "stability.damping={ gyroscopic=true }",
        'masses={ "plate.top" = { mass = "1 kg" } }',
    ]  # fmt: skip
    with pytest.raises(SceneError, match="leave the masses or gyroscopic out"):
        read_scene(BLOCK, turning)
