#!/usr/bin/env python3
"""Brake and braking equilibrium: speed against error. One table per subject.

    scripts/bench_equilibrium.py elements    kind, order and size of cells: frequencies, forces
    scripts/bench_equilibrium.py samples     condensed against sparse Newton, per sample
    scripts/bench_equilibrium.py ladder      20 k to 1 M free dofs: exponents of time and memory
    scripts/bench_equilibrium.py settings    orderings, threads and low-rank blocks of MUMPS

All on the reference brake, an exponential law per element with critical gaps that are a smooth
function of place. Every row runs in a process of its own, so that its memory is its own.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

SCENE = Path(__file__).parent / "scenes" / "disc_brake.toml"
LAW = (2e5, 2e-6)
MU = 0.5
MODES = 20
SECTORS, RINGS = 8, 2


def brake(
    sizes: dict[str, float], cells: str = "tetrahedra", order: int = 1, degree: int = 2
) -> Any:
    """The reference brake with other mesh sizes [mm]."""
    from mpi4py import MPI

    from brake_fenicsx.build.brake import assemble_brake
    from brake_fenicsx.scene import read_scene

    changes = ["stages=['equilibrium']", "samples.n=1", "contact.pad_disc.gap=none",
               f"contact.pad_disc.law={{ p0 = '{LAW[0]} Pa', u0 = '{LAW[1]} m' }}",
               f"mesh.cells={cells}", f"mesh.order={order}", f"mesh.degree={degree}"]  # fmt: skip
    changes += [f"parts.{name}='{size} mm'" for name, size in sizes.items()]
    scene = read_scene(SCENE, changes)
    return assemble_brake(scene, MPI.COMM_WORLD)


def scaled(factor: float, cells: str = "tetrahedra") -> dict[str, float]:
    """Sizes of disc, lining and plate as multiples of the reference scene's."""
    lining = 4.5 if cells == "tetrahedra" else 3.1
    return {"disc.size": 7 * factor, "pad.size": lining * factor, "pad.plate_size": 5 * factor}


def laws(points: np.ndarray) -> Any:
    """One exponential law; critical gaps a smooth function of place, the same on every mesh."""
    from brake_fenicsx.macro import EnrichedGap
    from brake_fenicsx.micro import OneLaw, exponential_law

    x, y, z = points.T
    g_cr = 2e-6 * np.sin(150 * x) * np.cos(170 * y) * np.sign(z)
    return EnrichedGap(OneLaw(exponential_law(*LAW)), np.zeros(len(points), dtype=np.intp), g_cr)


def gigabytes() -> float:
    """Peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def timed(job: Any) -> tuple[Any, float]:
    """Result of a call, and its seconds."""
    start = time.perf_counter()
    return job(), time.perf_counter() - start


def measure_element(case: dict[str, Any]) -> dict[str, Any]:
    """Frequencies and contact forces of one mesh."""
    from mpi4py import MPI

    from brake_fenicsx.macro.braking import reference_stiffness
    from brake_fenicsx.macro.equilibrium import compliance, equilibrium
    from brake_fenicsx.stability.eigensolvers.symmetric import lowest_modes

    sizes = scaled(case["factor"], case["cells"])
    kind = case["cells"], case["order"], case.get("degree", 2)
    brake(scaled(3, case["cells"]), *kind)  # compiles the forms
    b, assembly = timed(lambda: brake(sizes, *kind))
    enriched = laws(b.points)
    k0 = np.full(len(b.w), reference_stiffness(enriched, b.pressed / float(b.w.sum())))
    seen = compliance(b.K, b.N, b.T, b.w, b.f, k0, MPI.COMM_SELF)
    rows = b.M
    modes, seconds = timed(lambda: lowest_modes(seen.factor, rows, (2 * np.pi * 6.5e3) ** 2))
    eq = equilibrium(replace(b, compliance=seen), enriched, MU)
    return {
        "dofs": b.elastic.free.size, "elements": len(b.w), "assembly": assembly,
        "nonzeros": b.K.nnz, "factor": seen.factor.seconds, "modes": seconds,
        "frequency": list(np.sqrt(modes.kappa[:MODES]) / 2 / np.pi),
        "force": list(binned(b.points, b.w * eq.p)), "memory": gigabytes(),
    }  # fmt: skip


def binned(points: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Share of the contact force in sectors and rings of both pads, by smooth weights.

    Hats instead of boxes: which box an element's centre falls into is not the force's error.
    """
    x, y, z = points.T
    angle = np.clip((np.arctan2(y, x) - np.pi / 3) / (np.pi / 3), 0, 1) * SECTORS
    ring = np.clip((np.hypot(x, y) - 0.096) / 0.044, 0, 1) * RINGS
    hats = [np.maximum(0, 1 - np.abs(t - np.arange(n + 1)[:, None]))
            for t, n in ((angle, SECTORS), (ring, RINGS))]  # fmt: skip
    side = np.stack([z > 0, z < 0]).astype(float)
    shares = np.einsum("ie,je,ke,e->ijk", *hats, side, force)
    return np.asarray(shares.ravel() / force.sum())


def elements() -> None:
    """Which cells are cheaper at equal error."""
    cases = [(c, o, f) for c, o, fs in (
        ("tetrahedra", 1, (2.0, 1.4, 1.0, 0.75)), ("tetrahedra", 2, (1.4, 1.0)),
        ("hexahedra", 1, (2.6, 1.8, 1.3)), ("hexahedra", 2, (1.8, 1.3)),
    ) for f in fs]  # fmt: skip
    finest = run(measure_element, cells="hexahedra", order=2, factor=1.0)
    print(
        "cells       order  size    dofs  nonzeros  elements  mesh+assembly/s  factor/s  modes/s"
        "  memory/GB  frequencies: largest  median   force distribution"
    )
    for cells, order, factor in cases:
        r = run(measure_element, cells=cells, order=order, factor=factor)
        f = np.abs(np.array(r["frequency"]) / np.array(finest["frequency"]) - 1)
        force, exact = np.array(r["force"]), np.array(finest["force"])
        print(
            f"{cells:11s} {order:5d} {factor:5.2f} {r['dofs']:7d} {r['nonzeros']:9.2e}"
            f" {r['elements']:9d} {r['assembly']:16.2f} {r['factor']:9.2f} {r['modes']:8.1f}"
            f" {r['memory']:10.2f} {f.max():21.2e} {np.median(f):7.1e}"
            f" {np.linalg.norm(force - exact) / np.linalg.norm(exact):20.1e}",
            flush=True,
        )
    print(f"against hexahedra of order 2, size 1.0, {finest['dofs']} dofs")


def measure_sample(case: dict[str, Any]) -> dict[str, Any]:
    """One sample, condensed and sparse."""
    from mpi4py import MPI

    from brake_fenicsx.macro.braking import reference_stiffness
    from brake_fenicsx.macro.equilibrium import compliance, equilibrium

    sys.path.append(str(Path(__file__).parents[1] / "tests"))
    from sparse_equilibrium import sparse_equilibrium

    b = brake(scaled(case["factor"]))
    enriched = laws(b.points)
    k0 = np.full(len(b.w), reference_stiffness(enriched, b.pressed / float(b.w.sum())))
    seen, offline = timed(lambda: compliance(b.K, b.N, b.T, b.w, b.f, k0, MPI.COMM_SELF))
    ops = replace(b, compliance=seen)
    dense = [equilibrium(ops, enriched, MU) for _ in range(5)]
    sparse = sparse_equilibrium(b, enriched, MU)
    best = dense[0]
    return {
        "dofs": b.elastic.free.size, "elements": len(b.w), "factor": seen.factor.seconds,
        "compliance": offline - seen.factor.seconds, "dense": float(np.median(
            [e.seconds for e in dense])), "iterations": sum(best.iterations),
        "sparse": sparse.seconds, "sparse_iterations": sum(sparse.iterations),
        "difference": float(np.abs(best.p - sparse.p).max() / sparse.p.max()),
        "memory": gigabytes(),
    }  # fmt: skip


def samples() -> None:
    """What condensation buys."""
    print(
        "   dofs  elements  factor/s  compliance/s  condensed/s  iterations  sparse/s  iterations"
        "   ratio  memory/GB  difference of p"
    )
    for factor in (2.5, 1.6, 1.0):
        r = run(measure_sample, factor=factor)
        print(
            f"{r['dofs']:7d} {r['elements']:9d} {r['factor']:9.2f} {r['compliance']:13.2f}"
            f" {r['dense']:12.3f} {r['iterations']:11d} {r['sparse']:9.1f}"
            f" {r['sparse_iterations']:11d} {r['sparse'] / r['dense']:7.0f} {r['memory']:10.2f}"
            f" {r['difference']:16.1e}",
            flush=True,
        )


def measure_size(case: dict[str, Any]) -> dict[str, Any]:
    """Assembly, factor and solves of one size."""
    from brake_fenicsx.macro.solver import BLOCK

    brake(scaled(3))
    b, assembly = timed(lambda: brake(scaled(case["factor"])))
    nonzeros = b.K.nnz
    factor, A = _factor(b)
    n = b.elastic.free.size
    rhs = np.random.default_rng(0).normal(size=(n, BLOCK))
    x, block = timed(lambda: factor.solve(rhs))
    _, single = timed(lambda: factor.solve(rhs[:, 0]))
    error = float(np.linalg.norm(A @ x[:, 0] - rhs[:, 0]) / np.linalg.norm(rhs[:, 0]))
    return {
        "dofs": n, "nonzeros": nonzeros, "assembly": assembly, "factor": factor.seconds,
        "single": single, "block": block / BLOCK, "gigabytes": factor.gigabytes,
        "memory": gigabytes(), "error": error,
    }  # fmt: skip


def _factor(b: Any) -> tuple[Any, Any]:
    """Factor of the brake with springs of 1e11 Pa/m in the interface."""
    from brake_fenicsx.macro.solver import Factor, with_interface

    A = with_interface(b.K, b.N, b.w * 1e11, b.N)
    return Factor(A, "brake_compliance_"), A


def ladder(largest: float) -> None:
    """Exponents of time and memory."""
    print(
        "   dofs  nonzeros  mesh+assembly/s  factor/s  factor/GB  one solve/s  per vector in"
        " blocks/s  peak memory/GB  residual"
    )
    rows = []
    for factor in (2.6, 1.7, 1.15, 0.85, 0.62, 0.47):
        r = run(measure_size, factor=factor)
        rows.append(r)
        print(
            f"{r['dofs']:7d} {r['nonzeros']:9.2e} {r['assembly']:16.2f} {r['factor']:9.2f}"
            f" {r['gigabytes']:10.2f} {r['single']:12.3f} {r['block']:23.4f} {r['memory']:15.2f}"
            f" {r['error']:9.1e}",
            flush=True,
        )
        if r["dofs"] > 0.55 * largest:
            break
    n = np.log([r["dofs"] for r in rows])
    for name in ("assembly", "factor", "gigabytes", "single", "block", "memory"):
        slope = np.polyfit(n, np.log([r[name] for r in rows]), 1)[0]
        print(f"{name:10s} grows like dofs^{slope:.2f}")


def settings() -> None:
    """Orderings, threads, low-rank blocks."""
    cases: list[tuple[str, dict[str, Any], int]] = [
        ("default", {}, 1), ("two threads", {}, 2),
        ("AMD", {"icntl_7": 0}, 1), ("METIS", {"icntl_7": 5}, 1), ("SCOTCH", {"icntl_7": 3}, 1),
        ("PORD", {"icntl_7": 4}, 1),
        *((f"low rank {eps:.0e}", {"icntl_35": 2, "cntl_7": eps}, 1)
          for eps in (1e-12, 1e-9, 1e-6)),
    ]  # fmt: skip
    print("setting            factor/s  factor/GB  one solve/s  per vector in blocks/s  residual")
    for name, options, threads in cases:
        try:
            r = run(measure_size, threads=threads, factor=1.0, options=options)
        except subprocess.CalledProcessError:
            print(f"{name:18s} not in this build of MUMPS")
            continue
        print(
            f"{name:18s} {r['factor']:8.2f} {r['gigabytes']:10.2f} {r['single']:12.3f}"
            f" {r['block']:23.4f} {r['error']:9.1e}",
            flush=True,
        )


def run(job: Any, threads: int = 1, options: Any = None, **case: Any) -> dict[str, Any]:
    """Run one case in a process of its own and read its figures."""
    command = [sys.executable, __file__, "--case", json.dumps({"job": job.__name__, **case})]
    for name, value in (options or {}).items():
        command += ["--", f"-brake_compliance_mat_mumps_{name}", str(value)]
    env = dict(os.environ, OPENBLAS_NUM_THREADS=str(threads), OMP_NUM_THREADS=str(threads))
    done = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
    return json.loads(next(x for x in done.stdout.splitlines() if x.startswith("{")))  # type: ignore[no-any-return]


def main() -> None:
    """Print one table, or measure one case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tables = {f.__name__: f for f in (elements, samples, settings)}
    parser.add_argument("table", nargs="?", default="samples", choices=[*tables, "ladder"])
    parser.add_argument("--largest", type=float, default=1e6, help="dofs of the ladder's last rung")
    parser.add_argument("--case", type=json.loads, help=argparse.SUPPRESS)
    at = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    if sys.argv[at + 1 :]:
        from brake_fenicsx.libraries import start_petsc

        start_petsc(sys.argv[at + 1 :])
    given = parser.parse_args(sys.argv[1:at])
    if given.case:
        print(json.dumps(globals()[given.case.pop("job")](given.case)))
    elif given.table == "ladder":
        ladder(given.largest)
    else:
        tables[given.table]()


if __name__ == "__main__":
    main()
