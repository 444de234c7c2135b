"""Factorisation (MUMPS) with solves in blocks, or with the flexibility of an interface.

Blocks, because a single solve is bound by memory. The flexibility of the rows B of an interface
comes with the factorisation: the Schur complement of

    [ P  B' ]
    [ B  0  ]     on its last block is   -B P^-1 B',

all columns at once, without a pass of solves through the whole factor. petsc4py does not show these
functions of PETSc: they are called in the library that petsc4py is linked with. Where that lacks
them, blocks of solves give the same.
"""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

import ctypes
import time
from collections.abc import Callable, Iterator
from functools import partial
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

# Largest relative difference of displacements of the interface that are known from those of a
# factor: what one that went wrong exceeds by far.
DIFFERENCE = 1e-6

# Option that throws the factor away: what is left are pivots, and the Schur complement.
THROWN = "mat_mumps_icntl_31"

# Symbols are looked up through the module that is linked with the library.
_petsc = ctypes.CDLL(PETSc.__file__)
_NAMES = ("MatFactorSetSchurIS", "MatFactorGetSchurComplement")
AVAILABLE = all(hasattr(_petsc, name) for name in _NAMES)

# Of MUMPS: with 0, solves leave the rows of the Schur complement out; with 0, a transposed solve.
INTERIOR, TURNED = 26, 9


class Factor(OfOneProcess):
    """L D L' of a symmetric matrix, or L U of another one.

    Attributes:
        seconds: time of the factorisation [s].
        negative_pivots: number of negative eigenvalues of a symmetric A, by Sylvester's law of
            inertia.
        gigabytes: memory of the factor [GB].
    """

    def __init__(
        self, A: sp.spmatrix | PETSc.Mat, prefix: str = "brake_factor_", symmetric: bool = True,
        solves: bool = True,
    ):  # fmt: skip
        """Factor ``A``.

        Args:
            A: the matrix; of a symmetric one the upper triangle is taken.
            prefix: prefix of its PETSc options.
            symmetric: whether A is symmetric.
            solves: whether the factor is kept for them, or thrown away as it comes.

        Raises:
            InaccurateResult: the factorisation fails (singular matrix, no memory).
        """
        start = time.perf_counter()
        self._A = A = A if isinstance(A, PETSc.Mat) else petsc_matrix(A, symmetric)
        self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setOperators(A)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        pc.setType("cholesky" if symmetric else "lu")
        pc.setFactorSolverType("mumps")
        # Through the options, so that the user's own come first; ours leave the database again.
        options = PETSc.Options(prefix)
        values = {**MUMPS, THROWN: int(not solves)}
        ours = [name for name in values if not options.hasName(name)]
        for name in ours:
            options[name] = values[name]
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
            raise InaccurateResult(f"""MUMPS cannot factor the matrix: INFOG(1) =
                {F.getMumpsInfog(1)}""")
        if F.getMumpsInfog(28) > 0:
            raise InaccurateResult("""the stiffness is singular: a part can move freely; add
                supports (the command check names part and direction)""")
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


def petsc_matrix(A: sp.spmatrix, symmetric: bool = False) -> PETSc.Mat:
    """A SciPy matrix as a PETSc matrix of this process; of a symmetric one the upper triangle."""
    A = A.tocsr()
    A.sort_indices()
    indptr, indices = (np.asarray(places, PETSc.IntType) for places in (A.indptr, A.indices))
    csr, B = (indptr, indices, np.asarray(A.data, float)), PETSc.Mat()
    create = partial(B.createSBAIJ, bsize=1) if symmetric else B.createAIJ
    create(A.shape, csr=csr, comm=PETSc.COMM_SELF)
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


class InterfaceFactor(Factor):
    """Factor of P, and the flexibility of the rows of an interface.

    Attributes:
        flexibility: B P^-1 B', shape (rows, rows).
    """

    def __init__(
        self, P: Callable[[], sp.csr_matrix], B: sp.csr_matrix, symmetric: bool = True,
        solves: bool = True,
    ):  # fmt: skip
        """Factor P and check the flexibility.

        Args:
            P: makes a square matrix, shape (n, n); may be indefinite. It is not held.
            B: rows of the interface, shape (rows, n).
            symmetric: whether P is symmetric.
            solves: whether the factor is kept for them; two thirds of the memory.

        Raises:
            InaccurateResult: P is singular, or its factor is wrong.
        """
        A, rows, rng = P(), B.shape[0], np.random.default_rng(0)
        self._n, self._symmetric = A.shape[0], symmetric
        # P^-1 of these is known at the interface, of the first through the flexibility.
        size = np.sqrt(np.asarray(B.multiply(B).sum(axis=1)))
        size = np.where(size > 0, size, 1.0)
        v, x = rng.standard_normal((rows, 1)) / size, rng.standard_normal((self._n, 1))
        load = np.hstack([B.T @ v, A @ x])
        checked, solves = bool(np.any(load[:, 0])), solves or not AVAILABLE
        wide = sp.vstack([B, load.T[: 2 * checked]]).tocsr() if checked and not solves else B
        self._kept = wide.shape[0] * AVAILABLE
        if self._kept:
            every = np.arange(self._kept)
            # The diagonal of the last block is stored, though it is zero.
            zero = sp.coo_matrix((np.zeros(self._kept), (every, every)), (self._kept,) * 2)
            A = sp.triu(A) if symmetric else A
            A = sp.bmat([[A, wide.T], [None if symmetric else wide, zero]])
        A = petsc_matrix(A, symmetric)
        super().__init__(A, "brake_interface_", symmetric, solves)
        try:
            G = self._complement() if self._kept else self._solved(B)
            self.flexibility: Array = G[:rows, :rows]
            if checked:
                seen = G[:rows, rows:] if not solves else B @ self.solve(load)
                self._check(seen / size, np.hstack([self.flexibility @ v, B @ x]) / size)
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
        for b in blocks(rows * self._symmetric):
            A[b, b.stop :] = A[b.stop :, b].T
            A[b, b] = np.tril(A[b, b]) + np.tril(A[b, b], -1).T
        return A

    def _solved(self, B: sp.csr_matrix) -> Array:
        """The flexibility by blocks of solves."""
        columns, out = B.T.tocsc(), np.empty((B.shape[0],) * 2)
        for b in blocks(B.shape[0]):
            out[:, b] = B @ super().solve(columns[:, b])
        return out

    def _check(self, found: Array, known: Array) -> None:
        """Compare displacements of the interface by the factor with those that are known.

        Raises:
            InaccurateResult: they differ.
        """
        off = np.linalg.norm(found - known, axis=0) / np.linalg.norm(known, axis=0)
        if not np.all(off <= DIFFERENCE):
            raise InaccurateResult(f"""the factor of a body is wrong: displacements of its interface
                are off by {off.max():.1e}""")


def _call(name: str, *arguments: Any) -> None:
    """A function of the C interface of PETSc.

    Raises:
        InaccurateResult: it fails.
    """
    code = getattr(_petsc, name)(*arguments)
    if code:
        raise InaccurateResult(f"{name} of PETSc fails: error {code}")
