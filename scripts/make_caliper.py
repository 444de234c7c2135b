#!/usr/bin/env python3
"""The caliper of scripts/scenes/whole_brake.toml, as another code would hand it over.

    scripts/make_caliper.py [FOLDER]        scripts/scenes/caliper if not given

A floating caliper of ductile iron, a housing on the piston's side, a bridge over the disc and
fingers on the other side, meshed with quadratic tetrahedra and reduced by the method of Craig and
Bampton (AIAA J. 6, 1968, doi:10.2514/3.4741) to the nodes of three sets and the modes of the body
that is held there. Written: stiffness and mass in t, mm, s (npz), and the table of the nodes.
"""

from __future__ import annotations

import argparse
import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import KDTree

from brake_fenicsx.geometry.part import PartEntities
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.material import Material, isotropic
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.meshing.brake_mesh import build_mesh
from brake_fenicsx.stability.eigensolvers.symmetric import lowest_modes

# Boxes [mm]: housing, bridge, fingers, and the bosses of both guide pins.
BOXES = (
    (-45, 96, 32, 90, 72, 30), (-50, 148, -48, 100, 20, 110), (-40, 108, -48, 80, 45, 21),
    (-70, 110, 40, 30, 20, 20), (40, 110, 40, 30, 20, 20),
)  # fmt: skip
SIZE = 9e-3
IRON = Material(isotropic(169e9, 0.275), 7100.0)

# Places [mm] whose nearest nodes make the sets: where the fingers press the outer pad, where the
# piston's pressure acts on the housing, and the ends of the bosses.
SETS = {
    "fingers": [(x, y, -27) for x in (-20, 0, 20) for y in (112, 120, 130)],
    "bore": [(x, y, 32) for x in (-15, 0, 15) for y in (106, 118, 130)],
    "pins": [(x, y, z) for x in (-70, 70) for y, z in ((114, 46), (126, 46), (120, 54))],
}

# Modes of the held body up to this frequency [Hz], well beyond the band.
HIGHEST = 40e3


def build(occ: Any, _: Any) -> PartEntities:
    """The caliper as one volume of the current gmsh model."""
    boxes = [(3, occ.addBox(*(1e-3 * v for v in box))) for box in BOXES]
    found, _ = occ.fuse(boxes[:1], boxes[1:])
    occ.synchronize()
    volumes = [tag for _, tag in found]
    return PartEntities(volumes={"body": volumes}, faces={"none": []}, sizes={"body": SIZE})


def main() -> None:
    """Write the files."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = Path(__file__).parent / "scenes" / "caliper"
    parser.add_argument("folder", nargs="?", type=Path, default=default)
    folder = parser.parse_args().folder
    folder.mkdir(exist_ok=True)
    mesh = build_mesh({"caliper": (SimpleNamespace(build=build), None)}, MPI.COMM_SELF)
    elastic = assemble_elastic(mesh, {"caliper.body": IRON}, {})
    points = elastic.free.V.tabulate_dof_coordinates()
    nodes: list[int] = []
    rows = []
    for name, places in SETS.items():
        _, found = KDTree(points).query(1e-3 * np.array(places, float))
        if len({*found}) < len(found):
            raise SystemExit(f"{name}: two places have one node; take smaller cells")
        for node in found:
            x, y, z = 1e3 * points[node]
            rows.append(f"{len(nodes) + 1},{x:.9g},{y:.9g},{z:.9g},{name}")
            nodes.append(int(node))
    (folder / "nodes.csv").write_text("node,x,y,z,set\n" + "\n".join(rows) + "\n")
    held = (3 * np.array(nodes)[:, None] + np.arange(3)).reshape(-1)
    K, M, modes = craig_bampton(elastic.K, elastic.M, held)
    # N/mm and t, for mm, t, s.
    for name, A in (("stiffness", K), ("mass", M)):
        sp.save_npz(folder / f"{name}.npz", sp.csr_matrix(A / 1e3))
    print(
        f"{elastic.free.size} dofs to {3 * len(nodes)} displacements and {modes} modal coordinates"
        f" (parts.caliper.matrices.modal);"
        f" mass {elastic.M.sum() / 3:.3f} kg"
    )


def craig_bampton(
    K: sp.csr_matrix, M: sp.csr_matrix, held: NDArray[np.int64]
) -> tuple[NDArray, NDArray, int]:
    """Stiffness and mass on some dofs and the modes of the body that is held there."""
    inner = np.setdiff1d(np.arange(K.shape[0]), held)
    factor = Factor(K[inner][:, inner])
    static = -factor.solve(K[inner][:, held].toarray())
    Phi = lowest_modes(factor, M[inner][:, inner], (2 * np.pi * HIGHEST) ** 2).Phi
    T = np.zeros((K.shape[0], held.size + Phi.shape[1]))
    T[held, np.arange(held.size)] = 1.0
    T[inner, : held.size], T[inner, held.size :] = static, Phi
    found = (T.T @ (A @ T) for A in (K, M))
    reduced = [0.5 * (A + A.T) for A in found]
    return reduced[0], reduced[1], Phi.shape[1]


if __name__ == "__main__":
    main()
