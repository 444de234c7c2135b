#!/usr/bin/env python3
"""Driver of Dakota's file interface: DRIVER SCENE FOLDER PARAMETERS RESULTS.

In Dakota's input: analysis_drivers = "dakota_driver.py brake.toml prepared", descriptors the dotted
keys of the scene, fork; failure_capture says what becomes of brakes without equilibrium. The folder
keeps what all evaluations share.
"""

import sys
from pathlib import Path

from brake_fenicsx import prepare, sample
from brake_fenicsx.errors import BrakeError

scene, folder, parameters, results = sys.argv[1:5]
words = [line.split(maxsplit=1) for line in Path(parameters).read_text().splitlines()]
count = next(int(value) for value, name in words if name.strip() == "variables")
inputs = {name.strip(): float(value) for value, name in words[1 : 1 + count]}
try:
    modes = sample(prepare(scene, directory=folder), inputs)
    said = f"{modes.s.real.max()} growth\n"
except BrakeError as error:
    # What Dakota takes for a failed evaluation, as where there is no equilibrium.
    said = f"FAIL {error}\n"
Path(results).write_text(said)
