#!/usr/bin/env bash
# RosettaSciIO 0.15.0, surfalize 0.19.2, SurfaceTopography 1.27.1: the zero of the heights of one .sur file.
#
# Guess: three readers of Digital Surf's format return the same heights, as they return the same pixel and the same S_q.
# Behaviour: the shape is equal to all digits, the level is not: lowest point at -3.90 um (RosettaSciIO, which wrote the file, the
#   true value), -7.38 um (surfalize) and -3.48 um (SurfaceTopography). The header has an offset of z and, as integers, a
#   least value: RosettaSciIO combines both, surfalize adds the offset to the counts, SurfaceTopography adds none.
# Why the guess fails: every roughness parameter takes out the mean, so tests of readers do not see it. A wear depth from two scans, a
#   step between two files or heights on the stage's scale do.
#
# Output seen:
#   lowest point [um]: written -3.899, RosettaSciIO -3.899, surfalize -7.382, SurfaceTopography -3.483; S_q 0.978 in all
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosettasciio==0.15.0 surfalize==0.19.2 SurfaceTopography==1.27.1 numpy==2.4.6
cd "$folder"
export MPLBACKEND=Agg MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from rsciio.digitalsurf import file_reader, file_writer
from surfalize import Surface
from SurfaceTopography import read_topography

h = np.random.default_rng(0).normal(size=(30, 40))
axes = [
    {"name": n, "units": "µm", "scale": 0.5, "offset": 0.0, "size": s, "index_in_array": i, "navigate": False}
    for i, (n, s) in enumerate((("Y", 30), ("X", 40)))
]
meta = {"Signal": {"quantity": "Height (µm)"}, "General": {"title": "t"}}
signal = {"data": h, "axes": axes, "metadata": meta, "original_metadata": {}}
file_writer("a.sur", signal, compressed=False)
scan = read_topography("a.sur")
assert scan.unit == "µm" and np.allclose(scan.physical_sizes, [20, 15])
read = {
    "RosettaSciIO": file_reader("a.sur")[0]["data"],
    "surfalize": Surface.load("a.sur").data,
    "SurfaceTopography": np.asarray(scan.heights()).T,
}
print(
    f"lowest point [um]: written {h.min():.3f}, "
    + ", ".join(f"{name} {z.min():.3f}" for name, z in read.items())
    + f"; S_q {h.std():.3f} in all"
)
for z in read.values():
    assert np.allclose(z - z.mean(), h - h.mean(), atol=1e-6)
lowest = [z.min() for z in read.values()]
assert np.allclose(lowest, [-3.8994, -7.3822, -3.4827], atol=1e-3), lowest
PY
