#!/usr/bin/env bash
# MUMPS 5.5.1 by PETSc 3.18.5 (Debian 12): a Schur complement turns every ordering into minimum degree.
#
# Guess: ICNTL(7) chooses the ordering of a factor, with a Schur complement (ICNTL(19)) as without one; what a factor
#   without it costs tells what one with a few rows more will cost.
# Behaviour: without a Schur complement this build takes PORD (INFOG(7) = 4), a nested dissection; with one it takes
#   approximate minimum degree (INFOG(7) = 0), whatever is asked for, without a warning or an error. A cube of
#   20 x 20 x 20 points with three unknowns each then takes 2.5 times the operations (RINFOG(3)), although the Schur
#   complement has 30 rows.
# Why the guess fails: PORD has no way to keep variables for the end, METIS and SCOTCH are not built in, so that minimum
#   degree is what is left. INFOG(7) is the only trace. Zeros stored between all unknowns of a separator (the middle
#   layer, and so on) give these a degree that minimum degree leaves to the last: the same values cost less again.
#
# Output seen (ICNTL(7) asked, INFOG(7) taken, 1e9 operations):
#   no Schur complement           7: 4, 16.9
#   30 rows                       0, 2, 3, 4, 5, 6, 7: all 0, 42.7
#   30 rows, zeros in 3 layers    7: 0, 18.4
set -euo pipefail
/usr/bin/python3 -c "import petsc4py, scipy" 2>/dev/null || apt-get install --yes --quiet python3-petsc4py-real python3-scipy
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
OPENBLAS_NUM_THREADS=1 /usr/bin/python3 - <<'PY'
import ctypes

import numpy as np
import petsc4py
import scipy.sparse as sp

petsc4py.init([])
from petsc4py import PETSc

print("PETSc", ".".join(map(str, PETSc.Sys.getVersion())))
library = ctypes.CDLL(PETSc.__file__)
n, rows = 20, 30
line = sp.diags([1.0, 4.0, 1.0], [-1, 0, 1], shape=(n, n))
cube = sp.kron(sp.kron(sp.kron(line, line), line), np.full((3, 3), 0.1) + np.eye(3))
ends = sp.random(rows, 3 * n**3, 1e-3, random_state=0)
whole = sp.bmat([[cube, ends.T], [ends, 10 * sp.identity(rows)]]).tocoo()
grid = np.arange(3 * n**3).reshape(n, n, n, 3)
layers = [grid[n // 2], grid[: n // 2, n // 2], grid[n // 2 + 1 :, n // 2]]


def factor(asked, schur, groups=()):
    """Ordering that was taken, and operations."""
    row = np.concatenate([whole.row, *(np.repeat(g, g.size) for g in map(np.ravel, groups))])
    column = np.concatenate([whole.col, *(np.tile(g, g.size) for g in map(np.ravel, groups))])
    data = np.concatenate([whole.data, np.zeros(row.size - whole.nnz)])
    A = sp.coo_matrix((data, (row, column)), whole.shape).tocsr()
    A.sort_indices()
    B = PETSc.Mat().createAIJ(A.shape, csr=(A.indptr, A.indices, A.data), comm=PETSc.COMM_SELF)
    B.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    solver = PETSc.KSP().create(PETSc.COMM_SELF)
    solver.setOperators(B)
    solver.setType("preonly")
    pc = solver.getPC()
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    F = pc.getFactorMatrix()
    F.setMumpsIcntl(7, asked)
    if schur:
        last = np.arange(A.shape[0] - rows, A.shape[0], dtype=PETSc.IntType)
        chosen = PETSc.IS().createGeneral(last, comm=PETSc.COMM_SELF)
        call = library.MatFactorSetSchurIS
        assert call(ctypes.c_void_p(F.handle), ctypes.c_void_p(chosen.handle)) == 0
    solver.setUp()
    return F.getMumpsInfog(7), F.getMumpsRinfog(3) / 1e9


plain = factor(7, False)
held = [factor(asked, True) for asked in (0, 2, 3, 4, 5, 6, 7)]
helped = factor(7, True, layers)
print("no Schur complement", plain, "\nwith", held, "\nzeros in 3 layers", helped)
assert plain[0] == 4 and {taken for taken, _ in held} == {0} and helped[0] == 0
assert held[0][1] > 1.8 * plain[1] and helped[1] < 0.75 * held[0][1]
PY
