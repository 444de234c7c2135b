"""Values of a sample by dotted key, in place of those of the scene: each against full order."""

from itertools import product
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import model
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.damping_terms import damping_terms
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.samples.sampling import at_values, draw_sample
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import ContactLinearisation
from coarse_block import BLOCK
from contact_alone import at_contact
from full_order import agrees, at_full_order

COARSE = [
    "stages=['equilibrium','stability']", "parts.block.size='20 mm'", "parts.plate.size='30 mm'",
    "stability.band=['0 Hz','20 kHz']", "stability.zeta_max=0.3", "stability.method=reduced",
]  # fmt: skip
MU, LOAD, C44 = (
    "contact.block_plate.friction", "loads.block.top.pressure", "materials.lining.C44",
)  # fmt: skip

PENALTY, SPEED = "samples.classical.penalty", "motion.speed"
FALLING = "contact.block_plate.friction={ static=0.6, kinetic=0.4, decay='2 m/s' }"


def test_values_replace_and_complete_the_drawn_ones():
    random = f"samples.random.\"{MU}\"={{ law='uniform', min=0.3, max=0.7 }}"
    changes = ["stages=['equilibrium','uncertainty']", random, "samples.n=3"]
    scene = read_scene(BLOCK, [*changes, "samples.approaches=['multi-scale','classical']"])
    at = at_contact(SimpleNamespace(interface=np.zeros(4, int), speed=np.ones(4)))

    def drawn(approach, values):
        return at_values(draw_sample(scene, approach, 1, at), values)

    own = drawn("multi-scale", {})
    loaded = drawn("multi-scale", {LOAD: 3e5})
    assert loaded.values == {**own.values, LOAD: 3e5}
    np.testing.assert_array_equal(loaded.friction.mu, own.friction.mu)
    assert loaded.values.pressures == [3e5]
    for approach in ("multi-scale", "classical"):
        given = drawn(approach, {MU: 0.61, C44: 1e9})
        np.testing.assert_array_equal(given.friction.mu, 0.61)
        np.testing.assert_array_equal(given.friction.equilibrium, 0.61)
        assert given.values.materials["lining"][3, 3] == 1e9
    with pytest.raises(SceneError, match=r"friction = -0.1: must be zero or more"):
        drawn("classical", {MU: -0.1})
    with pytest.raises(SceneError, match="pressure = '3 bar': write a number, in SI"):
        drawn("classical", {LOAD: "3 bar"})


def test_a_swept_modulus_is_that_of_full_order():
    """Over C44, with friction and load beside it; beyond what was prepared, too."""
    prepared = model.prepare(BLOCK, COARSE, parameters={C44: (0.9e9, 1.5e9)})
    branches = prepared.sweep(C44, [0.9e9, 1.5e9], tolerance=0.1)
    assert branches.frequency.shape[0] >= 5
    for i, value in enumerate(branches.values):
        exact = at_full_order(prepared, {C44: value})
        followed = branches.frequency[:, i]
        followed = np.sort(followed[np.isfinite(followed)])
        np.testing.assert_allclose(followed, np.sort(exact.frequency), rtol=5e-6)
    for values in ({C44: 0.9e9, MU: 0.2, LOAD: 9e5}, {C44: 3e9}):
        agrees(prepared.modes(values), at_full_order(prepared, values))
    with pytest.raises(SceneError, match=r"materials.lining.C33: .*sweep.parameters"):
        prepared.modes({"materials.lining.C33": 2e9})


THREE = {
    kind: f'{kind}=["{value}", "{value}", "{value}"]'
    for kind, value in {"stiffness": "5e6 N/m", "damping": "60 N s/m"}.items()
}
CLIP = f"{THREE['stiffness']}, {THREE['damping']}"
JOINED = {
    # Neither springs nor masses are materials: both stay as they are where the modulus changes.
    "springs and masses": [
        'springs={ "plate.bottom" = { stiffness = ["80 kN/mm", "60 kN/mm", "150 kN/mm"] } }',
        'masses={ "block.top" = { mass = "20 g" } }', "supports={ 'block.top' = ['x', 'y'] }",
    ],
    # Of the block that it is tied to: one body of the reduced model, two in the shares.
    "tie": [
        'parts.cap={ builder="block", length="40 mm", width="20 mm", height="8 mm", z="20 mm",'
        ' size="9 mm", material="iron" }',
        'ties={ cap={ faces=["block.top", "cap.bottom"] } }',
        'loads={ "cap.top"={ pressure="5 bar" } }',
        'supports={ "plate.bottom"="clamped", "cap.top"=["x", "y"] }',
    ],
    # They join parts to one body; as strong as the impedance of the block, so that modes feel them.
    "springs and dashpots": [
        'parts.cap={ builder="block", length="30 mm", width="20 mm", height="8 mm", z="30 mm",'
        ' size="20 mm", material="iron" }',
        f'springs={{ clip={{ faces=["block.sides", "cap.bottom"], {CLIP} }},'
        f' "cap.top"={{ {CLIP} }} }}',
    ],
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("joint", JOINED)
def test_joints_beside_a_modulus(joint):
    """Dashpots damp the modes, with no other damping named."""
    prepared = model.prepare(BLOCK, [*COARSE, *JOINED[joint]], parameters={C44: (0.9e9, 1.5e9)})
    models = prepared.study.models
    ((damped, reduced),) = models.reduction.models.items()
    assert len(reduced.bodies) == 2 and damped == ("dashpots" in joint)
    assert [*models.facts.get("damping", ())] == ["springs"] * damped
    assert len(models.brake.masses) == (2 if "masses" in joint else 3)
    for value in (0.9e9, 1.4e9):
        found = prepared.modes({C44: value})
        agrees(found, at_full_order(prepared, {C44: value}), 5 + ("masses" in joint))
        assert (found.damping.max() > 1e-2) == damped


def test_speed_moves_friction_and_its_damping():
    """mu(V), mu'(V) and mu p / V; in the equilibrium too: closed forms, then full order."""
    damping = "stability.damping={ sliding=true, slope=true }"
    prepared = model.prepare(BLOCK, [*COARSE, FALLING, damping], parameters={SPEED: (1.5, 4.0)})
    study = prepared.study
    sample = study.sample(("multi-scale", 0), {SPEED: 3.0})
    np.testing.assert_allclose(sample.friction.speed, 3.0)
    np.testing.assert_allclose(sample.friction.mu, 0.4 + 0.2 * np.exp(-1.5))
    np.testing.assert_allclose(sample.friction.equilibrium, sample.friction.mu)
    np.testing.assert_allclose(sample.friction.slope, -0.1 * np.exp(-1.5))
    faster = [*COARSE, FALLING, damping, "motion.speed='3 m/s'"]
    written = model.prepare(BLOCK, faster, parameters={SPEED: (1.5, 4.0)})
    s = prepared.modes({SPEED: 3.0}).s
    np.testing.assert_allclose(s, written.modes().s, rtol=1e-10)
    agrees(prepared.modes({SPEED: 4.0}), at_full_order(prepared, {SPEED: 4.0}))
    with pytest.raises(SceneError, match="have the scene's sign"):
        prepared.modes({SPEED: -1.0})


@pytest.mark.hard
def test_strong_damping_of_sliding_at_low_speed():
    """mu p / V near the impedance of the lining: errors as estimated; far above: rejected."""
    changes = [*COARSE, FALLING, "stability.damping={ sliding=true, slope=true }"]
    prepared = model.prepare(BLOCK, changes, parameters={SPEED: (0.02, 4.0)})
    for speed in (0.2, 0.5):
        agrees(prepared.modes({SPEED: speed}), at_full_order(prepared, {SPEED: speed}))
    with pytest.raises(InaccurateResult, match="too strong for the reduced model"):
        prepared.modes({SPEED: 0.02})


def test_penalty_is_that_of_perfect_contact_alone():
    both = "samples.approaches=['multi-scale','classical']"
    changes = [*COARSE, both]
    prepared = model.prepare(BLOCK, changes, parameters={PENALTY: (1e11, 1e13)})
    rough = prepared.modes({PENALTY: 1e11}).s
    np.testing.assert_array_equal(rough, prepared.modes().s)
    found = prepared.modes({PENALTY: 1e11}, "classical")
    agrees(found, at_full_order(prepared, {PENALTY: 1e11}, "classical"))
    written = model.prepare(BLOCK, [*changes, f"{PENALTY}='1e11 Pa/m'"])
    np.testing.assert_allclose(found.s, written.modes({}, "classical").s, rtol=1e-5)


@pytest.mark.parametrize(
    ("key", "law", "changes", "remedy"),
    [
        (SPEED, "start='1 m/s', stop='2 m/s'", [], "nothing depends on the speed"),
        (SPEED, "start='1 rad/s', stop='2 rad/s'", [FALLING], "wrong unit"),
        (PENALTY, "start='1e12 Pa/m', stop='1e13 Pa/m'", [], "add classical or parametric"),
        (PENALTY, "start='1 bar', stop='2 bar'", [], "wrong unit"),
        ("materials.lining.loss", "start=0, stop=0.1", [], "loss = true"),
        ("materials.rubber.loss", "start=0, stop=0.1", [], "there are iron, lining"),
        ("stability.damping.rayleigh.beta", "start='0 s', stop='1 us'", [], "own values"),
    ],
)
def test_what_would_act_on_nothing_is_refused(key, law, changes, remedy):
    with pytest.raises(SceneError) as error:
        read_scene(BLOCK, [*COARSE, *changes, f'sweep.parameters."{key}"={{ {law} }}'])
    assert remedy in str(error.value)
    assert key in str(error.value)


LOSS, ALPHA, BETA = (
    "materials.lining.loss", "stability.damping.rayleigh.alpha", "stability.damping.rayleigh.beta",
)  # fmt: skip
DAMPED = [
    *COARSE, "materials.lining.loss=0.02", "materials.iron.loss=0.001",
    "stability.damping={ rayleigh=['20 1/s','1e-8 s'], loss=true, omega_ref='8 kHz' }",
]  # fmt: skip
ENDS = {C44: (1e9, 1.4e9), LOSS: (0.0, 0.1), ALPHA: (0.0, 200.0), BETA: (0.0, 1e-7)}
CORNERS = [*product(range(2), repeat=4)][::5]


@pytest.fixture(scope="module")
def damped():
    return model.prepare(BLOCK, DAMPED, parameters=ENDS)


@pytest.mark.parametrize("corner", CORNERS, ids=str)
def test_damping_of_the_bodies_beside_a_modulus(damped, corner):
    """At corners of the box: loss and beta follow the stiffness of the sample (bilinear)."""
    values = {key: ENDS[key][end] for key, end in zip(ENDS, corner, strict=True)}
    agrees(damped.modes(values), at_full_order(damped, values))


def test_full_order_is_that_of_the_scene_written_with_the_values(damped):
    values = {C44: 1.05e9, LOSS: 0.07, ALPHA: 50.0, BETA: 4e-8}
    written = read_scene(
        BLOCK,
        [*DAMPED, "materials.lining.C44='1.05 GPa'", "materials.lining.loss=0.07",
         "stability.damping.rayleigh=['50 1/s','4e-8 s']"],
    )  # fmt: skip
    models = damped.study.models
    sample = damped.study.sample(("multi-scale", 0), values)
    found = models.brake.terms.bulk + models.brake.changes.change(sample.values, "C")
    expected = damping_terms(written, assemble_brake(written, MPI.COMM_SELF)).bulk
    assert abs(found - expected).max() < 1e-12 * abs(expected).max()


def test_rayleigh_closed_form():
    """zeta = alpha / 2 omega + beta omega / 2 of every mode where contact is open."""
    rayleigh = "stability.damping.rayleigh=['20 1/s','1e-8 s']"
    ends = {key: ENDS[key] for key in (C44, ALPHA, BETA)}
    models = model.prepare(BLOCK, [*COARSE, rayleigh], parameters=ends).study.models
    contact = ContactLinearisation.of(0 * models.brake.w, 0.5)
    for alpha, beta in ((0.0, 1e-7), (200.0, 0.0), (130.0, 4e-8)):
        x = models.brake.at({C44: 1.1e9, ALPHA: alpha, BETA: beta}).point
        found = models.reduction.models[True].modes(x, contact, 0.3)
        elastic = np.abs(found.s) > 1e3
        s, error = found.s[elastic], found.error[elastic]
        omega = np.abs(s)
        expected = -0.5 * (alpha + beta * omega**2)
        assert np.all(np.abs(s.real - expected) <= error + 1e-9 * omega)
        assert np.all(error < 1e-4 * omega)
        assert omega.size >= 3


TURNING = [
    *COARSE, "motion={ axis='z', speed='40 rad/s' }",
    "stability.damping={ rayleigh=['20 1/s', 0], gyroscopic=true }",
]  # fmt: skip


@pytest.mark.long
def test_speed_of_a_turning_body():
    """The gyroscopic matrix of the plate alone, beside the damping of its mass."""
    ends = {SPEED: (20.0, 200.0), ALPHA: (0.0, 200.0)}
    prepared = model.prepare(BLOCK, TURNING, parameters=ends)
    for values in ({SPEED: 200.0, ALPHA: 200.0}, {SPEED: 20.0, ALPHA: 0.0}):
        agrees(prepared.modes(values), at_full_order(prepared, values))
    models = prepared.study.models
    faster = read_scene(BLOCK, [*TURNING, "motion.speed='200 rad/s'"])
    expected = damping_terms(faster, assemble_brake(faster, MPI.COMM_SELF)).bulk
    found = models.brake.terms.bulk + models.brake.changes.change({SPEED: 200.0}, "C")
    assert abs(found - expected).max() < 1e-12 * abs(expected).max()


def test_a_scalar_of_one_body_costs_the_other_no_anchors(damped):
    """The loss of the lining is not the plate's, whose interpolation is over alpha and beta."""
    bodies = damped.study.models.reduction.models[True].bodies
    assert sorted(len(b.component._own) for b in bodies) == [2, 4]
