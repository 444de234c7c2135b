"""Limit cycles of whole samples against time steps of their finite-element matrices."""

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.extras.limit_cycle.growth import STABLE, exponents, verdict
from places import SCENES
from time_steps import TimeSteps, measured

STAGES = "stages=['surface','equilibrium','stability','uncertainty']"
HALF_MICRON = "law={ p0 = '10 MPa', u0 = '0.5 um' }, gap='hdf', friction=0.5"
# Scene, what is changed in it, and the frequency beyond which the time steps damp all modes [Hz].
BLOCK = "squealing_block.toml", ["countermeasures=[]", "samples.n=4"], np.inf
FINE_BLOCK = (
    "block_on_plate.toml",
    [
        STAGES, "surface={ statistics = { S_q = '0.3 um' } }", "stability.method='reduced'",
        "contact.block_plate={ faces=['block.bottom','plate.top'],"
        " law={ p0 = '10 MPa', u0 = '0.3 um' }, gap='hdf', friction=0.5 }",
        "stability.band=['0 Hz', '20 kHz']", "samples={ n=4, approaches=['multi-scale'] }",
    ],
    np.inf,
)  # fmt: skip
COARSE_BRAKE = (
    "disc_brake_demo.toml",
    [
        STAGES, "surface={ statistics = { S_q = '0.5 um' } }", "stability.verify=0",
        f"contact.pad_disc={{ faces=['pad.friction','disc.friction'], {HALF_MICRON} }}",
        "parts.disc.size='25 mm'", "parts.pad.size='16 mm'", "parts.pad.plate_size='16 mm'",
        "samples.approaches=['multi-scale']",
    ],
    30e3,
)  # fmt: skip


def prepared(scene, k, beta):
    """Study, sample, equilibrium and modes, with so much damping of the bodies [s]."""
    file, changes, _ = scene
    damping = f"stability.damping={{ rayleigh = ['0 1/s', '{beta:g} s'] }}"
    study = prepare(str(SCENES / file), ["limit_cycle={}", *changes, damping]).study
    task = ("multi-scale", k)
    return study, study.sample(task), *study.solved(task, {})


def squealing(scene, k, share):
    """``prepared`` with a share of the growth without damping taken away, and the growing mode."""
    *_, modes = prepared(scene, k, 1e-12)
    s = modes.s[np.argmax(modes.s.real)]
    found = prepared(scene, k, 2 * share * s.real / s.imag**2)
    return *found, int(np.argmax(found[-1].s.real))


def cycle_and_steps(scene, k, share, seconds, start):
    """Outcome, amplitude [m] and frequency [Hz] of a cycle; those of time steps, and their drift.

    Args:
        scene: see above.
        k: number of the sample.
        share: of the growth without damping that damping takes away.
        seconds: of the time steps.
        start: their first amplitude over that of the cycle.
    """
    study, sample, eq, modes, mode = squealing(scene, k, share)
    cycles = study.beside["limit cycles"].sample(sample, eq)
    problem = cycles.problem(9, 64)
    branch = cycles.branch(problem, modes.s[mode], modes.right[:, mode], 20e-6)
    # The branch begins at the linear mode.
    assert branch.s[0] == pytest.approx(modes.s[mode], rel=1e-3)
    at = branch.cycles[0].at
    assert branch.cycles[0].kind == STABLE
    shift, *others = exponents(problem, at)
    largest = max(others, key=lambda one: one.real)
    outcome = verdict(largest.real, abs(shift.real), largest.imag / at.s.imag)
    C = sample.brake.C(sample.friction, eq.p)
    steps = TimeSteps(study.brake, eq, sample.laws, sample.friction.mu, C, beyond=scene[2])
    weights = study.brake.w * (eq.p > 0)
    gaps = steps.run(seconds, 2.5e-7, start * at.amplitude)
    found = measured(gaps, 2.5e-7, weights / weights.sum())
    return outcome, (at.amplitude, at.s.imag / 2 / np.pi), found


def agree(cycle, steps):
    """Amplitude within 5 %, frequency within 0.5 %, of time steps that have settled."""
    near = (abs(a / b - 1) < limit for a, b, limit in zip(cycle, steps, (0.05, 5e-3), strict=False))
    return abs(steps[2]) < 1e-2 and all(near)


def test_a_sample_against_time_steps():
    """From beyond the cycle down to it."""
    outcome, *given = cycle_and_steps(BLOCK, 2, 0.9, 0.008, 3.0)
    assert outcome == "stable" and agree(*given)


@pytest.mark.long
@pytest.mark.hard
@pytest.mark.parametrize(
    ("size", "k", "share"),
    [
        ("9 mm", 1, 0.25),
        pytest.param("9 mm", 1, 0.1, marks=pytest.mark.slow),
        pytest.param("10 mm", 2, 0.1, marks=pytest.mark.slow),
    ],
)
def test_a_branch_through_resonances_of_higher_harmonics(size, k, share):
    """Little damping: harmonics meet modes on the way, and the branch turns; it is not lost."""
    scene = BLOCK[0], [*BLOCK[1], f"parts.block.size='{size}'"], np.inf
    study, sample, eq, modes, mode = squealing(scene, k, share)
    cycles = study.beside["limit cycles"].sample(sample, eq)
    branch = cycles.branch(cycles.problem(5, 32), modes.s[mode], modes.right[:, mode], 20e-6)
    assert branch.cycles[0].kind == STABLE
    # Near a cycle the branch passes from growth to decay.
    a, alpha = branch.amplitude, branch.s.real
    before = int(np.argmax(alpha < 0)) - 1
    assert (alpha[: before + 1] > 0).all()
    assert a[before : before + 2].min() < 1.05 * branch.cycles[0].at.amplitude
    assert a[before : before + 2].max() > 0.95 * branch.cycles[0].at.amplitude


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.25, 0.5, 0.75, 0.9])
@pytest.mark.parametrize(
    ("scene", "k"),
    [(BLOCK, 0), (BLOCK, 1), (BLOCK, 2), (FINE_BLOCK, 0), (COARSE_BRAKE, 0)],
)
def test_stable_cycles_are_those_of_time_steps(scene, k, share):
    """From a small disturbance on: what time steps do not come to is not called stable."""
    outcome, *given = cycle_and_steps(scene, k, share, 0.08, 0.1)
    assert agree(*given) or outcome != "stable"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "k", "share", "expected"),
    [
        (BLOCK, 0, 0.75, "stable"),
        (BLOCK, 1, 0.9, "stable"),
        (FINE_BLOCK, 0, 0.9, "stable"),
        (BLOCK, 2, 0.5, "gives way: its period doubles"),
        (COARSE_BRAKE, 0, 0.75, "gives way: its period doubles"),
    ],
)
def test_outcomes(scene, k, share, expected):
    """Outcomes that a period of 0.08 s shows: one vibration, or one of twice the period."""
    outcome, cycle, steps = cycle_and_steps(scene, k, share, 0.08, 0.1)
    assert outcome == expected
    assert agree(cycle, steps) == (expected == "stable")
