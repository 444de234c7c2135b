"""Thicknesses that vary from sample to sample: matrices, modes, derivatives, refusals."""

import numpy as np
import pytest

from brake_fenicsx import model
from brake_fenicsx.errors import SceneError
from coarse_block import BLOCK, SCENES
from full_order import agrees, at_full_order

# As many cells over the height whatever it is, so that meshes of two heights have the same cells.
COARSE = [
    "stages=['equilibrium','stability']", "parts.block.size='18 mm'", "parts.plate.size='20 mm'",
    "mesh.cells='hexahedra'", "stability.band=['0 Hz','20 kHz']", "stability.method=reduced",
]  # fmt: skip
HEIGHT, PLATE, C44 = "parts.block.height", "parts.plate.height", "materials.lining.C44"
DAMPED = 'stability.damping={ rayleigh=["300 1/s", "2e-7 s"], loss=true, omega_ref="5 kHz" }'
TURNING = [
    "motion={ axis='z', point=['40 mm', 0, 0], speed='20 rad/s' }",
    "stability.damping={ rayleigh=['300 1/s', '2e-7 s'], gyroscopic=['plate'] }",
]
LOSS = "materials.lining.loss=0.05"


def written(height, plate, *changes):
    """The scene with these heights, meshed anew: the plate grows downwards."""
    sets = [f"parts.block.height='{height!r} m'", f"parts.plate.height='{plate!r} m'"]
    return [*COARSE, *sets, f"parts.plate.z='{-plate!r} m'", *changes]


@pytest.mark.long
@pytest.mark.parametrize(
    "damping",
    [
        pytest.param([], id="undamped"),
        pytest.param([DAMPED, LOSS], id="damped", marks=pytest.mark.slow),
        pytest.param(
            [*TURNING, "contact.block_plate.friction=0.2"], id="turning", marks=pytest.mark.slow
        ),
    ],
)
def test_modes_of_two_thicknesses_and_a_modulus_are_those_of_full_order(damping):
    """At corners, between the anchors, and a little beyond; the scene's own heights too."""
    box = {HEIGHT: (19e-3, 21e-3), PLATE: (9.5e-3, 10.5e-3), C44: (1.1e9, 1.3e9)}
    prepared = model.prepare(BLOCK, [*COARSE, *damping], parameters=box)
    for values in (
        {}, {HEIGHT: 19e-3, PLATE: 10.5e-3}, {HEIGHT: 20.6e-3, PLATE: 9.8e-3, C44: 1.15e9},
        {HEIGHT: 21.05e-3},
    ):  # fmt: skip
        exact = at_full_order(prepared, values)
        assert agrees(prepared.modes(values), exact, 8, 1e-5).max() < 1e-4


def test_modes_are_those_of_a_mesh_of_that_thickness():
    """Full order of the scene written with the height, mesh and all; none has a negative one."""
    box = {HEIGHT: (18e-3, 22e-3), PLATE: (9e-3, 11e-3)}
    prepared = model.prepare(BLOCK, COARSE, parameters=box)
    for height, plate in ((21.5e-3, 9.5e-3), (18e-3, 11e-3)):
        scene = written(height, plate, "stability.method=full")
        exact = model.prepare(BLOCK, scene).modes()
        found = prepared.modes({HEIGHT: height, PLATE: plate})
        np.testing.assert_allclose(found.frequency, exact.frequency, rtol=1e-4)
    with pytest.raises(SceneError, match=r"parts.block.height = -0.01: must be positive"):
        prepared.modes({HEIGHT: -0.01})


@pytest.mark.slow
def test_modes_of_the_demo_at_five_lengths_are_those_of_scenes_meshed_anew():
    """Frequencies within what another mesh of the same brake changes, and the same verdicts."""
    demo, lining = SCENES / "disc_brake_demo.toml", "parts.pad.lining"
    sets = [
        "stages=['equilibrium','stability']", "samples={ approaches=['classical'] }",
        "stability.band=['0 Hz','6 kHz']", "contact.pad_disc.gap=none",
        "contact.pad_disc.law={ linear='2e13 Pa/m' }",
    ]  # fmt: skip
    prepared, finer = model.prepare(demo, sets, parameters={lining: (8e-3, 12e-3)}), 6.3
    other = model.prepare(demo, [*sets, f"parts.pad.size='{finer} mm'", "parts.disc.size='13 mm'"])
    own = prepared.modes().frequency
    mesh = np.abs(other.modes().frequency / own - 1).max()
    assert 1e-3 < mesh < 0.05
    loud = 0
    for length in (8e-3, 9e-3, 10e-3, 11e-3, 12e-3):
        found = prepared.modes({lining: length})
        exact = model.prepare(demo, [*sets, f"{lining}='{length!r} m'"]).modes()
        f, g = found.frequency, exact.frequency
        assert f.size == g.size >= 12
        assert np.abs(f / g - 1).max() < mesh
        # Meshes may order the modes of close frequencies otherwise.
        a, b = (m.frequency[np.array(m.verdict) == "unstable"] for m in (found, exact))
        np.testing.assert_allclose(a, b, rtol=mesh)
        loud += a.size
    assert loud


def test_frequencies_of_a_bar_follow_its_length():
    """Longitudinal, one end free and the other on next to no contact: f = c / (2 h)."""
    bar = [
        "materials.lining={ model='isotropic', E='200 GPa', nu=0, rho='8000 kg/m^3' }",
        "parts.block.length='4 mm'", "parts.block.width='4 mm'", "parts.block.height='100 mm'",
        "parts.block.size='4 mm'", "contact.block_plate.law={ p0='5 bar', u0='1 m' }",
        'supports={ "block.top"=["x", "y"], "plate.bottom"="clamped", "block.sides"=["x", "y"] }',
        "stability.band=['0 Hz','40 kHz']", "contact.block_plate.friction=0",
    ]  # fmt: skip
    prepared = model.prepare(BLOCK, [*COARSE, *bar], parameters={HEIGHT: (95e-3, 120e-3)})
    for height in (95e-3, 111e-3, 120e-3):
        f = prepared.modes({HEIGHT: height}).frequency
        assert f[f > 1e3][0] == pytest.approx(5000 / (2 * height), rel=1e-4)


@pytest.mark.parametrize(
    ("key", "changes", "text"),
    [
        ("parts.block.size", [], "only these lengths may vary"),
        ("parts.block.lining", [], "is no thickness of a layer of this part"),
        (
            HEIGHT,
            ["stability.damping={ modal={ block={ ratio=0.01 } } }"],
            "modal is of bodies of one",
        ),
        (
            HEIGHT,
            ["motion={ axis='x' }", "stability.damping={ gyroscopic=['block'] }"],
            "gyroscopic needs the axis z",
        ),
    ],
)
def test_refusals(key, changes, text):
    with pytest.raises(SceneError, match=text):
        model.prepare(BLOCK, [*COARSE, *changes], parameters={key: (18e-3, 22e-3)})


def test_a_face_on_the_side_of_the_layer_is_refused():
    spring = 'springs={ "block.sides"={ stiffness=["1 kN/mm", 0, 0] } }'
    with pytest.raises(SceneError, match=r"springs.block.sides: .*lies on the sides of the layer"):
        model.prepare(BLOCK, [*COARSE, spring], parameters={HEIGHT: (18e-3, 22e-3)})
