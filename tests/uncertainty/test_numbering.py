"""Vectors kept in a results folder find their dofs again, whatever cut the mesh."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.brake import assemble_brake
from brake_fenicsx.macro.condensation import gathered
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import read_scene
from brake_fenicsx.store import Store
from brake_fenicsx.uncertainty.numbering import FILE, Numbering

COMM = MPI.COMM_WORLD
BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
# Nodes of block and plate lie in one place: 10 mm cells on either side of the contact.
COARSE = [
    "parts.block.size='10 mm'", "parts.plate.size='10 mm'", "parts.plate.length='40 mm'",
    "parts.plate.width='20 mm'",
]  # fmt: skip


# A cap on the block, tied: their nodes lie in one place too, and nothing tells the two apart in K.
TIED = [
    'parts.cap={ builder="block", length="40 mm", width="20 mm", height="10 mm", z="20 mm",'
    ' size="10 mm", material="iron" }',
    'ties={ cap={ faces=["block.top", "cap.bottom"] } }',
]  # fmt: skip


LUMPED = ["mesh.degree=1", "mesh.mass='lumped'"]


def brake(comm, *changes):
    made = assemble_brake(read_scene(BLOCK, [*COARSE, *changes]), comm)
    return made, local_rows(gathered(made.K))


@pytest.fixture
def store(tmp_path):
    """One folder for all processes."""
    folder = Path(COMM.bcast(str(tmp_path), root=0))
    if COMM.rank == 0:
        (folder / "cache").mkdir()
    COMM.Barrier()
    return Store(folder)


@pytest.mark.parametrize("changes", [[], TIED, [*TIED, *LUMPED]])
def test_order_of_one_process_and_of_all(store, changes):
    """The stiffness of the one is that of the other, row by row and column by column."""
    own = Store(store.path(f"alone{COMM.rank}"))
    own.path("cache").mkdir(parents=True)
    alone, K = brake(MPI.COMM_SELF, *changes)
    Numbering(alone, own, MPI.COMM_SELF)
    shared, K_shared = brake(COMM, *changes)
    numbering = Numbering(shared, own, COMM)
    order = numbering.kept(np.arange(len(shared.f)))
    assert abs(K_shared[order][:, order] - K).max() < 1e-12 * abs(K).max()
    np.testing.assert_allclose(numbering.kept(shared.f), alone.f, atol=1e-12)
    assert abs(shared.N[:, order] - alone.N).max() < 1e-12
    np.testing.assert_array_equal(numbering.present(alone.f[:, None])[order, 0], alone.f)


def test_any_order_is_found_again(store):
    made, _ = brake(COMM)
    first = Numbering(made, store, COMM)
    COMM.Barrier()
    x = np.arange(2.0 * len(made.f)).reshape(-1, 2)
    assert first.kept(x) is x
    shuffled = np.random.default_rng(0).permutation(len(x))
    keys = store.load(FILE)["keys"]
    COMM.Barrier()
    if COMM.rank == 0:
        store.save(FILE, keys=keys[shuffled])
    COMM.Barrier()
    again = Numbering(made, store, COMM)
    assert again.mark == first.mark
    np.testing.assert_array_equal(again.kept(x), x[shuffled])
    np.testing.assert_array_equal(again.present(x[shuffled]), x)


@pytest.mark.parametrize("change", ["parts.block.size='9 mm'", "parts.block.height='20.1 mm'"])
def test_folder_of_another_mesh_is_refused(store, change):
    """Other cells, or as many a little elsewhere."""
    Numbering(brake(COMM)[0], store, COMM)
    with pytest.raises(SceneError, match="belong to another mesh"):
        Numbering(brake(COMM, change)[0], store, COMM)
