"""Factorisation of a non-symmetric matrix (MUMPS) with solves in blocks."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from brake_fenicsx.errors import InaccurateResult
from brake_fenicsx.macro.condensation import petsc_matrix
from brake_fenicsx.macro.solver import MUMPS, blocks

Array = NDArray[np.float64]


class LU:
    """L U of a matrix of this process."""

    def __init__(self, A: sp.spmatrix, prefix: str = "brake_lu_"):
        """Factor.

        Args:
            A: the matrix.
            prefix: prefix of its PETSc options.

        Raises:
            InaccurateResult: A is singular, or there is no memory.
        """
        self._A = petsc_matrix(A)
        self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setOperators(self._A)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        pc.setType("lu")
        pc.setFactorSolverType("mumps")
        options = PETSc.Options(prefix)
        ours = [name for name in MUMPS if not options.hasName(name)]
        for name in ours:
            options[name] = MUMPS[name]
        try:
            self._ksp.setFromOptions()
            self._ksp.setUp()
        except PETSc.Error as error:
            raise InaccurateResult(f"MUMPS cannot factor the matrix: {error}") from error
        finally:
            for name in ours:
                options.delValue(name)
        self._F = pc.getFactorMatrix()
        if self._F.getMumpsInfog(1) < 0 or self._F.getMumpsInfog(28) > 0:
            raise InaccurateResult("MUMPS cannot factor the matrix: it is singular")

    def solve(self, b: Array) -> Array:
        """Solve for a block of right-hand sides, shape (rows, columns)."""
        n = self._A.getSize()[0]
        out = np.empty(b.shape, order="F")
        for part in blocks(b.shape[1]):
            block = np.asfortranarray(b[:, part], dtype=float)
            B = PETSc.Mat().createDense(block.shape, array=block, comm=PETSc.COMM_SELF)
            X = PETSc.Mat().createDense((n, block.shape[1]), comm=PETSc.COMM_SELF)
            X.setUp()
            for m in (B, X):
                m.assemble()
            self._F.matSolve(B, X)
            out[:, part] = X.getDenseArray()
            B.destroy()
            X.destroy()
        return out

    def destroy(self) -> None:
        """Free the factor."""
        self._ksp.destroy()
        self._A.destroy()
