#!/usr/bin/env bash
# pyNastran 1.3.4: volume and mass of a CHEXA.
#
# Guess: Volume() and mass_properties() of an eight-node brick are exact, and do not depend on where its numbering begins.
# Behaviour: a unit cube slanted by 45 degrees (volume 1) has the volume 1.4142 or, numbered from another face, 1.
#   A frustum of a pyramid (7/3) has 2.5 or 2.5156. mass_properties() of the model takes the same number.
# Why the guess fails: the volume is the mean area of the first and the last face times the distance of their
#   centres, not times the height between them, and not an integral. Swept meshes of flat parts hit the exact case;
#   chamfers, cooling vanes and mapped pads do not.
#
# Output seen:
#   slanted cube, exact 1.0000: 1.4142, numbered from its side 1.0000, mass 1.4142
#   frustum, exact 2.3333: 2.5000, numbered from its side 2.5156, mass 2.5000
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyNastran==1.3.4 numpy==2.4.6
cd "$folder"
cat > check.py <<'PY'  # pyNastran looks up the source of its caller
import numpy as np
from pyNastran.bdf.bdf import BDF


def brick(points):
    model = BDF(debug=None)
    model.add_mat1(1, 1e7, None, 0.3, rho=1.0)
    model.add_psolid(1, 1)
    for i, x in enumerate(points, 1):
        model.add_grid(i, x)
    model.add_chexa(1, 1, list(range(1, 9)))
    model.cross_reference()
    return model.elements[1].Volume(), model.mass_properties()[0]


square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
turned = [0, 1, 5, 4, 3, 2, 6, 7]
found = []
for name, exact, points in (
    ("slanted cube", 1.0, np.vstack([square, square + [1, 0, 1]])),
    ("frustum", 7 / 3, np.vstack([2 * square, square + [0.5, 0.5, 1]])),
):
    (volume, mass), (other, _) = brick(points), brick(points[turned])
    print(f"{name}, exact {exact:.4f}: {volume:.4f}, numbered from its side {other:.4f}, mass {mass:.4f}")
    found += [volume, other, mass]
assert np.allclose(found, [2**0.5, 1, 2**0.5, 2.5, 2.5156, 2.5], atol=1e-4), found
PY
"$folder/venv/bin/python" check.py
