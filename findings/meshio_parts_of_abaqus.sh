#!/usr/bin/env bash
# meshio 5.3.5: a deck of Abaqus with parts, as Abaqus/CAE writes it.
#
# Guess: parts and instances are either read or refused; at worst the instances are not moved to their places.
# Behaviour: every part's nodes are numbered from 1, and each *NODE block replaces the points of the one before. The cells
#   of all parts then lie on the points of the last part: a rotor at x = 0 to 1 is found at the pad's 5 to 6, inside the pad.
#   The number of cells and their sets are right, and nothing is said.
# Why the guess fails: numbers are resolved when a block is read, positions after the last one. A part with more nodes than
#   the last ends in an IndexError at its first use; parts of equal size, such as two pads, do not.
#
# Output seen:
#   rotor meant at x = 0.5, read at 5.5; pad meant at 5.5, read at 5.5; points 8 of 16
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet meshio==5.3.5 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
from pathlib import Path

import meshio

PART = """*PART, NAME={0}
*NODE
{1}
*ELEMENT, TYPE=C3D8, ELSET={0}
1, 1, 2, 3, 4, 5, 6, 7, 8
*END PART
"""
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
deck = ""
for name, start in (("ROTOR", 0.0), ("PAD", 5.0)):
    rows = [f"{i}, {start + x}, {y}, {z}" for i, (x, y, z) in enumerate(CORNERS, 1)]
    deck += PART.format(name, "\n".join(rows))
deck += "*ASSEMBLY, NAME=ALL\n"
for name in ("ROTOR", "PAD"):
    deck += f"*INSTANCE, NAME={name}-1, PART={name}\n*END INSTANCE\n"
Path("parts.inp").write_text(deck + "*END ASSEMBLY\n")
mesh = meshio.read("parts.inp")
rotor, pad = (mesh.points[block.data].mean(axis=(0, 1))[0] for block in mesh.cells)
print(f"rotor meant at x = 0.5, read at {rotor}; pad meant at 5.5, read at {pad}; points {len(mesh.points)} of 16")
assert rotor == pad == 5.5 and len(mesh.points) == 8
assert {"ROTOR", "PAD"} <= mesh.cell_sets.keys()
PY
