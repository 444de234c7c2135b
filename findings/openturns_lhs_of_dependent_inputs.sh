#!/usr/bin/env bash
# OpenTURNS 1.27.post1: Latin hypercube of inputs that depend on each other.
#
# Guess: LHSExperiment of a joint distribution with a copula is refused (as SobolIndicesExperiment refuses it), or
#   stratifies every input.
# Behaviour: it is drawn with the right dependence; of 1000 strata of equal probability the first input fills all 1000, the
#   second about 630, as many as plain random numbers would (1 - 1/e). With an independent copula both fill all. No warning.
# Why the guess fails: the strata are those of independent numbers that are then turned into the joint distribution; each input after
#   the first mixes several of them. Which input keeps the gain in variance depends on the order in which they are listed.
#
# Output seen:
#   independent: strata filled 1000, 1000; dependent: 1000, 621 (correlation 0.78)
#   SobolIndicesExperiment: refused
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
margins = [ot.Uniform(0, 1)] * 2
joint = ot.JointDistribution(margins, ot.NormalCopula(R))


def strata(distribution):
    ot.RandomGenerator.SetSeed(1)
    x = np.array(ot.LHSExperiment(distribution, 1000).generate())
    return [len(set((1000 * column).astype(int))) for column in x.T], np.corrcoef(x.T)[0, 1]


(free, _), (bound, correlation) = strata(ot.JointDistribution(margins)), strata(joint)
print(
    "independent: strata filled {}, {}; dependent: {}, {}".format(*free, *bound),
    f"(correlation {correlation:.2f})",
)
try:
    ot.SobolIndicesExperiment(joint, 64).generate()
except Exception as error:
    assert "independent copula" in str(error)
    print("SobolIndicesExperiment: refused")
else:
    raise SystemExit("SobolIndicesExperiment: accepted")
assert min(*free, bound[0]) > 990 and bound[1] < 700 and 0.7 < correlation < 0.85
PY
