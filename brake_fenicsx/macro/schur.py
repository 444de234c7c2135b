"""Flexibility of the rows of an interface by one factorisation with a Schur complement (MUMPS).

With B the rows, the Schur complement of

    [ P  B' ]
    [ B  0  ]     on its last block is   -B P^-1 B',

all columns at once, without a pass of solves through the whole factor. petsc4py does not show these
functions of PETSc: they are called in the library that petsc4py is linked with. Where that lacks
them, blocks of solves give the same.
"""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

import ctypes
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import InaccurateResult

from .solver import Factor, blocks

# Largest relative residual of a solve, and its largest difference from the flexibility: what a
# factor that went wrong exceeds by far.
RESIDUAL, DIFFERENCE = 1e-6, 1e-6

# Symbols are looked up through the module that is linked with the library.
_petsc = ctypes.CDLL(PETSc.__file__)
_NAMES = ("MatFactorSetSchurIS", "MatFactorGetSchurComplement")
AVAILABLE = all(hasattr(_petsc, name) for name in _NAMES)

# Of MUMPS: with 0, solves leave the rows of the Schur complement out; with 0, a transposed solve.
INTERIOR, TURNED = 26, 9


class InterfaceFactor(Factor):
    """Factor of P, and the flexibility of the rows of an interface.

    Attributes:
        flexibility: B P^-1 B', shape (rows, rows).
    """

    def __init__(self, P: sp.csr_matrix, B: sp.csr_matrix, symmetric: bool = True):
        """Factor P and check the flexibility by a solve.

        Args:
            P: square matrix, shape (n, n); may be indefinite.
            B: rows of the interface, shape (rows, n).
            symmetric: whether P is symmetric.

        Raises:
            InaccurateResult: P is singular, or its factor is wrong.
        """
        self._n, self._kept, self._symmetric = P.shape[0], B.shape[0] * AVAILABLE, symmetric
        whole = P
        if self._kept:
            every = np.arange(self._kept)
            # The diagonal of the last block is stored, though it is zero.
            zero = sp.coo_matrix((np.zeros(self._kept), (every, every)), (self._kept,) * 2)
            whole = sp.bmat([[P, B.T], [B, zero]], format="csr")
        super().__init__(whole, "brake_interface_", symmetric)
        try:
            self.flexibility: Array = self._complement() if self._kept else self._solved(B)
            self._check(P, B)
        except InaccurateResult:
            self.destroy()
            raise

    def solve(self, b: Array, transpose: bool = False) -> Array:
        """P^-1 b of a dense block, or P^-T b."""
        if not b.shape[1]:
            return np.zeros(b.shape)
        given = np.zeros((self._n + self._kept, b.shape[1]), order="F")
        given[: self._n] = b
        self._F.setMumpsIcntl(INTERIOR, 0)
        self._F.setMumpsIcntl(TURNED, int(not transpose))
        try:
            return super().solve(given)[: self._n]
        finally:
            self._F.setMumpsIcntl(TURNED, 1)

    def _prepare(self, F: PETSc.Mat) -> None:
        """Keep the last rows out of the elimination."""
        if not self._kept:
            return
        rows = np.arange(self._n, self._n + self._kept, dtype=PETSc.IntType)
        chosen = PETSc.IS().createGeneral(rows, comm=PETSc.COMM_SELF)
        _call("MatFactorSetSchurIS", ctypes.c_void_p(F.handle), ctypes.c_void_p(chosen.handle))

    def _complement(self) -> Array:
        """The flexibility from the Schur complement: of a symmetric one the lower half is there."""
        S, status, values = ctypes.c_void_p(), ctypes.c_int(), ctypes.POINTER(ctypes.c_double)()
        F = ctypes.c_void_p(self._F.handle)
        _call("MatFactorGetSchurComplement", F, ctypes.byref(S), ctypes.byref(status))
        _call("MatDenseGetArray", S, ctypes.byref(values))
        rows = self._kept
        A = -np.ctypeslib.as_array(values, shape=(rows, rows)).T
        _call("MatDenseRestoreArray", S, ctypes.byref(values))
        _call("MatFactorRestoreSchurComplement", F, ctypes.byref(S), status)
        if self._symmetric:
            upper = np.triu_indices(rows, 1)
            A[upper] = A.T[upper]
        return A

    def _solved(self, B: sp.csr_matrix) -> Array:
        """The flexibility by blocks of solves."""
        columns, out = B.T.tocsc(), np.empty((B.shape[0],) * 2)
        for b in blocks(B.shape[0]):
            out[:, b] = B @ super().solve(columns[:, b])
        return out

    def _check(self, P: sp.csr_matrix, B: sp.csr_matrix) -> None:
        """Compare a combination of the columns of the flexibility with a solve.

        Raises:
            InaccurateResult: they differ.
        """
        if not B.shape[0]:
            return
        v = np.random.default_rng(0).standard_normal((B.shape[0], 1))
        load = B.T @ v
        if not np.any(load):  # rows of displacements that are held
            return
        x = self.solve(load)
        rest = np.linalg.norm(P @ x - load) / np.linalg.norm(load)
        seen = B @ x
        off = np.linalg.norm(seen - self.flexibility @ v) / np.linalg.norm(seen)
        if not (rest <= RESIDUAL and off <= DIFFERENCE):
            raise InaccurateResult(
                f"the factor of a body is wrong: residual {rest:.1e}, flexibility of the contact"
                f" rows off by {off:.1e}"
            )


def _call(name: str, *arguments: Any) -> None:
    """A function of the C interface of PETSc.

    Raises:
        InaccurateResult: it fails.
    """
    code = getattr(_petsc, name)(*arguments)
    if code:
        raise InaccurateResult(f"{name} of PETSc fails: error {code}")
