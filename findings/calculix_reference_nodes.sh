#!/usr/bin/env bash
# CalculiX 2.20 (Debian 12, calculix-ccx): the reference node of *COUPLING.
#
# Guess: it is as in Abaqus. *KINEMATIC without data lines couples all displacements. What holds, moves or weighs the
#   node of *DISTRIBUTING holds, moves or weighs the mean motion of the surface.
# Behaviour: *KINEMATIC without data lines couples nothing, and a force on its node is lost; with "1, 3" all is as in
#   Abaqus. The node of *DISTRIBUTING takes forces alone: held in all six components, or with a mass of a hundred times
#   that of the body, the frequencies stay those of the free surface, and a displacement of it moves nothing.
# Why the guess fails: a distributing coupling has no equations here, its force is divided among the nodes. Neither is
#   an error or a warning about the coupling, and the reference node is printed with the displacement 0.
#
# Output seen (force: reaction at the foot to 100 N on the node; else first frequency in Hz):
#   force: *KINEMATIC 0, *KINEMATIC with 1, 3 100, *DISTRIBUTING 100
#   free surface 5114, held: *KINEMATIC with 1, 3 27259, *DISTRIBUTING 5114
#   a mass: *KINEMATIC with 1, 3 261, *DISTRIBUTING 5114
#   moved by 0.01: *KINEMATIC with 1, 3 0.01, *DISTRIBUTING 0
set -euo pipefail
command -v ccx >/dev/null || apt-get install --yes --quiet calculix-ccx
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 - <<'PY'
import re
import subprocess
from pathlib import Path

NODES = "".join(
    f"{4 * k + i}, {x}, {y}, {10 * k}\n" for k in range(5) for i, (x, y) in enumerate(((0, 0), (10, 0), (10, 10), (0, 10)), 1)
)
CELLS = "".join(f"{k + 1}, " + ", ".join(str(4 * k + i) for i in range(1, 9)) + "\n" for k in range(4))
DECK = f"""*NODE
{NODES}*NODE, NSET=REF
99, 5., 5., 40.
*ELEMENT, TYPE=C3D8I, ELSET=BODY
{CELLS}*NSET, NSET=FOOT
1, 2, 3, 4
*NSET, NSET=TOP
17, 18, 19, 20
*SURFACE, NAME=FACE
4, S2
*MATERIAL, NAME=STEEL
*ELASTIC
207000., 0.3
*DENSITY
7.82e-9
*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL
{{}}*BOUNDARY
FOOT, 1, 3
"""
KINDS = {"*KINEMATIC": "*KINEMATIC\n", "*KINEMATIC with 1, 3": "*KINEMATIC\n1, 3\n", "*DISTRIBUTING": "*DISTRIBUTING\n1, 3\n"}
MODES = "*STEP\n*FREQUENCY\n1\n*END STEP\n"
PRINT = "*NODE PRINT, NSET=FOOT, TOTALS=ONLY\nRF\n*NODE PRINT, NSET=TOP\nU\n*END STEP\n"


def numbers(kind, more, step):
    coupling = kind and f"*COUPLING, REF NODE=99, SURFACE=FACE, CONSTRAINT NAME=C\n{KINDS[kind]}"
    Path("case.inp").write_text(DECK.format(coupling + more) + step)
    subprocess.run(["ccx", "case"], check=True, capture_output=True)
    lines = Path("case.dat").read_text().splitlines()
    rows = [line.split() for line in lines if re.match(r"\s+[-\d]", line)]
    return [[float(word) for word in row] for row in rows]


def frequency(kind, more=""):
    return round(numbers(kind, more, MODES)[0][3])


force = {k: -round(numbers(k, "", f"*STEP\n*STATIC\n*CLOAD\n99, 1, 100.\n{PRINT}")[0][0]) + 0 for k in KINDS}
moved = {k: numbers(k, "", f"*STEP\n*STATIC\n*BOUNDARY\n99, 3, 3, 0.01\n{PRINT}")[1][3] for k in [*KINDS][1:]}
free, held = frequency(""), {k: frequency(k, "*BOUNDARY\n99, 1, 6\n") for k in [*KINDS][1:]}
mass = "*ELEMENT, TYPE=MASS, ELSET=L\n98, 99\n*MASS, ELSET=L\n3e-3\n"
weighed = {k: frequency(k, mass) for k in [*KINDS][1:]}


def text(found):
    return ", ".join(f"{kind} {value:g}" for kind, value in found.items())


print("force:", text(force))
print(f"free surface {free}, held:", text(held))
print("a mass:", text(weighed))
print("moved by 0.01:", text(moved))
assert [*force.values()] == [0, 100, 100] and [*moved.values()] == [0.01, 0.0]
assert held["*DISTRIBUTING"] == weighed["*DISTRIBUTING"] == free
assert held["*KINEMATIC with 1, 3"] > 2 * free > 4 * weighed["*KINEMATIC with 1, 3"]
PY
