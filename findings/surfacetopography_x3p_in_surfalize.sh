#!/usr/bin/env bash
# SurfaceTopography 1.27.1 and surfalize 0.19.2: an X3P file from one to the other.
#
# Guess: to_x3p writes a file that any reader of X3P takes, since both name ISO 25178-72 as their format.
# Behaviour: surfalize refuses it: "Checksum of main.xml file does not match". The file md5checksum.hex has the checksum of
#   bindata/data.bin; surfalize takes its first word for that of main.xml. With that word replaced the file is read, heights
#   equal to the last digit. SurfaceTopography itself reads both.
# Why the guess fails: one reads back what it wrote without ever looking at the checksum, the other trusts the checksum alone,
#   so the test of a round trip in either program passes.
#
# Output seen:
#   as written: refused (CorruptedFileError); with the checksum of main.xml: read, largest difference 4.4e-16 um
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet SurfaceTopography==1.27.1 surfalize==0.19.2 numpy==2.4.6
cd "$folder"
export MPLBACKEND=Agg MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import hashlib
import zipfile

import numpy as np
from surfalize import Surface
from surfalize.exceptions import CorruptedFileError
from SurfaceTopography import Topography, read_topography

heights = np.random.default_rng(1).normal(size=(40, 30))
Topography(heights, (40.0, 30.0), unit="um").to_x3p("a.x3p")
with zipfile.ZipFile("a.x3p") as source, zipfile.ZipFile("b.x3p", "w") as target:
    content = {name: source.read(name) for name in source.namelist()}
    written = content["md5checksum.hex"].split()[0].decode().lower()
    assert written == hashlib.md5(content["bindata/data.bin"]).hexdigest()
    content["md5checksum.hex"] = hashlib.md5(content["main.xml"]).hexdigest().encode() + b" *main.xml\n"
    for name, data in content.items():
        target.writestr(name, data)
for name in ("a.x3p", "b.x3p"):
    assert np.allclose(read_topography(name).to_unit("um").heights(), heights)
try:
    Surface.load("a.x3p")
except CorruptedFileError as error:
    assert "Checksum of main.xml" in str(error)
else:
    raise SystemExit("surfalize reads the file as written")
off = np.abs(Surface.load("b.x3p").data - heights.T).max()
print(f"as written: refused (CorruptedFileError); with the checksum of main.xml: read, largest difference {off:.1e} um")
assert off < 1e-9
PY
