"""Stiffness and mass of a brake in one file, which the processes of a machine hold once.

Samples of the reduced model look at neither; a sample at full order, and pictures of modes, do.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.build.brake import Brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.memory import release_memory
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.store import Store

FILE = "cache/matrices.npz"
PARTS = ("data", "indices", "indptr")
# Matrices of two processes differ by the order of their sums alone.
SAME = 1e-10


def with_shared_matrices(brake: Brake, store: Store, comm: MPI.Comm) -> Brake:
    """A brake whose K and M are those of the file, mapped into memory; collective.

    The first process writes the file where there is none, unless the run computes a share. Where
    the file holds other matrices the process keeps its own.

    Args:
        brake: operators of the scene.
        store: the results folder.
        comm: processes of the run.
    """
    elastic = brake.elastic
    own = {"K": elastic.K, "M": elastic.M}
    if store.share is None:
        on_first(lambda: _keep(store, own), comm)
    there = _mapped(store)
    if not _same(there, own):
        return brake
    own.clear()
    brake = replace(brake, elastic=replace(elastic, **there))
    release_memory()
    return brake


def _keep(store: Store, own: dict[str, sp.csr_matrix]) -> None:
    """Write the matrices where the file holds others, or is damaged."""
    there = dict[str, sp.csr_matrix]()
    with suppress(SceneError):
        store.check_mapped(FILE)
        there = _mapped(store)
    if not _same(there, own):
        arrays = {f"{n}_{part}": getattr(A, part) for n, A in own.items() for part in PARTS}
        store.save(FILE, **arrays)


def _mapped(store: Store) -> dict[str, sp.csr_matrix]:
    """The matrices of the file; none where there is none."""
    stored = store.load(FILE, mapped=True) or {}
    names = sorted({name[0] for name in stored})
    found = {n: sp.csr_matrix(tuple(stored[f"{n}_{part}"] for part in PARTS)) for n in names}
    for A in found.values():
        # To look for it would be to write into the file.
        A.has_canonical_format = True
    return found


def _same(there: dict[str, sp.csr_matrix], own: dict[str, sp.csr_matrix]) -> bool:
    """Whether both hold the same matrices, but for round-off."""
    if there.keys() != own.keys():
        return False
    for A, B in ((there[n], own[n]) for n in own):
        if A.shape != B.shape or A.nnz != B.nnz or not np.array_equal(A.indices, B.indices):
            return False
        if np.abs(A.data - B.data).max(initial=0.0) > SAME * np.abs(B.data).max(initial=0.0):
            return False
    return True
