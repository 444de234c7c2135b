"""What a folder keeps of a brake: its dofs, refused where they are others, and its matrices."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.lock import Share
from brake_fenicsx.folder.store import Store
from brake_fenicsx.pipeline import assemble, run
from brake_fenicsx.samples.numbering import FILE, MATRICES, Numbering, with_shared_matrices
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK

pytestmark = pytest.mark.together

COMM = MPI.COMM_WORLD
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
]


SIZES = ["parts.block.size='4 mm'", "parts.plate.size='6 mm'"]
LUMPED = ["mesh.degree=1", "mesh.mass='lumped'"]


def brake(*changes):
    return assemble_brake(read_scene(BLOCK, [*COARSE, *changes]), COMM)


@pytest.mark.parametrize("changes", [[], TIED, [*TIED, *LUMPED]])
def test_every_process_has_the_same_brake(store, changes):
    """Dof by dof, and entry by entry; nothing in K tells the bodies of a tie apart."""
    made = brake(*changes)
    numbering = Numbering(made, store, COMM)
    assert numbering.mark == COMM.bcast(numbering.mark)
    first = COMM.bcast((made.K, made.M, made.N, made.f, numbering.body))
    for A, B in zip((made.K, made.M, made.N), first, strict=False):
        assert abs(A - B).max() <= 1e-14 * abs(B).max()
    np.testing.assert_allclose(made.f, first[3], atol=1e-12)
    np.testing.assert_array_equal(numbering.body, first[4])
    assert len(np.unique(numbering.body)) == (3 if changes else 2)
    again = Numbering(made, store, COMM)
    assert again.mark == numbering.mark


def test_another_order_is_refused(store):
    """As another version of DOLFINx might number them."""
    made = brake()
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
    Numbering(brake(), store, COMM)
    with pytest.raises(SceneError, match="belong to another mesh"):
        Numbering(brake(change), store, COMM)


@pytest.fixture(scope="module")
def whole():
    return assemble(BLOCK, COMM, SIZES)


def mapped(A):
    return not A.data.flags.writeable


def test_matrices_are_those_of_the_file(whole, store):
    found = with_shared_matrices(whole, store, COMM)
    for name in ("K", "M"):
        own, shared = getattr(whole, name), getattr(found, name)
        assert mapped(shared) and not mapped(own)
        assert abs(own - shared).max() <= 1e-10 * abs(own).max()
        u = np.linspace(-1, 1, own.shape[0])
        np.testing.assert_allclose(shared @ u, own @ u, atol=1e-9 * abs(own @ u).max())
    assert found.contact is whole.contact and found.elastic.free is whole.elastic.free


def test_a_share_writes_nothing_and_other_matrices_are_not_taken(whole, store):
    store.share = Share(1, 2)
    assert not mapped(with_shared_matrices(whole, store, COMM).K)
    assert not store.path(MATRICES).exists()
    # A share is nothing that processes do together: none goes on to write while another looks.
    COMM.Barrier()
    store.share = None
    with_shared_matrices(whole, store, COMM)
    elastic = whole.elastic
    softer = replace(whole, elastic=replace(elastic, K=0.9 * elastic.K))
    # A share keeps its own; a run of all samples makes the file again.
    store.share = Share(1, 2)
    kept = with_shared_matrices(softer, store, COMM)
    assert not mapped(kept.K) and abs(kept.K - softer.K).max() == 0
    COMM.Barrier()
    store.share = None
    made = with_shared_matrices(softer, store, COMM)
    assert mapped(made.K) and abs(made.K - softer.K).max() <= 1e-10 * abs(softer.K).max()


@pytest.mark.long
@pytest.mark.parametrize("method", ["reduced", "full"])
def test_nothing_writes_into_mapped_matrices(store, monkeypatch, without_pixels, method):
    """Equilibrium, reduced model, full order, damping and pictures: every array is read-only."""
    monkeypatch.setattr("brake_fenicsx.folder.arrays.MAPPED", 1)
    pictures = ", 'report'" if method == "reduced" else ""
    changes = [
        "parts.block.size='14 mm'", "parts.plate.size='20 mm'", f"stability.method={method}",
        "stability.band=['0 Hz', '12 kHz']", "stability.damping={ rayleigh=['10 1/s', '1e-8 s'] }",
        f"stages=['equilibrium', 'stability', 'uncertainty'{pictures}]", "samples.n=2",
        "samples.approaches=['parametric']",
        "samples.random.'contact.block_plate.friction'={ law='uniform', min=0.4, max=0.6 }",
    ]  # fmt: skip
    out = store.path("out")
    run(BLOCK, COMM, out, changes, prepare=True)
    assert mapped(with_shared_matrices(assemble(BLOCK, COMM, changes), Store(out), COMM).K)
    for k in (1, 2):
        run(BLOCK, COMM, out, changes, share=Share(k, 2))
    done = run(BLOCK, COMM, out, changes)
    if COMM.rank == 0:
        assert done.facts["failed_samples"] == 0
