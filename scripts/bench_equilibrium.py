#!/usr/bin/env python3
"""Braking equilibrium of the reference brake: mesh size against seconds, memory and error.

    scripts/bench_equilibrium.py [--sizes 14 10 7.5] [--mu 0.5]

Columns: size of the linings' friction faces, free dofs, contact elements; seconds of meshing and
assembly, of the factorisation, of the compliance (one block solve per 64 contact elements), of one
equilibrium; peak memory so far; difference of the first moment of pressure about the disc axis
(the brake torque over mu) to that of the finest mesh; largest difference of a pressure to Newton's
iteration on all displacements with a sparse factorisation, relative to the largest pressure.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from brake_fenicsx.geometry import disc, pad

from brake_fenicsx.macro import EnrichedGap, displacement
from brake_fenicsx.macro.condensation import (
    Compliance,
    gathered_vector,
    interface_moments,
    petsc_matrix,
    reference_factor,
)
from brake_fenicsx.macro.contact import contact_elements
from brake_fenicsx.macro.elasticity import assemble_elastic
from brake_fenicsx.macro.equilibrium import equilibrium
from brake_fenicsx.macro.friction import Rotation
from brake_fenicsx.macro.material import Material, isotropic, transversely_isotropic
from brake_fenicsx.macro.mesh import build_mesh
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.micro import OneLaw, exponential_law

STEEL = Material(isotropic(207e9, 0.28), 7820.0)
MATERIALS = {
    "disc.body": Material(isotropic(125e9, 0.24), 7200.0),
    "pad.lining": Material(transversely_isotropic(5.94e9, 0.76e9, 0.98e9, 2.27e9, 1.18e9), 2510.0),
    "pad.plate": STEEL,
}
SUPPORTS = {"disc.bore": ["x", "y", "z"], "pad.ears": ["x", "y"]}
K0 = 2e11


@dataclass(frozen=True)
class Case:
    """Operators of one mesh."""

    elastic: Any
    contact: Any
    f: np.ndarray
    seconds: float


def brake(size: float, comm: MPI.Comm = MPI.COMM_SELF) -> Case:
    """The reference brake without shim, its friction faces meshed with a size [m]."""
    start = time.perf_counter()
    parts = {
        "disc": (disc, disc.Disc(size=1.6 * size)),
        "pad": (pad, pad.Pad(size=size, plate_size=1.2 * size)),
    }
    mesh = build_mesh(parts, comm)
    elastic = assemble_elastic(mesh, MATERIALS, SUPPORTS, {"pad.piston": 5e5})
    contact = contact_elements(mesh, elastic.free, ("pad.friction", "disc.friction"), Rotation(5.0))
    return Case(elastic, contact, gathered_vector(elastic.f), time.perf_counter() - start)


def enriched(points: np.ndarray) -> EnrichedGap:
    """One exponential law; critical gaps a smooth function of place, the same on every mesh."""
    x, y, z = points.T
    g_cr = 2e-6 * np.sin(150 * x) * np.cos(170 * y) * np.sign(z)
    n = len(points)
    return EnrichedGap(OneLaw(exponential_law(2e5, 2e-6)), np.zeros(n, dtype=np.intp), g_cr)


def sparse_newton(case: Case, laws: EnrichedGap, mu: float, u: np.ndarray) -> np.ndarray:
    """Gaps by Newton's iteration on all displacements, from a start nearby."""
    from petsc4py import PETSc

    c, K = case.contact, local_rows(case.elastic.K)
    push = (c.N + mu * c.T).T.tocsr()
    for _ in range(20):
        g = c.gap(u)
        r = case.f + push @ (c.w * laws.pressure(g)) - K @ u
        A = petsc_matrix(K + push @ sp.diags(c.w * laws.stiffness(g)) @ c.N)
        ksp = PETSc.KSP().create(A.comm)
        ksp.setOperators(A)
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        b, x = A.createVecs()
        b.array[:] = r
        ksp.solve(b, x)
        du = x.array_r.copy()
        ksp.destroy()
        u = u + du
        if np.linalg.norm(du) < 1e-12 * np.linalg.norm(u):
            break
    return c.gap(u)


def measure(size: float, mu: float) -> dict[str, float]:
    """All figures of one mesh."""
    case = brake(size)
    c = case.contact
    k0 = np.full(c.w.size, K0)
    factor = reference_factor(case.elastic.K, c.N, c.w, k0)
    start = time.perf_counter()
    ((NN, NT),) = interface_moments(factor, None, c.N, c.T, 0, MPI.COMM_SELF)
    ops = SimpleNamespace(
        N=c.N, T=c.T, w=c.w, g0=c.g0,
        compliance=Compliance(factor, k0, NN, NT, c.N @ factor.solve(case.f)),
    )  # fmt: skip
    seconds = time.perf_counter() - start
    laws = enriched(c.points)
    eq = equilibrium(ops, laws, mu)
    u = displacement(ops, eq, case.f)
    p = laws.pressure(sparse_newton(case, laws, mu, u * (1 + 1e-3)))
    radius = np.hypot(*c.points[:, :2].T)
    return {
        "size": size, "dofs": case.elastic.free.size, "elements": c.w.size,
        "assembly": case.seconds, "factor": factor.seconds, "compliance": seconds,
        "equilibrium": eq.seconds, "iterations": sum(eq.iterations),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        "moment": float(np.sum(c.w * eq.p * radius)), "peak": float(eq.p.max()),
        "sparse": float(np.abs(eq.p - p).max() / eq.p.max()),
    }  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=float, nargs="+", default=[14.0, 10.0, 7.5], help="mm")
    parser.add_argument("--mu", type=float, default=0.5)
    given = parser.parse_args()
    brake(max(given.sizes) * 1e-3)  # warms the cache of compiled forms
    rows = [measure(s * 1e-3, given.mu) for s in sorted(given.sizes, reverse=True)]
    print(
        " size/mm    dofs  elements  assembly/s  factor/s  compliance/s  equilibrium/s  iterations"
        "  peak memory/GB  torque against finest  against sparse Newton"
    )
    for r in rows:
        error = abs(r["moment"] / rows[-1]["moment"] - 1)
        print(
            f"{r['size'] * 1e3:8.2f} {r['dofs']:7d} {r['elements']:9d} {r['assembly']:11.2f}"
            f" {r['factor']:9.2f} {r['compliance']:13.2f} {r['equilibrium']:14.4f}"
            f" {r['iterations']:11d} {r['memory']:15.2f} {error:22.1e} {r['sparse']:22.1e}"
        )


if __name__ == "__main__":
    main()
