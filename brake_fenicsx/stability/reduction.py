"""Reduced model of a whole ensemble: real modes of a reference, the interface treated exactly.

Samples differ in the contact stiffness k of every element and in mu. With K0 = K + N'W k0 N,
D = W k, dD = W (k - k0) the undamped problem reads, for kappa = -lambda^2,

    (K0 - kappa M) phi = -(N' dD + mu T' D) N phi.

Phi, Lambda are the real modes of (K0, M) below a cutoff; the rest of (K0 - kappa M)^-1 is
R0 + kappa R1 + kappa^2 R2 + ..., R_j = K0^-1 (M K0^-1)^j - Phi Lambda^-(j+1) Phi'. The gaps
N phi = E(kappa)^-1 Phi_N a follow with E = I + C0 + kappa C1 + ..., C_j = R_j,NN dD + mu R_j,NT D,
and leave a pencil in the modal coordinates a, to first order in kappa. R2 corrects each eigenvalue
by the two-sided quotient and bounds what is left out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import BrakeError, InaccurateResult, SceneError
from brake_fenicsx.macro.condensation import (
    gathered,
    interface_moments,
    petsc_matrix,
    reference_factor,
    slip_compliance,
)
from brake_fenicsx.macro.solver import Factor, add_interface, local_rows

from .complex_columns import on_parts
from .full.lanczos import lowest_modes
from .modes import Complex, Modes
from .reduced.basis import Basis
from .reduced.correction import Deeper
from .reduced.deflation import Deflated
from .reduced.refinement import Refinement
from .reduced.sample import Sample
from .reduced.sample_pairs import undamped_modes
from .reduced.trial_vectors import Reference

Array = NDArray[np.float64]

# Modes are kept up to this multiple of the band's highest frequency.
CUTOFF = 1.7

# Orders of the residual flexibility; those beyond 2 serve the error alone.
ORDER = 5


class Reduced:
    """Complex modes of any sample of an ensemble, dense and fast.

    Attributes:
        basis: the offline result.
        band: lowest and highest frequency [Hz].
        factor: factor of K0, on every process.
        Phi: real modes of the reference, shape (dofs, modes).
        seconds: time of the offline stage by part [s].
    """

    def __init__(
        self,
        K: Any,
        M: Any,
        N: sp.csr_matrix,
        T: sp.csr_matrix,
        w: Array,
        k0: Array | float,
        band: tuple[float, float],
        cutoff: float | None = None,
        comm: MPI.Comm | None = None,
        progress: Callable[[int], None] = lambda n: None,
        known: tuple[Basis, Array] | None = None,
        order: int = ORDER,
    ):
        """Offline stage.

        Args:
            K: elastic stiffness [N/m], SciPy sparse or PETSc.
            M: mass [kg], likewise.
            N: gap operator, shape (elements, dofs).
            T: slip operator, shape (elements, dofs).
            w: areas of the elements [m^2], shape (elements,).
            k0: reference stiffness [Pa/m], one or one per element, positive.
            band: lowest and highest frequency [Hz].
            cutoff: frequency up to which real modes are kept [Hz]; 1.7 times the band's if None.
            comm: processes that share the work; this process alone if None.
            progress: called with the number of interface columns done.
            known: basis and mode shapes of an earlier offline stage of the same problem.
            order: largest j of R_j; 0 leaves a basis for ``DampedReduced`` and equilibria alone.

        Raises:
            SceneError: the cutoff lies inside the band.
            InaccurateResult: K0 is singular, the inertia count finds a missing mode, or the
                reference has no mode below the cutoff.
        """
        comm = MPI.COMM_SELF if comm is None else comm
        K, M = (petsc_matrix(A) if sp.issparse(A) else gathered(A) for A in (K, M))
        k0 = np.broadcast_to(np.asarray(k0, float), w.shape).copy()
        cutoff = CUTOFF * band[1] if cutoff is None else cutoff
        if not cutoff > band[1]:
            raise SceneError(f"cutoff {cutoff:g} Hz must lie above the band's {band[1]:g} Hz")
        limit = (2 * np.pi * cutoff) ** 2
        times = [time.perf_counter()]
        self.factor = reference_factor(K, N, w, k0)
        times.append(time.perf_counter())
        rows = local_rows(M)
        # The three components of a displacement share no mass: two thirds of the pattern.
        rows.eliminate_zeros()
        self.band, self.N, self.T, self.M = band, N, T, rows
        self.seconds = {"factor": times[1] - times[0]}
        if known is not None:
            self.basis, self.Phi = known
            return
        found: Any = None
        if comm.rank == 0:
            # Meanwhile the other processes begin with the slips.
            try:
                modes = lowest_modes(self.factor, rows, limit)
                found = modes.Phi, modes.Lambda, _inertia(K, M, N, w * k0, limit)
            except BrakeError as error:
                found = error
        times.append(time.perf_counter())
        TT = slip_compliance(self.factor, T, comm, 0.0 if comm.size > 1 else 1.0)
        found = comm.bcast(found, root=0)
        if isinstance(found, BrakeError):
            raise found
        self.Phi, Lambda, expected = found
        if expected != len(Lambda):
            raise InaccurateResult(
                f"the reference has {expected} modes below {np.sqrt(limit) / 2 / np.pi:.0f} Hz by"
                f" inertia, {len(Lambda)} were found"
            )
        if not expected:
            raise InaccurateResult(
                f"the reference has no mode below {cutoff:.0f} Hz: raise the cutoff"
            )
        rest = Deflated(self.factor, self.Phi, Lambda)
        # What was taken out of X is not in M X either, and grows back in two steps at the earliest.
        moments = interface_moments(rest, rows, N, T, order, comm, progress, between=self.factor)
        times.append(time.perf_counter())
        self.seconds |= {"modes": times[2] - times[1], "interface": times[3] - times[2]}
        Phi_N, Phi_T = N @ self.Phi, T @ self.Phi
        NN, NT = (tuple(m[i] for m in moments) for i in (0, 1))
        P, TT_0 = Phi_N / Lambda, TT - (Phi_T / Lambda) @ Phi_T.T
        whole = (NN[0] + P @ Phi_N.T, NT[0] + P @ Phi_T.T, TT)
        self.basis = Basis(Lambda, Phi_N, Phi_T, NN, NT, TT_0, whole, w, k0, limit)

    def modes(self, k: Array, mu: float | Array, tolerance: float = 1e-6) -> Modes:
        """Complex modes of one sample in the band.

        Args:
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
            tolerance: relative error of lambda; modes estimated beyond it are corrected on the full
                problem, and ``iterations`` says how many.

        Returns:
            The modes in coordinates of the reference: ``right`` and ``left`` have one row per kept
            real mode; ``expand`` gives displacements. ``residual`` bounds the residual of the full
            problem in the norm of K0^-1, relative to the mode's norm in K0.
        """
        start = time.perf_counter()
        deeper = Deeper(self.reference.rest, self.M, self.N, self.T, self.basis.limit)
        sample = Sample(self.basis, k, mu)
        refined = Refinement(sample, self.reference, self.N, self.T)
        return undamped_modes(sample, self.band, start, tolerance, deeper, refined)

    def expand(self, s: Complex, a: Complex, k: Array, mu: float | Array) -> Complex:
        """Displacements of some modes of a sample.

        Args:
            s: eigenvalues lambda [1/s], shape (chosen,).
            a: their coordinates, columns of ``right``, shape (modes, chosen).
            k: contact stiffness of the sample [Pa/m].
            mu: its friction coefficient, one or one per element.

        Returns:
            Shape (dofs, chosen).
        """
        kappa = -(s**2)
        g = Sample(self.basis, k, mu).gaps(a, kappa)
        D, dD = self.basis.w * k, self.basis.w * (k - self.basis.k0)
        force = self.N.T @ (dD[:, None] * g) + self.T.T @ ((mu * D)[:, None] * g)
        rest = self.reference.rest
        first = total = on_parts(rest.solve, force)
        for _ in range(2):
            total = first + on_parts(rest.solve, kappa * (self.M @ total))
        return self.Phi @ a - total

    @property
    def reference(self) -> Reference:
        """The brake on the springs k0, and its kept modes."""
        Lambda = self.basis.Lambda
        return Reference(Deflated(self.factor, self.Phi, Lambda), self.M, self.Phi, Lambda)


def _inertia(K: PETSc.Mat, M: PETSc.Mat, N: sp.csr_matrix, D: Array, limit: float) -> int:
    """Number of modes of the reference below the limit, by Sylvester's law of inertia."""
    shifted = add_interface(K, N, D, N)
    shifted.axpy(-limit, M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    factor = Factor(shifted, "brake_inertia_")
    expected = factor.negative_pivots
    factor.destroy()
    return expected
