#!/usr/bin/env bash
# SLEPc 3.18.2 (Debian 12, python3-slepc4py-real): the relative error of K x = lambda M x depends on the units.
#
# Guess: computeError(i, RELATIVE) has no unit, so the same chain of masses in N/m and kg or in mN/m and g gives the
#   same number.
# Behaviour: K and M both times 1000 leave the eigenvalues as they are and raise the relative error of each of them
#   a thousand times. The backward error does not change.
# Why the guess fails: it is |K x - lambda M x| / (|lambda| |x|), relative to lambda only. The residual has the unit
#   of K, the denominator that of K / M: the number is a mass, a "relative" error of 1e-8 in kg is one of 1e-11 in t. With
#   the small masses of the nodes of a fine mesh a poor mode passes a bound that it would fail in other units.
#
# Output seen (ratio of the errors of the first three modes):
#   relative [1000. 1000. 1000.]  backward [1. 1. 1.]
set -euo pipefail
/usr/bin/python3 -c "import slepc4py" 2>/dev/null || apt-get install --yes --quiet python3-slepc4py-real python3-numpy
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
OPENBLAS_NUM_THREADS=1 /usr/bin/python3 - <<'PY'
import numpy as np
import slepc4py

slepc4py.init([])
from petsc4py import PETSc
from slepc4py import SLEPc

print("SLEPc", ".".join(map(str, SLEPc.Sys.getVersion())))
n = 50
k = np.random.default_rng(1).uniform(1, 2, n + 1) * 1e6
K = np.diag(k[1:] + k[:-1]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
M = 1e-3 * np.eye(n)


def errors(factor):
    A, B = (PETSc.Mat().createDense([n, n], array=factor * X) for X in (K, M))
    A.assemble()
    B.assemble()
    eps = SLEPc.EPS().create()
    eps.setOperators(A, B)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    eps.setDimensions(3, 20)
    # Stopped early, so that the errors are far above the rounding; the start is the same.
    eps.setTolerances(1e-3, 100)
    start = A.createVecRight()
    start.setArray(np.random.default_rng(2).normal(size=n))
    eps.setInitialSpace([start])
    eps.solve()
    kinds = SLEPc.EPS.ErrorType.RELATIVE, SLEPc.EPS.ErrorType.BACKWARD
    rows = [[eps.computeError(i, kind) for i in range(3)] for kind in kinds]
    return np.array([eps.getEigenvalue(i).real for i in range(3)]), np.array(rows)


values, one = errors(1.0)
same, thousand = errors(1e3)
assert np.allclose(values, same, rtol=1e-9)
ratio = thousand / one
print("first errors", one, "\nrelative", ratio[0].round(3), " backward", ratio[1].round(3))
assert np.allclose(ratio[0], 1000, rtol=0.01) and np.allclose(ratio[1], 1, rtol=0.01)
PY
