"""Lengths that a second mesh file defines: against files written with the nodes in their places."""

import re
from dataclasses import replace
from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx import model
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.changes import assemble_changes
from brake_fenicsx.build.damping_terms import damping_terms
from brake_fenicsx.build.lengths import movement
from brake_fenicsx.build.scene_mesh import mesh_settings, scene_mesh
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.geometry import block
from brake_fenicsx.macro.morphing import Move, moving
from brake_fenicsx.meshing.brake_mesh import raw_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.pipeline import run
from brake_fenicsx.results.run import read_run
from brake_fenicsx.samples.solve import full_modes
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import complex_modes
from run_tables import read_columns

SCENE = """
stages = ["equilibrium", "stability"]
[mesh]
file = "{file}"
unit = "mm"
degree = {degree}
mass = "{mass}"
[mesh.groups]
pad_body = "pad.lining"
plate_body = "plate.body"
pad_bottom = "pad.friction"
plate_top = "plate.top"
pad_top = "pad.back"
pad_sides = "pad.sides"
plate_bottom = "plate.bottom"
[parts.pad]
material = "lining"
{morph}
[parts.plate]
material = "iron"
[materials.iron]
model = "isotropic"
E = "125 GPa"
nu = 0.24
rho = "7200 kg/m^3"
[materials.lining]
model = "isotropic"
E = "4 GPa"
nu = 0.3
rho = "2500 kg/m^3"
[contact.pad_plate]
faces = ["pad.friction", "plate.top"]
law = {{ p0 = "10 MPa", u0 = "10 um" }}
friction = 0.4
[supports]
"plate.bottom" = "clamped"
"pad.back" = ["x", "y"]
[loads]
"pad.back" = {{ pressure = "5 bar" }}
[motion]
axis = "z"
point = ["70 mm", 0, 0]
speed = "20 rad/s"
[stability]
band = ["0 Hz", "25 kHz"]
method = "reduced"
"""
KEY, E = "parts.pad.morph.wear.value", "materials.lining.E"
WEAR = 'morph.wear = { displaced = "worn.msh", ends = ["12 mm", "8 mm"] }'
TURNING = "stability.damping={ rayleigh=['300 1/s', '2e-7 s'], gyroscopic=['pad'] }"


def worn(points, pad):
    """4 mm less high, the inside in no proportion, and sides that bulge."""
    x, y, z = points[pad].T
    out = points.copy()
    bulge = np.sin(np.pi * z / 12e-3)
    out[pad] = np.column_stack(
        [x * (1 + 0.08 * bulge), y + 0.04 * x * bulge, z - 4e-3 * (z / 12e-3) ** 1.3]
    )
    return out


def narrowed(points, pad):
    """A friction face that gets narrower and moves over the plate, below a back that stays."""
    bottom = np.where(pad, 1 - points[:, 2] / 12e-3, 0)
    move = np.column_stack(
        [-0.1 * points[:, 0] - 0.02 * points[:, 1], -0.06 * points[:, 1], 0 * bottom]
    )
    return points + bottom[:, None] * move


COARSE, FINE, TETRAHEDRA = ("hexahedra", 2, 11e-3), ("hexahedra", 2), ("tetrahedra", 1, 11e-3)


def nodes_of_pad(mesh):
    pad = np.zeros(len(mesh.points), dtype=bool)
    pad[mesh.cells[mesh.part("pad")]] = True
    return pad


@pytest.fixture
def written(tmp_path, meshes):
    """``written(length)``: a scene of files of 12 mm and 8 mm; or of one of a length alone [mm]."""

    def write(length=None, kind=COARSE, move=worn, morph=WEAR, form="msh", mesh=None, **more):
        mesh = mesh or meshes.boxes(*kind)
        # Nodes of tetrahedra of order 2 move on their own as well.
        step = move(mesh.points, nodes_of_pad(mesh)) - mesh.points

        def save(name, share):
            moved = replace(mesh, points=mesh.points + share * step)
            write = meshes.write_gmsh if form == "msh" else meshes.write_abaqus
            write(moved, tmp_path / f"{name}.{form}")
            return f"{name}.{form}"

        save("worn", 1.0)
        name = "new" if length is None else f"pad_{length}"
        file = save(name, 0.0 if length is None else (12 - length) / 4)
        morph = "" if length is not None else morph.replace("msh", form)
        scene = tmp_path / f"{name}.toml"
        settings = {"degree": 2, "mass": "consistent", **more}
        scene.write_text(SCENE.format(file=file, morph=morph, **settings))
        return scene

    return write


LAYER = "parts.pad.layers.lining"
BAR = {
    "pad": (block, block.Block(length=4e-3, width=4e-3, height=100e-3, z=0.0, size=4e-3)),
    "plate": (block, block.Block(length=4e-3, width=4e-3, height=4e-3, z=-4e-3, size=4e-3)),
}


def assert_same(found, exact, least, within=1e-4):
    """At least so many modes, near each other and within the errors that are stated."""
    assert found.s.size == exact.s.size >= least
    distance, size = np.abs(found.s - exact.s), np.abs(exact.s)
    assert np.all(distance < within * size)
    # The equilibria differ by the interpolation of the compliance.
    assert np.all(distance <= found.error + exact.error + 1e-5 * size)


def assert_near(found, exact, bound):
    """Matrices that differ by less than a share of the largest entry."""
    assert abs(found - exact).max() < bound * abs(exact).max()


def swept(low, high):
    return (
        f'sweep.parameters={{ "{KEY}"={{ values=["{low} mm","{high} mm"] }},'
        f' "{E}"={{ values=["3 GPa","5 GPa"] }} }}'
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "form", "more"),
    [
        pytest.param(COARSE, "msh", {}, marks=pytest.mark.slow),
        (("tetrahedra", 2, 14e-3), "inp", {}),
        (TETRAHEDRA, "msh", {"degree": 1, "mass": "lumped"}),
        (COARSE, "inp", {}),
    ],
)
def test_matrices_are_those_of_the_file_with_moved_nodes(kind, form, more, written):
    """Inside, at the ends and beside a modulus."""
    scene = read_scene(written(kind=kind, form=form, **more), [swept(8, 12), TURNING])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    for length in (8, 9.3, 12):
        sets = [TURNING, f"{E}='3.5 GPa'"]
        scene = read_scene(written(length, kind=kind, form=form, **more), sets)
        exact = assemble_brake(scene, MPI.COMM_SELF)
        values = {KEY: length * 1e-3, E: 3.5e9}
        K, M = brake.K + changes.change(values, "K"), brake.M + changes.change(values, "M")
        C = damping_terms(read_scene(written(kind=kind, form=form, **more), [TURNING]), brake).bulk
        C = C + changes.change(values, "C")
        for found, expected, bound in (
            (K, exact.K, 2e-9), (M, exact.M, 1e-10), (C, damping_terms(scene, exact).bulk, 1e-9),
        ):  # fmt: skip
            assert_near(found, expected, bound)


def test_a_scene_with_another_value_is_the_file_of_that_length(written):
    """Also where samples then move on from there."""
    exact = assemble_brake(read_scene(written(9.3)), MPI.COMM_SELF)
    scene = read_scene(written(), [f"{KEY}='9.3 mm'", swept(8, 9)])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    for A, B in ((brake.K, exact.K), (brake.M, exact.M), (brake.N, exact.N)):
        assert_near(A, B, 1e-9)
    changes = assemble_changes(scene, brake)
    assert abs(changes.change({}, "M")).max() == 0 == abs(changes.change({}, "K")).max()
    exact = assemble_brake(read_scene(written(8)), MPI.COMM_SELF)
    assert_near(brake.K + changes.change({KEY: 8e-3}, "K"), exact.K, 2e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    "box",
    [
        pytest.param({KEY: (8e-3, 12e-3)}, id="wear"),
        pytest.param({KEY: (10.5e-3, 12e-3), E: (3.8e9, 4.2e9)}, id="wear and modulus"),
    ],
)
def test_modes_are_those_of_the_file_with_moved_nodes(box, written):
    """Full order of the file with this length; at the ends as good as inside."""
    prepared = model.prepare(written(), parameters=box)
    for share in (0.0, 0.63, 1.0):
        values = {key: low + share * (high - low) for key, (low, high) in box.items()}
        sets = ["stability.method=full", f"{E}='{values.get(E, 4e9)} Pa'"]
        found = prepared.modes(values)
        exact = model.prepare(written(1e3 * values[KEY]), sets).modes()
        assert_same(found, exact, 8)


def test_frequencies_of_a_bar_follow_its_length(written):
    """Longitudinal, both ends free: f = c / (2 h), however the nodes inside move."""

    def worn(points, pad):
        z = np.maximum(points[:, 2], 0)
        return points - 40e-3 * np.outer((z / 0.1) ** 1.1, [0, 0, 1])

    bar = [
        "materials.lining={ model='isotropic', E='200 GPa', nu=0, rho='8000 kg/m^3' }",
        "contact.pad_plate.law={ p0='5 bar', u0='1 m' }",
        "contact.pad_plate.friction=0",
        'supports={ "pad.back"=["x", "y"], "plate.bottom"="clamped", "pad.sides"=["x", "y"] }',
        "stability.band=['0 Hz','50 kHz']",
    ]
    morph = 'morph.wear = { displaced = "worn.msh", ends = ["100 mm", "60 mm"] }'
    scene = written(move=worn, morph=morph, mesh=raw_mesh(BAR, MeshSettings(cells="hexahedra")))
    prepared = model.prepare(scene, bar, parameters={KEY: (80e-3, 100e-3)})
    for height in (80e-3, 91e-3, 100e-3):
        f = prepared.modes({KEY: height}).frequency
        assert f[f > 1e3][0] == pytest.approx(5000 / (2 * height), rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("move", [pytest.param(worn, marks=pytest.mark.slow), narrowed])
def test_derivative_to_a_length_is_that_of_files_beside_it(move, written):
    """Central differences at full order, on the contact of the sample as it stands."""
    sets = [
        "stages=['equilibrium','stability','uncertainty']", "samples.n=2", "stability.drivers=true",
        "contact.pad_plate.friction=0.5", "contact.pad_plate.law={ p0='1 MPa', u0='0.3 um' }",
        f'samples.random={{ "{KEY}"={{ law="uniform", min="9.9 mm", max="10.1 mm" }} }}',
    ]  # fmt: skip
    study = model.prepare(written(kind=FINE, move=move), sets).study
    data = study.work(("multi-scale", 0))
    length, s = float(data["random"][0]), data["s"][data["driver_mode"]]

    def beside(x):
        # Files hold their nodes to 16 digits of the unit.
        scene = read_scene(written(1e3 * length * (1 + x), kind=FINE, move=move))
        b = assemble_brake(scene, MPI.COMM_SELF)
        k = sp.diags(b.w * data["k_vibration"])
        K = b.K + b.N.T @ k @ b.N + 0.5 * b.T.T @ k @ b.N
        found = complex_modes(b.M, None, K.tocsr(), band=(0.0, 25e3)).s
        return found[np.abs(found[:, None] - s).argmin(axis=0)]

    exact = (beside(1e-4) - beside(-1e-4)) / 2e-4
    found = data["driver_value"][(data["driver_kind"] == "length").argmax()]
    assert s.size and np.all(s.real > 0)
    np.testing.assert_allclose(found, exact, rtol=1e-3)


@pytest.mark.parametrize(
    ("kind", "sets"),
    [
        pytest.param(COARSE, [], marks=pytest.mark.slow),
        (TETRAHEDRA, [TURNING, "contact.pad_plate.discretisation='quadrature'"]),
        pytest.param(TETRAHEDRA, ["stability.damping={ sliding=true }"], marks=pytest.mark.slow),
    ],
)
def test_a_face_in_contact_may_slide_over_the_other(kind, sets, written):
    """Areas by their closed form; force of the load; modes of the file with moved nodes."""
    degree = kind[1]
    prepared = model.prepare(
        written(kind=kind, move=narrowed, degree=degree), sets, parameters={KEY: (10e-3, 12e-3)}
    )
    study = prepared.study
    whole = study.brake.w.sum()
    for length in (10, 11.3):
        values, share = {KEY: length * 1e-3}, (12 - length) / 4
        other = model.prepare(
            written(length, kind=kind, move=narrowed, degree=degree),
            [*sets, "stability.method=full"],
        )
        (eq, found), (state, exact) = (
            p.equilibrium_and_modes(v) for p, v in ((prepared, values), (other, {}))
        )
        w = study.models.brake.at(values).contact.w
        # The face is sheared along x too.
        assert w.sum() == pytest.approx(whole * (1 - 0.1 * share) * (1 - 0.06 * share), rel=1e-9)
        np.testing.assert_allclose(w, other.study.brake.w, rtol=1e-9)
        assert w @ eq.p == pytest.approx(w @ state.p, rel=1e-5)
        assert_same(found, exact, 6)


def shifted(points, pad, x=0.0, tilt=0.0, plate=0.0):
    """A pad whose friction face moves."""
    out = worn(points, pad)
    bottom = np.where(pad, 1 - points[:, 2] / 12e-3, 0)
    out[:, 0] += x * bottom
    out[:, 2] += (0.5e-3 + tilt * points[:, 0]) * bottom
    out[points[:, 2] < -5e-3, 0] += plate
    return out


def test_a_face_may_move_along_its_normal(written):
    """Matrices of the body at the new places; contact as it lies in the scene."""
    scene = read_scene(written(move=shifted), [swept(8, 12)])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    exact = assemble_brake(read_scene(written(9.3, move=shifted)), MPI.COMM_SELF)
    M = brake.M + assemble_changes(scene, brake).change({KEY: 9.3e-3}, "M")
    assert_near(M, exact.M, 1e-9)


@pytest.mark.parametrize(
    ("move", "sets", "text"),
    [
        (
            partial(shifted, x=1e-3),
            ["contact.pad_plate.zone={ x=['-1 m', '1 m'] }"],
            r"wear.value: moves the facets of contact.pad_plate, which its zone",
        ),
        (partial(shifted, tilt=0.01), [], r"contact.pad_plate.faces: .*deforms or tilts the face"),
        (partial(shifted, plate=1e-3), [], "nodes of other parts than pad are moved"),
        (
            lambda points, pad: points.copy(),
            [],
            r"displaced = 'worn.msh': no node is at another place",
        ),
        (worn, [f"{KEY}='2.5 mm'"], "turned inside out"),
        (worn, ["parts.pad.morph.wear.displaced='new.toml'"], "files .toml are not known"),
        (worn, ["stability.damping={ modal={ pad={ ratio=0.01 } } }"], "of bodies of one shape"),
    ],
)
def test_refusals(move, sets, text, written):
    with pytest.raises(SceneError, match=text):
        model.prepare(written(move=move), sets, parameters={KEY: (8e-3, 12e-3)})


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("parts.pad.morph.chamfer.value", "there is no such table; there are wear"),
        ("parts.plate.morph.wear.value", "there is no such table; there are none"),
        ("parts.pad.morph.wear.ends", "only these lengths may vary"),
    ],
)
def test_refused_names(key, text, written):
    with pytest.raises(SceneError, match=text):
        model.prepare(written(), parameters={key: (8e-3, 12e-3)})


def test_values_beyond_what_was_prepared_are_refused(written):
    scene = written(kind=TETRAHEDRA, degree=1)
    prepared = model.prepare(scene, parameters={KEY: (9e-3, 11e-3)})
    with pytest.raises(SceneError, match=r"value = 8 mm: lies beyond .* 8.87\d* to 12.1\d* mm"):
        prepared.modes({KEY: 8e-3})
    with pytest.raises(SceneError, match=r"wear.value = -0.008: must be positive"):
        prepared.modes({KEY: -8e-3})


def randomly(ranges):
    """Three scalars at a time may be random, two swept."""
    law = ", ".join(
        f'"{k}"={{ law="uniform", min="{a!r} {u}", max="{b!r} {u}" }}'
        for k, (a, b) in ranges.items()
        for u in ["Pa" if k == E else "m"]
    )
    return [
        "stages=['equilibrium','stability','uncertainty']", "samples.n=2",
        "samples.approaches=['multi-scale']", f"samples.random={{ {law} }}",
    ]  # fmt: skip


def twisted(points, pad):
    """An inside that swells over the height, the lower half more, and a top that turns inwards."""
    x, y, z = points.T
    share = np.where(pad, np.sin(np.pi * np.clip(z, 0, None) / 12e-3) ** 2, 0.0)
    return points + np.outer(share, [0, 0, 1]) * (1e-3 + 0.05 * x + 0.02 * y)[:, None]


SWELL = KEY.replace("wear", "swell")


def swelling(written, meshes, **more):
    """A mesh, the swollen one, nodes of the pad, and a scene of both lengths."""
    mesh = meshes.boxes("tetrahedra", 1, 14e-3)
    pad = nodes_of_pad(mesh)
    morph = WEAR + '\nmorph.swell = { displaced = "swollen.msh", ends = ["1 mm", "2 mm"] }'
    scene = written(mesh=mesh, morph=morph, degree=1, **more)
    swollen = replace(mesh, points=twisted(mesh.points, pad))
    meshes.write_gmsh(swollen, scene.parent / "swollen.msh")
    return mesh, swollen, pad, scene


@pytest.mark.long
def test_two_lengths_and_a_modulus_of_one_part(written, meshes):
    """Matrices of the file whose nodes both have moved; at corners of the ranges and inside."""
    mesh, swollen, pad, scene = swelling(written, meshes, mass="lumped")
    ranges = {KEY: (10e-3, 12e-3), SWELL: (1e-3, 1.25e-3), E: (3e9, 5e9)}
    sets = [*randomly(ranges), TURNING]
    scene = read_scene(scene, sets)
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    bulk = damping_terms(scene, brake).bulk
    for length, size in ((10, 1.25), (10.7, 1.1)):
        step = (12 - length) / 4 * (worn(mesh.points, pad) - mesh.points)
        both = replace(
            mesh, points=mesh.points + step + (size - 1) * (swollen.points - mesh.points)
        )
        alone = written(12, mesh=both, degree=1, mass="lumped")
        exact_scene = read_scene(alone, [TURNING, f"{E}='3.5 GPa'"])
        exact = assemble_brake(exact_scene, MPI.COMM_SELF)
        values = {KEY: length * 1e-3, SWELL: size * 1e-3, E: 3.5e9}
        for found, expected, bound in (
            (brake.K + changes.change(values, "K"), exact.K, 1e-8),
            (brake.M + changes.change(values, "M"), exact.M, 1e-10),
            (bulk + changes.change(values, "C"), damping_terms(exact_scene, exact).bulk, 1e-8),
        ):
            assert_near(found, expected, bound)


@pytest.mark.slow
def test_modes_of_two_lengths_and_a_modulus(written, meshes):
    """Full order of the same sample, at corners of the box and inside."""
    *_, scene = swelling(written, meshes)
    box = {KEY: (10.5e-3, 12e-3), SWELL: (1e-3, 1.5e-3), E: (3.8e9, 4.2e9)}
    prepared = model.prepare(scene, parameters=box)
    study = prepared.study
    for shares in ((0, 0, 0), (1, 0, 1), (0, 1, 1), (0.3, 0.63, 0.45)):
        values = {
            key: a + x * (b - a) for (key, (a, b)), x in zip(box.items(), shares, strict=True)
        }
        sample, found = study.sample(("multi-scale", 0), values), prepared.modes(values)
        exact = full_modes(study.models, sample, study.balance(sample))
        assert_same(found, exact, 6)


@pytest.fixture
def layered(written, meshes):
    """``layered(thickness, stated)``: a scene whose file has a pad of that thickness [mm]."""

    def write(thickness, stated):
        mesh = meshes.boxes(*COARSE)
        mesh.points[mesh.points[:, 2] > 0, 2] *= thickness / 12
        return written(mesh=mesh, morph=f'layers = {{ lining = "{stated} mm" }}')

    return write


def test_a_layer_of_another_thickness_is_the_file_with_moved_nodes(layered):
    sweep = f'sweep.parameters={{ "{LAYER}"={{ values=["9 mm", "13 mm"] }} }}'
    scene = read_scene(layered(12, 12), [sweep])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    exact = assemble_brake(read_scene(layered(9, 9)), MPI.COMM_SELF)
    for name in ("K", "M"):
        found = getattr(brake, name) + changes.change({LAYER: 9e-3}, name)
        assert_near(found, getattr(exact, name), 1e-9)


def test_modes_of_a_layer_of_another_thickness(layered):
    found = model.prepare(layered(12, 12), parameters={LAYER: (9e-3, 13e-3)}).modes({LAYER: 10e-3})
    exact = model.prepare(layered(10, 10), ["stability.method=full"]).modes()
    np.testing.assert_allclose(found.frequency, exact.frequency, rtol=1e-4)


@pytest.mark.parametrize(
    ("stated", "key", "text"),
    [
        (11, LAYER, r"parts.pad.layers.lining = 11 mm: the layer of the mesh is 12 mm thick"),
        (12, "parts.pad.layers.shim", "is no thickness of a layer of this part"),
        (12, "parts.plate.layers.body", "is no thickness of a layer of this part"),
    ],
)
def test_refused_layers(stated, key, text, layered):
    with pytest.raises(SceneError, match=text):
        model.prepare(layered(12, stated), parameters={key: (9e-3, 13e-3)})


def test_a_thickness_of_a_file_and_a_displaced_mesh_are_refused(written):
    box = {KEY: (9e-3, 11e-3), LAYER: (11e-3, 12e-3)}
    with pytest.raises(
        SceneError, match=r"move the same layers, which parts.pad.layers.lining can only alone"
    ):
        model.prepare(written(), ["parts.pad.layers={ lining='12 mm' }"], parameters=box)


def test_a_mesh_of_other_numbers_is_refused(written, meshes):
    scene = written()
    meshes.write_gmsh(meshes.boxes("tetrahedra", 2), scene.parent / "worn.msh")
    with pytest.raises(SceneError, match=r"is another mesh \(\d+ nodes and \d+ cells, in mesh"):
        assemble_brake(read_scene(scene), MPI.COMM_SELF)


@pytest.mark.hard
def test_a_range_that_folds_cells_is_refused_with_the_largest_that_does_not(written):
    """The highest cells have no height left at 2.83 mm."""
    with pytest.raises(SceneError, match="narrow the range") as refused:
        model.prepare(written(kind=FINE), parameters={KEY: (2.5e-3, 12e-3)})
    holds = float(re.search(r"the mesh holds to (\S+) mm", str(refused.value))[1]) / 1e3
    assert 2.8e-3 < holds < 3.1e-3
    # Just above, a series of few terms does not reach the stiffness.
    with pytest.raises(InaccurateResult, match=r"changes too much between .*: narrow the range"):
        model.prepare(written(kind=FINE), parameters={KEY: (1.1 * holds, 12e-3)})


@pytest.mark.hard
def test_facets_that_leave_the_other_face(written):
    """A pad that moves off the plate loses contact elements: refused, not left out."""
    scene = written(move=partial(shifted, x=60e-3), kind=("tetrahedra", 1), degree=1)
    with pytest.raises(SceneError, match=r"wear.value = 1[012][.\d]* mm: facets of contact.pad"):
        model.prepare(scene, ["mesh.quality=1e-4"], parameters={KEY: (10e-3, 12e-3)})


@pytest.mark.hard
def test_cells_that_fold_between_two_good_meshes(written):
    """A pad turned by half a turn has good cells at both ends, and none in the middle."""

    def turned(points, pad):
        return np.where(pad[:, None], points * [-1, -1, 1], points)

    scene = read_scene(written(kind=("tetrahedra", 1), move=turned))
    mesh = scene_mesh(scene, MPI.COMM_SELF)
    move = Move(KEY, 12e-3, (8e-3, 12e-3), movement(scene, mesh.raw, KEY))
    with pytest.raises(SceneError, match=r"collapses; the mesh holds to 1\d\.\d* mm"):
        moving(mesh, mesh_settings(scene), [move], {})


@pytest.mark.hard
@pytest.mark.slow
def test_a_length_over_a_factor_of_three(written):
    """Close to where cells fold: modes within their stated errors, no wrong verdict."""
    prepared = model.prepare(written(), parameters={KEY: (4e-3, 12e-3)})
    for length in (4, 5, 12):
        exact = model.prepare(written(length), ["stability.method=full"]).modes()
        found = prepared.modes({KEY: length * 1e-3})
        assert_same(found, exact, 1, np.inf)
        pairs = zip(found.verdict, exact.verdict, strict=True)
        assert not any({a, b} == {"stable", "unstable"} for a, b in pairs)


@pytest.mark.hard
def test_a_range_of_one_length(written):
    """Without width there is nothing to interpolate: the modes of that length."""
    prepared = model.prepare(written(), [f"{KEY}='9 mm'"], parameters={KEY: (9e-3, 9e-3)})
    exact = model.prepare(written(9), ["stability.method=full"]).modes()
    np.testing.assert_allclose(prepared.modes({KEY: 9e-3}).s, exact.s, rtol=1e-6)


@pytest.mark.hard
def test_the_same_nodes_in_another_order(written, meshes):
    """As many nodes and cells, numbered otherwise: rejected."""
    scene, mesh = written(form="inp"), meshes.boxes(*COARSE)
    order = np.arange(len(mesh.points))[::-1]
    other = replace(mesh, points=mesh.points[order], cells=order[mesh.cells])
    other = replace(other, facets=order[mesh.facets])
    meshes.write_abaqus(other, scene.parent / "worn.inp")
    with pytest.raises(SceneError, match=r"is another mesh .* or is numbered otherwise"):
        assemble_brake(read_scene(scene), MPI.COMM_SELF)


def test_a_countermeasure_moves_the_value(written):
    """On one brake; its run is the scene with that value."""
    more = [
        "stages=['equilibrium','stability','uncertainty']", "samples.n=2", f"{KEY}='10 mm'",
        f'countermeasures=[{{ key="{KEY}", to="11 mm" }}]',
    ]  # fmt: skip
    (found,) = (scene := read_scene(written(), more)).countermeasures
    assert (found.start, found.stop, found.unit) == (10e-3, 11e-3, "m")
    moved = read_scene(written(), [*more[:3], found.override(scene, 11e-3)])
    assert moved.parts["pad"].morph["wear"].length == 11e-3


@pytest.mark.slow
def test_a_run_with_a_random_length(written, tmp_path):
    """Verification at full order and drivers take the nodes of each sample.

    A pad held along its back tips where the friction is its half length over its height.
    """
    sets = [
        "stages=['equilibrium','stability','uncertainty','report']", "samples.n=3",
        "contact.pad_plate.friction=0.4", "contact.pad_plate.law={ p0='1 MPa', u0='0.3 um' }",
        f'samples.random={{ "{KEY}"={{ law="uniform", min="9 mm", max="11 mm" }} }}',
        "stability.drivers=true", "stability.verify=2",
    ]  # fmt: skip
    run(written(), MPI.COMM_WORLD, directory=tmp_path / "out", overrides=sets)
    found = read_run(tmp_path / "out")
    assert {*found.samples["status"]} == {"ok"}
    assert "length" in {*read_columns(tmp_path / "out" / "drivers.csv")["kind"]}
