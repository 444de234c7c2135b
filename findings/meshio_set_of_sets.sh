#!/usr/bin/env bash
# meshio 5.3.5: an element set of Abaqus that is made of other sets.
#
# Guess: "*ELSET, ELSET=PAD" with the line "LINING, PLATE" has the elements of both.
# Behaviour: the first name of each line counts, the others are dropped. Written one below the other both are taken, but
#   their numbers are attached to the blocks of elements in the order of the names: with PLATE before LINING the set has
#   the first of 3 elements of the lining and 3 of 1 of the plate, so that the plate's are out of range.
# Why the guess fails: such sets are read without an error, and a set of numbers in the same place is read right.
#
# Output seen:
#   LINING, PLATE: 3 of 4 elements
#   PLATE above LINING: [0] of the 3 of the lining, [0, 1, 2] of the 1 of the plate
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet meshio==5.3.5 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
from pathlib import Path

import meshio

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
nodes, rows = [], []
for k in range(4):
    nodes += [f"{8 * k + i}, {2 * k + x}, {y}, {z}" for i, (x, y, z) in enumerate(CORNERS, 1)]
    rows.append(f"{k + 1}, " + ", ".join(str(8 * k + i) for i in range(1, 9)))
deck = ["*NODE", *nodes, "*ELEMENT, TYPE=C3D8, ELSET=LINING", *rows[:3], "*ELEMENT, TYPE=C3D8, ELSET=PLATE", rows[3],
        "*ELSET, ELSET=PAD", "LINING, PLATE", "*ELSET, ELSET=BACKWARDS", "PLATE,", "LINING,"]
Path("pad.inp").write_text("\n".join(deck) + "\n")
sets = meshio.read("pad.inp").cell_sets
pad = sum(len(own) for own in sets["PAD"])
lining, plate = ([int(i) for i in own] for own in sets["BACKWARDS"])
print(f"LINING, PLATE: {pad} of 4 elements")
print(f"PLATE above LINING: {lining} of the 3 of the lining, {plate} of the 1 of the plate")
assert pad == 3 and lining == [0] and plate == [0, 1, 2]
PY
