#!/usr/bin/env bash
# CalculiX 2.20 (Debian 12, calculix-ccx): loads that are written twice, and OP=NEW.
#
# Guess: the last value of a load counts, as it does from step to step: forces of 1 and 2 on one node and component are
#   2. *DLOAD, OP=NEW removes what *DLOAD wrote, and *DSLOAD stays.
# Behaviour: within one step they are 3, also with *DLOAD and *DSLOAD on one face, or in two blocks; from step to step
#   the new value takes the place of the old one. *DLOAD, OP=NEW removes the pressures of *DSLOAD as well.
# Why the guess fails: a load is replaced only where it stands in a step before; a surface pressure is kept as pressures
#   of its elements, among those of *DLOAD. Neither is warned of.
#
# Output seen (reaction to the loads, after each step):
#   forces 1 and 2 in one step: 3; in two steps: 1, 2
#   pressures 1 and 2 on one face in one step: *DLOAD 300, *DSLOAD 300, one of each 300
#   *DSLOAD of 1, then *DLOAD, OP=NEW: 100, 0
set -euo pipefail
command -v ccx >/dev/null || apt-get install --yes --quiet calculix-ccx
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 - <<'PY'
import re
import subprocess
from pathlib import Path

DECK = """*NODE
1, 0., 0., 0.
2, 10., 0., 0.
3, 10., 10., 0.
4, 0., 10., 0.
5, 0., 0., 10.
6, 10., 0., 10.
7, 10., 10., 10.
8, 0., 10., 10.
*ELEMENT, TYPE=C3D8, ELSET=BODY
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=FOOT
1, 2, 3, 4
*SURFACE, NAME=FACE
1, S2
*MATERIAL, NAME=STEEL
*ELASTIC
207000., 0.3
*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL
*BOUNDARY
FOOT, 1, 3
"""
END = "*NODE PRINT, NSET=FOOT, TOTALS=ONLY\nRF\n*END STEP\n"
ONE, TWO = "*DLOAD\n1, P2, 1.\n", "*DLOAD\n1, P2, 2.\n"
ALSO, MORE = "*DSLOAD\nFACE, P, 1.\n", "*DSLOAD\nFACE, P, 2.\n"


def reactions(*steps):
    Path("case.inp").write_text(DECK + "".join(f"*STEP\n*STATIC\n{step}{END}" for step in steps))
    subprocess.run(["ccx", "case"], check=True, capture_output=True)
    rows = (line.split() for line in Path("case.dat").read_text().splitlines() if re.match(r"\s+[-\d]", line))
    return [round(max(abs(float(word)) for word in row)) for row in rows]


force = "*CLOAD\n7, 1, {}.\n"
together = reactions(force.format(1) + force.format(2))
apart = reactions(force.format(1), force.format(2))
pressures = [reactions(first + second)[0] for first, second in ((ONE, TWO), (ALSO, MORE), (ALSO, TWO))]
new = reactions(ALSO, "*DLOAD, OP=NEW\n")
print(f"forces 1 and 2 in one step: {together[0]}; in two steps: {apart[0]}, {apart[1]}")
print("pressures 1 and 2 on one face in one step: *DLOAD {}, *DSLOAD {}, one of each {}".format(*pressures))
print(f"*DSLOAD of 1, then *DLOAD, OP=NEW: {new[0]}, {new[1]}")
assert (together, apart, pressures, new) == ([3], [1, 2], [300] * 3, [100, 0])
PY
