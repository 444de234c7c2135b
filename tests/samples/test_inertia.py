"""Densities and masses on faces that vary: against the scene that is written with them."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import model
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.changes import assemble_changes
from brake_fenicsx.build.damping_terms import damping_terms
from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK
from full_order import agrees, at_full_order

# As many cells over the height of the plate whatever it is; a disc that turns beneath the block.
COARSE = [
    "stages=['equilibrium','stability']", "parts.block.size='12 mm'", "parts.plate.size='15 mm'",
    "mesh.cells='hexahedra'", "stability.band=['0 Hz','20 kHz']", "stability.method=reduced",
    'masses={ "block.top"={ mass="20 g" } }', "contact.block_plate.friction=0.2",
]  # fmt: skip
TURNING = [
    "motion={ axis='z', point=['40 mm', 0, 0], speed='20 rad/s' }",
    "stability.damping={ rayleigh=['300 1/s', '2e-7 s'] }",
]
GYROSCOPIC = [
    "masses={}", TURNING[0],
    "stability.damping={ rayleigh=['300 1/s', '2e-7 s'], gyroscopic=['plate'] }",
]  # fmt: skip
LOSS = [
    'stability.damping={ rayleigh=["300 1/s", "2e-7 s"], loss=true, omega_ref="5 kHz" }',
    "materials.lining.loss=0.05",
]
HEIGHT, C44 = "parts.block.height", "materials.lining.C44"
LINING, IRON, MASS, PLATE = (
    "materials.lining.rho", "materials.iron.rho", 'masses."block.top".mass', "parts.plate.height",
)  # fmt: skip
UNIT = {LINING: "kg/m^3", IRON: "kg/m^3", MASS: "kg", PLATE: "m", HEIGHT: "m", C44: "Pa"}
RANGES = {LINING: (2000, 3000), IRON: (7000.0, 8000), MASS: (0.01, 0.04), PLATE: (9e-3, 11e-3)}


def written(values):
    """The scene with other values; the plate grows downwards."""
    sets = [f"{key}='{value!r} {UNIT[key]}'" for key, value in values.items()]
    return [*sets, *([f"parts.plate.z='{-values[PLATE]!r} m'"] if PLATE in values else [])]


@pytest.mark.parametrize("lumped", [[], ["mesh.mass=lumped", "mesh.degree=1"]])
@pytest.mark.parametrize(
    ("sets", "values"),
    [
        (TURNING, {LINING: 2700.0, MASS: 0.06}),
        (GYROSCOPIC, {IRON: 7700.0}),
        (GYROSCOPIC, {IRON: 7700.0, PLATE: 10.7e-3}),
        (GYROSCOPIC, {IRON: 7100.0, "motion.speed": 15.0}),
        (GYROSCOPIC, {PLATE: 10.7e-3, "motion.speed": 21.5}),
        (LOSS, {HEIGHT: 22e-3, C44: 1.25e9}),
    ],
)
def test_matrices_are_those_of_the_scene_written_with_the_values(sets, values, lumped):
    """Stiffness, mass, damping and gyroscopic term, to round-off; moduli and heights together."""
    unit = UNIT | {"motion.speed": "rad/s"}
    swept = ", ".join(
        f"'{key}'={{ values=['{0.9 * v!r} {unit[key]}','{1.1 * v!r} {unit[key]}'] }}"
        for key, v in values.items()
    )
    sets = [*COARSE, *sets, *lumped]
    scene = read_scene(BLOCK, [*sets, f"sweep.parameters={{ {swept} }}"])
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    own = [f"{k}='{values[k]!r} rad/s'" for k in values if k == "motion.speed"]
    anew = read_scene(
        BLOCK, [*sets, *written({k: v for k, v in values.items() if k in UNIT}), *own]
    )
    exact = assemble_brake(anew, MPI.COMM_SELF)
    for found, expected in (
        (brake.M + changes.change(values, "M"), exact.M),
        (brake.K + changes.change(values, "K"), exact.K),
        (damping_terms(scene, brake).bulk + changes.change(values, "C"),
         damping_terms(anew, exact).bulk),
    ):  # fmt: skip
        assert abs(found - expected).max() < 1e-11 * abs(expected).max()
    assert abs(brake.M - exact.M).max() > 1e-3 * abs(exact.M).max()


def test_total_mass_of_a_part_is_its_density_times_its_volume():
    """And that of a face what is put there: of the block alone, free along z."""
    scene = read_scene(
        BLOCK,
        [*COARSE, f"sweep.parameters={{ '{LINING}'={{ values=['2000 kg/m^3', '3000 kg/m^3'] }},"
                  f" '{MASS}'={{ values=['1 g', '90 g'] }} }}"],
    )  # fmt: skip
    brake = assemble_brake(scene, MPI.COMM_SELF)
    changes = assemble_changes(scene, brake)
    column = (brake.elastic.free.local % 3 == 2).astype(float)
    added = column @ changes.change({LINING: 2600.0, MASS: 0.05}, "M") @ column
    assert added == pytest.approx(90 * 40e-3 * 20e-3 * 20e-3 + 0.03, rel=1e-9)


@pytest.mark.slow
def test_modes_are_those_of_full_order():
    """At corners and inside, within their errors; of a scene written with the values too."""
    box = {LINING: RANGES[LINING], MASS: RANGES[MASS], PLATE: RANGES[PLATE]}
    prepared = model.prepare(BLOCK, [*COARSE, *TURNING], parameters=box)
    for values in (
        {LINING: 2000.0, MASS: 0.04}, {LINING: 3000.0, MASS: 0.01, PLATE: 9e-3},
        {LINING: 2300.0, MASS: 0.03, PLATE: 10.6e-3},
    ):  # fmt: skip
        anew = model.prepare(BLOCK, [*COARSE, *TURNING, *written(values), "stability.method=full"])
        for exact in (at_full_order(prepared, values), anew.modes()):
            assert agrees(prepared.modes(values), exact, 6, 5e-5).max() < 1e-4


def test_a_bar_follows_its_density():
    """Frequencies of a scene of one part go with the root of 1 / rho, exactly."""
    sets = [*COARSE, TURNING[0], "contact.block_plate.friction=0"]
    prepared = model.prepare(
        BLOCK, [*sets, "masses={}"], parameters={LINING: (2000, 3000), IRON: (6000, 9000)}
    )
    usual = prepared.modes().frequency
    lighter = prepared.modes({LINING: 0.9 * 2510, IRON: 0.9 * 7200}).frequency
    np.testing.assert_allclose(lighter[: usual.size - 3], usual[:-3] / np.sqrt(0.9), rtol=2e-5)


@pytest.mark.parametrize(
    ("key", "sets", "text"),
    [
        (LINING, ["stability.damping={ modal={ block={ ratio=0.01 } } }"], "bodies of one mass"),
        ("materials.other.rho", ["materials.other={ model='isotropic', E='1 GPa', nu=0.3,"
                                 " rho='1 g/cm^3' }"], "no part is made of the material"),
        ('masses."block.bottom".mass', [], "there is no .masses.block.bottom."),
    ],
)  # fmt: skip
def test_refusals(key, sets, text):
    with pytest.raises(SceneError, match=text):
        model.prepare(BLOCK, [*COARSE, *sets], parameters={key: (1.0, 2.0)})


def test_a_density_that_a_law_takes_below_zero():
    law = f"samples.random={{ '{LINING}'={{ law='normal', mean='1 g/cm^3', sd='0.9 g/cm^3' }} }}"
    more = ["stages=['equilibrium','stability','uncertainty']", "samples.n=2", law]
    with pytest.raises(SceneError, match=r"rho.: the law reaches .* kg/m\^3"):
        model.prepare(BLOCK, [*COARSE, *more])
