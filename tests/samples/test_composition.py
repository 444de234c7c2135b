"""What a mode is made of, in the tables: flutter partners, and shares of the layers."""

import csv

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.pipeline import run
from places import DEMO

MU = "samples.random.\"contact.pad_disc.friction\"={ law='uniform', min=0.8, max=1.0 }"
SMALL = [
    "stages=['equilibrium','stability','uncertainty']", "contact.pad_disc.gap=none",
    "contact.pad_disc.law={ linear='1e10 Pa/m' }", "parts.disc.size='24 mm'",
    "parts.pad.size='18 mm'", "parts.pad.plate_size='18 mm'", "mesh.quality=0.02", MU,
    "stability.band=['0 Hz','5 kHz']", "stability.verify=1", "samples.n=2",
    "samples.approaches=['multi-scale']",
]  # fmt: skip
LAYERS = ["disc.body", "pad.lining", "pad.plate", "pad.shim"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    run(DEMO, MPI.COMM_SELF, out, SMALL)
    return out


def test_columns_of_the_table(folder):
    """Shares add up to one; partners name each other and coalesced: same frequency, +-alpha."""
    with (folder / "modes.csv").open() as file:
        table = list(csv.DictReader(file))
    assert list(table[0])[-5:] == ["partner", *(f"share_{name}" for name in LAYERS)]
    shares = np.array([[float(r[f"share_{name}"]) for name in LAYERS] for r in table])
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, rtol=1e-9)
    # Modes of the disc and modes of the pads.
    assert np.any(shares[:, 0] > 0.95) and np.any(shares[:, 0] < 0.05)
    by_row = {(r["sample"], int(r["mode"])): r for r in table}
    unstable = [r for r in table if r["verdict"] == "unstable"]
    assert unstable
    for r in unstable:
        other = by_row[r["sample"], int(r["partner"])]
        assert other["partner"] == r["mode"]
        assert float(other["real_1_s"]) == pytest.approx(-float(r["real_1_s"]), rel=1e-6)
        assert float(other["frequency_hz"]) == pytest.approx(float(r["frequency_hz"]), rel=1e-9)
    assert all(r["partner"] == "" for r in table if float(r["real_1_s"]) == 0)


def test_reduced_modes_are_made_of_what_whole_ones_are(folder):
    """A sample by the kept real modes alone, and by whole vectors: within 1 % of the energy."""
    mine, whole = (
        np.load(folder / "samples" / f"{name}-00000.npz") for name in ("multi-scale", "verify")
    )
    assert mine["layers"].tolist() == whole["layers"].tolist() == LAYERS
    np.testing.assert_array_equal(mine["partner"], whole["partner"])
    alone = mine["condition"] < 1e3
    np.testing.assert_allclose(mine["shares"][:, alone], whole["shares"][:, alone], atol=0.01)
    assert "coordinates" in mine.files and "vectors" in whole.files


@pytest.mark.long
def test_a_damped_sample_names_its_partner(folder, tmp_path):
    """Little damping: the pairs of the undamped sample, though their eigenvalues are no mirror."""
    damping = "stability.damping={ loss=true, omega_ref='2 kHz' }"
    little = [damping, "materials.lining.loss=1e-3", "stability.verify=0"]
    run(DEMO, MPI.COMM_SELF, tmp_path / "out", [*SMALL, *little])
    one, other = (
        np.load(f / "samples" / "multi-scale-00000.npz") for f in (folder, tmp_path / "out")
    )
    assert one["s"].size == other["s"].size
    np.testing.assert_array_equal(one["partner"], other["partner"])
    i = int(np.flatnonzero(other["partner"] >= 0)[0])
    j = int(other["partner"][i])
    assert abs(other["s"][i] + other["s"][j].conj()) > 1e-6 * abs(other["s"][i])
    np.testing.assert_allclose(other["shares"], one["shares"], atol=0.02)
