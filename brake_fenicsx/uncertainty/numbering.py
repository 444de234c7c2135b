"""The order of the free dofs that a results folder keeps its vectors in.

The mesh is cut for the processes of a run, and the dofs are numbered piece by piece: on another
number of processes, or with a partitioner of another mind, the same dof has another number. What is
kept is in the order of the folder's first run, and comes back in that of the present one.
"""

from __future__ import annotations

import hashlib

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.store import Store

from .shapes import body_centres

FILE = "cache/dofs.npz"

# Two dofs whose keys differ by less, relative to the size of the brake, are the same.
SAME = 1e-7


class Numbering:
    """From the order of the present run to that of the folder, and back.

    Attributes:
        body: number of the body that each free dof belongs to, tied bodies apart, shape (dofs,).
        mark: tells the present order from others.
        kept_mark: tells the order of the folder from others.
    """

    def __init__(self, brake: Brake, store: Store, comm: MPI.Comm):
        """Compare with the folder, or found its order; collective.

        Args:
            brake: operators of the scene.
            store: the results folder.
            comm: processes of the run.

        Raises:
            SceneError: the folder belongs to another mesh.
        """
        self.body = _bodies(brake, comm)
        keys = _keys(brake, self.body, comm)
        self.mark = self.kept_mark = _mark(keys)
        stored = store.load(FILE)
        comm.Barrier()
        self._order: NDArray[np.intp] | None = None
        if stored is None:
            if comm.rank == 0:
                store.save(FILE, keys=keys)
        elif not np.array_equal(stored["keys"], keys):
            self._order, self.kept_mark = _matched(stored["keys"], keys), _mark(stored["keys"])
            if self._order is None:
                raise SceneError(
                    f"{store.directory}: its results belong to another mesh, perhaps of another"
                    " version of gmsh; choose another folder with -o, or --from equilibrium"
                )

    def kept(self, X: NDArray) -> NDArray:
        """Rows of this run, shape (dofs, ...), in the order of the folder."""
        return X if self._order is None else X[self._order]

    def present(self, X: NDArray) -> NDArray:
        """Rows of the folder in the order of this run."""
        if self._order is None:
            return X
        out = np.empty_like(X)
        out[self._order] = X
        return out


def dof_points(brake: Brake, comm: MPI.Comm) -> NDArray:
    """Coordinates [m] and direction (0, 1, 2) of every free dof, shape (dofs, 4); collective."""
    free = brake.elastic.free
    block, component = np.divmod(free.local, 3)
    own = np.column_stack([free.V.tabulate_dof_coordinates()[block], component])
    return np.concatenate(comm.allgather(own))


def _mark(keys: NDArray) -> str:
    return hashlib.sha256(np.ascontiguousarray(keys).tobytes()).hexdigest()[:16]


def _bodies(brake: Brake, comm: MPI.Comm) -> NDArray[np.intp]:
    """Body of each free dof, by the cells: ties and springs join bodies in the stiffness."""
    free, topology = brake.elastic.free, brake.mesh.domain.topology
    V, index_map = free.V, free.V.dofmap.index_map
    cells = np.arange(topology.index_map(topology.dim).size_local)
    local = compat.cell_dofs(V, cells).astype(np.int32)
    node = np.concatenate(
        comm.allgather(index_map.local_to_global(local.reshape(-1)).reshape(local.shape))
    )
    first = np.repeat(node[:, 0], node.shape[1])
    links = sp.coo_matrix(
        (np.ones(first.size), (first, node.reshape(-1))), 2 * [index_map.size_global]
    )
    label = connected_components(links, directed=False)[1]
    own = np.concatenate(comm.allgather(free.local // 3 + index_map.local_range[0]))
    # A body that is held everywhere has no free dof.
    return np.asarray(np.unique(label[own], return_inverse=True)[1], dtype=np.intp)


def _keys(brake: Brake, body: NDArray[np.intp], comm: MPI.Comm) -> NDArray:
    """What tells a free dof from all others: its place, its component, its body's centre [m]."""
    keys = dof_points(brake, comm)
    size = np.ptp(keys[:, :3], axis=0).max()
    keys[:, 3] *= size
    # Nodes of two bodies may lie in one place.
    return np.column_stack([keys, body_centres(keys, body)])


def _matched(stored: NDArray, keys: NDArray) -> NDArray[np.intp] | None:
    """Present number of each stored dof; None if they are not the same dofs."""
    if stored.shape != keys.shape:
        return None
    distance, order = KDTree(keys).query(stored)
    size = np.ptp(keys[:, :3], axis=0).max()
    if not (distance.max() <= SAME * size and np.all(np.bincount(order) == 1)):
        return None
    return np.asarray(order, dtype=np.intp)
