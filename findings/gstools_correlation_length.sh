#!/usr/bin/env bash
# GSTools 1.7.0 and OpenTURNS 1.27.post1: the correlation length of a random field (stiffness of a lining, roughness).
#
# Guess: a Gaussian covariance of length 1 falls to 1/e = 0.368 at distance 1 in any library, or at worst to exp(-1/2).
# Behaviour: GSTools: exp(-pi/4) = 0.456; its length is the integral scale. OpenTURNS: exp(-1/2) = 0.607. Within GSTools the
#   rule changes with the model: Gaussian and exponential have the integral scale 1, Matern (nu = 1) has pi/2.
# Why the guess fails: one word and one number for three lengths. A field fitted in one program and drawn in the other has patches
#   of another size by a factor of 1.25, and a change of the model in GSTools changes the size too.
#
# Output seen:
#   GSTools Gaussian 0.456, exponential 0.368, Matern 0.602; integral scales 1.000, 1.000, 1.571; OpenTURNS Gaussian 0.607
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet gstools==1.7.0 openturns==1.27.post1 numpy==2.4.6 scipy==1.17.1
"$folder/venv/bin/python" - <<'PY'
import gstools
import numpy as np
import openturns

models = [kind(dim=2, var=1, len_scale=1) for kind in (gstools.Gaussian, gstools.Exponential)]
models.append(gstools.Matern(dim=2, var=1, len_scale=1, nu=1))
at_one = [float(model.correlation(1.0)) for model in models]
scales = [float(model.integral_scale) for model in models]
other = openturns.SquaredExponential([1.0], [1.0])([0.0], [1.0])[0, 0]
print(
    "GSTools Gaussian {:.3f}, exponential {:.3f}, Matern {:.3f}; ".format(*at_one)
    + "integral scales {:.3f}, {:.3f}, {:.3f}; ".format(*scales)
    + f"OpenTURNS Gaussian {other:.3f}"
)
assert np.allclose(at_one, [np.exp(-np.pi / 4), np.exp(-1), 0.6019], atol=1e-3)
assert np.allclose(scales, [1, 1, np.pi / 2], atol=1e-3)
assert np.isclose(other, np.exp(-0.5))
PY
