"""The offline stage of all bodies of a brake, each once, with any degrees of the interpolation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.processes import in_turns

from .component import image_arrays, originals_and_images
from .contact_rows import Rows
from .parameters import Parameters
from .reduction import Reduction, kept_modes
from .substructure import Substructure

Index = NDArray[np.intp]


class OfflineBodies:
    """Bodies and the modes that they keep, which no degree changes.

    Attributes:
        orders: degree in each parameter to begin with, shape (d,).
    """

    def __init__(
        self,
        substructures: Sequence[Substructure],
        rows: Rows,
        parameters: Parameters,
        degrees: tuple[int, ...],
        omega: float,
        reach: float | None,
        comm: MPI.Comm,
    ):
        """Compute the kept modes; collective.

        Args:
            substructures: the bodies.
            rows: blocks of contact rows.
            parameters: box of the materials.
            degrees: degree of the interpolation of each coefficient to begin with.
            omega: end of the band [rad/s].
            reach: kept modes lie below this multiple of it; chosen for each body if None.
            comm: processes that share the work.
        """
        self.orders: Index = np.full(parameters.dimension, degrees[0])
        self._originals, self._images = originals_and_images(substructures, parameters)
        self._given = rows, parameters, omega, comm
        self._degrees, self._comm = degrees, comm
        self._modes = [
            *in_turns(
                len(self._originals),
                lambda i: kept_modes(self._originals[i], parameters, omega, reach),
                comm,
            )
        ]

    def points(self, orders: Index) -> int:
        """Most points of the box where a body is computed with some degrees."""
        return max(reduction.points for reduction in self._planned(orders))

    def arrays(
        self, orders: Index, progress: Callable[[int], Callable[[int], None]]
    ) -> dict[str, NDArray[Any]]:
        """What ``placed`` takes, on the first process alone; collective.

        Args:
            orders: degree in each parameter, shape (d,).
            progress: see ``ReducedModel.offline``.
        """
        reductions = self._planned(orders)
        advance = progress(sum(reduction.factors for reduction in reductions))
        # The largest body takes most memory: it comes before the values of others are there.
        order = sorted(range(len(reductions)), key=lambda i: -self._originals[i].dofs.size)
        made = {i: reductions[i].arrays(advance) for i in order}
        if self._comm.rank > 0:
            return {}
        arrays = {f"{i}.{name}": a for i, one in made.items() for name, a in one.items()}
        return {**arrays, **image_arrays(self._images), "orders": orders}

    def _planned(self, orders: Index) -> list[Reduction]:
        rows, parameters, omega, comm = self._given
        more = int(max(orders, default=self._degrees[0])) - self._degrees[0]
        degrees = tuple(degree + more for degree in self._degrees)
        return [
            Reduction(body, kept, rows, parameters, degrees, orders, omega, comm)
            for body, kept in zip(self._originals, self._modes, strict=True)
        ]
