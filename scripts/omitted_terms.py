#!/usr/bin/env python3
"""Size of the stiffness terms that the linearisation leaves out (docs/theory.md, "Terms left out").

    scripts/omitted_terms.py [SCENE] [--samples 2] [--set KEY=VALUE]

Equilibria of rough samples by the program, their modes at full order, and the shift of every
eigenvalue by each term to first order; then the unstable modes with the term, in the space of all
modes of the band. First of all the script turns both bodies together: the terms of the interface
must give the pressure and the friction turned by the same angle, and nothing else.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
import ufl
from bench_ensemble import SCENE, study
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from brake_fenicsx.build.brake import Brake, assemble_brake
from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.build.material_table import layer_materials
from brake_fenicsx.macro.elasticity import on_free_dofs, sigma
from brake_fenicsx.macro.faces import Face, gather_face
from brake_fenicsx.macro.integrals import facet_areas
from brake_fenicsx.macro.overlap import facing_pairs, overlap, rule
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import complex_modes, contact_interface
from brake_fenicsx.stability.eigen import tangent

Gradient = list[list[sp.csr_matrix]]
# Growth alpha / |lambda| beyond which a mode counts as unstable, and rigid modes [rad/s].
LIMIT, RIGID = 1e-6, 600.0


def gradients(pad: Face, disc: Face, dofs: int) -> Gradient:
    """Mean over each contact element of d u_i / d x_j on the disc's face, as G[i][j]."""
    count = len(pad.nodes)
    batches = overlap(pad, disc, facing_pairs(pad, disc, None), rule(pad, disc, 0))
    w = sum(np.bincount(o.pad, o.weight.sum(axis=1), minlength=count) for o in batches)
    kept = np.flatnonzero(w > 1e-6 * facet_areas(pad))
    number = np.full(count, -1)
    number[kept] = np.arange(kept.size)
    G = [[sp.csr_matrix((kept.size, dofs)) for _ in range(3)] for _ in range(3)]
    for o in batches:
        slope = disc.element.gradient(o.on_disc)
        t = np.einsum("pqad,pac->pqdc", slope, disc.nodes[o.disc])
        inverse = np.linalg.inv(np.einsum("pqdc,pqec->pqde", t, t))
        grad = np.einsum("pqad,pqde,pqec->pqac", slope, inverse, t)
        mean = np.einsum("pq,pqac->pac", o.weight, grad) / w[o.pad][:, None, None]
        used = number[o.pad] >= 0
        row = number[o.pad[used]]
        for i in range(3):
            column = disc.columns[o.disc][used][:, :, i]
            held, rows = column < 0, np.broadcast_to(row[:, None], column.shape)
            for j in range(3):
                at = (rows[~held], column[~held])
                G[i][j] += sp.csr_matrix((mean[used][:, :, j][~held], at), shape=G[i][j].shape)
    return G


def along(G: Gradient, a: np.ndarray, b: np.ndarray) -> sp.csr_matrix:
    """A . (b . grad) u of each contact element."""
    return sum(sp.diags(a[:, i] * b[:, j]) @ G[i][j] for i in range(3) for j in range(3)).tocsr()


def interface_terms(brake: Brake, G: Gradient, motion: Any, mu: Any, p: Any) -> dict[str, Any]:
    """Terms of pressure and friction on a face that turns, on the side of the stiffness."""
    c = brake.contact
    n, s, r = c.normal, c.s, np.cross(c.normal, c.s)
    P, F = sp.diags(c.w * p), sp.diags(c.w * p * mu)
    D_s, D_r = along(G, n, s), along(G, n, r)

    def base(a: np.ndarray) -> sp.dia_matrix:
        """Turn of the sliding direction along a; of no meaning in a translation, where it is 0."""
        slope = motion.velocity(c.points + a) - motion.velocity(c.points)
        return sp.diags(np.einsum("ij,ij->i", r, slope) / c.speed)

    turned = along(G, r, s) + base(s) @ c.T + base(r) @ c.R
    half = c.T.T @ P @ D_s + c.R.T @ P @ D_r
    return {
        "pressure, turned": half + half.T,
        "friction, turned with the face": -(c.N.T @ F @ D_s),
        "friction, convective slip rate": -(c.R.T @ F @ turned),
        "friction, point moved along": along(G, s, s).T @ F @ c.T + along(G, s, r).T @ F @ c.R,
    }


def check_turning(brake: Brake, terms: dict[str, Any], pad: Face, mu: Any, p: Any) -> float:
    """Largest error of the force on the pads when both bodies turn, relative to that force."""
    free, c, errors = brake.elastic.free, brake.contact, []
    total = sum(terms.values())
    x = free.V.tabulate_dof_coordinates()
    traction = c.normal + mu[:, None] * c.s
    scale = np.linalg.norm((c.w * p)[:, None] * traction, axis=1).sum()
    for axis in np.eye(3):
        w = np.zeros(free.size)
        w[free.column[free.local]] = np.cross(axis, x).reshape(-1)[free.local]
        wanted, force = -(c.w * p) @ np.cross(axis, traction), total @ w
        for i in range(3):
            columns = np.unique(pad.columns[:, :, i])
            errors.append(abs(force[columns[columns >= 0]].sum() - wanted[i]) / scale)
    return float(max(errors))


def stress_stiffness(scene: Any, brake: Brake, u: np.ndarray) -> sp.csr_matrix:
    """Geometric stiffness of the stresses at equilibrium, (grad u sigma) : grad v."""
    free, mesh = brake.elastic.free, brake.mesh
    steady = fem.Function(free.V)
    steady.x.array[:] = free.expand(u)
    a, v = ufl.TrialFunction(free.V), ufl.TestFunction(free.V)
    whole = ufl.Measure("dx", domain=mesh.domain, subdomain_data=mesh.cell_tags)
    parts = []
    for name, m in layer_materials(scene, mesh.layers).items():
        S = sigma(steady, ufl.as_matrix(np.asarray(m.C).tolist()))
        S = ufl.as_matrix([[S[0], S[5], S[4]], [S[5], S[1], S[3]], [S[4], S[3], S[2]]])
        form = ufl.inner(ufl.dot(ufl.grad(a), S), ufl.grad(v)) * whole(mesh.layers[name])
        parts.append(on_free_dofs(fem_petsc.assemble_matrix(fem.form(form)), free))
    return sum(parts[1:], parts[0])


def sizes(scene: Any, brake: Brake, data: Any) -> None:
    """Table of one sample."""
    c, free = brake.contact, brake.elastic.free
    p, k, mu = (data[n] for n in ("p", "k_vibration", "mu"))
    K, M, f = brake.K, brake.M, brake.f
    # Springs on open elements as well, taken off again on the right: the gaps are known.
    springs = c.w * (k + 1e9)
    push = c.N.T @ (c.w * p + springs * (data["g"] - c.g0)) + c.T.T @ (c.w * mu * p)
    u = Factor(K + c.N.T @ sp.diags(springs) @ c.N).solve(f + push)
    faces = next(iter(scene.contact.values())).faces
    pad, disc = (gather_face(brake.mesh, free, face) for face in faces)
    G = gradients(pad, disc, free.size)
    terms = interface_terms(brake, G, scene_motion(scene), mu, p)
    n, s = c.normal, c.s
    slopes = [along(G, n, a) @ u for a in (s, np.cross(n, s))]
    print(
        f"p / k {c.w @ p / (c.w @ k):.1e} m, slope of the disc at equilibrium"
        f" {max(np.abs(a).max() for a in slopes):.1e}, both bodies turned: error"
        f" {check_turning(brake, terms, pad, mu, p):.0e}"
    )
    tilt = sp.diags(slopes[0]) @ c.T + sp.diags(slopes[1]) @ c.R
    N, T, Wk = c.N, c.T, sp.diags(c.w * k)
    terms["slope of the disc at equilibrium"] = (
        N.T @ sp.diags(mu * slopes[0]) @ Wk @ N - (N + sp.diags(mu) @ T).T @ Wk @ tilt
        - tilt.T @ Wk @ N
    )  # fmt: skip
    terms["stress at equilibrium"] = stress_stiffness(scene, brake, u)
    terms["all of these"] = sum(terms.values())
    terms["for comparison: mu T'W k N"] = T.T @ sp.diags(mu) @ Wk @ N
    band, friction = scene.stability.band, contact_interface(N, T, c.w * k, mu)
    tangents = tangent(brake.K, N, T, c.w, k, mu)
    modes = complex_modes(M, None, tangents, (band[0], band[1]), friction=friction)
    X, Y, eigenvalues = modes.right, modes.left, modes.s
    mass = Y.conj().T @ (M @ X)
    growing = growth(np.diag(-(eigenvalues**2)))
    print(f"{'':34s}{'median':>9}{'largest':>9}{'real part':>10}{'unstable':>9}{'change':>9}")
    print(f"{'none':62s}{growing.size:9d}")
    elastic = np.abs(eigenvalues) > RIGID
    for name, term in terms.items():
        change = np.linalg.solve(mass, Y.conj().T @ (term @ X))
        shift = -np.diag(change)[elastic] / (2 * eigenvalues[elastic] ** 2)
        real = np.abs((shift * eigenvalues[elastic]).real / np.abs(eigenvalues[elastic]))
        size, line = np.abs(shift), ""
        if "comparison" not in name:
            now = growth(np.diag(-(eigenvalues**2)) + change)
            both = min(now.size, growing.size)
            line = f"{now.size:9d}{np.abs(now[:both] - growing[:both]).max(initial=0):9.0e}"
        print(f"{name:34s}{np.median(size):9.0e}{size.max():9.0e}{real.max():10.0e}{line}")


def growth(kappa: np.ndarray) -> np.ndarray:
    """Growth alpha / |lambda| of the unstable modes of kappa = -lambda^2, largest first."""
    roots = np.sqrt(-np.linalg.eigvals(kappa).astype(complex))
    roots = np.where(roots.imag < 0, -roots, roots)
    roots = roots[np.abs(roots) > RIGID]
    found = roots.real / np.abs(roots)
    return np.sort(found[found > LIMIT])[::-1]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    scene = read_scene(args.scene, args.set)
    stages = [s for s in scene.stages if s not in ("stability", "report")]
    with tempfile.TemporaryDirectory() as folder:
        study(args.scene, Path(folder) / "out", args.samples, 1, [f"stages={stages}", *args.set])
        files = sorted((Path(folder) / "out" / "samples").glob("*.npz"))
        samples = {f.stem: dict(np.load(f)) for f in files}
    brake = assemble_brake(scene, MPI.COMM_SELF)
    for name, data in samples.items():
        print(f"\n{name}")
        sizes(scene, brake, data)


if __name__ == "__main__":
    main()
