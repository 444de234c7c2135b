#!/usr/bin/env python3
"""This machine's row of the tested versions in docs/installation.md: printed, or put there.

scripts/tested_versions.py [--write]    the last cell, what was tested, stays as it is written
"""

import platform
import sys
from pathlib import Path

import numpy as np
import scipy

from brake_fenicsx.libraries import solver_versions, version_of

PAGE = Path(__file__).parents[1] / "docs" / "installation.md"

system, solvers = platform.freedesktop_os_release(), solver_versions()
cells = [
    f"{system['NAME'].split()[0]} {system.get('VERSION_ID', 'unstable')}",
    platform.python_version(), solvers["DOLFINx"], solvers["PETSc"], solvers["SLEPc"],
    np.__version__, scipy.__version__, version_of("gmsh"),
]  # fmt: skip
row = f"| {' | '.join(cells)} |"
lines = PAGE.read_text().splitlines()
places = [i for i, line in enumerate(lines) if line.startswith(f"| {cells[0]} |")]
if "--write" not in sys.argv:
    print(row)
elif places:
    lines[places[0]] = row + lines[places[0]].split("|")[len(cells) + 1] + "|"
    PAGE.write_text("\n".join(lines) + "\n")
else:
    sys.exit(f"{PAGE}: no row of {cells[0]}; write one that ends with what was tested")
