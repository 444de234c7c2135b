"""The kept reduced model: taken again, or made again."""

import shutil

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.folder.store import Store
from brake_fenicsx.pipeline import run
from brake_fenicsx.samples.reduced_models import LAYOUT
from coarse_block import BLOCK

COMM, FILE = MPI.COMM_SELF, "cache/undamped.npz"
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


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder of a run whose samples are forgotten, and lambda of these."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run(BLOCK, COMM, out, GIVEN)
    return out, modes(out)


@pytest.fixture
def kept(whole, tmp_path):
    """A copy of the folder for one test."""
    return shutil.copytree(whole[0], tmp_path / "out"), whole[1]


def test_cache_of_another_layout_is_made_again(kept):
    """One of the same layout is read: what stands in it is taken for true."""
    folder, first = kept
    store = Store(folder)
    content = store.load(FILE)
    assert int(content["layout"]) == LAYOUT
    name = next(n for n, D in content.items() if n.endswith(".D0") and D.shape[0] > 1)
    wrong = {**content, name: 2 * content[name]}
    store.save(FILE, **wrong)
    run(BLOCK, COMM, folder, GIVEN)
    assert np.abs(modes(folder) / first - 1).max() > 1e-6
    store.save(FILE, **{**wrong, "layout": np.array(LAYOUT - 1)})
    run(BLOCK, COMM, folder, GIVEN)
    np.testing.assert_array_equal(modes(folder), first)
    np.testing.assert_array_equal(store.load(FILE)[name], content[name])


@pytest.mark.long
@pytest.mark.parametrize("length", [0, 200, 4000])
def test_damaged_cache_is_made_again(kept, length):
    """Cut short by a full disc: the samples of the run are of one kind, as those before."""
    folder, first = kept
    path = Store(folder).path(FILE)
    whole = path.read_bytes()
    path.unlink()
    path.write_bytes(whole[:length])
    run(BLOCK, COMM, folder, GIVEN)
    np.testing.assert_array_equal(modes(folder), first)
    assert "made again" in (folder / "log.txt").read_text()
