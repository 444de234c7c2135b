"""Which mesh a results folder belongs to, and where each free dof lies.

The dofs are numbered by gmsh and DOLFINx, the same on every process and in every run of the same
versions. What a folder keeps of them is refused by a run that numbers them otherwise.
"""

from __future__ import annotations

import hashlib

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.build.brake import Brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.faces import body_of_nodes

FILE = "cache/dofs.npz"

# Two dofs whose keys differ by less, relative to the size of the brake, are the same.
SAME = 1e-7


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
        self.body: NDArray[np.intp] = _bodies(brake)
        keys = _keys(brake, self.body)
        stored = store.load(FILE)
        comm.Barrier()
        if stored is None:
            if comm.rank == 0:
                store.save(FILE, keys=keys)
        elif not _same(stored["keys"], keys):
            raise SceneError(
                f"{store.directory}: its results belong to another mesh, perhaps of another"
                " version of gmsh or DOLFINx; choose another folder with -o, or --from equilibrium"
            )
        # That of the first run: another one may differ from it by round-off.
        kept = keys if stored is None else stored["keys"]
        self.mark: str = hashlib.sha256(np.ascontiguousarray(kept).tobytes()).hexdigest()[:16]


def dof_points(brake: Brake) -> NDArray:
    """Coordinates [m] and direction (0, 1, 2; 3: none) of every free dof, shape (dofs, 4)."""
    free = brake.elastic.free
    node, component = np.divmod(free.local, 3)
    own = np.column_stack([free.V.tabulate_dof_coordinates()[node], component])
    return np.concatenate([own, free.places[:, :4]])


def body_centres(points: NDArray, body: NDArray[np.intp]) -> NDArray:
    """Centre of the body of every dof [m], shape (dofs, 3).

    Args:
        points: coordinates [m] of every dof in the first three columns.
        body: number of the body of every dof, shape (dofs,).
    """
    count = np.bincount(body)
    return np.column_stack([np.bincount(body, x)[body] / count[body] for x in points[:, :3].T])


def dof_places(brake: Brake, body: NDArray[np.intp]) -> NDArray:
    """``dof_points`` and ``body_centres`` of every free dof, shape (dofs, 7)."""
    points = dof_points(brake)
    return np.column_stack([points, body_centres(points, body)])


def _bodies(brake: Brake) -> NDArray[np.intp]:
    """Body of each free dof; ties and springs join bodies in the stiffness."""
    free = brake.elastic.free
    label = body_of_nodes(free.V)
    # A body that is held everywhere has no free dof.
    given = label.size + free.places[:, 4].astype(int)
    every = np.concatenate([label[free.local // 3], given])
    return np.asarray(np.unique(every, return_inverse=True)[1], dtype=np.intp)


def _keys(brake: Brake, body: NDArray[np.intp]) -> NDArray:
    """What tells a free dof from all others: its place, its component, its body's centre [m]."""
    keys = dof_points(brake)
    size = np.ptp(keys[:, :3], axis=0).max()
    keys[:, 3] *= size
    # Nodes of two bodies may lie in one place.
    return np.column_stack([keys, body_centres(keys, body)])


def _same(stored: NDArray, keys: NDArray) -> bool:
    """Whether all dofs are the same, but for round-off."""
    if stored.shape != keys.shape:
        return False
    return bool(np.abs(stored - keys).max() <= SAME * np.ptp(keys[:, :3], axis=0).max())
