"""The elastic bodies seen from their contact elements: one factorisation, then dense matrices.

K0 = K + N'W k0 N is symmetric positive definite for a reference stiffness k0 > 0. Its inverse,
seen through N and T, is all that contact needs: exact, dense, small. The solves run in blocks and
are shared by the processes of a communicator, each of which holds the factor.
"""

from dataclasses import dataclass, replace
from typing import Protocol

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError

from .solver import Factor, blocks, with_interface


class Solves(Protocol):
    """A symmetric inverse, known by its products."""

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """Product with a block, sparse or not, shape (dofs, columns)."""


@dataclass(frozen=True, slots=True)
class Compliance:
    """The bodies seen from the contact elements: K0^-1, or K^-1 from a reduced model.

    Without springs a body may be held by contact alone. Its free motions then are coordinates r of
    their own, which follow the gaps. Under contact pressures a - k g both obey
    (1 + NN diag(w k, 1) + NT diag(mu w k)) [g; r] = [g0; 0] + Nf + NN w a + NT mu w a.

    Attributes:
        factor: factor of K0, on every process; None where a reduced model gave the matrices.
        k0: reference stiffness of each element [Pa/m], shape (elements,).
        NN: N K0^-1 N' [m/N], shape (elements, elements); with free coordinates (all, all).
        NT: N K0^-1 T' [m/N], shape (elements, elements); with free coordinates (all, elements).
        Nf: N K0^-1 f [m] of the full loads, shape (elements,) or (all,).
        carried: force [N] that the loads press the faces together with, where there are no springs
            k0 in these matrices; None where there are.
    """

    factor: Factor | None
    k0: Array
    NN: Array
    NT: Array
    Nf: Array
    carried: float | None = None

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """Product of K0^-1 with a block."""
        if self.factor is None:
            raise ValueError("a compliance without a factor")
        return self.factor.solve(b)


@dataclass(frozen=True, slots=True)
class UnitLoads:
    """The bodies seen from the contact elements under multiples of some loads.

    Attributes:
        bodies: under other loads.
        gaps: N K0^-1 of each load [m], shape (elements, loads), or (all, loads) with free
            coordinates.
        carried: forces that each presses the faces together with [N], as ``Compliance.carried``.
    """

    bodies: Compliance
    gaps: Array
    carried: Array | None = None

    def times(self, sizes: Array) -> Compliance:
        """The bodies under the loads times some sizes, shape (loads,)."""
        carried = None if self.carried is None else float(self.carried @ sizes)
        return replace(self.bodies, Nf=self.gaps @ sizes, carried=carried)


def reference_factor(K: sp.csr_matrix, N: sp.csr_matrix, w: Array, k0: Array) -> Factor:
    """Factor of K0 = K + N'W k0 N.

    Args:
        K: stiffness [N/m].
        N: gap operator.
        w: areas [m^2].
        k0: reference stiffness [Pa/m], shape (elements,), positive.

    Returns:
        The factor.

    Raises:
        InaccurateResult: K0 is singular: a part is neither supported nor in contact.
    """
    return Factor(with_interface(K, N, w * k0, N), "brake_compliance_")


def interface_compliance(
    factor: Solves, N: sp.csr_matrix, T: sp.csr_matrix, comm: MPI.Comm
) -> tuple[Array, Array]:
    """N K0^-1 N' and N K0^-1 T' [m/N], each of shape (elements, elements).

    Args:
        factor: factor of K0.
        N: gap operator, shape (elements, dofs).
        T: slip operator, shape (elements, dofs).
        comm: processes that share the columns.
    """
    n = N.shape[0]
    both = sp.vstack([N, T]).tocsr()
    columns = N.T.tocsc()
    ends = np.rint(n * np.arange(comm.size + 1) / comm.size).astype(int)
    share = np.arange(ends[comm.rank], ends[comm.rank + 1])
    out = np.empty((both.shape[0], share.size))
    for b in blocks(share.size):
        out[:, b] = both @ factor.solve(columns[:, share[b]])
    whole = np.hstack(comm.allgather(out))
    NN, TN = whole[:n], whole[n:]
    return 0.5 * (NN + NN.T), np.ascontiguousarray(TN.T)


def compliance(
    K: sp.csr_matrix,
    N: sp.csr_matrix,
    T: sp.csr_matrix,
    w: Array,
    f: Array,
    k0: Array,
    comm: MPI.Comm,
) -> Compliance:
    """Compliance of the bodies at the contact elements.

    Args:
        K: stiffness [N/m].
        N: gap operator, shape (elements, dofs).
        T: slip operator.
        w: areas [m^2].
        f: loads [N], all free dofs.
        k0: reference stiffness [Pa/m].
        comm: processes that share the work.

    Returns:
        The compliance and the factor behind it.

    Raises:
        SceneError: k0 is not positive everywhere.
    """
    if k0.shape != w.shape or not (np.all(np.isfinite(k0)) and np.all(k0 > 0)):
        raise SceneError("k0: positive finite values are needed, one for each contact element")
    factor = reference_factor(K, N, w, k0)
    NN, NT = interface_compliance(factor, N, T, comm)
    return Compliance(factor, k0, NN, NT, np.asarray(N @ factor.solve(f)))
