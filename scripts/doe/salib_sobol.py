"""Sobol indices of the largest growth rate, by SALib: friction against brake pressure."""

import sys

import numpy as np
from SALib.analyze import sobol
from SALib.sample import sobol as design

from brake_fenicsx import prepare, sample

scene, interface, face = sys.argv[1:4]
problem = {
    "names": [f"contact.{interface}.friction", f'loads."{face}".pressure'],
    "num_vars": 2, "bounds": [[0.3, 0.6], [2e5, 8e5]],
}  # fmt: skip
model = prepare(scene)
points = design.sample(problem, int(sys.argv[4]), calc_second_order=False, seed=1)
growth = [sample(model, dict(zip(problem["names"], x, strict=True))).s.real.max() for x in points]
print(sobol.analyze(problem, np.array(growth), calc_second_order=False).to_df())
