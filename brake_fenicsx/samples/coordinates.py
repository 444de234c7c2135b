"""Coordinates that modes are followed in across samples, and the layers' masses in them.

Those of the kept modes of a reduced model; of a study at full order those of real modes of the
reference.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.build.parametric import ParametricBrake
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.condensation import Solves

if TYPE_CHECKING:
    from brake_fenicsx.stability.substructures import ReducedModel

Array = NDArray[np.float64]

SHAPES = "cache/shapes.npz"
LAYERS = "cache/layers.npz"

# Real modes up to this multiple of the band tell modes apart where there is no reduced model.
FAMILIES = 1.3


class FamilyCoordinates:
    """Coordinates of modes of any sample of a study.

    Attributes:
        grams: mass of each layer between the kept modes of the reduced models, shape (kept modes,
            kept modes); none at full order.
    """

    def __init__(
        self, brake: ParametricBrake, model: ReducedModel | None, shapes: Array | None,
        grams: dict[str, Array] | None = None,
    ):  # fmt: skip
        """Take the coordinates of a reduced model, or of shapes.

        Args:
            brake: the brake.
            model: a reduced model of it.
            shapes: real modes, shape (dofs, modes).
            grams: see above.
        """
        self._brake, self._model, self._shapes = brake, model, shapes
        self.grams = grams or {}

    def of(self, u: NDArray[Any]) -> NDArray[Any] | None:
        """Coordinates of displacements, shape (dofs, columns); None without any."""
        if self._model is not None:
            return self._model.coordinates(self._brake.central_mass, u)
        return None if self._shapes is None else self._shapes.T @ (self._brake.M @ u)

    def displacements(self, coordinates: NDArray[Any]) -> NDArray[Any]:
        """Displacements of modes by their coordinates alone.

        Args:
            coordinates: shape (coordinates, columns).

        Returns:
            Shape (dofs, columns).
        """
        if self._model is not None:
            return self._model.kept_displacements(coordinates)
        if self._shapes is None:
            raise ValueError("families have no coordinates")
        return np.asarray(self._shapes @ coordinates)


def layer_grams(
    model: ReducedModel, masses: Callable[[], dict[str, sp.csr_matrix]], mark: str, store: Store,
    comm: MPI.Comm,
) -> dict[str, Array]:  # fmt: skip
    """Layers' masses of the kept modes, from the folder where they are there; collective.

    Args:
        model: the reduced model.
        masses: gives the mass of each layer [kg].
        mark: tells the mesh.
        store: the results folder.
        comm: processes of the run.
    """
    mark = f"{mark} {model.bodies[-1].modes.stop}"

    def make() -> dict[str, Array]:
        stored = store.load(LAYERS) or {}
        if str(stored.pop("mark", "")) == mark:
            return {key.removeprefix("of_"): gram for key, gram in stored.items()}
        made = {name: model.coordinates(A) for name, A in masses().items()}
        named = {f"of_{name}": gram for name, gram in made.items()}
        store.save(LAYERS, mark=np.array(mark), **named)
        return made

    return on_first(make, comm)


def reference_shapes(
    factor: Solves, M: sp.csr_matrix, end: float, store: Store, comm: MPI.Comm
) -> Array:
    """Real modes of the reference that families are followed in, shape (dofs, modes); collective.

    They are kept: an eigensolver may return them with other signs.

    Args:
        factor: of the reference stiffness.
        M: mass [kg].
        end: of the band [Hz].
        store: the results folder.
        comm: processes of the run.
    """
    from brake_fenicsx.stability.eigensolvers.lanczos import lowest_modes

    def make() -> Array:
        if (stored := store.load(SHAPES)) is not None:
            return np.asarray(stored["shapes"])
        shapes = lowest_modes(factor, M, (2 * np.pi * FAMILIES * end) ** 2).Phi
        store.save(SHAPES, shapes=shapes)
        return shapes

    return np.asarray(on_first(make, comm))
