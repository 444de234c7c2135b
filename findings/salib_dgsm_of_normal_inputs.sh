#!/usr/bin/env bash
# SALib 1.6.0: derivative-based sensitivity (dgsm) of normally distributed inputs.
#
# Guess: inputs declared with dists = ["norm", "norm"] and bounds [mean, standard deviation] are sampled and analysed as
#   normal; dgsm bounds the total index from above, for a normal input by sigma^2 E[(df/dx)^2] / Var f.
# Behaviour: sampled as normal, analysed as uniform between "mean" and "standard deviation". Of y = a + b, a of
#   N(100, 2), b of N(0, 2), both bounds are 1/2 (the total indices too). dgsm says 122 for a and 0.05 for b: the second is below the
#   total index that it should bound, and the order of the inputs follows their means.
# Why the guess fails: the sampler reads `dists`, the analysis multiplies by (bounds[1] - bounds[0])^2 / pi^2 whatever
#   they mean. Nothing warns.
#
# Output seen:
#   scatter of a and b: 2.0, 2.0; dgsm 121.8, 0.0507 (right: 0.5, 0.5)
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet SALib==1.6.0 numpy==2.4.6 scipy==1.17.1
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from SALib.analyze import dgsm
from SALib.sample import finite_diff

problem = {
    "num_vars": 2,
    "names": ["a", "b"],
    "bounds": [[100.0, 2.0], [0.0, 2.0]],
    "dists": ["norm", "norm"],
}
X = finite_diff.sample(problem, 2000, delta=1e-4, seed=1)
Y = X.sum(axis=1)
scatter = X[::3].std(axis=0)
index = dgsm.analyze(problem, X, Y, seed=1)["dgsm"]
print(f"scatter of a and b: {scatter[0]:.1f}, {scatter[1]:.1f}; dgsm {index[0]:.1f}, {index[1]:.4f} (right: 0.5, 0.5)")
assert np.allclose(scatter, 2, rtol=0.1)
assert index[0] > 100 and index[1] < 0.1, index
PY
