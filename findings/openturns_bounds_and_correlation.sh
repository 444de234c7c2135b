#!/usr/bin/env bash
# OpenTURNS 1.27.post1: correlated inputs between bounds.
#
# Guess: two normal inputs of correlation 0.8, both cut at one standard deviation, keep a correlation of about 0.8 whichever way the
#   bounds are given.
# Behaviour: TruncatedDistribution of the joint distribution has 0.47; two TruncatedNormal joined by NormalCopula(0.8) have 0.79. The
#   margins differ too: standard deviations 0.51 and 0.54.
# Why the guess fails: the first rejects points outside the box, which cuts the ends of the ellipse that carry the correlation; the
#   second cuts the margins and keeps the dependence of their ranks. Both have bounds -1 and 1, mean 0 and a matrix with 0.8 in
#   the script. A lining whose moduli are measured, correlated and bounded gets the one or the other by the order of two lines.
#
# Output seen:
#   box around the joint distribution: correlation 0.47, deviation 0.51; bounds of the margins: 0.79, 0.54
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet openturns==1.27.post1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PY'
import numpy as np
import openturns as ot

R = ot.CorrelationMatrix(2)
R[0, 1] = 0.8
joint = ot.Normal([0, 0], [1, 1], R)
box = ot.TruncatedDistribution(joint, ot.Interval([-1, -1], [1, 1]))
margins = ot.JointDistribution([ot.TruncatedNormal(0, 1, -1, 1)] * 2, ot.NormalCopula(R))
found = []
for distribution in (box, margins):
    ot.RandomGenerator.SetSeed(1)
    x = np.array(distribution.getSample(100_000))
    assert np.abs(x).max() <= 1
    found += [np.corrcoef(x.T)[0, 1], x.std()]
print(
    "box around the joint distribution: correlation {:.2f}, deviation {:.2f}; "
    "bounds of the margins: {:.2f}, {:.2f}".format(*found)
)
assert np.allclose(found, [0.47, 0.51, 0.79, 0.54], atol=0.02), found
PY
