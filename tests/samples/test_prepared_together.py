"""A scene prepared from Python by several processes: one folder, the modes of one process."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.folder.store import Store
from coarse_block import BLOCK

pytestmark = pytest.mark.together

ROUGH = [
    "stages=['surface','micro','equilibrium','stability']", "surface.statistics={ S_q = '1 um' }",
    "contact.block_plate.law=library", "micro.E='1983.3 MPa'", "micro.nu=0.4054",
    "micro.patch='1 mm'", "micro.pixels=32", "micro.laws=2", "micro.steps=8",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'", "stability.band=['0 Hz','20 kHz']",
    "stability.method=reduced",
]  # fmt: skip


def test_processes_share_the_folder_that_none_was_named_for():
    alone = prepare(BLOCK, ROUGH).modes()
    together = prepare(BLOCK, ROUGH, comm=MPI.COMM_WORLD).modes()
    assert len(alone) == len(together) > 3
    np.testing.assert_allclose(together.s, alone.s, rtol=1e-6)


def test_the_first_process_alone_looks_into_the_folder(monkeypatch):
    """It may have begun to write there before another process looks."""

    def look(self, scene):
        raise AssertionError("a process that is not the first looks into the folder")

    if MPI.COMM_WORLD.rank:
        monkeypatch.setattr(Store, "check", look)
    assert len(prepare(BLOCK, ROUGH, comm=MPI.COMM_WORLD).modes()) > 3
