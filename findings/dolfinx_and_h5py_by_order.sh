#!/usr/bin/env bash
# Debian 12's DOLFINx 0.5.2 (HDF5 1.10) and the wheel of h5py 3.16.0 (an HDF5 2.0.0 of its own): one process, either order of import.
#
# Guess: two HDF5 libraries in one process fail whichever comes first, or never, since the wheel carries its own under another name.
# Behaviour: h5py first, both work: DOLFINx writes a mesh, h5py reads it. DOLFINx first, `import h5py` raises "Not a datatype".
# Why the guess fails: h5py's modules look up symbols of HDF5 that are global once DOLFINx has loaded Debian's library, and the order of loading
#   decides whose they are. `pip install` of any package that needs h5py makes the pair: pip cannot see Debian's h5py, whose metadata have
#   another name. Sorted imports put dolfinx before h5py.
#
# Output seen:
#   h5py first: mesh of 2 x 2 squares read, 9 points
#   DOLFINx first: ValueError: Not a datatype (not a datatype)
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
dpkg-query -W python3-dolfinx-real >/dev/null  # Debian's, by apt-get install python3-dolfinx-real
/usr/bin/python3 -m venv --system-site-packages "$folder/venv"
PIP_NO_DEPS=1 PIP_IGNORE_INSTALLED=1 "$folder/venv/bin/pip" install --quiet h5py==3.16.0
cd "$folder"
cat >first.py <<'PY'
import h5py
import dolfinx
from dolfinx.io import XDMFFile
from dolfinx.mesh import create_unit_square
from mpi4py import MPI

with XDMFFile(MPI.COMM_SELF, "mesh.xdmf", "w") as file:
    file.write_mesh(create_unit_square(MPI.COMM_SELF, 2, 2))
with h5py.File("mesh.h5") as file:
    points = file["Mesh/mesh/geometry"].shape[0]
print(f"h5py first: mesh of 2 x 2 squares read, {points} points")
assert dolfinx.__version__ == "0.5.2" and points == 9
PY
cat >second.py <<'PY'
import dolfinx.io

try:
    import h5py
except ValueError as error:
    print(f"DOLFINx first: ValueError: {error}")
else:
    raise SystemExit(f"h5py {h5py.__version__} loads after DOLFINx {dolfinx.__version__}")
PY
"$folder/venv/bin/python" first.py
"$folder/venv/bin/python" second.py
