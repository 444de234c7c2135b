"""The cache of the bodies that change: taken again, or made again."""

from functools import partial
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.pipeline import run
from brake_fenicsx.stability.ensemble_basis import EnsembleBasis
from brake_fenicsx.store import Store
from brake_fenicsx.uncertainty.changing import FILE, MADE_WITH

pytestmark = pytest.mark.alone

COMM = MPI.COMM_SELF
BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
GIVEN = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='10 mm'", "parts.plate.size='14 mm'", "stability.band=['0 Hz','15 kHz']",
    "stability.method=reduced", "stability.verify=0", "samples.n=2",
    "samples.random.\"materials.lining.C44\"={ law='uniform', spread=0.2 }",
]  # fmt: skip


def modes(folder):
    """lambda of both samples; they are forgotten."""
    out = []
    for k in range(2):
        file = folder / "samples" / f"multi-scale-{k:05d}.npz"
        with np.load(file) as data:
            out.append(data["s"])
        file.unlink()
    return np.concatenate(out)


def test_cache_of_another_layout_is_made_again(tmp_path):
    """One of the same layout is read: what stands in it is taken for true."""
    run(BLOCK, COMM, tmp_path, GIVEN)
    first, store = modes(tmp_path), Store(tmp_path)
    content = store.load(FILE)
    np.testing.assert_array_equal(content["made_with"], MADE_WITH)
    changing = next(name for name in content if name.endswith(".R_0"))
    wrong = {**content, changing: 2 * content[changing]}
    store.save(FILE, **wrong)
    run(BLOCK, COMM, tmp_path, GIVEN)
    assert np.abs(modes(tmp_path) / first - 1).max() > 1e-6
    # Earlier layouts had one number less there.
    store.save(FILE, **{**wrong, "made_with": MADE_WITH[1:]})
    run(BLOCK, COMM, tmp_path, GIVEN)
    np.testing.assert_array_equal(modes(tmp_path), first)
    np.testing.assert_array_equal(store.load(FILE)[changing], content[changing])


def test_errors_hold_that_of_the_equilibrium(tmp_path, monkeypatch):
    """Bodies interpolated with degree one, modes refined: what is left comes from the equilibrium.

    Full order solves for its own. Catches a doubt of the gaps that never gets to the modes.
    """
    poor = partial(EnsembleBasis, degree=1)
    monkeypatch.setattr("brake_fenicsx.uncertainty.changing.EnsembleBasis", poor)
    found = []
    for method in ("reduced", "full"):
        folder = tmp_path / method
        run(BLOCK, COMM, folder, [*GIVEN, f"stability.method={method}", "stability.tolerance=1e-8"])
        files = sorted((folder / "samples").glob("*.npz"))
        found.append([dict(np.load(file)) for file in files])
    worst = []
    for reduced, full in zip(*found, strict=True):
        assert len(reduced["s"]) == len(full["s"])
        distance = np.abs(reduced["s"][:, None] - full["s"])
        nearest = distance.argmin(axis=1)
        off = distance.min(axis=1)
        assert np.all(off <= reduced["error"] + full["error"][nearest])
        worst.append((off / np.abs(reduced["s"])).max())
    assert max(worst) > 1e-8
