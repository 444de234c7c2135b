"""Moments of high order by few combinations of contact rows, on a brake with many of them."""

from functools import cache
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.samples.numbering import dof_points
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import (
    ContactLinearisation,
    ReducedModel,
    complex_modes,
    contact_interface,
    split_substructures,
)
from brake_fenicsx.stability.damping_matrices import sliding_damping
from brake_fenicsx.stability.modes import relative_errors
from brake_fenicsx.stability.operators import tangent
from brake_fenicsx.stability.substructures.low_rank import SHARE
from brake_fenicsx.stability.substructures.series import Series

SCENE = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
BAND, MU = (0.0, 9e3), 0.5


@cache
def brake():
    sizes = ["parts.block.size='4 mm'", "parts.plate.size='10 mm'"]
    return assemble_brake(read_scene(SCENE, sizes), MPI.COMM_SELF)


@pytest.mark.parametrize(("sliding", "stiffness"), [(False, 1e12), (True, 1e10)])
def test_modes_are_those_of_full_order(monkeypatch, sliding, stiffness):
    """Errors are no larger than stated, with moments of the plate that few combinations give.

    The block has no mode near the band and moments that fall by a thousand each: of it all rows are
    solved, for the combinations err by more than the last moment.
    """
    plans, errors = [], []
    made = Series.moments

    def noted(self, plan, *rest):
        D, error = made(self, plan, *rest)
        plans.append(plan)
        errors.append(error)
        return D, error

    monkeypatch.setattr(Series, "moments", noted)
    b, rng = brake(), np.random.default_rng(7)
    interface = {"N": b.N, "T": b.T, "R": b.R}
    bodies = split_substructures(b.K, b.M, interface, b.f[:, None])
    model = ReducedModel.offline(bodies, b.w, BAND, followed="NR" if sliding else "N")
    assert [plan.further for plan in plans] == [3, 3, 0]
    assert errors[0] < SHARE < errors[1]
    k = stiffness * np.exp(rng.standard_normal(b.w.size)) * (rng.random(b.w.size) > 0.3)
    p, V = 2e5 * (k > 0) * sliding, np.ones(b.w.size)
    found = model.modes([], ContactLinearisation.of(k, MU, 0.0, MU * p / V), 0.2)
    C = sliding_damping(b.R, b.w, p, V, MU) if sliding else None
    full = complex_modes(
        b.M, C, tangent(b.K, b.N, b.T, b.w, k, MU), BAND, zeta_max=0.2,
        friction=contact_interface(b.N, b.T, b.w * k, MU),
    )  # fmt: skip
    assert len(found) == len(full)
    assert np.all(np.abs(found.s - full.s) <= found.error + full.error)
    assert relative_errors(found.s, found.error).max() < 1e-5


def test_stated_errors_of_the_demo_brake_hold():
    """Its pad has moments that few combinations give to a fifth of the last one: too little.

    Modes low in the band felt that more than the moments beyond the last one, which are stated.
    """
    smooth = [
        "contact.pad_disc.gap = none",
        "contact.pad_disc.law = { p0 = '2e5 Pa', u0 = '2e-6 m' }",
        "samples.approaches = ['multi-scale']",
        "stages = ['equilibrium','stability','uncertainty']",
    ]
    scene = read_scene(SCENE.with_name("disc_brake_demo.toml"), smooth)
    b = assemble_brake(scene, MPI.COMM_SELF)
    band, rng = (0.0, 8e3), np.random.default_rng(0)
    k = 8e9 * np.exp(rng.normal(0.0, np.log(10) / 2, b.w.size)) * (rng.random(b.w.size) > 0.3)
    interface = {"N": b.N, "T": b.T, "R": b.R}
    bodies = split_substructures(b.K, b.M, interface, b.f[:, None], points=dof_points(b))
    found = ReducedModel.offline(bodies, b.w, band).modes([], ContactLinearisation.of(k, MU))
    full = complex_modes(
        b.M, None, tangent(b.K, b.N, b.T, b.w, k, MU), band,
        friction=contact_interface(b.N, b.T, b.w * k, MU),
    )  # fmt: skip
    assert len(found) == len(full)
    assert np.all(np.abs(found.s - full.s) <= found.error + full.error)
