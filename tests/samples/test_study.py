"""Whole studies: killed at any moment, laws made afresh, all approaches side by side."""

import os
import signal
import subprocess
import time

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.pipeline import run
from coarse_block import BLOCK
from full_order import text_rows
from processes import command

COMM = MPI.COMM_SELF
STAGES = "['surface','equilibrium','stability','uncertainty']"
ROUGH = [
    f"stages={STAGES}", "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'",
    "stability.band=['0 Hz','20 kHz']", "stability.method=reduced",
]  # fmt: skip
MU = "samples.random.\"contact.block_plate.friction\"={ law='uniform', min=0.3, max=0.7 }"
G13 = "samples.random.\"materials.lining.G_13\"={ law='uniform', spread=0.2 }"
TABLES = ("modes", "samples", "contact", "sensitivity", "probabilities", "convergence")


def test_more_verified_samples_than_there_are(tmp_path):
    """A design has no point for a sample beyond its own."""
    lhs = [MU, "samples.design=latin-hypercube", "samples.n=2", "stability.verify=3"]
    run(BLOCK, COMM, tmp_path / "out", [*ROUGH, *lhs])
    assert len(list((tmp_path / "out" / "samples").glob("verify-*.npz"))) == 2


FOUR = "samples.approaches=['multi-scale','parametric','classical','joint']"


def test_four_approaches_in_one_scene(tmp_path):
    """Each has its own number, design and inputs; families are told apart in one basis."""
    small = [
        "samples.parametric.n=6",
        "samples.parametric.design=rbd-fast",
        "samples.joint.n=3",
        "samples.n=4",
    ]
    run(BLOCK, COMM, tmp_path / "out", [*ROUGH, MU, G13, FOUR, *small])
    samples = text_rows(tmp_path / "out" / "samples.csv")
    counts = {
        a: sum(s["approach"] == a for s in samples) for a in ("multi-scale", "parametric", "joint")
    }
    assert counts == {"multi-scale": 4, "parametric": 6, "joint": 3}
    assert {s["status"] for s in samples} == {"ok"}
    drawn = [s for s in samples if s["materials.lining.G_13"]]
    assert {s["approach"] for s in drawn} == {"parametric", "joint"}
    assert len({s["materials.lining.G_13"] for s in drawn}) == 9
    modes = text_rows(tmp_path / "out" / "modes.csv")
    assert min(int(m["family"]) for m in modes if m["approach"] != "classical") >= 0
    robust = text_rows(tmp_path / "out" / "probabilities.csv")
    unstable = {(m["approach"], m["sample"]) for m in modes if m["verdict"] == "unstable"}
    for approach, n in counts.items():
        whole = next(r for r in robust if (r["approach"], r["where"]) == (approach, "0-20000"))
        assert int(whole["samples"]) == n
        assert int(whole["squeal_samples"]) == sum(a == approach for a, _ in unstable)


def lines_of(out):
    """Lines of the log of a results folder so far."""
    log = out / "log.txt"
    return log.read_text().count("\n") if log.exists() else 0


@pytest.mark.slow
def test_killed_at_ten_random_moments_ends_with_the_same_bytes(tmp_path):
    """SIGKILL anywhere, also while a file is written: no half file is read, nothing renumbered."""
    study = [*ROUGH, MU, "samples.design=latin-hypercube", "samples.n=60"]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    whole = tmp_path / "whole"
    subprocess.run(command(BLOCK, whole, study), check=True, capture_output=True, env=environment)
    rng, killed, told = np.random.default_rng(11), 0, lines_of(whole)
    for k in range(10):
        # A little after a line of its log: at any place of the run, however busy the machine is.
        out, line, later = tmp_path / f"killed{k}", rng.integers(1, told - 3), rng.uniform(0, 0.2)
        going = subprocess.Popen(
            command(BLOCK, out, study), stderr=subprocess.DEVNULL, env=environment
        )
        while going.poll() is None and lines_of(out) < line:
            time.sleep(0.002)
        time.sleep(later)
        going.send_signal(signal.SIGKILL)
        killed += going.wait() == -signal.SIGKILL
        subprocess.run(command(BLOCK, out, study), check=True, capture_output=True, env=environment)
        for name in TABLES:
            a, b = (folder / f"{name}.csv" for folder in (whole, out))
            assert a.read_bytes() == b.read_bytes(), (k, name)
    assert killed >= 7
