"""A results folder that all processes of a test share."""

from pathlib import Path

from mpi4py import MPI

import pytest

from brake_fenicsx.folder.store import Store

COMM = MPI.COMM_WORLD


@pytest.fixture
def store(tmp_path):
    """One folder for all processes, that of the first one."""
    folder = Path(COMM.bcast(str(tmp_path), root=0))
    if COMM.rank == 0:
        for name in ("cache", "samples"):
            (folder / name).mkdir()
    COMM.Barrier()
    return Store(folder)
