#!/usr/bin/env bash
# meshio 5.3.5: a mesh that it cannot read.
#
# Guess: meshio.read() raises meshio.ReadError, which its __init__ exports for that.
# Behaviour: it prints the reason and ends the interpreter: SystemExit(1), past "except meshio.ReadError" and
#   "except Exception". A valid Abaqus deck whose faces are plane elements, as gmsh writes those of C3D10 (CPS6), is enough.
#   The same deck without its file, from an open stream, raises ReadError.
# Why the guess fails: the function was made for the command line's converter. In a loop over decks, or a worker of a pool,
#   the first deck that is not understood ends all of it.
#
# Output seen:
#   Element type not available: CPS6
#   Error: Couldn't read file face.inp as abaqus
#   from a path SystemExit, from a stream ReadError
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet meshio==5.3.5 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
from io import StringIO
from pathlib import Path

import meshio

DECK = (
    "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0.5, 0, 0\n5, 0.5, 0.5, 0\n6, 0, 0.5, 0\n"
    "*ELEMENT, TYPE=CPS6, ELSET=FACE\n1, 1, 2, 3, 4, 5, 6\n"
)
Path("face.inp").write_text(DECK)
raised = []
for source, form in (("face.inp", None), (StringIO(DECK), "abaqus")):
    try:
        meshio.read(source, form)
    except BaseException as error:
        raised.append(type(error))
print("from a path {}, from a stream {}".format(*(kind.__name__ for kind in raised)))
assert raised == [SystemExit, meshio.ReadError] and not issubclass(SystemExit, Exception)
PY
