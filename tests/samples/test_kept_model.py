"""The kept reduced model: taken again, or made again."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.folder.store import Store
from brake_fenicsx.pipeline import run
from brake_fenicsx.samples.reduced_models import LAYOUT

COMM, FILE = MPI.COMM_SELF, "cache/undamped.npz"
BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
GIVEN = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='20 mm'", "parts.plate.size='30 mm'", "stability.band=['0 Hz','15 kHz']",
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
    assert int(content["layout"]) == LAYOUT
    name = next(n for n, D in content.items() if n.endswith(".D0") and D.shape[0] > 1)
    wrong = {**content, name: 2 * content[name]}
    store.save(FILE, **wrong)
    run(BLOCK, COMM, tmp_path, GIVEN)
    assert np.abs(modes(tmp_path) / first - 1).max() > 1e-6
    store.save(FILE, **{**wrong, "layout": np.array(LAYOUT - 1)})
    run(BLOCK, COMM, tmp_path, GIVEN)
    np.testing.assert_array_equal(modes(tmp_path), first)
    np.testing.assert_array_equal(store.load(FILE)[name], content[name])


@pytest.mark.parametrize("length", [0, 200, 4000])
def test_damaged_cache_is_made_again(tmp_path, length):
    """Cut short by a full disc: the samples of the run are of one kind, as those before."""
    run(BLOCK, COMM, tmp_path, GIVEN)
    first, path = modes(tmp_path), Store(tmp_path).path(FILE)
    whole = path.read_bytes()
    path.unlink()
    path.write_bytes(whole[:length])
    run(BLOCK, COMM, tmp_path, GIVEN)
    np.testing.assert_array_equal(modes(tmp_path), first)
    assert "made again" in (tmp_path / "log.txt").read_text()
