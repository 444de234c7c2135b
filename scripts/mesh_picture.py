#!/usr/bin/env python3
"""Pictures of what the builders make, side by side: docs/meshes.png.

Run as: scripts/mesh_picture.py [FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pyvista as pv
from dolfinx import plot

from brake_fenicsx.geometry import disc, pad
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings

OUT = Path(__file__).parents[1] / "docs" / "meshes.png"
COLOURS = {"body": "#b8bec6", "lining": "#c9743c", "plate": "#5b7fa6", "shim": "#3f8f6b"}
VIEW = [(0.39, 0.15, 0.40), (0.0, 0.02, 0.0), (0.0, 0.0, 1.0)]

CASES: list[tuple[Any, Any, MeshSettings]] = [
    (
        disc.Disc(vanes=24, hat=40e-3, size=9e-3),
        pad.Pad(chamfer=8e-3, slot=3e-3, shim=(1e-3,), size=5e-3, plate_size=5e-3),
        MeshSettings(),
    ),
    (
        disc.Disc(size=8e-3),
        pad.Pad(shim=(1e-3,), size=5e-3, plate_size=6e-3, shape="parallel"),
        MeshSettings(cells="hexahedra"),
    ),
]


def main() -> None:
    """Draw and save."""
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("file", nargs="?", default=OUT, type=Path, metavar="FILE")
    file = words.parse_args().file
    pv.OFF_SCREEN = True
    plotter = pv.Plotter(shape=(1, len(CASES)), window_size=(1300, 560), border=False)
    make = getattr(plot, "vtk_mesh", None) or plot.create_vtk_mesh
    for i, (d, p, table) in enumerate(CASES):
        mesh = build_mesh({"disc": (disc, d), "pad": (pad, p)}, MPI.COMM_SELF, table)
        plotter.subplot(0, i)
        grid = pv.UnstructuredGrid(*make(mesh.domain, 3))
        for layer, tag in mesh.layers.items():
            cells = np.sort(mesh.cell_tags.find(tag))
            colour = COLOURS[layer.partition(".")[2].rstrip("0123456789")]
            plotter.add_mesh(grid.extract_cells(cells), color=colour, show_edges=True)
        plotter.camera_position = VIEW
    plotter.screenshot(str(file))


if __name__ == "__main__":
    main()
