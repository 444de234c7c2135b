#!/usr/bin/env bash
# SALib 1.6.0: the third number of a triangular input.
#
# Guess: {"dists": ["triang"], "bounds": [[0.3, 0.5, 0.45]]} is friction between 0.3 and 0.5 with its mode at 0.45.
# Behaviour: the mode is at 0.39. The third number is the place of the mode as a fraction of the range,
#   0.3 + 0.45 * 0.2. Only a mode outside 0 to 1 would be refused, so damping, friction and Poisson's ratio all pass.
# Why the guess fails: the first two numbers are in the unit of the input, the third has none.
#
# Output seen:
#   mean 0.3967 (mode at 0.45: 0.4167; mode at 0.39: 0.3967)
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet SALib==1.6.0 numpy==2.4.6 scipy==1.17.1
"$folder/venv/bin/python" - <<'PY'
from SALib.sample import latin

problem = {
    "num_vars": 1,
    "names": ["friction"],
    "bounds": [[0.3, 0.5, 0.45]],
    "dists": ["triang"],
}
mean = latin.sample(problem, 100_000, seed=1).mean()
print(f"mean {mean:.4f} (mode at 0.45: {1.25 / 3:.4f}; mode at 0.39: {1.19 / 3:.4f})")
assert abs(mean - 1.19 / 3) < 1e-3
PY
