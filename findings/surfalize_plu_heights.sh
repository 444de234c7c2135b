#!/usr/bin/env bash
# surfalize 0.19.2 and SurfaceTopography 1.27.1: heights of a .plu file of Sensofar.
#
# Guess: two readers that agree on pixels, sides, range and S_q of a real scan have the same heights.
# Behaviour: surfalize begins eight bytes early. Its first two heights are the numbers of rows and columns, read as floats
#   (8e-43), every row is shifted by two pixels, with the end of the row before at its beginning, and the last two heights are lost.
# Why the guess fails: 8e-43 um is zero in any print, and two points of 400,000 change no statistic of a level scan: range and S_q of
#   a scan about zero agree to all digits. Of a scan with its heights at -111 um the range becomes -111 to 0. A difference of the two
#   maps, or a second scan of the same place read elsewhere, shows the shift.
#
# Output seen:
#   first heights [um]: SurfaceTopography 1.000, 1.250, 1.500; surfalize 0.000, 0.000, 1.000
#   surfalize shifted by two pixels equals SurfaceTopography: True
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet SurfaceTopography==1.27.1 surfalize==0.19.2 numpy==2.4.6
cd "$folder"
export MPLBACKEND=Agg MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import struct

import numpy as np
from surfalize import Surface
from SurfaceTopography import read_topography

rows, columns = 12, 16
heights = (1 + 0.25 * np.arange(rows * columns, dtype="<f4")).reshape(rows, columns)
with open("a.plu", "wb") as file:
    file.write(struct.pack("<128sI256s", b"Mon Apr 19 11:40:13 2021", 1618832413, b"(None)"))
    # Rows, columns, 0, 1, um per pixel along x and y, offsets, um per step of z, offset.
    file.write(struct.pack("<3I7f", rows, columns, 0, 1, 0.5, 0.5, 0, 0, 1, 0))
    # Topography (3), algorithm, method, objective, area, its pixels, planes and ranges.
    file.write(struct.pack("<10IdfII", 3, 0, 0, 0, 0, rows, columns, rows, columns, 0, 0.1, 10, 100, 0))
    # One layer, format of 2006, no image.
    file.write(struct.pack("<5B3xI", 0, 1, 0xFF, 0, 0, 0))
    file.write(struct.pack("<2I", rows, columns) + heights.tobytes())
    file.write(struct.pack("<2f", heights.min(), heights.max()))
right = np.asarray(read_topography("a.plu").heights()).T.ravel()
found = Surface.load("a.plu").data.ravel()
print(
    "first heights [um]: SurfaceTopography {:.3f}, {:.3f}, {:.3f};".format(*right[:3]),
    "surfalize {:.3f}, {:.3f}, {:.3f}".format(*found[:3]),
)
same = np.array_equal(right, heights.ravel()) and np.array_equal(found[2:], right[:-2])
print("surfalize shifted by two pixels equals SurfaceTopography:", same)
assert same and list(found[:2].astype("<f4").view("<u4")) == [rows, columns]
PY
