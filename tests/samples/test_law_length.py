"""Laws that are made to the pressure of the brake, and longer where a sample needs them."""

import json

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build import law_stage
from brake_fenicsx.pipeline import run
from coarse_block import BLOCK

ROUGH = [
    "stages=['surface','micro','equilibrium','stability','uncertainty']",
    "surface={ statistics={ S_q='3 um' } }",
    "micro={ laws=4, pixels=32, scans=0, hardness='200 MPa' }",
    "contact.block_plate.law=library",
    "parts.block.size='14 mm'",
    "parts.plate.size='20 mm'",
    "stability.band=['0 Hz','20 kHz']",
    "stability.method=reduced",
    "samples.n=3",
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """With the whole laws: the scene names their highest pressure."""
    out = tmp_path_factory.mktemp("whole")
    run(BLOCK, MPI.COMM_SELF, out, [*ROUGH, "micro.max_pressure=0.008"])
    return out


def tables(folder):
    """Numbers of contact.csv and modes.csv."""
    names = ("contact.csv", "modes.csv")
    rows = (np.genfromtxt(folder / n, delimiter=",", names=True, dtype=float) for n in names)
    return [{k: x[k] for k in x.dtype.names if not np.isnan(x[k]).all()} for x in rows]


@pytest.mark.parametrize("least", [1e6, 0.05e6])
def test_laws_of_the_pressure_give_what_whole_laws_give(whole, tmp_path, monkeypatch, least):
    """At 4 times the mean pressure no patch asks for more; far below it every sample does."""
    monkeypatch.setattr(law_stage, "LEAST", least)
    monkeypatch.setattr(law_stage, "TIMES", 4.0 if least == 1e6 else 0.01)
    run(BLOCK, MPI.COMM_SELF, tmp_path, ROUGH)
    ours, theirs = tables(tmp_path), tables(whole)
    for one, other in zip(ours, theirs, strict=True):
        for name, values in other.items():
            if name not in ("residual", "error_estimate"):
                np.testing.assert_allclose(one[name], values, rtol=1e-7, err_msg=name)
    with np.load(tmp_path / "laws.npz") as short, np.load(whole / "laws.npz") as long:
        assert short["p"].max() < 0.5 * long["p"].max() and "reach" not in long
        asked = tables(tmp_path)[0]["p"].max() > short["reach"].min()
    assert asked == (least < 1e6) == ("is made longer" in (tmp_path / "log.txt").read_text())
    assert json.loads((tmp_path / "summary.json").read_text())["failed_samples"] == 0
