"""Stiffness and mass that processes hold once: the same ones, never those of another mesh."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.folder.lock import Share
from brake_fenicsx.folder.store import Store
from brake_fenicsx.pipeline import assemble, run
from brake_fenicsx.samples.numbering import MATRICES, with_shared_matrices

pytestmark = pytest.mark.together

COMM = MPI.COMM_WORLD
BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
SIZES = ["parts.block.size='4 mm'", "parts.plate.size='6 mm'"]


@pytest.fixture(scope="module")
def brake():
    return assemble(BLOCK, COMM, SIZES)


def mapped(A):
    return not A.data.flags.writeable


def test_matrices_are_those_of_the_file(brake, store):
    found = with_shared_matrices(brake, store, COMM)
    for name in ("K", "M"):
        own, shared = getattr(brake, name), getattr(found, name)
        assert mapped(shared) and not mapped(own)
        assert abs(own - shared).max() <= 1e-10 * abs(own).max()
        u = np.linspace(-1, 1, own.shape[0])
        np.testing.assert_allclose(shared @ u, own @ u, atol=1e-9 * abs(own @ u).max())
    assert found.contact is brake.contact and found.elastic.free is brake.elastic.free


def test_a_share_writes_nothing_and_other_matrices_are_not_taken(brake, store):
    store.share = Share(1, 2)
    assert not mapped(with_shared_matrices(brake, store, COMM).K)
    assert not store.path(MATRICES).exists()
    # A share is nothing that processes do together: none goes on to write while another looks.
    COMM.Barrier()
    store.share = None
    with_shared_matrices(brake, store, COMM)
    elastic = brake.elastic
    softer = replace(brake, elastic=replace(elastic, K=0.9 * elastic.K))
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
