"""Factorisation (MUMPS) with solves in blocks: a single solve is bound by memory."""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

import time
from collections.abc import Iterator
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, of_kind
from brake_fenicsx.errors import InaccurateResult, OfOneProcess
from brake_fenicsx.folder.processes import release_memory

BLOCK = 128

# Room for pivoting [%]; null pivots are detected, not divided by; right-hand sides at once.
MUMPS = {"mat_mumps_icntl_14": 40, "mat_mumps_icntl_24": 1, "mat_mumps_icntl_27": BLOCK}


class Factor(OfOneProcess):
    """L D L' of a symmetric matrix, or L U of another one.

    Attributes:
        seconds: time of the factorisation [s].
        negative_pivots: number of negative eigenvalues of a symmetric A, by Sylvester's law of
            inertia.
        gigabytes: memory of the factor [GB].
    """

    def __init__(self, A: sp.spmatrix, prefix: str = "brake_factor_", symmetric: bool = True):
        """Factor ``A``.

        Args:
            A: the matrix; both triangles of a symmetric one are stored.
            prefix: prefix of its PETSc options.
            symmetric: whether A is symmetric.

        Raises:
            InaccurateResult: the factorisation fails (singular matrix, no memory).
        """
        start = time.perf_counter()
        self._A = A = petsc_matrix(A)
        A.setOption(PETSc.Mat.Option.SYMMETRIC, symmetric)
        self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setOperators(A)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        pc.setType("cholesky" if symmetric else "lu")
        pc.setFactorSolverType("mumps")
        # Through the options, so that the user's own come first; ours leave the database again.
        options = PETSc.Options(prefix)
        ours = [name for name in MUMPS if not options.hasName(name)]
        for name in ours:
            options[name] = MUMPS[name]
        try:
            self._ksp.setFromOptions()
            pc.setFactorSetUpSolverType()
            self._prepare(pc.getFactorMatrix())
            self._ksp.setUp()
        except PETSc.Error as error:
            raise InaccurateResult(f"MUMPS cannot factor the matrix: {error}") from error
        finally:
            for name in ours:
                options.delValue(name)
        F = pc.getFactorMatrix()
        if F.getMumpsInfog(1) < 0:
            raise InaccurateResult(
                f"MUMPS cannot factor the matrix: INFOG(1) = {F.getMumpsInfog(1)}"
            )
        if F.getMumpsInfog(28) > 0:
            raise InaccurateResult(
                "the stiffness is singular: a part can move freely; add supports (the command"
                " check names part and direction)"
            )
        self.negative_pivots: int = int(F.getMumpsInfog(12))
        self.gigabytes: float = F.getMumpsInfog(22) / 1e3
        self._F = F
        self.seconds: float = time.perf_counter() - start

    def _prepare(self, F: PETSc.Mat) -> None:
        """Settings of the factor before it is computed."""

    def solve(self, b: Array | sp.csc_matrix) -> Array:
        """Solve for right-hand sides.

        Args:
            b: shape (rows,) or (rows, columns); a sparse block costs about half as much.

        Returns:
            The solutions, same shape.
        """
        if not isinstance(b, np.ndarray):
            return self._solve_sparse(b)
        if b.ndim == 1:
            return self.solve(b[:, None])[:, 0]
        out = np.empty(b.shape, order="F")
        for part in blocks(b.shape[1]):
            block = np.asfortranarray(b[:, part], dtype=float)
            B, X = dense_matrix(block), dense_matrix(out[:, part])
            self._F.matSolve(B, X)
            B.destroy()
            X.destroy()
        return out

    def _solve_sparse(self, b: sp.csc_matrix) -> Array:
        """Solve for the columns of a sparse matrix; MUMPS passes by what stays zero."""
        out = np.empty(b.shape, order="F")
        for part in blocks(b.shape[1]):
            rows = b[:, part].T.tocsr()
            rows.sort_indices()
            csr = (rows.indptr.astype(np.int32), rows.indices.astype(np.int32), rows.data)
            turned = PETSc.Mat().createAIJ(rows.shape, csr=csr, comm=PETSc.COMM_SELF)
            turned.assemble()
            B = PETSc.Mat().createTranspose(turned)
            X = dense_matrix(out[:, part])
            self._F.matSolve(B, X)
            for m in (X, B, turned):
                m.destroy()
        return out

    def destroy(self) -> None:
        """Free factor and matrix now: PETSc keeps what Python lets go, perhaps to the end."""
        self._F.destroy()
        self._ksp.destroy()
        self._A.destroy()
        release_memory()


class BlockProduct:
    """Products of a sparse matrix with blocks whose columns are contiguous, as in ``Factor.solve``.

    Half the time of SciPy's product, which wants contiguous rows and copies the block.

    Attributes:
        shape: of the matrix.
    """

    def __init__(self, A: sp.spmatrix):
        """Take the matrix."""
        self._A = petsc_matrix(A)
        self.shape: tuple[int, int] = A.shape

    def __call__(self, x: Array) -> Array:
        """A x of a block, shape (columns of A, columns)."""
        out = np.empty((self.shape[0], x.shape[1]), order="F")
        if x.shape[1]:
            B, C = dense_matrix(np.asfortranarray(x, dtype=float)), dense_matrix(out)
            self._A.matMult(B, C)
            B.destroy()
            C.destroy()
        return out


def dense_matrix(a: Array) -> PETSc.Mat:
    """A matrix of PETSc on the memory of an array whose columns are contiguous."""
    A = PETSc.Mat().createDense(a.shape, array=a, comm=PETSc.COMM_SELF)
    A.assemble()
    return A


def petsc_matrix(A: sp.spmatrix) -> PETSc.Mat:
    """A SciPy matrix as a PETSc matrix of this process."""
    A = A.tocsr()
    A.sort_indices()
    csr = (A.indptr.astype(np.int32), A.indices.astype(np.int32), A.data.astype(float))
    B = PETSc.Mat().createAIJ(A.shape, csr=csr, comm=PETSc.COMM_SELF)
    B.assemble()
    return B


def whole(A: Any) -> sp.csr_matrix:
    """A SciPy or PETSc matrix or an array as CSR; all of a distributed one on every process.

    Collective.
    """
    if sp.issparse(A) or isinstance(A, np.ndarray):
        return sp.csr_matrix(A)
    of_kind("matrix", A, PETSc.Mat, "one of SciPy or PETSc, or an array")
    indptr, indices, data = A.getValuesCSR()
    rows = sp.csr_matrix((data, indices, indptr), shape=(indptr.size - 1, A.getSize()[1]))
    if A.comm.size == 1:
        return rows
    return sp.vstack(A.comm.tompi4py().allgather(rows)).tocsr()


def with_interface(
    K: sp.csr_matrix, left: sp.csr_matrix, D: Array, right: sp.csr_matrix
) -> sp.csr_matrix:
    """K + left' diag(D) right, with the interface operators of ``contact``.

    Args:
        K: matrix on the free dofs [N/m].
        left: shape (elements, free dofs).
        D: stiffness of each element [N/m], shape (elements,).
        right: shape (elements, free dofs).

    Returns:
        A new matrix.
    """
    return (K + left.T.tocsr() @ sp.diags(D) @ right).tocsr()


def blocks(columns: int) -> Iterator[slice]:
    """Slices of at most BLOCK columns."""
    for first in range(0, columns, BLOCK):
        yield slice(first, min(first + BLOCK, columns))
