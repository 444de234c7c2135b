"""What a results folder keeps of a brake: the places of its dofs, its stiffness and its mass.

The dofs are numbered by gmsh and DOLFINx, the same on every process and in every run of the same
versions. What a folder keeps of them is refused by a run that numbers them otherwise.

Stiffness and mass are in one file, which the processes of a machine hold once. Samples of the
reduced model look at neither; a sample at full order, and pictures of modes, do.
"""

import hashlib
from contextlib import suppress
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Index
from brake_fenicsx.build.brake import Brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.processes import on_first, release_memory
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.faces import body_of_nodes

FILE = "cache/dofs.npz"

# Two dofs whose keys differ by less, relative to the size of the brake, are the same.
SAME = 1e-7

MATRICES = "cache/matrices.npz"
PARTS = ("data", "indices", "indptr")
# Matrices of two processes differ by the order of their sums alone.
SAME_ENTRIES = 1e-10


class Numbering:
    """The free dofs of a run.

    Attributes:
        body: number of the body that each free dof belongs to, tied bodies apart, shape (dofs,).
        mark: tells this mesh and order from others.
    """

    def __init__(self, brake: Brake, store: Store, comm: MPI.Comm):
        """Compare with the folder, or leave a mark in it; collective.

        Args:
            brake: operators of the scene.
            store: the results folder.
            comm: processes of the run.

        Raises:
            SceneError: the folder belongs to another mesh.
        """
        self.body: Index = _bodies(brake)
        keys = _keys(brake, self.body)
        stored = store.load(FILE)
        comm.Barrier()
        if stored is None:
            if comm.rank == 0:
                store.save(FILE, keys=keys)
        # The same dofs are the same but for round-off.
        elif stored["keys"].shape != keys.shape or not (
            np.abs(stored["keys"] - keys).max() <= SAME * np.ptp(keys[:, :3], axis=0).max()
        ):
            raise SceneError(f"""{store.directory}: its results belong to another mesh, perhaps of
                another version of gmsh or DOLFINx; choose another folder with -o, or --from
                equilibrium""")
        # That of the first run: another one may differ from it by round-off.
        kept = keys if stored is None else stored["keys"]
        self.mark: str = hashlib.sha256(np.ascontiguousarray(kept).tobytes()).hexdigest()[:16]


def dof_points(brake: Brake) -> AnyArray:
    """Coordinates [m] and direction (0, 1, 2; 3: none) of every free dof, shape (dofs, 4)."""
    free = brake.elastic.free
    node, component = np.divmod(free.local, 3)
    own = np.column_stack([free.V.tabulate_dof_coordinates()[node], component])
    return np.concatenate([own, free.places[:, :4]])


def body_centres(points: AnyArray, body: Index) -> AnyArray:
    """Centre of the body of every dof [m], shape (dofs, 3).

    Args:
        points: coordinates [m] of every dof in the first three columns.
        body: number of the body of every dof, shape (dofs,).
    """
    count = np.bincount(body)
    return np.column_stack([np.bincount(body, x)[body] / count[body] for x in points[:, :3].T])


def dof_places(brake: Brake, body: Index) -> AnyArray:
    """``dof_points`` and ``body_centres`` of every free dof, shape (dofs, 7)."""
    points = dof_points(brake)
    return np.column_stack([points, body_centres(points, body)])


def _bodies(brake: Brake) -> Index:
    """Body of each free dof; ties and springs join bodies in the stiffness."""
    free = brake.elastic.free
    label = body_of_nodes(free.V)
    # A body that is held everywhere has no free dof.
    given = label.size + free.places[:, 4].astype(int)
    every = np.concatenate([label[free.local // 3], given])
    return np.asarray(np.unique(every, return_inverse=True)[1], dtype=np.intp)


def _keys(brake: Brake, body: Index) -> AnyArray:
    """What tells a free dof from all others: its place, its component, its body's centre [m]."""
    keys = dof_points(brake)
    size = np.ptp(keys[:, :3], axis=0).max()
    keys[:, 3] *= size
    # Nodes of two bodies may lie in one place.
    return np.column_stack([keys, body_centres(keys, body)])


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
    if not _equal(there, own):
        return brake
    own.clear()
    brake = replace(brake, elastic=replace(elastic, **there))
    release_memory()
    return brake


def _keep(store: Store, own: dict[str, sp.csr_matrix]) -> None:
    """Write the matrices where the file holds others, or is damaged."""
    there = dict[str, sp.csr_matrix]()
    with suppress(SceneError):
        store.check_mapped(MATRICES)
        there = _mapped(store)
    if not _equal(there, own):
        arrays = {f"{n}_{part}": getattr(A, part) for n, A in own.items() for part in PARTS}
        store.save(MATRICES, **arrays)


def _mapped(store: Store) -> dict[str, sp.csr_matrix]:
    """The matrices of the file; none where there is none."""
    stored = store.load(MATRICES, mapped=True) or {}
    names = sorted({name[0] for name in stored})
    found = {n: sp.csr_matrix(tuple(stored[f"{n}_{part}"] for part in PARTS)) for n in names}
    for A in found.values():
        # To look for it would be to write into the file.
        A.has_canonical_format = True
    return found


def _equal(there: dict[str, sp.csr_matrix], own: dict[str, sp.csr_matrix]) -> bool:
    """Whether both hold the same matrices, but for round-off."""
    return there.keys() == own.keys() and all(
        there[n].shape == A.shape and abs(there[n] - A).max() <= SAME_ENTRIES * abs(A).max()
        for n, A in own.items()
    )
