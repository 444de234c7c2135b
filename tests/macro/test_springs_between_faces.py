"""Springs and dashpots between two faces, and to the ground: rigid bodies, totals, ratios."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from brake_fenicsx.build.brake import assemble_brake, check_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.scene import active_terms
from brake_fenicsx.stability import complex_modes
from places import BLOCK

# A block of iron above the block of the scene, neither held nor loaded; the plate is.
LIFTED = [
    "parts.block.size='20 mm'", "parts.plate.size='30 mm'", "loads={}",
    'parts.cap={ builder="block", length="30 mm", width="24 mm", height="10 mm", z="35 mm",'
    ' size="20 mm", material="iron" }', "supports={ 'plate.bottom' = 'clamped' }",
]  # fmt: skip
# Length, width, height [m] and mass [kg] of block and cap.
BLOCK_BOX = (40e-3, 20e-3, 20e-3, 2510.0 * 16e-6)
CAP_BOX = (30e-3, 24e-3, 10e-3, 7200.0 * 7.2e-6)
K = np.array([2e4, 5e4, 3e4])


def springs(name="clip", **kinds):
    """Text of a spring of a scene, from SI values."""
    units = {"stiffness": "N/m", "damping": "N s/m", "stiffness_per_area": "Pa/m"}
    values = [
        f"{kind} = [{', '.join(f'{chr(34)}{v:.12g} {units[kind]}{chr(34)}' for v in three)}]"
        for kind, three in kinds.items()
        if kind != "faces"
    ]
    values += [f"faces = {list(kinds['faces'])!r}"] if "faces" in kinds else []
    return f'springs."{name}"={{ {", ".join(values)} }}'.replace("'", '"')


def loose_bodies(*changes, comm=MPI.COMM_SELF):
    """Stiffness, mass and damping of block and cap, and the places of their nodes [m].

    The plate is held 2 mm below the block, and nothing joins it to that.
    """
    scene = read_scene(BLOCK, [*LIFTED, "parts.plate.z='-12 mm'", *changes])
    brake = assemble_brake(scene, comm)
    free, matrices = brake.elastic.free, (brake.K, brake.M, brake.elastic.C)
    node, component = np.divmod(free.local, 3)
    x = np.column_stack([free.V.tabulate_dof_coordinates()[node], component])
    loose = np.flatnonzero(x[:, 2] > -1e-9)
    K, M, C = (None if A is None else A[loose][:, loose] for A in matrices)
    return K, M, C, x[loose]


def moving(x, velocity, part):
    """Displacement of some dofs, of the block (below 30 mm), the cap, or both."""
    chosen = {"block": x[:, 2] < 30e-3, "cap": x[:, 2] > 30e-3, "both": np.ones(len(x), bool)}
    values = velocity(x[:, :3]) if callable(velocity) else np.broadcast_to(velocity, (len(x), 3))
    return np.where(chosen[part], values[np.arange(len(x)), x[:, 3].astype(int)], 0.0)


def compliance(box, arm):
    """Inverse mass [1/kg] of a rigid box at a point above or below its centre: 1/m + arm^2 / I."""
    *sides, mass = box
    x, y, _ = mass / 12 * (np.sum(np.square(sides)) - np.square(sides))
    return np.diag([1 / mass + arm**2 / y, 1 / mass + arm**2 / x, 1 / mass])


def clip(**more):
    """Springs along axes that are turned by 30 degrees, from the block's top to the cap's lower."""
    given = {"stiffness": K, "faces": ["block.top", "cap.bottom"], **more}
    return springs(**given), "parts.block.axis='30 deg'"


TURN = np.array([[np.sqrt(0.75), -0.5, 0.0], [0.5, np.sqrt(0.75), 0.0], [0.0, 0.0, 1.0]])


def test_two_rigid_boxes_joined_by_springs(comm):
    """Three modes of the springs, one of them sqrt(k (1/m + 1/m)), and nine rigid ones."""
    stiff, mass, C, _ = loose_bodies(*clip(), comm=comm)
    assert C is None
    found = np.sort(eigsh(stiff, 13, mass, sigma=-1e5, return_eigenvectors=False))
    mobility = compliance(BLOCK_BOX, 10e-3) + compliance(CAP_BOX, 5e-3)
    expected = np.linalg.eigvals(TURN @ np.diag(K) @ TURN.T @ mobility)
    np.testing.assert_allclose(found[9:12], np.sort(expected), rtol=2e-3)
    along = K[2] * (1 / BLOCK_BOX[3] + 1 / CAP_BOX[3])
    assert np.abs(found[9:12] / along - 1).min() < 2e-3
    assert np.abs(found[:9]).max() < 1e-6 * found[9]
    assert found[12] > 100 * found[11]


def test_totals_of_springs_and_dashpots_between_faces(comm):
    """k |jump|^2 along the springs' axes, none for a motion of both; faces of two sizes."""
    stiff, _, C, x = loose_bodies(*clip(damping=K / 1e3), comm=comm)
    for direction, k in zip(TURN.T, K, strict=True):
        for part in ("block", "cap"):
            u = moving(x, direction, part)
            assert u @ stiff @ u == pytest.approx(k, rel=1e-6)
            assert u @ C @ u == pytest.approx(1e-3 * k, rel=1e-12)
        u = moving(x, direction, "both")
        assert abs(u @ stiff @ u) < 1e-6 * k
        assert abs(u @ C @ u) < 1e-12 * k


def test_bedding_and_dashpots_to_the_ground(comm):
    """A bedding is per area, dashpots are totals, both along the part's axes."""
    bed, per_area = springs("cap.top", stiffness_per_area=K, damping=K), 720e-6
    stiff, _, C, x = loose_bodies(bed, "parts.cap.axis='30 deg'", comm=comm)
    for direction, k in zip(TURN.T, K, strict=True):
        u = moving(x, direction, "cap")
        assert u @ stiff @ u == pytest.approx(per_area * k, rel=1e-3)
        assert u @ C @ u == pytest.approx(k, rel=1e-12)


def test_inertia_of_a_face_is_that_of_its_rotation(comm):
    """About the centroid and the part's axes, none for a displacement; on the top of the cap."""
    inertia, text = np.array([3e-6, 5e-6, 7e-6]), 'masses={ "cap.top"={ mass="1 g"'
    axis = "parts.cap.axis='30 deg'"
    moments = ", ".join(f'"{1e6 * v:.12g} kg mm^2"' for v in inertia)
    _, plain, _, x = loose_bodies(text + "} }", axis, comm=comm)
    _, mass, _, _ = loose_bodies(f"{text}, inertia=[{moments}] }} }}", axis, comm=comm)
    added = mass - plain
    for k, direction in enumerate(TURN.T):
        turning = moving(x, lambda at, d=direction: np.cross(d, at - [0, 0, 45e-3]), "cap")
        assert turning @ added @ turning == pytest.approx(inertia[k], rel=1e-9)
        assert abs(moving(x, direction, "cap") @ added @ moving(x, direction, "cap")) < 1e-15
    box = CAP_BOX[3] / 12 * (24e-3**2 + 10e-3**2) + CAP_BOX[3] * 5e-3**2
    turning = moving(x, lambda at: np.cross([1.0, 0, 0], at - [0, 0, 45e-3]), "cap")
    assert turning @ plain @ turning == pytest.approx(box + 1e-3 * 24e-3**2 / 12, rel=1e-9)


def test_damping_ratio_of_rigid_boxes_on_damped_springs():
    """Dashpots in proportion to the springs: 2 zeta = omega c / k in each mode of the springs."""
    ratio = 2e-5
    stiff, mass, C, _ = loose_bodies(
        *clip(damping=ratio * K), springs("cap.top", stiffness=2 * K, damping=2 * ratio * K)
    )
    modes = complex_modes(mass, C, stiff, (20.0, 5e3), zeta_max=0.3)
    assert modes.s.size == 9
    omega = np.abs(modes.s)
    np.testing.assert_allclose(-2 * modes.s.real / omega, ratio * omega, rtol=2e-3)


def test_dashpots_alone_are_a_damping_term():
    scene = read_scene(BLOCK, [*LIFTED, springs("cap.top", damping=K)])
    assert active_terms(scene, "multi-scale") == ("springs",)
    assert active_terms(read_scene(BLOCK, [*LIFTED, clip()[0]]), "multi-scale") == ()


@pytest.mark.parametrize(
    ("spring", "said"),
    [
        ({"faces": ["block.top", "cap.bottom"]}, "neither stiffness nor damping"),
        ({"faces": ["block.top"], "stiffness": K}, "write two faces"),
        ({"faces": ["block.top", "cap.side"], "stiffness": K}, "cap.side"),
        ({"faces": ["block.top", "cap.top"], "stiffness_per_area": K}, "the total of the two"),
        ({"faces": ["block.top", "cap.top"], "damping": K[:2]}, "write three"),
        ({"stiffness": K}, "clip"),
    ],
)
def test_mistakes_are_one_line(spring, said):
    with pytest.raises(SceneError) as error:
        check_brake(read_scene(BLOCK, [*LIFTED, springs(**spring)]), MPI.COMM_SELF)
    assert said in str(error.value)


def test_inertia_of_two_values_is_refused():
    text = 'masses={ "cap.top"={ mass="1 g", inertia=["1 kg mm^2", 0] } }'
    with pytest.raises(SceneError, match="write three, about the part's axes"):
        read_scene(BLOCK, [*LIFTED, text])


def test_faces_too_large_for_a_mean_motion_are_refused(monkeypatch):
    monkeypatch.setattr("brake_fenicsx.macro.tie.MOST_NODES", 20)
    with pytest.raises(SceneError, match=r"springs.clip: \d+ nodes .* name a smaller face"):
        loose_bodies(*clip())
