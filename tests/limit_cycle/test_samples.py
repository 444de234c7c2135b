"""Limit cycles of whole samples against time steps of the same finite-element matrices."""

from pathlib import Path

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.limit_cycle.growth import STABLE
from brake_fenicsx.limit_cycle.sample import Settings
from brake_fenicsx.uncertainty.solve import sample_damping
from time_steps import TimeSteps, measured

BLOCK = str(Path(__file__).parents[2] / "scripts" / "scenes" / "squealing_block.toml")
ROUGH = "multi-scale"
HARDER = [
    "contact.block_plate.law={ p0 = '10 MPa', u0 = '0.15 um' }",
    "surface.statistics={ S_q = '0.15 um' }",
]


def cycle_and_steps(k, damping, seconds, start, overrides=()):
    """Amplitude [m], frequency [Hz] of the cycle, and the same by time steps with their drift.

    Rayleigh's beta gives the damping at 14.6 kHz, and more beyond the band, where the mesh of a
    band flutters too.
    """
    beta = f"stability.damping={{ rayleigh = ['0 1/s', '{2 * damping / 92e3:g} s'] }}"
    given = ["samples.n=4", "limit_cycle={}", "countermeasures=[]", beta, *overrides]
    model = prepare(BLOCK, given)
    study, models = model.study, model.study.models
    sample = study._draw(ROUGH, k)
    eq, modes = study.solved((ROUGH, k), {})
    (grows,) = np.flatnonzero(np.array(modes.verdict) == "unstable")
    branch, _ = study.cycles.sample(ROUGH, sample, eq).branch(
        modes.s[grows], modes.right[:, grows], Settings(9, 64, 20e-6)
    )
    (cycle,) = branch.cycles
    assert cycle.kind == STABLE
    # The branch begins at the linear mode.
    assert branch.s[0] == pytest.approx(modes.s[grows], rel=1e-3)
    steps = TimeSteps(study.brake, eq, sample.laws, sample.mu, sample_damping(models, sample, eq.p))
    assert steps.linear()[0] == pytest.approx(modes.s[grows], rel=2e-4)
    weights = study.brake.w * (eq.p > 0)
    gaps = steps.run(seconds, 2.5e-7, start * cycle.at.amplitude)
    found = measured(gaps, 2.5e-7, weights / weights.sum())
    return (cycle.at.amplitude, cycle.at.s.imag / 2 / np.pi), found


def agree(cycle, steps):
    assert abs(steps[2]) < 1e-2, "the time steps have not settled"
    assert cycle[0] == pytest.approx(steps[0], rel=0.05)
    assert cycle[1] == pytest.approx(steps[1], rel=0.005)


def test_a_sample_against_time_steps():
    """From beyond the cycle down to it: the small one of the cases below."""
    agree(*cycle_and_steps(2, 0.025, 0.008, 3.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "damping"),
    [
        (0, 0.01),
        (0, 0.015),
        (0, 0.02),
        (1, 0.006),
        (1, 0.008),
        (1, 0.01),
        (2, 0.022),
        (2, 0.024),
        (2, 0.027),
    ],
)
def test_samples_against_time_steps(k, damping):
    """Three samples, three levels of damping each, from a small disturbance on."""
    agree(*cycle_and_steps(k, damping, 0.06, 0.1))
