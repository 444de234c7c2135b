#!/usr/bin/env python3
"""Stand-ins for a user's own files: see docs/own_scan_own_mesh.md.

my_scan.txt    heights [um], one row of the map per line, no header: as many instruments export
my_brake.inp   Abaqus deck of a disc and two pads [mm], element sets for parts and faces

Run as: scripts/example_inputs.py [FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from brake_fenicsx.surface import read_topography

SCAN = Path(__file__).parent / "scenes" / "pad_scan.npz"
SIZE = 25.0  # of the cells [mm]; far too coarse for anything but an example


def write_scan(path: Path) -> None:
    np.savetxt(path, 1e6 * read_topography(SCAN).heights, fmt="%.3f")


def faces_at(volumes: list[int], place: Any) -> list[int]:
    """Faces of some volumes whose box (x, y, z low, x, y, z high) satisfies ``place``."""
    around = gmsh.model.getBoundary([(3, v) for v in volumes], combined=False, oriented=False)
    return sorted({t for _, t in around if place(gmsh.model.getBoundingBox(2, t))})


def write_mesh(path: Path) -> None:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    whole, hole = (occ.addCylinder(0, 0, -10, 0, 0, 20, r) for r in (140, 70))
    disc = occ.cut([(3, whole)], [(3, hole)])[0][0][1]
    linings = [occ.addBox(-40, 85, z, 80, 45, 10) for z in (10, -20)]
    plates = [occ.addBox(-40, 85, z, 80, 45, 6) for z in (20, -26)]
    # Lining and back plate share their nodes, lining and disc do not.
    for lining, plate in zip(linings, plates, strict=True):
        occ.fragment([(3, lining)], [(3, plate)])
    occ.synchronize()

    def flat(*heights: float) -> Any:
        return lambda box: any(abs(box[2] - z) + abs(box[5] - z) < 1e-3 for z in heights)

    groups = {
        "ROTOR": (3, [disc]), "LINING": (3, linings), "BACKPLATE": (3, plates),
        "ROTOR_FACE": (2, faces_at([disc], flat(10, -10))),
        "PAD_FACE": (2, faces_at(linings, flat(10, -10))),
        "PISTON": (2, faces_at(plates, flat(26, -26))),
        "SIDES": (2, faces_at(plates, lambda box: box[3] - box[0] < 1e-3)),
        "CLAMP": (2, faces_at([disc], lambda box: box[3] < 71)),
    }  # fmt: skip
    for name, (dimension, tags) in groups.items():
        number = gmsh.model.addPhysicalGroup(dimension, tags)
        gmsh.model.setPhysicalName(dimension, number, name)
    gmsh.option.setNumber("Mesh.MeshSizeMin", SIZE)
    gmsh.option.setNumber("Mesh.MeshSizeMax", SIZE)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("folder", nargs="?", default=Path(), type=Path, metavar="FOLDER")
    folder = words.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    write_scan(folder / "my_scan.txt")
    write_mesh(folder / "my_brake.inp")
    print(f"wrote my_scan.txt and my_brake.inp into {folder}")
