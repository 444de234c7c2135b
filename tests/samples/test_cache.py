"""What results folders share: made once, taken by scenes that differ elsewhere, never by others."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import pipeline
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.files import SharedCache
from brake_fenicsx.folder.store import Store
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import bodies_key, laws_key
from coarse_block import BLOCK, SCENES

COMM = MPI.COMM_WORLD
SMALL = [
    "stages=['surface','micro','equilibrium','stability','uncertainty']",
    f"surface.scan='{(SCENES / 'pad_scan.npz').as_posix()}'", "contact.block_plate.gap=hdf",
    "contact.block_plate.law=library", "micro.E='1983.3 MPa'", "micro.nu=0.4054",
    "micro.patch='2.8 mm'", "micro.pixels=32", "micro.laws=3", "micro.scans=0",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'", "samples.n=2", "samples.seed=1",
    "stability.method=reduced", "stability.band=['0 Hz','20 kHz']",
]  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """One for all processes."""
    return Path(COMM.bcast(str(tmp_path), root=0))


def facts(name, *changes):
    return (bodies_key if name == "bodies" else laws_key)(read_scene(BLOCK, [*SMALL, *changes]))


def test_what_bodies_and_laws_depend_on():
    """A fact left out would hand on another brake's model; one too many makes it afresh."""
    other_bodies = "parts.block.size='9 mm'", "materials.lining.rho='2400 kg/m^3'"
    for change in other_bodies:
        assert facts("bodies", change) != facts("bodies")
    stuck = "contact.block_plate.slip=stuck", "contact.block_plate.tangential_stiffness='1e12 Pa/m'"
    stiffer = stuck[1].replace("1e12", "2e12")
    zone = "contact.block_plate.zone={ x = [0, '1 m'] }"
    keys = [facts("bodies", *more) for more in ((), stuck, (stuck[0], stiffer), (zone,))]
    assert all(keys[i] != keys[j] for i in range(4) for j in range(i))
    assert facts("bodies", *stuck, "contact.block_plate.friction=0.1") == keys[1]
    for change in ("samples.seed=7", "samples.n=5", "micro.laws=7"):
        assert facts("bodies", change) == facts("bodies")
    assert facts("laws", "micro.laws=7") != facts("laws")
    for change in (*other_bodies, "samples.seed=7"):
        assert facts("laws", change) == facts("laws")


@pytest.mark.together
def test_second_run_takes_from_the_first(folder):
    """Another seed: laws and basis are the first run's, and its modes are those of a run alone."""

    def run(name, cache=None):
        changes = [*SMALL, "samples.seed=5"] if name != "first" else SMALL
        pipeline.run(BLOCK, COMM, folder / name, changes, cache=cache)

    run("first", folder / "cache")
    run("second", folder / "cache")
    run("alone")
    if COMM.rank == 0:
        names = {path.name.rsplit("-", 1)[0] for path in (folder / "cache").iterdir()}
        assert names == {"laws", "dofs", "undamped"}
        log = (folder / "second" / "log.txt").read_text()
        assert "laws.npz: from" in log and "reduced model: taken from an earlier run" in log
        assert (
            "laws: 1 of" not in log
            and "from the cache" not in (folder / "first/log.txt").read_text()
        )
        own, taken = (
            np.load(folder / name / "samples" / "multi-scale-00000.npz")["s"]
            for name in ("alone", "second")
        )
        np.testing.assert_allclose(taken, own, rtol=1e-7)


@pytest.mark.together
def test_a_cache_that_is_no_folder(folder, capsys):
    path = folder / "file"
    if COMM.rank == 0:
        path.write_text("x")
    COMM.Barrier()
    with pytest.raises(SceneError, match=r"--cache .*file: File exists; name a folder"):
        SharedCache(Store(folder), path)
    assert main(["run", str(BLOCK), "-o", str(folder / "out"), "--cache", str(path)]) == 2
    assert not (folder / "out").exists()
    COMM.Barrier()
