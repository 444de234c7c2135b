#!/usr/bin/env bash
# SciPy 1.17.1 (ARPACK), also Debian's 1.10.1: modes nearest to a complex shift.
#
# Guess: eigs(A, k, sigma=10j) of a real A returns the k eigenvalues nearest to 10j.
# Behaviour: of modes at 5 and 16 rad/s it returns those at +-16j, which are farther away (6 against 5). The same
#   matrix stored as complex numbers gives 16j and 5j for k = 2, the nearest of another kind: no conjugate takes a place.
# Why the guess fails: with a real matrix the inverse is replaced by its real part, whose eigenvalues are
#   i w / (t^2 - w^2) for a mode at i w and a shift i t. These rank by w / |t^2 - w^2|, not by 1 / |t - w|: a low
#   mode counts for less than a high one as near, a rigid body mode (w = 0) for nothing. Residuals are perfect, so
#   nothing tells that the mode beside the shift is missing.
#
# Output seen:
#   float    [-16.0, 16.0]
#   complex  [5.0, 16.0]
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet scipy==1.17.1 numpy==2.4.6
OPENBLAS_NUM_THREADS=1 "$folder/venv/bin/python" - <<'PY'
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigs

w = np.array([1.0, 3, 5, 16, 30, 40, 50, 60, 70, 80])
n = w.size
A = sp.bmat([[None, sp.eye(n)], [-sp.diags(w**2), None]]).tocsc()
start = np.random.default_rng(1).normal(size=2 * n)
found = {}
for kind in (float, complex):
    s, V = eigs(A.astype(kind), k=2, sigma=10j, v0=start.astype(kind))
    assert np.linalg.norm(A @ V - V * s, axis=0).max() < 1e-8
    found[kind] = sorted(s.imag.round(6).tolist())
    print(f"{kind.__name__:8}", found[kind])
assert found[float] == [-16, 16] and found[complex] == [5, 16], found
PY
