"""Sobol indices of the largest growth rate, by SALib: friction against brake pressure.

Every point of the design needs a value: samples that fail are named, and there are no indices then.
"""

import sys

import numpy as np
from SALib.analyze import sobol
from SALib.sample import sobol as design

from brake_fenicsx import prepare, sample
from brake_fenicsx.errors import BrakeError

scene, interface, face = sys.argv[1:4]
problem = {
    "names": [f"contact.{interface}.friction", f'loads."{face}".pressure'],
    "num_vars": 2, "bounds": [[0.3, 0.6], [2e5, 8e5]],
}  # fmt: skip
model = prepare(scene)
points = design.sample(problem, int(sys.argv[4]), calc_second_order=False, seed=1)
growth = np.full(len(points), np.nan)
for row, x in enumerate(points):
    inputs = dict(zip(problem["names"], x.tolist(), strict=True))
    try:
        growth[row] = sample(model, inputs).s.real.max()
    except BrakeError as error:
        print(f"sample {row} failed, {inputs}: {error}", file=sys.stderr)
if failed := np.isnan(growth).sum():
    sys.exit(f"{failed} of {len(points)} samples failed: no indices; narrow the bounds")
print(sobol.analyze(problem, growth, calc_second_order=False).to_df())
