"""The dofs of a results folder: the same on every process, and refused where they are others."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.samples.numbering import FILE, Numbering
from brake_fenicsx.scene import read_scene

pytestmark = pytest.mark.together

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
    return made, made.K


@pytest.mark.parametrize("changes", [[], TIED, [*TIED, *LUMPED]])
def test_every_process_has_the_same_brake(store, changes):
    """Dof by dof, and entry by entry; nothing in K tells the bodies of a tie apart."""
    made, K = brake(COMM, *changes)
    numbering = Numbering(made, store, COMM)
    assert numbering.mark == COMM.bcast(numbering.mark)
    first = COMM.bcast((K, made.M, made.N, made.f, numbering.body))
    for A, B in zip((K, made.M, made.N), first, strict=False):
        assert abs(A - B).max() <= 1e-14 * abs(B).max()
    np.testing.assert_allclose(made.f, first[3], atol=1e-12)
    np.testing.assert_array_equal(numbering.body, first[4])
    assert len(np.unique(numbering.body)) == (3 if changes else 2)
    again = Numbering(made, store, COMM)
    assert again.mark == numbering.mark


def test_another_order_is_refused(store):
    """As another version of DOLFINx might number them."""
    made, _ = brake(COMM)
    Numbering(made, store, COMM)
    COMM.Barrier()
    keys = store.load(FILE)["keys"]
    COMM.Barrier()
    if COMM.rank == 0:
        store.save(FILE, keys=keys[::-1])
    COMM.Barrier()
    with pytest.raises(SceneError, match="of gmsh or DOLFINx; choose another folder"):
        Numbering(made, store, COMM)


@pytest.mark.parametrize("change", ["parts.block.size='9 mm'", "parts.block.height='20.1 mm'"])
def test_folder_of_another_mesh_is_refused(store, change):
    """Other cells, or as many a little elsewhere."""
    Numbering(brake(COMM)[0], store, COMM)
    with pytest.raises(SceneError, match="belong to another mesh"):
        Numbering(brake(COMM, change)[0], store, COMM)
