#!/usr/bin/env python3
"""Compile DOLFINx's forms of every kind of element, so that no run of an image has to.

They go to the cache of DOLFINx, $XDG_CACHE_HOME/fenics. Run as: scripts/warm_jit.py
"""

import tempfile
from pathlib import Path

from mpi4py import MPI

from brake_fenicsx import pipeline
from brake_fenicsx.folder.log import start_log

# What adds forms to those of the smallest scene: springs and dashpots on a face, a rotation; a mass
# on a face, which no rotation may have beside it.
SPRINGS = """
[springs."block.top"]
stiffness = [0, 0, "1 N/mm"]
damping = [0, 0, "1 N s/m"]
"""
ROTATION = """
[stability.damping]
gyroscopic = true
"""
MASS = """
[masses."block.top"]
mass = "1 g"
"""


def main() -> None:
    scene = (Path(__file__).parent / "scenes" / "block_on_plate.toml").read_text()
    turning = scene.replace("direction = [1, 0, 0]", 'axis = "z"').replace("1 m/s", "5 rad/s")
    scenes = {
        "turning": (turning + SPRINGS + ROTATION, "stages=['equilibrium', 'stability']"),
        "mass": (scene + MASS, "stages=['equilibrium']"),
    }
    start_log(0, level="WARNING")
    with tempfile.TemporaryDirectory() as folder:
        for name, (text, stages) in scenes.items():
            file = Path(folder) / f"{name}.toml"
            file.write_text(text)
            for cells in ("tetrahedra", "hexahedra"):
                for degree, order in ((1, 1), (2, 1), (2, 2)):
                    out = Path(folder) / f"{name}-{cells}-{degree}-{order}"
                    mesh = [f"mesh.cells={cells!r}", f"mesh.degree={degree}", f"mesh.order={order}"]
                    pipeline.run(file, MPI.COMM_SELF, out, [stages, *mesh])


main()
