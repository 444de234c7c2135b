"""A brake with a caliper by matrices, ties and springs, on a coarse mesh."""

import json

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.pipeline import run
from places import WHOLE
from run_tables import read_columns

FORCE = 1145.0
COARSE = [
    "stages=['equilibrium', 'stability', 'uncertainty']", "parts.disc.size='30 mm'",
    "parts.inner.size='16 mm'", "parts.inner.plate_size='18 mm'", "parts.outer.size='16 mm'",
    "parts.outer.plate_size='18 mm'", "stability.band=['0 Hz', '4 kHz']",
    "samples={ n=2, approaches=['parametric'] }", "stability.verify=0",
    "contact.inner.gap='none'", "contact.outer.gap='none'",
    "contact.inner.law={ p0='1 MPa', u0='5 um' }", "contact.outer.law={ p0='1 MPa', u0='5 um' }",
    "samples.random.'contact.inner.friction'={ law='uniform', min=0.3, max=0.5 }",
]  # fmt: skip


def results(folder, *more):
    run(WHOLE, MPI.COMM_SELF, folder, overrides=[*COARSE, *more])
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.long
@pytest.mark.parametrize("verify", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_floating_caliper_presses_both_pads_alike(verify, tmp_path):
    """No spring along z: the fingers give the outer pad what the piston gives the inner one; the
    reduced model, with dashpots, has the modes of full order; the caliper takes part in them."""
    summary = results(
        tmp_path, f"stability.verify={verify}", "springs.seal.stiffness=['1 kN/mm', '1 kN/mm', 0]",
        "springs.'caliper.pins'.stiffness=['8 kN/mm', '8 kN/mm', 0]",
    )  # fmt: skip
    pads = summary["contact_forces"]["parametric"]
    assert pads["inner"]["normal_N"] == pytest.approx(FORCE, rel=1e-6)
    assert pads["outer"]["normal_N"] == pytest.approx(FORCE, rel=1e-6)
    for pad in pads.values():
        assert 110 < pad["effective_radius_mm"] < 125
    # The piston's force stays where it is; the caliper gives way to the tilting of the outer pad.
    assert pads["inner"]["leading_half_share"] > pads["outer"]["leading_half_share"] + 0.02
    if verify:
        check = summary["verification"]
        assert check["samples_compared"] == 1
        assert check["eigenvalues"] > 10
        assert check["wrong_verdicts"] == 0
        assert check["largest_relative_error"] < 1e-5
    modes = read_columns(tmp_path / "modes.csv")
    assert np.max(modes["share_caliper"]) > 0.5


def test_springs_of_pins_and_seal_share_the_force(tmp_path):
    """The seal carries as the caliper opens, and the pins as it floats: both pads say how much."""
    summary = results(tmp_path, "stages=['equilibrium']", "samples={ approaches=['classical'] }")
    pads = summary["contact_forces"]["classical"]
    inner, outer = (pads[name]["normal_N"] - FORCE for name in ("inner", "outer"))
    # The housing moves away from the piston: the seal pulls the inner pad back.
    assert inner < 0
    assert abs(inner) < 0.1 * FORCE
    assert abs(outer) < 0.1 * FORCE
