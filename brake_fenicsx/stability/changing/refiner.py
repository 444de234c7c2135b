"""Refinement of a sample's modes on its own full problem, where anything is to be refined."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..modes import Complex
from ..reduced.contact_forces import interface_rows
from ..reduced.damped_correction import Refined
from ..reduced.damped_pairs import Refine
from ..reduced.damped_sample import DampedSample
from ..reduced.refinement import Refinement
from ..reduced.sample import Sample
from ..reduced.trial_vectors import Reference
from .own_bodies import Factored, OwnBodies, Whole
from .view import Seen

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Refiner:
    """Steps on the full problems of samples; what never changes is factored once."""

    def __init__(self, bodies: Sequence[Seen], sigma: float):
        """Keep what all samples have in common.

        Args:
            bodies: the bodies.
            sigma: shift of their eigenvalues [1/s^2].
        """
        self._bodies, self._sigma = bodies, sigma
        self._constant: dict[int, Factored] = {}

    def undamped(
        self, sample: Sample, shapes: list[Array], rows: Index, whole: Callable[[], Whole]
    ) -> Refine:
        """Steps for the modes of a sample.

        Args:
            sample: the sample in the reduced model.
            shapes: kept modes of each body in the coordinates of its space.
            rows: the elements that the sample sees, in its order.
            whole: makes the sample at full order, if any mode is refined.
        """

        def steps(
            kappa: Complex, a: Complex, b: Complex, tolerance: float | Array
        ) -> tuple[Complex, Array]:
            with self._factored(whole, shapes, sample.basis.Lambda) as (full, reference):
                refined = Refinement(sample, reference, full.N[rows], full.T[rows])
                return refined(kappa, a, b, tolerance)

        return steps

    def damped(
        self, sample: DampedSample, shapes: list[Array], rows: Index, whole: Callable[[], Whole]
    ) -> Refine:
        """The same for a damped sample."""

        def steps(
            s: Complex, a: Complex, b: Complex, tolerance: float | Array
        ) -> tuple[Complex, Array]:
            with self._factored(whole, shapes, sample.basis.Lambda) as (full, reference):
                C = sp.csr_matrix(full.M.shape) if full.C is None else full.C
                seen = (A[rows] for A in (full.N, full.T, full.R))
                O, I = interface_rows(sample.basis.names, *seen)
                return Refined(sample, reference, C, O, I)(s, a, b, tolerance)

        return steps

    @contextmanager
    def _factored(
        self, whole: Callable[[], Whole], shapes: list[Array], Lambda: Array
    ) -> Iterator[tuple[Whole, Reference]]:
        """A sample at full order, and its bodies factored for a while."""
        full = whole()
        own = OwnBodies(self._bodies, shapes, Lambda, full, self._sigma, self._constant)
        try:
            yield full, own.reference
        finally:
            own.destroy()
