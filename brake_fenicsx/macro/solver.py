"""Factorisation (MUMPS) with solves in blocks, or with the flexibility of an interface.

Blocks, because a single solve is bound by memory. The flexibility of the rows B of an interface
comes with the factorisation: the Schur complement of

    [ P  B' ]
    [ B  0  ]     on its last block is   -B P^-1 B',

all columns at once, without a pass of solves through the whole factor. petsc4py does not show these
functions of PETSc: they are called in the library that petsc4py is linked with. Where that lacks
them, blocks of solves give the same.

Where MUMPS is built without METIS and SCOTCH, as that of Debian is, it orders a matrix with a Schur
complement by approximate minimum degree, which costs a solid body 1.6 to 2.5 times the operations
of nested dissection (George 1973, doi:10.1137/0710032), the more, the larger it is. Unknowns of a
separator that are joined with each other by stored zeros have a degree that minimum degree leaves
to the last; their front is full in any case. METIS finds them (Karypis and Kumar 1998,
doi:10.1137/S1064827595287997): PETSc is linked with it by way of CHOLMOD; elsewhere there are none.
"""

import brake_fenicsx.petsc_started  # noqa: F401

# isort: split

import ctypes
import hashlib
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from petsc4py import PETSc

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Index, of_kind
from brake_fenicsx.errors import InaccurateResult, OfOneProcess
from brake_fenicsx.folder.processes import release_memory

BLOCK = 128

# Room for pivoting [%]; null pivots are detected, not divided by; right-hand sides at once.
MUMPS = {"mat_mumps_icntl_14": 40, "mat_mumps_icntl_24": 1, "mat_mumps_icntl_27": BLOCK}

# Largest relative difference of displacements of the interface that are known from those of a
# factor: what one that went wrong exceeds by far.
DIFFERENCE = 1e-6

# Option that discards the factor: what is left are the pivots and the Schur complement.
DISCARDED = "mat_mumps_icntl_31"

# Symbols are looked up through the module that is linked with the library.
_petsc = ctypes.CDLL(PETSc.__file__)
_ARRAYS = tuple(f"MatSeq{k}{do}Array" for k in ("SBAIJ", "AIJ") for do in ("Get", "Restore"))
_NAMES = ("MatFactorSetSchurIS", "MatFactorGetSchurComplement", *_ARRAYS)
AVAILABLE = all(hasattr(_petsc, name) for name in _NAMES)

# Of MUMPS: with 0, solves leave the rows of the Schur complement out; with 0, a transposed solve.
INTERIOR, TURNED = 26, 9

# Parts of a graph of fewer vertices are left whole, and an unknown of a separator is joined with so
# many others before and after it: measured on bodies of 39,000 to 292,000 unknowns.
LEAST, REACH = 2000, 200

# Separators of so many patterns are kept: a body is analysed for each point of the box.
MOST = 8
OPTIONS = 40  # METIS_NOPTIONS
_separators: dict[bytes, list[Index]] = {}


class Factor(OfOneProcess):
    """L D L' of a symmetric matrix, or L U of another one.

    Attributes:
        seconds: time of the factorisation [s].
        negative_pivots: number of negative eigenvalues of a symmetric A, by Sylvester's law of
            inertia.
        gigabytes: memory of the factor [GB].
        symmetric: whether A is symmetric.
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
            solves: whether the factor is kept for solves, or discarded while it is computed.

        Raises:
            InaccurateResult: the factorisation fails (singular matrix, no memory).
        """
        start = time.perf_counter()
        self._A = A = A if isinstance(A, PETSc.Mat) else petsc_matrix(A, symmetric)
        self.symmetric: bool = symmetric
        self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setOperators(A)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        pc.setType("cholesky" if symmetric else "lu")
        pc.setFactorSolverType("mumps")
        # Through the options, so that the user's own come first; ours leave the database again.
        options = PETSc.Options(prefix)
        values = {**MUMPS, DISCARDED: int(not solves)}
        ours = [name for name in values if not options.hasName(name)]
        for name in ours:
            options[name] = values[name]
        try:
            self._ksp.setFromOptions()
            pc.setFactorSetUpSolverType()
            self._prepare(pc.getFactorMatrix())
            self._factor()
        except PETSc.Error as error:
            raise InaccurateResult(f"MUMPS cannot factor the matrix: {error}") from error
        finally:
            for name in ours:
                options.delValue(name)
        self.seconds: float = time.perf_counter() - start

    def _factor(self) -> None:
        """Factor the matrix as it is; its pattern is analysed the first time alone.

        Raises:
            InaccurateResult: the factorisation fails.
        """
        try:
            self._ksp.setUp()
        except PETSc.Error as error:
            raise InaccurateResult(f"MUMPS cannot factor the matrix: {error}") from error
        self._F = F = self._ksp.getPC().getFactorMatrix()
        if F.getMumpsInfog(1) < 0:
            raise InaccurateResult(f"""MUMPS cannot factor the matrix: INFOG(1) =
                {F.getMumpsInfog(1)}""")
        if F.getMumpsInfog(28) > 0:
            raise InaccurateResult("""the stiffness is singular: a part can move freely; add
                supports (the command check names part and direction)""")
        self.negative_pivots: int = int(F.getMumpsInfog(12))
        self.gigabytes: float = F.getMumpsInfog(22) / 1e3

    def _write(self, values: Array) -> None:
        """Other values in place of those of the matrix, in the order in which these are stored."""
        kind, held = "SBAIJ" if self.symmetric else "AIJ", ctypes.POINTER(ctypes.c_double)()
        A = ctypes.c_void_p(self._A.handle)
        _call(f"MatSeq{kind}GetArray", A, ctypes.byref(held))
        np.ctypeslib.as_array(held, shape=values.shape)[:] = values
        _call(f"MatSeq{kind}RestoreArray", A, ctypes.byref(held))
        self._A.stateIncrease()
        self._ksp.setOperators(self._A)

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

    def destroy(self) -> None:
        """Free the copy of the matrix now, see ``Factor``."""
        self._A.destroy()


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
            solves: whether the factor, two thirds of the memory, is kept for solves.

        Raises:
            InaccurateResult: P is singular, or its factor is wrong.
        """
        A, self._solves = P(), solves or not AVAILABLE
        wide, known = self._rows(A, B)
        self._n, self._kept = A.shape[0], wide.shape[0] * AVAILABLE
        self._pattern = _pattern(A, wide)
        # In place of each value its number among those of ``_values``.
        whole = _numbered(A, 1)
        if self._kept:
            every, border = np.arange(self._kept), _numbered(wide, 1 + A.nnz)
            # The diagonal of the last block is stored, though it is zero.
            zero = sp.coo_matrix((np.zeros(self._kept), (every, every)), (self._kept,) * 2)
            whole = joined(whole, separators(A))
            whole = sp.triu(whole) if symmetric else whole
            whole = sp.bmat([[whole, border.T], [None if symmetric else border, zero]])
        whole = (sp.triu(whole) if symmetric else whole).tocsr()
        whole.sort_indices()
        self._numbers: Index = whole.data.astype(PETSc.IntType)
        whole.data = self._values(A, wide)
        A = petsc_matrix(whole, symmetric)
        del whole, wide
        super().__init__(A, "brake_interface_", symmetric, self._solves)
        self._take(B, *known)

    def update(self, P: Callable[[], sp.csr_matrix], B: sp.csr_matrix) -> bool:
        """Factor another matrix of the same pattern, which is not analysed again.

        Args:
            P: as above.
            B: likewise.

        Returns:
            Whether the pattern is the same and the library has what writes values; else nothing is
            done.

        Raises:
            InaccurateResult: P is singular, or its factor is wrong.
        """
        if not AVAILABLE:
            return False
        A = P()
        wide, known = self._rows(A, B)
        if _pattern(A, wide) != self._pattern:
            return False
        self._write(self._values(A, wide))
        del A, wide, self.flexibility
        self._factor()
        self._take(B, *known)
        return True

    def _rows(
        self, A: sp.csr_matrix, B: sp.csr_matrix
    ) -> tuple[sp.csr_matrix, tuple[Array, Array, Array]]:
        """Rows of the Schur complement; columns, and what P^-1 of them is at the interface.

        That of the first is known through the flexibility: as coordinates of the rows. The second
        one loads the neighbours of the interface: a dense row is dear to order.
        """
        rng, x = np.random.default_rng(0), np.zeros((A.shape[0], 1))
        v = rng.standard_normal((B.shape[0], 1)) / _size(B)
        x[B.indices, 0] = rng.standard_normal(B.nnz)
        load = np.hstack([B.T @ v, A @ x])
        load = load[:, : 2 * bool(np.any(load[:, 0]))]
        wide = B if self._solves or not load.shape[1] else sp.vstack([B, load.T]).tocsr()
        return wide, (load, v, B @ x)

    def _values(self, A: sp.csr_matrix, wide: sp.csr_matrix) -> Array:
        """Values of what is factored: each is none, one of P or one of the rows."""
        return np.concatenate([[0.0], A.data, wide.data])[self._numbers]

    def _take(self, B: sp.csr_matrix, load: Array, v: Array, seen: Array) -> None:
        """Take the flexibility from the factor, and check it; see ``_rows``."""
        rows = B.shape[0]
        try:
            G = self._complement() if self._kept else self._solved(B)
            self.flexibility: Array = G[:rows, :rows]
            if load.shape[1]:
                found = B @ self.solve(load) if self._solves else G[:rows, rows:]
                known = np.hstack([self.flexibility @ v, seen])
                self._check(found / _size(B), known / _size(B))
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
        for b in blocks(rows * self.symmetric):
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


def interface_factor(
    held: list[InterfaceFactor], P: Callable[[], sp.csr_matrix], B: sp.csr_matrix,
    symmetric: bool = True, solves: bool = True,
) -> InterfaceFactor:  # fmt: skip
    """A factor like the one that is held, with its analysis where the pattern is the same.

    Args:
        held: it, or nothing; the new one takes its place.
        P: see ``InterfaceFactor``.
        B: likewise.
        symmetric: likewise.
        solves: as that of the one held.
    """
    if held and (held[0].symmetric != symmetric or not held[0].update(P, B)):
        held.pop().destroy()
    if not held:
        held.append(InterfaceFactor(P, B, symmetric, solves))
    return held[0]


def _size(B: sp.csr_matrix) -> Array:
    """Norm of each row, shape (rows, 1); 1 where it is zero."""
    size = np.sqrt(np.asarray(B.multiply(B).sum(axis=1)))
    return np.where(size > 0, size, 1.0)


def _numbered(A: sp.csr_matrix, first: int) -> sp.csr_matrix:
    """A matrix of the same pattern: numbers in place of its values."""
    numbers = np.arange(first, first + A.nnz, dtype=float)
    return sp.csr_matrix((numbers, A.indices, A.indptr), A.shape)


def _pattern(*matrices: sp.csr_matrix) -> bytes:
    """What tells patterns apart; indices are sorted, and entries of one place become one."""
    digest = hashlib.sha256()
    for A in matrices:
        A.sum_duplicates()
        digest.update(A.indices)
        digest.update(A.indptr)
    return digest.digest()


def separators(A: sp.csr_matrix) -> list[Index]:
    """Unknowns of the separators of nested dissection, those of the largest parts first.

    Args:
        A: square matrix.

    Returns:
        Numbers of the unknowns of each; none of a small matrix.
    """
    if A.shape[0] < LEAST or not _metis():
        return []
    pattern = _pattern(A)
    if pattern not in _separators:
        while len(_separators) >= MOST:
            _separators.pop(next(iter(_separators)))
        _separators[pattern] = _dissected(A)
    return _separators[pattern]


def joined(A: sp.csr_matrix, groups: list[Index]) -> sp.csr_matrix:
    """The same matrix, with stored zeros between unknowns of the same group."""
    if not groups:
        return A
    rows, columns, first = list[Index](), list[Index](), 0
    for group in groups:
        near = np.arange(-REACH, REACH + 1) if group.size > 2 * REACH else np.arange(group.size)
        own = np.repeat(np.arange(group.size), near.size)
        rows.append(first + own)
        columns.append(group[(own + np.tile(near, group.size)) % group.size])
        first += group.size
    held, n = np.concatenate(groups), A.shape[0]
    part = A[held].tocoo()
    places = np.concatenate([part.row, *rows]), np.concatenate([part.col, *columns])
    values = np.concatenate([part.data, np.zeros(places[0].size - part.nnz)])
    changed = sp.coo_matrix((values, places), part.shape).tocsr()
    order = np.arange(n)
    order[held] = n + np.arange(held.size)
    return sp.vstack([A, changed]).tocsr()[order]


def _dissected(A: sp.csr_matrix) -> list[Index]:
    """Separators of a matrix."""
    vertex, G = _graph(A)
    members = np.split(np.argsort(vertex, kind="stable"), np.cumsum(np.bincount(vertex))[:-1])
    found, parts = list[Index](), [np.arange(G.shape[0])]
    while parts:
        part = parts.pop(0)
        if part.size < LEAST:
            continue
        side = _sides(G[part][:, part].tocsr())
        if np.any(side == 2):
            found.append(np.concatenate([members[i] for i in part[side == 2]]))
        if np.any(side == 0) and np.any(side == 1):
            parts += [part[side == 0], part[side == 1]]
    return found


def _graph(A: sp.csr_matrix) -> tuple[Index, sp.csr_matrix]:
    """Vertex of each unknown, one for those of the same neighbours, and the graph of vertices."""
    pattern = sp.csr_matrix((np.ones(A.nnz), A.indices, A.indptr), A.shape)
    marks: Array = np.random.default_rng(0).random(A.shape[0])
    _, vertex = np.unique(np.round(pattern @ marks, 9), return_inverse=True)
    ones = np.ones(vertex.size)
    gathered = sp.csr_matrix((ones, (np.arange(vertex.size), vertex)))
    G = (gathered.T @ (pattern + pattern.T) @ gathered).tocsr()
    G.setdiag(0)
    G.eliminate_zeros()
    return vertex, G


def _sides(G: sp.csr_matrix) -> Index:
    """0 and 1 for the two sides of a graph, 2 for the separator."""
    side: Index = np.zeros(G.shape[0], np.int32)
    size, n = ctypes.c_int(), ctypes.c_int(G.shape[0])
    begin, neighbours = G.indptr.astype(np.int32), G.indices.astype(np.int32)
    _petsc.METIS_ComputeVertexSeparator(
        *(ctypes.byref(n), _pointer(begin), _pointer(neighbours), None),
        *(None, ctypes.byref(size), _pointer(side)),  # its own options
    )
    return side


def _pointer(a: Index) -> ctypes.c_void_p:
    """Address of an array of integers."""
    return a.ctypes.data_as(ctypes.c_void_p)


def _metis() -> bool:
    """Whether METIS is there with integers of 32 bits: its options are -1 by default."""
    if not hasattr(_petsc, "METIS_ComputeVertexSeparator"):
        return False
    options: Index = np.zeros(2 * OPTIONS, np.int32)
    _petsc.METIS_SetDefaultOptions(_pointer(options))
    return bool(np.all(options == np.repeat([-1, 0], OPTIONS)))


def _call(name: str, *arguments: Any) -> None:
    """A function of the C interface of PETSc.

    Raises:
        InaccurateResult: it fails.
    """
    code = getattr(_petsc, name)(*arguments)
    if code:
        raise InaccurateResult(f"{name} of PETSc fails: error {code}")
