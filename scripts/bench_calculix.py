#!/usr/bin/env python3
"""The same brake in CalculiX: frequencies, growth and CPU seconds of both programs in one table.

    scripts/bench_calculix.py [SCENE ...] [--bodies] [--penalty 2e13] [--slip 1e-4] [--modes 30]
                              [--keep FOLDER] [--set KEY=VALUE ...]

Writes the deck of a scene of tetrahedra: its mesh (C3D10, or C3D4 of ``mesh.degree = 1``),
materials, supports and loads, and for its contact CalculiX's own face-to-face penalty with Coulomb
friction. Two static steps press the faces together and slide them by the prescribed displacement
of the clamped faces of the second bodies; a frequency step about that state has an unsymmetric
stiffness, and complex frequencies. Both programs have the same linear penalty, without critical
gaps. What differs is the discretisation of the contact: CalculiX has pressures at points of the
clipped facets, this program means over facets, or pressures at Gauss points with
``discretisation = "quadrature"``.

With ``--bodies`` real modes of the bodies without contact are compared, here with an exact mass and
with the points at which CalculiX integrates it: four in a C3D10, one in a C3D4.

Friction must be a number, and the second body of an interface clamped somewhere. Needs ``ccx``
(Debian: calculix-ccx).
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh

from brake_fenicsx import compat, prepare
from brake_fenicsx.build.brake import Brake, assemble_brake
from brake_fenicsx.build.material_table import layer_materials
from brake_fenicsx.macro.elasticity import COMPONENTS, mass_form, on_free_dofs
from brake_fenicsx.scene import Scene, read_scene

Array = NDArray[np.float64]

SCENES = Path(__file__).parent / "scenes"
# Corners of the edges that carry nodes 5 to 10, and of the faces S1 to S4, of a C3D10.
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
# Voigt order of CalculiX: 11, 22, 33, 12, 13, 23.
ORDER = [0, 1, 2, 5, 4, 3]

# Friction of CalculiX sticks with this stiffness [Pa/m] before it slips, and resists slips across
# the sliding direction with it in the frequency step. It is so small that it shifts no frequency,
# and the loads so small [Pa] that all points slip nevertheless: a linear penalty without gaps has
# the same modes under any load.
STICK, PRESSURE = 1e7, 50.0

# In the frequency step friction is this much stiffer, so that no point is on the verge of sticking.
BEYOND = 1.5


class Deck:
    """The deck of a scene, and what its faces are made of."""

    def __init__(self, scene: Scene, brake: Brake, penalty: float, slip: float, modes: int):
        self.scene, self.brake, self.penalty, self.slip, self.modes = (
            scene, brake, penalty, slip, modes,
        )  # fmt: skip
        self.mesh, self.V = brake.mesh, brake.elastic.free.V
        domain = self.mesh.domain
        for pair in ((2, 3), (3, 2), (2, 0), (3, 0)):
            domain.topology.create_connectivity(*pair)
        self.x = self.V.tabulate_dof_coordinates()
        cells = np.arange(domain.topology.index_map(3).size_local)
        self.cells = self._ordered(compat.cell_dofs(self.V, cells))

    def _ordered(self, dofs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Nodes of each cell in the order of a C3D4 or C3D10 of positive volume."""
        corners = dofs[:, :4].copy()
        a, b, c, d = (self.x[corners[:, i]] for i in range(4))
        inverted = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0
        corners[inverted] = corners[inverted][:, [0, 2, 1, 3]]
        middle, out = self.x[dofs[:, 4:]], [corners]
        if dofs.shape[1] == 4:
            return corners
        for i, j in EDGES:
            at = 0.5 * (self.x[corners[:, i]] + self.x[corners[:, j]])
            nearest = np.linalg.norm(middle - at[:, None], axis=2).argmin(axis=1)
            out.append(dofs[np.arange(len(dofs)), 4 + nearest][:, None])
        return np.hstack(out)

    def facets(self, face: str) -> list[tuple[int, int]]:
        """Cells and numbers of their faces, both from 1, of a named face."""
        topology = self.mesh.domain.topology
        to_cell = topology.connectivity(2, 3)
        places = fem.locate_dofs_topological
        out = []
        for facet in self.mesh.facet_tags.find(self.mesh.faces[face]):
            cell = int(to_cell.links(facet)[0])
            own = set(places(self.V, 2, np.array([facet], np.int32)).tolist())
            number = next(n for n, f in enumerate(FACES) if {*self.cells[cell][list(f)]} <= own)
            out.append((cell + 1, number + 1))
        return out

    def nodes(self, face: str) -> NDArray[np.int64]:
        """Nodes of a named face, from 0."""
        facets = self.mesh.facet_tags.find(self.mesh.faces[face])
        return np.asarray(fem.locate_dofs_topological(self.V, 2, facets), dtype=np.int64)

    def bodies(self) -> Iterable[str]:
        """Nodes, elements, materials and supports, line by line."""
        scene, mesh = self.scene, self.mesh
        yield "*NODE, NSET=ALL"
        for i, p in enumerate(self.x, 1):
            yield f"{i},{p[0]:.12g},{p[1]:.12g},{p[2]:.12g}"
        materials = layer_materials(scene, mesh.layers)
        for layer, tag in mesh.layers.items():
            name = re.sub(r"\W", "_", layer)
            yield f"*ELEMENT, TYPE=C3D{self.cells.shape[1]}, ELSET={name}"
            for cell in mesh.cell_tags.find(tag):
                yield ",".join(str(n) for n in (cell + 1, *(self.cells[cell] + 1)))
            C = materials[layer].C[np.ix_(ORDER, ORDER)]
            moduli = [f"{C[i, j]:.10g}" for j in range(6) for i in range(j + 1)]
            yield f"*MATERIAL, NAME={name}"
            yield "*ELASTIC, TYPE=ANISO"
            yield from (",".join(moduli[i : i + 8]) for i in (0, 8, 16))
            yield f"*DENSITY\n{materials[layer].rho:.10g}"
            yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
        held = [(n, COMPONENTS[c] + 1) for f, cs in scene.supports.items() for n in self.nodes(f)
                for c in cs]  # fmt: skip
        yield "*BOUNDARY"
        yield from (f"{node + 1},{c}" for node, c in sorted(set(held)))

    def real_modes(self) -> Iterable[str]:
        """The bodies without contact, and their real modes."""
        yield from self.bodies()
        yield f"*STEP\n*FREQUENCY\n{self.modes}\n*END STEP"

    def braking(self) -> Iterable[str]:
        """The brake pressed and slid, and its complex modes."""
        scene = self.scene
        yield from self.bodies()
        for i, contact in enumerate(scene.contact.values()):
            for j, face in enumerate(contact.faces):
                yield f"*SURFACE, NAME=FACE{i}{j}, TYPE=ELEMENT"
                yield from (f"{cell},S{number}" for cell, number in self.facets(face))
            yield f"*SURFACE INTERACTION, NAME=CONTACT{i}"
            yield f"*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n{self.penalty:.10g}"
            if contact.friction:
                yield f"*FRICTION\n{contact.friction:.10g},{STICK:.10g}"
            yield f"*CONTACT PAIR, INTERACTION=CONTACT{i}, TYPE=SURFACE TO SURFACE"
            yield f"FACE{i}0,FACE{i}1"
        yield "*STEP, INC=1000, NLGEOM=NO\n*STATIC\n0.25,1.,1e-6,1."
        yield "*DLOAD"
        highest = max(load.pressure for load in scene.loads.values())
        for face, load in scene.loads.items():
            p = PRESSURE * load.pressure / highest
            yield from (f"{cell},P{n},{p:.10g}" for cell, n in self.facets(face))
        yield "*END STEP\n*STEP, INC=1000\n*STATIC\n0.25,1.,1e-6,1.\n*BOUNDARY"
        for node, u in self._slid():
            yield from (f"{node + 1},{c},{c},{u[c - 1]:.10g}" for c in (1, 2, 3) if u[c - 1])
        yield "*END STEP\n*STEP, PERTURBATION"
        for i, contact in enumerate(scene.contact.values()):
            if contact.friction:
                yield f"*CHANGE FRICTION, INTERACTION=CONTACT{i}"
                yield f"*FRICTION\n{contact.friction:.10g},{BEYOND * STICK:.10g}"
        yield "*FREQUENCY"
        yield f"{self.modes}\n*END STEP"

    def _slid(self) -> Iterable[tuple[int, Array]]:
        """Nodes of clamped faces of the bodies that move, and their displacement [m]."""
        moved = {c.faces[1].partition(".")[0] for c in self.scene.contact.values()}
        motion = self.scene.motion
        for face, held in self.scene.supports.items():
            if face.partition(".")[0] not in moved or len(held) < 3:
                continue
            nodes = self.nodes(face)
            if motion is not None and motion.direction is not None:
                u = np.tile(self.slip * np.asarray(motion.direction, float), (nodes.size, 1))
            else:
                x, y, z = self.x[nodes].T
                angle = self.slip / np.hypot(x, y).max()
                c, s = np.cos(angle) - 1.0, np.sin(angle)
                u = np.stack([c * x - s * y, s * x + c * y, 0 * z], axis=1)
            yield from zip(nodes.tolist(), u, strict=True)


def by_calculix(lines: Iterable[str], folder: Path) -> tuple[Array, float]:
    """Angular frequencies [rad/s] of CalculiX, growth as imaginary part, and its CPU seconds.

    Raises:
        RuntimeError: CalculiX finds none; its last words.
    """
    (folder / "brake.inp").write_text("\n".join(lines) + "\n")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    out = subprocess.run(["ccx", "brake"], cwd=folder, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    (folder / "brake.log").write_text(out.stdout + out.stderr)
    rows = [line.split() for line in (folder / "brake.dat").read_text().splitlines()]
    # Number, real part, cycles, imaginary part; real problems have the eigenvalue before them.
    table = [row[-3:] for row in rows if len(row) in (4, 5) and row[0].isdigit()]
    if not table:
        raise RuntimeError("\n".join(out.stdout.splitlines()[-15:]))
    omega, _, growth = np.array(table, dtype=float).T
    return omega + 1j * np.abs(growth), seconds


def mass_of_few_points(scene: Scene, brake: Brake) -> sp.csr_matrix:
    """Mass on the free dofs by four points in a quadratic tetrahedron, one in a linear one."""
    mesh, free = brake.mesh, brake.elastic.free
    materials = layer_materials(scene, mesh.layers)
    u, v = ufl.TrialFunction(free.V), ufl.TestFunction(free.V)
    total = sp.csr_matrix((free.size, free.size))
    for layer, tag in mesh.layers.items():
        cells = compat.meshtags(mesh.domain, 3, mesh.cell_tags.find(tag), 1)
        rule = {"quadrature_degree": scene.mesh.degree}
        dx = ufl.Measure("dx", domain=mesh.domain, subdomain_data=cells, metadata=rule)(1)
        A = fem_petsc.assemble_matrix(fem.form(mass_form(u, v, materials[layer].rho, dx)))
        total = total + on_free_dofs(A, free)
    return total


def compare_bodies(scene: Path, overrides: list[str], modes: int, folder: Path) -> Array:
    """Print the table of the bodies without contact, and give it.

    Returns:
        Frequency with exact mass, with that of CalculiX, and of CalculiX [Hz], shape (modes, 3).
    """
    parsed = read_scene(scene, [*overrides_of(scene, 1e13), *overrides])
    brake = assemble_brake(parsed, MPI.COMM_SELF)
    omega, theirs = by_calculix(Deck(parsed, brake, 1.0, 0.0, modes).real_modes(), folder)
    K, M = brake.K, brake.M
    few = mass_of_few_points(parsed, brake)
    shift = (0.5 * omega[omega.real > 1.0].real.min()) ** 2
    found = [
        np.sqrt(np.abs(np.sort(eigsh(K, modes, A, sigma=-shift, return_eigenvectors=False))))
        for A in (M, few)
    ]
    count = min(modes, omega.size)
    table = np.stack([*(w[:count] for w in found), omega.real[:count]], axis=1) / 2 / np.pi
    table = table[table[:, 2] > 1.0]  # rigid motions are round-off
    print(f"{scene.stem}, bodies without contact: {theirs:.1f} CPU s in CalculiX")
    print("| f [Hz] | f with the points of CalculiX [Hz] | f CalculiX [Hz] | differences | |")
    print("| --- | --- | --- | --- | --- |")
    for exact, like, other in table:
        print(f"| {exact:.2f} | {like:.2f} | {other:.2f} | {other / exact - 1:+.1e} |"
              f" {other / like - 1:+.1e} |")  # fmt: skip
    return table


def overrides_of(scene: Path, penalty: float) -> list[str]:
    """The scene with a linear penalty in all contact, full order, and nothing that is random."""
    given = read_scene(scene)
    out = ['stages=["equilibrium","stability"]', 'stability.method="full"']
    if "uncertainty" in given.stages:
        out[0] = 'stages=["equilibrium","stability","uncertainty"]'
        out += ['samples.approaches=["multi-scale"]', "samples.n=1"]
    for name in given.contact:
        out.append(f'contact.{name}.law={{ linear = "{penalty:g} Pa/m" }}')
        out.append(f'contact.{name}.gap="none"')
    return out


def compare(
    scene: Path, overrides: list[str], penalty: float, slip: float, modes: int, folder: Path
) -> Array:
    """Print the table of both programs, and give it.

    Returns:
        Frequency here and in CalculiX [Hz], growth here and there [1/s]: one row for each mode
        that grows or keeps its size, of as many as CalculiX found, shape (modes, 4).
    """
    overrides = [*overrides_of(scene, penalty), *overrides]
    parsed = read_scene(scene, overrides)
    brake = assemble_brake(parsed, MPI.COMM_SELF)
    omega, theirs = by_calculix(Deck(parsed, brake, penalty, slip, modes).braking(), folder)
    frequency, growth = omega.real / 2 / np.pi, omega.imag
    start = time.process_time()
    s = prepare(scene, overrides).modes().s
    ours = time.process_time() - start
    s = s[(s.real > -1e-6 * np.abs(s)) & (s.imag <= 2 * np.pi * frequency.max())]
    distance = np.abs(s.imag[:, None] / 2 / np.pi - frequency)
    distance += np.abs(s.real[:, None] - growth) / 2 / np.pi
    nearest = distance.argmin(axis=1)
    table = np.stack([s.imag / 2 / np.pi, frequency[nearest], s.real, growth[nearest]], axis=1)
    print(f"{scene.stem}: {brake.elastic.free.size} dofs, {brake.w.size} contact elements,"
          f" penalty {penalty:g} Pa/m; {ours:.1f} CPU s, CalculiX {theirs:.1f}")  # fmt: skip
    print("| f here [Hz] | f CalculiX [Hz] | difference | growth here [1/s] | CalculiX [1/s] |")
    print("| --- | --- | --- | --- | --- |")
    for f, g, a, b in table:
        print(f"| {f:.1f} | {g:.1f} | {g / f - 1:+.1e} | {round(a)} | {round(b)} |")
    return table


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scenes", nargs="*", type=Path, default=[SCENES / "block_on_plate.toml"])
    parser.add_argument("--bodies", action="store_true", help="real modes without contact")
    parser.add_argument("--penalty", type=float, default=2e13, help="contact stiffness [Pa/m]")
    parser.add_argument("--slip", type=float, default=1e-4, help="displacement of sliding [m]")
    parser.add_argument("--modes", type=int, default=30, help="modes wanted of CalculiX")
    parser.add_argument("--keep", type=Path, help="folder for deck and results of CalculiX")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the scene")
    options = parser.parse_args()
    if shutil.which("ccx") is None:
        parser.exit(2, "ccx is not installed (Debian: apt install calculix-ccx)\n")
    for scene in options.scenes:
        with tempfile.TemporaryDirectory() as made:
            folder = options.keep or Path(made)
            folder.mkdir(parents=True, exist_ok=True)
            if options.bodies:
                compare_bodies(scene, options.set, options.modes, folder)
                continue
            compare(scene, options.set, options.penalty, options.slip, options.modes, folder)


if __name__ == "__main__":
    main()
