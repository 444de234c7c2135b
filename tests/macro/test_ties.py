"""Faces glued together: patch test, rigid motions, glued meshes, what is glued and what is not."""

import logging
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse as sp
from dolfinx import fem
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh, norm

from brake_fenicsx.build.brake import assemble_brake, check_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.geometry import block
from brake_fenicsx.macro.elasticity import assemble_elastic, unit_loads
from brake_fenicsx.macro.faces import body_of_nodes
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.macro.tie import tied_faces
from brake_fenicsx.meshing.brake_mesh import raw_mesh, tagged_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.meshing.rawmesh import joined
from brake_fenicsx.report.mode_fields import tied_bodies
from brake_fenicsx.samples.numbering import body_centres
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability.substructures.component import originals_and_images
from brake_fenicsx.stability.substructures.substructure import split_substructures
from places import BLOCK

# A second block glued on the first one, its mesh another one.
CAP = [
    "parts.block.size='20 mm'", "parts.plate.size='30 mm'", "loads={}",
    'parts.cap={ builder="block", length="30 mm", width="24 mm", height="8 mm", z="20 mm",'
    ' size="9 mm", material="iron" }',
    'ties={ glue={ faces=["block.top", "cap.bottom"] } }',
]  # fmt: skip
STEEL = Material(isotropic(210e9, 0.3), 7800.0)
C33 = float(STEEL.C[2, 2])
LENGTH = 20e-3


def bar(comm, table=MeshSettings(), gap=0.0, bend=None, **upper):  # noqa: B008
    """Two blocks, one upon the other, of unlike meshes; the upper one may differ, all be bent."""
    low = block.Block(length=10e-3, width=8e-3, height=LENGTH, z=-LENGTH, size=4e-3)
    high = {"length": 10e-3, "width": 8e-3, "height": LENGTH, "z": gap, "size": 2.9e-3, **upper}

    def made():
        raw = raw_mesh({"low": (block, low), "high": (block, block.Block(**high))}, table)
        return raw if bend is None else replace(raw, points=bend(raw.points))

    return tagged_mesh(made, comm, table)


def tied(mesh, supports, kappa=None, search=None):
    """Assembled bodies, and the tie of low.top and high.bottom that is in their stiffness."""
    materials = dict.fromkeys(mesh.layers, STEEL)
    elastic = assemble_elastic(mesh, materials, supports)
    tie = tied_faces(mesh, elastic.free, ("low.top", "high.bottom"), materials, kappa, search)
    return with_layer(elastic, tie), tie


def with_layer(elastic, tie):
    return replace(elastic, K=elastic.K + tie.K)


def field(mesh, elastic, **bodies):
    """A displacement that is given per body as a function of x."""
    u = fem.Function(elastic.free.V)
    for body, values in bodies.items():
        u.interpolate(values, mesh.cell_tags.find(mesh.layers[f"{body}.body"]))
    return u.x.array[elastic.free.local]


def largest(values):
    return np.abs(values).max()


@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_patch(comm, cells):
    """Uniaxial strain: displacements linear in each body, and the jump sigma / kappa."""
    mesh = bar(comm, MeshSettings(cells=cells))
    supports = {"low.bottom": ["z"], "low.sides": ["x", "y"], "high.sides": ["x", "y"]}
    p, kappa = 1e6, 3e13
    elastic, tie = tied(mesh, supports, kappa)
    factor = Factor(elastic.K)
    u = factor.solve(p * unit_loads(mesh, elastic.free, "high.top"))
    factor.destroy()

    def sunk(jump):
        return lambda x: np.stack([0 * x[0], 0 * x[0], -p / C33 * (x[2] + LENGTH) - jump])

    exact = field(mesh, elastic, low=sunk(0.0), high=sunk(p / kappa))
    assert largest(u - exact) < 1e-10 * largest(exact)
    assert tie.area == pytest.approx(80e-6, rel=1e-12)
    assert tie.uncovered == pytest.approx(0.0, abs=1e-18)


def test_any_uniform_stress_is_in_equilibrium_across_the_faces(comm):
    """Shear along the faces too: no force is left on nodes within the bodies or on the tie."""
    mesh, kappa = bar(comm), 2e13
    elastic, _ = tied(mesh, {"low.bottom": ["x", "y", "z"], "low.sides": ["x", "y", "z"],
                             "high.top": ["x", "y", "z"], "high.sides": ["x", "y", "z"]},
                      kappa)  # fmt: skip
    strain = 1e-4 * np.array([[1.0, 0.4, -0.7], [0.4, -0.5, 0.9], [-0.7, 0.9, 0.6]])
    stress = STEEL.C @ [*np.diag(strain), *(2 * strain[[1, 0, 0], [2, 2, 1]])]
    jump = stress[[4, 3, 2]] / kappa
    # Held dofs are out of the matrix: what they would add is known from the bodies apart.
    free, tie = tied(mesh, {}, kappa)
    u = field(mesh, free, low=lambda x: strain @ x, high=lambda x: strain @ x + jump[:, None])
    force = free.K @ u
    inner = np.isin(free.free.local, elastic.free.local)
    assert inner.sum() == elastic.free.size
    assert largest(force[inner]) < 1e-11 * largest(force)
    assert tie.area == pytest.approx(80e-6, rel=1e-12)


@pytest.mark.parametrize(
    ("gap", "curved"), [(0.0, False), (0.3e-3, False), (0.0, True), (0.2e-3, True)]
)
def test_rigid_motions_strain_no_tie(comm, gap, curved):
    """Faces on a cylinder whose meshes do not match, and faces with a gap between them."""

    def bend(x):
        radius = 40e-3 + x[:, 2]
        angle = x[:, 0] / 40e-3
        return np.stack([radius * np.sin(angle), x[:, 1], radius * np.cos(angle)], axis=1)

    low = {"height": 8e-3}
    mesh = bar(comm, MeshSettings(order=2), gap, bend if curved else None, **low)
    elastic, tie = tied(mesh, {}, 1e14, search=0.5e-3)
    if curved:
        # The chords of the borders leave out some of the area.
        assert tie.area == pytest.approx(80e-6, rel=2e-3)
        assert tie.gap == pytest.approx(gap, abs=0.05e-3)
    scale = 1e14 * tie.area
    for k in range(3):
        move = np.eye(3)[k][:, None]
        for motion, size in (
            (lambda x, m=move: np.repeat(m, x.shape[1], axis=1), 1.0),
            (lambda x, m=move: np.cross(m, x, axis=0), 20e-3),
        ):
            u = field(mesh, elastic, low=motion, high=motion)
            energy = u @ elastic.K @ u
            assert abs(energy) < 1e-12 * scale * size**2
    # Every other motion of the two strains something: they are one body.
    found = lowest(elastic, 7)
    assert np.abs(found[:6]).max() < 1e-6 * found[6]


def lowest(elastic, count=8):
    """Lowest eigenvalues of a small model [1/s^2]."""
    K, M = elastic.K, elastic.M
    return np.sort(eigsh(K, count, M, sigma=-1e9, return_eigenvectors=False))


def test_modes_tend_to_those_of_the_glued_mesh(meshes):
    """Of matching meshes: first order in 1 / kappa, down to the glued mesh itself."""
    raw, table, comm = meshes.boxes(), MeshSettings(), MPI.COMM_SELF
    apart, glued = (tagged_mesh(lambda r=r: r, comm, table) for r in (raw, meshes.glued(raw)))
    materials, held = dict.fromkeys(raw.layers, STEEL), {"plate.bottom": ["x", "y", "z"]}
    exact = lowest(assemble_elastic(glued, materials, held))
    errors = []
    for kappa in (1e16, 1e17, 1e18):
        elastic = assemble_elastic(apart, materials, held)
        faces = ("pad.bottom", "plate.top")
        tie = tied_faces(apart, elastic.free, faces, materials, kappa)
        errors.append(1 - lowest(with_layer(elastic, tie)) / exact)
    np.testing.assert_allclose(errors[0] / errors[1], 10, rtol=0.02)
    np.testing.assert_allclose(errors[1] / errors[2], 10, rtol=0.02)
    assert errors[2].max() < 2e-5


def test_usual_stiffness_costs_less_than_the_mesh():
    """Of unlike meshes: no further from a fine mesh than one piece of the coarser cells is, but for
    the layer itself; ten times the stiffness moves modes by less than the cells do.
    """
    comm, table = MPI.COMM_SELF, MeshSettings()

    def one(size):
        piece = block.Block(length=10e-3, width=8e-3, height=24e-3, z=-12e-3, size=size)
        mesh = tagged_mesh(lambda: raw_mesh({"low": (block, piece)}, table), comm, table)
        return lowest(assemble_elastic(mesh, {"low.body": STEEL}, {"low.bottom": ["z"]}))

    def two(kappa=None):
        low = block.Block(length=10e-3, width=8e-3, height=12e-3, z=-12e-3, size=5e-3)
        high = replace(low, z=0.0, size=4e-3)
        parts = {"low": (block, low), "high": (block, high)}
        mesh = tagged_mesh(lambda: raw_mesh(parts, table), comm, table)
        elastic, tie = tied(mesh, {"low.bottom": ["z"]}, kappa)
        return lowest(elastic), tie.stiffness

    fine, coarse, (found, kappa) = one(2.5e-3), one(5e-3), two()
    # Of a bar in series with the layer, where its stress is the largest.
    layer = 2 * C33 / kappa / 24e-3
    assert layer < 5e-4
    allowed = 1.2 * np.abs(coarse / fine - 1) + layer
    assert np.all(np.abs(found / fine - 1)[3:] < allowed[3:])
    stiffer, _ = two(10 * kappa)
    assert np.all(np.abs(stiffer / found - 1)[3:] < np.abs(coarse / fine - 1)[3:] + layer)


def test_a_slit_in_one_part_is_closed(meshes):
    """One half of the boxes' common face is whole, the other a slit of one part: tied, all is."""
    raw, table, comm = meshes.boxes(), MeshSettings(), MPI.COMM_SELF
    names = {"pad.body": "one.low", "plate.body": "one.high"}
    raw = replace(raw, layers={names[n]: tag for n, tag in raw.layers.items()})
    plate = np.unique(raw.cells[raw.cell_tag == raw.layers["one.high"]])
    open_ = np.isin(np.arange(len(raw.points)), plate) & (np.abs(raw.points[:, 2]) < 1e-9)
    open_ &= raw.points[:, 0] > 1e-9
    places = np.rint(np.column_stack([raw.points / 1e-7, open_])).astype(int)
    _, first, number = np.unique(places, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    _, at, count = np.unique(
        np.sort(number[raw.facets], axis=1), axis=0, return_inverse=True, return_counts=True
    )
    outer = count[at.reshape(-1)] == 1
    slit = replace(
        raw, points=raw.points[first], cells=number[raw.cells],
        facets=number[raw.facets][outer], facet_tag=raw.facet_tag[outer],
    )  # fmt: skip
    held, found = {"plate.bottom": ["x", "y", "z"]}, []
    for made in (slit, meshes.glued(raw)):
        mesh = tagged_mesh(lambda r=made: r, comm, table)
        elastic = assemble_elastic(mesh, dict.fromkeys(mesh.layers, STEEL), held)
        found.append(lowest(elastic))
        if made is slit:
            materials = dict.fromkeys(mesh.layers, STEEL)
            faces = ("pad.bottom", "plate.top")
            tie = tied_faces(mesh, elastic.free, faces, materials, 1e18)
            found.append(lowest(with_layer(elastic, tie)))
    free, closed, whole_piece = found
    assert np.all(free < 0.97 * whole_piece)
    np.testing.assert_allclose(closed, whole_piece, rtol=1e-5)


def test_only_the_common_part_is_glued(caplog):
    """The cap hangs over on two sides and is narrower on the others: 30 x 20 mm^2 are common."""
    with caplog.at_level(logging.INFO):
        scene = read_scene(BLOCK, CAP)
        brake = assemble_brake(scene, MPI.COMM_SELF)
    assert "tie glue: 600 mm^2 glued, 200 mm^2 of block.top not; gap up to" in caplog.text
    bodies = split_substructures(brake.K, brake.M, {"N": brake.N})
    assert len(bodies) == 2
    # So do pictures: three meshes, the cap above 20 mm with the block.
    V, drawn = brake.elastic.free.V, tied_bodies(scene, brake)
    z = V.tabulate_dof_coordinates()[:, 2]
    assert len({*drawn}) == 2 and len({*body_of_nodes(V)}) == 3
    assert {*drawn[z > 1e-9]} == {drawn[z.argmax()]} and drawn[z.argmin()] != drawn[z.argmax()]
    # A face of a body by matrices is none of the mesh, and joins nothing there.
    (glue,) = scene.ties.values()
    caliper = replace(glue, faces=("caliper.fingers", glue.faces[1]))
    apart = tied_bodies(replace(scene, ties={"fingers": caliper}), brake)
    assert len({*apart}) == 3


def test_tied_bodies_are_one_substructure_and_repeat_as_one():
    """Two equal pairs, side by side: one is the other's image, unless their ties differ."""
    low = block.Block(length=10e-3, width=8e-3, height=6e-3, z=-6e-3, size=5e-3)
    high = replace(low, z=0.0, size=4e-3)
    first = raw_mesh({"low": (block, low), "high": (block, high)}, MeshSettings())
    second = replace(
        first, points=first.points + np.array([50e-3, 0, 0]),
        layers={f"other_{n}": tag for n, tag in first.layers.items()},
        faces={f"other_{n}": tag for n, tag in first.faces.items()},
    )  # fmt: skip
    mesh = tagged_mesh(lambda: joined([first, second]), MPI.COMM_SELF, MeshSettings())
    materials = dict.fromkeys(mesh.layers, STEEL)
    found = []
    for factors in ((), (1.0,), (1.0, 1.0), (1.0, 1.001)):
        elastic = assemble_elastic(mesh, materials, {})
        apart = elastic.K
        for before, factor in zip(("", "other_"), factors, strict=False):
            faces = (f"{before}low.top", f"{before}high.bottom")
            tie = tied_faces(mesh, elastic.free, faces, materials, factor * 1e15)
            elastic = with_layer(elastic, tie)
        node, component = np.divmod(elastic.free.local, 3)
        places = elastic.free.V.tabulate_dof_coordinates()[node]
        body = connected_components(apart, directed=False)[1]
        centres = body_centres(places, body)
        points = np.column_stack([places, component, centres])
        none = sp.csr_matrix((0, elastic.free.size))
        rows = {"N": none, "T": none}
        bodies = split_substructures(elastic.K, elastic.M, rows, points=points)
        found.append((len(bodies), len(originals_and_images(bodies)[0])))
    assert found == [(4, 2), (3, 3), (2, 1), (2, 2)]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('ties.glue.faces=["block.top"]', "write two faces"),
        ('ties.glue.faces=["block.top", "block.top"]', "write two faces"),
        ('ties.glue.faces=["block.bottom", "cap.bottom"]', "contact.block_plate as well"),
        ('ties.glue.faces=["block.top", "cap.side"]', "cap.side"),
        ('ties.glue.stiffness="1 N/m"', "wrong unit"),
    ],
)
def test_mistakes_are_one_line(change, said):
    with pytest.raises(SceneError) as error:
        check_brake(read_scene(BLOCK, [*CAP, change]), MPI.COMM_SELF)
    assert said in str(error.value)


def test_a_part_tied_to_one_that_turns_turns_too():
    turning = [
        *CAP, "motion={ axis='z', speed='40 rad/s' }", "stability.damping={ gyroscopic=true }",
        'contact.block_plate.faces=["plate.top", "block.bottom"]',
    ]  # fmt: skip
    with pytest.raises(SceneError, match=r'cap does not turn.*gyroscopic = \["block", "cap"\]'):
        read_scene(BLOCK, turning)
    read_scene(BLOCK, [*turning, 'stability.damping.gyroscopic=["block", "cap"]'])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("parts.cap.z='20.7 mm'", 'lie 0.7 mm apart, and .* or write search = "0.77 mm"'),
        ("parts.cap.z='90 mm'", "nowhere opposite to each other, their nearest nodes are 7. mm"),
        ('ties.glue.faces=["block.sides", "cap.top"]', "nowhere opposite to each other"),
    ],
)
def test_faces_that_do_not_touch(comm, change, said):
    with pytest.raises(SceneError, match=said) as error:
        assemble_brake(read_scene(BLOCK, [*CAP, change]), comm)
    assert "ties.glue: " in str(error.value)


def test_a_gap_that_is_named_is_glued(comm):
    scene = read_scene(BLOCK, [*CAP, "parts.cap.z='20.7 mm'", "ties.glue.search='0.8 mm'"])
    apart = assemble_brake(read_scene(BLOCK, [*CAP, "ties={}"]), comm)
    glued = assemble_brake(scene, comm)
    assert norm(glued.K) > 1.1 * norm(apart.K)
