"""Forces and moments on faces and sets of nodes: totals, closed forms, samples, mistakes."""

import json

from mpi4py import MPI

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.pipeline import run
from brake_fenicsx.samples.numbering import dof_points
from brake_fenicsx.scene import read_scene
from places import BLOCK

COARSE = ["parts.block.size='10 mm'", "parts.plate.size='20 mm'",
          'contact.block_plate.law={ linear="1e12 Pa/m" }']  # fmt: skip


def loaded(text, *more):
    return assemble_brake(
        read_scene(BLOCK, [*COARSE, "supports={}", f"loads={text}", *more]), MPI.COMM_SELF
    )


def test_totals_about_the_centroid():
    """Along axes turned by 30 degrees; a moment has no force, a force no moment there."""
    text = '{ "block.top"={ force=["3 N", "0 N", "-5 kN"], moment=["2 N m", 0, "7 N m"] } }'
    brake = loaded(text, "parts.block.axis='30 deg'")
    points = dof_points(brake)
    f = np.zeros((len(points), 3))
    f[np.arange(len(points)), points[:, 3].astype(int)] = brake.f
    force, lever = f.sum(axis=0), points[:, :3] - [0, 0, 20e-3]
    c, s = np.cos(np.pi / 6), 0.5
    np.testing.assert_allclose(force, [3 * c, 3 * s, -5e3], rtol=1e-9)
    np.testing.assert_allclose(np.cross(lever, f).sum(axis=0), [2 * c, 2 * s, 7.0], rtol=1e-7)
    assert brake.pressed == pytest.approx(np.hypot(3, 5e3))


def test_force_is_the_pressure_on_a_plane_face():
    pressed = loaded('{ "block.top"={ pressure="5 bar" } }')
    pushed = loaded('{ "block.top"={ force=[0, 0, "-400 N"] } }')
    np.testing.assert_allclose(pushed.f, pressed.f, atol=1e-9 * np.abs(pressed.f).max())
    assert pushed.pressed == pytest.approx(pressed.pressed)


def test_a_bar_bends_and_twists_as_it_should():
    """Of a slender bar under a moment at its end: the angle M l / (E I), and the twist's sign."""
    bar = ["parts.block.length='10 mm'", "parts.block.width='10 mm'",
           "parts.block.height='100 mm'", "parts.block.size='5 mm'",
           "parts.block.material='iron'", "supports={ 'block.bottom'='clamped' }"]  # fmt: skip
    scene = read_scene(
        BLOCK, [*COARSE, *bar, 'loads={ "block.top"={ moment=["1 N m", 0, "1 N m"] } }']
    )
    brake = assemble_brake(scene, MPI.COMM_SELF)
    points = dof_points(brake)
    own = np.flatnonzero(points[:, 2] > 0)
    u = spsolve(brake.K[own][:, own].tocsc(), brake.f[own])
    _, y, z, c = points[own].T
    end = (z > 0.0999) & (c == 2)
    angle = np.polyfit(y[end], u[end], 1)[0]
    # Axis 1 of the block is x: the moment about it lifts y > 0.
    assert angle == pytest.approx(0.1 / (125e9 * 10e-3**4 / 12), rel=0.02)
    across = (z > 0.0999) & (c == 0)
    assert np.polyfit(y[across], u[across], 1)[0] < 0


@pytest.mark.parametrize(
    ("load", "said"),
    [
        ("{ }", "write a pressure, or a force"),
        ('{ pressure="5 bar", force=[0, 0, "1 N"] }', "write a pressure, or a force"),
        ('{ force=["1 N", "2 N"] }', "write three"),
        ("{ force=[0, 0, 0] }", "write three"),
        ('{ force=[0, 0, "1 bar"] }', "wrong unit; a force"),
        ("{ moment=[0, 0, 3.0] }", "unit is missing; write moment"),
    ],
)
def test_mistakes(load, said):
    with pytest.raises(SceneError, match=rf'loads."?block.top"?.*{said}'):
        read_scene(BLOCK, [f'loads={{ "block.top"={load} }}'])


def test_a_random_pressure_needs_a_pressure():
    more = (
        "samples.random.'loads.\"block.top\".pressure'={ law='uniform', min='1 bar', max='2 bar' }"
    )
    with pytest.raises(SceneError, match=r"has no loads.*pressure; write its own value"):
        read_scene(BLOCK, ['loads={ "block.top"={ force=[0, 0, "-1 N"] } }', more])


def test_a_force_on_both_sides_is_refused():
    demo = BLOCK.with_name("disc_brake_demo.toml")
    with pytest.raises(SceneError, match="both sides of the disc"):
        read_scene(demo, ['loads={ "pad.piston"={ force=[0, 0, "-1 kN"] } }'])


# Block and plate of one cross section between guides: both are strained along z alone.
COLUMN = [
    "parts.block.size='10 mm'", "parts.plate.size='10 mm'", "parts.plate.length='40 mm'",
    "parts.plate.width='20 mm'", 'contact.block_plate.law={ linear="1e13 Pa/m" }',
    "contact.block_plate.friction=0.0",
    "supports={ 'plate.bottom'='clamped', 'plate.sides'=['x', 'y'], 'block.sides'=['x', 'y'],"
    " 'block.top'=['z'] }",
]  # fmt: skip


def pressed_column(folder, *more):
    """Forces on the column whose upper end is moved by 20 um."""
    move = 'loads={ "block.top"={ displacement={ z="-20 um" }, steps=2 } }'
    run(BLOCK, MPI.COMM_SELF, folder, overrides=[*COLUMN, move, *more])
    (found,) = json.loads((folder / "summary.json").read_text())["contact_forces"].values()
    return found["block_plate"]


def test_a_column_is_pressed_by_the_displacement_of_its_end(tmp_path):
    """Springs in series, h_1 / C33_1 + 1 / eps + h_2 / C33_2."""
    found = pressed_column(tmp_path, "stages=['equilibrium']")
    lining, iron = (read_scene(BLOCK).materials[n] for n in ("lining", "iron"))
    modulus = iron.E * (1 - iron.nu) / (1 + iron.nu) / (1 - 2 * iron.nu)
    p = 20e-6 / (20e-3 / lining.C33 + 1e-13 + 10e-3 / modulus)
    assert found["normal_N"] == pytest.approx(p * 800e-6, rel=1e-6)
    assert found["largest_pressure_MPa"] == pytest.approx(1e-6 * p, rel=1e-6)


def test_displacement_in_the_reduced_model(tmp_path):
    """Samples with friction: the equilibrium is that of full order, and so are the modes."""
    more = [
        "contact.block_plate.friction=0.3", "samples={ n=2, approaches=['parametric'] }",
        "samples.random.'contact.block_plate.friction'={ law='uniform', min=0.2, max=0.3 }",
        "stages=['equilibrium', 'stability', 'uncertainty']", "stability.verify=1",
        "stability.band=['0 Hz', '40 kHz']",
    ]  # fmt: skip
    full, reduced = (
        pressed_column(tmp_path / name, *more, f"stability.method='{name}'")
        for name in ("full", "reduced")
    )
    # The column is symmetric in y but for its mesh: a centre there is measured by half the width.
    across = {key for key in full if key.startswith("centre_y_mm")}
    for key, value in full.items():
        within = 1e-7 * 10.0 if key in across else None
        assert reduced[key] == pytest.approx(value, rel=1e-7, abs=within), key
    assert len(across) == 2 and reduced.keys() == full.keys()
    summary = json.loads((tmp_path / "reduced" / "summary.json").read_text())
    assert summary["verification"]["largest_relative_error"] < 1e-5
    assert summary["verification"]["eigenvalues"] > 3


@pytest.mark.parametrize(
    ("load", "said"),
    [
        ('"block.top"={ displacement={ x="1 um" } }', "moves directions that a support holds"),
        ('"block.top"={ displacement={ w="1 um" } }', "write x, y or z"),
        ('"block.top"={ displacement={ } }', "moves directions that a support holds"),
        ('"block.top"={ displacement={ z="1 um" }, pressure="1 bar" }', "or a displacement"),
        ('"block.sides"={ displacement={ x="1 um" } }', "nodes of 'block.bottom' too"),
    ],
)
def test_displacements_that_cannot_be(load, said):
    with pytest.raises(SceneError, match=said):
        assemble_brake(read_scene(BLOCK, [*COLUMN, f"loads={{ {load} }}"]), MPI.COMM_SELF)


def test_random_moduli_of_a_part_that_is_moved():
    more = "samples.random.'materials.lining.C33'={ law='uniform', spread=0.1 }"
    with pytest.raises(SceneError, match=r"would change with materials\.lining\.C33"):
        read_scene(BLOCK, [*COLUMN, 'loads={ "block.top"={ displacement={ z="1 um" } } }', more,
                           "samples.approaches=['parametric']", "samples.n=2"])  # fmt: skip
