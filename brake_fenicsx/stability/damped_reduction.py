"""Reduced model of an ensemble with damping: the bodies' own, and that of friction at contact.

The kept real modes and the factor are those of ``reduction``; ``damped_basis`` adds what their rest
does with damping, ``damped_sample`` solves a sample. Beyond the tolerance a mode is refined on the
full problem, ``damped_correction``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult

from .modes import Complex, Modes
from .reduced.contact_forces import interface_rows
from .reduced.damped_basis import DampedBasis, convergence_radius, damped_moments
from .reduced.damped_correction import Refined
from .reduced.damped_pairs import sample_modes
from .reduced.damped_sample import DampedSample
from .reduction import Reduced

Array = NDArray[np.float64]

# The series in lambda must converge up to this multiple of the band's end.
REACH = 1.15


class DampedReduced:
    """Damped complex modes of any sample of an ensemble, dense and fast.

    Attributes:
        reduced: real modes and factor of the reference.
        basis: the offline result.
        C: damping of the bodies [N s/m], shape (dofs, dofs).
        seconds: time of the offline stage [s].
    """

    def __init__(
        self,
        reduced: Reduced,
        C: sp.csr_matrix | None,
        R: sp.csr_matrix,
        along: bool,
        across: bool,
        comm: MPI.Comm | None = None,
        progress: Callable[[int], None] = lambda n: None,
        known: Sequence[Array] | None = None,
    ):
        """Offline stage.

        Args:
            reduced: reduced model of the same brake without damping; its order may be 0.
            C: damping of the bodies [N s/m]; None where they have none.
            R: slip across the sliding direction, shape (elements, dofs).
            along: whether forces along the slip follow its rate (falling friction).
            across: whether forces across it do (sliding damping).
            comm: processes that share the work; this process alone if None.
            progress: called with the number of columns done.
            known: G of an earlier offline stage of the same problem.

        Raises:
            InaccurateResult: so strongly damped that the series does not reach the band's end.
        """
        start = time.perf_counter()
        comm = MPI.COMM_SELF if comm is None else comm
        own, Phi, Lambda = reduced.basis, reduced.Phi, reduced.basis.Lambda
        self.reduced, self.C = reduced, sp.csr_matrix(reduced.M.shape) if C is None else C
        names = "N" + "T" * along + "R" * across
        self.O, self.I = interface_rows(names, reduced.N, reduced.T, R)
        G = known or damped_moments(
            reduced.factor, (Phi, Lambda), reduced.M, C, self.O, self.I, comm, progress
        )
        radius = convergence_radius(G, self.O.shape[0], self.I.shape[0], own.limit)
        high = 2 * np.pi * reduced.band[1]
        if not radius > REACH * high:
            raise InaccurateResult(
                f"damping too strong for the reduced model: its series converges up to"
                f" {radius / 2 / np.pi:.0f} Hz"
            )
        seen = self.O @ Phi
        answers = {"N": own.compliance[0], "T": own.compliance[2]}
        if across:
            last = slice(seen.shape[0] - len(own.w), seen.shape[0])
            P = seen[last]
            answers["R"] = G[0][last, 2 * len(own.w) : self.I.shape[0]] + (P / Lambda) @ P.T
        self.basis = DampedBasis(
            Lambda, Phi.T @ (self.C @ Phi), seen, self.I @ Phi, tuple(G), names, answers,
            own.w, own.k0, own.limit, radius,
        )  # fmt: skip
        self.seconds = time.perf_counter() - start

    def modes(
        self,
        k: Array,
        mu: float | Array,
        along: Array,
        across: Array,
        zeta_max: float,
        tolerance: float = 1e-6,
    ) -> Modes:
        """Complex modes of one sample in the band.

        Args:
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            along: p mu'(V) of each element [Pa s/m].
            across: mu p / V of each element [Pa s/m].
            zeta_max: decaying modes up to this damping ratio are looked for.
            tolerance: relative error of lambda; modes estimated beyond it are refined on the full
                problem, and ``iterations`` says how many.

        Returns:
            The modes in coordinates of the reference, see ``Reduced.modes``.

        Raises:
            InaccurateResult: the count differs.
        """
        start = time.perf_counter()
        sample = self._sample(k, mu, along, across)
        refined = Refined(sample, self.reduced.reference, self.C, self.O, self.I)
        return sample_modes(sample, self.reduced.band, zeta_max, start, tolerance, refined)

    def expand(
        self, s: Complex, a: Complex, k: Array, mu: float | Array, along: Array, across: Array
    ) -> Complex:
        """Displacements of some modes of a sample.

        Args:
            s: eigenvalues lambda [1/s], shape (chosen,).
            a: their coordinates, columns of ``right``, shape (modes, chosen).
            k: contact stiffness of the sample [Pa/m].
            mu: its friction coefficient.
            along: its p mu'(V) [Pa s/m].
            across: its mu p / V [Pa s/m].

        Returns:
            Shape (dofs, chosen).
        """
        sample = self._sample(k, mu, along, across)
        return Refined(sample, self.reduced.reference, self.C, self.O, self.I).right(s, a)

    def _sample(self, k: Array, mu: float | Array, along: Array, across: Array) -> DampedSample:
        mu = np.broadcast_to(np.asarray(mu, float), k.shape)
        return DampedSample(self.basis, k, mu, along, across)
