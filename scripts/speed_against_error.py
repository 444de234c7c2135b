#!/usr/bin/env python3
"""Speed against error of every stage, one figure: where is the next second best spent?

    scripts/speed_against_error.py [--folder FOLDER] [--quick]

Writes speed_against_error.png and .csv (panel, curve, setting, seconds, error, default). Every
point is measured in this run, on one core; seconds and errors compare within it alone.
``--quick``: smaller models, which show the curves' shape and no figure that means anything.
A fifth panel shows brake_sizes.csv, where ``bench_ensemble.py sizes`` has written it to the folder.

laws           stiffness of vibrations between 0.05 and 5 MPa, rms over surfaces, against one grid
               of all pixels and four times the steps; seconds of a law; Tamaas where installed
brake          first 20 frequencies (largest error) and contact forces of the reference brake
               against finer hexahedra of curved sides; seconds of mesh, factor and real modes
complex modes  largest error of the demo brake's eigenvalues against full order; of that the error
               that it states; seconds of a sample
probability    of squeal of the demo brake under random friction: half of the 95 % interval, and by
               what other changes move it in the same samples; seconds of the samples
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from mpi4py import MPI
from slepc4py import SLEPc

import bench_equilibrium as bodies
import bench_reduction as reduction
import numpy as np
from matplotlib.figure import Figure

from brake_fenicsx import run
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.folder.log import start_log
from brake_fenicsx.macro.solver import petsc_matrix
from brake_fenicsx.micro import LawSettings, law_of_surface
from brake_fenicsx.report.style import CYCLE, MARKERS, house_style
from brake_fenicsx.results.ensemble_statistics import wilson
from brake_fenicsx.results.run import read_run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.surface import characterise, make_topography, read_topography, synthesise

SCENES = Path(__file__).parent / "scenes"
PATCH, E_STAR, HARDNESS = 2.825e-3, 2373.4e6, 200e6
PRESSURES = np.geomspace(0.05e6, 5e6, 9)
BY_TAMAAS = PRESSURES[3:]  # at the lower ones a single pixel may touch, which it refuses
PANELS = {
    "laws": "stiffness of vibrations [-]", "brake": "frequencies, forces [-]",
    "complex modes": "eigenvalues [-]", "probability": "probability of squeal [-]",
}  # fmt: skip


@dataclass(frozen=True)
class Point:
    """One measurement."""

    panel: str
    curve: str
    setting: str
    seconds: float
    error: float
    default: bool = False


def laws(quick: bool) -> Iterator[Point]:
    """Pixels, steps, grids and hardness."""
    n, surfaces, usual = *((156, 1) if quick else (625, 6)), law_of_surface.STEPS_PER_DECADE
    stats = characterise(read_topography(SCENES / "pad_scan.npz"))
    fine = [
        synthesise(stats.spectrum, stats.hdf, (n, n), (PATCH, PATCH), np.random.default_rng(seed))
        for seed in range(surfaces)
    ]

    def pressed(pixels: int, density: int = 1, **settings) -> tuple[float, np.ndarray]:
        """Seconds of a law, and ln v at the pressures of every surface."""
        law_of_surface.STEPS_PER_DECADE = round(density * usual)
        seconds, found = [], []
        for topo in fine:
            if pixels < n:
                h = law_of_surface.low_passed(topo.heights, (pixels, pixels))
                topo = make_topography(h, topo.size, periodic=True)
            steps = round(40 * density)
            start = time.perf_counter()
            law = law_of_surface.law_steps(topo, LawSettings(E_STAR, 6e6, steps=steps, **settings))
            seconds.append(time.perf_counter() - start)
            found.append(np.interp(np.log(PRESSURES), np.log(law.p), np.log(law.v)))
        law_of_surface.STEPS_PER_DECADE = usual
        return float(np.median(seconds)), np.array(found)

    for hardness, name in ((None, "elastic"), (HARDNESS, "hardness")):
        _, true = pressed(n, 4, hardness=hardness, grids="one")
        for curve, setting, pixels, more in (
            *(("pixels", f"{p} pixels", p, {}) for p in (n // 8, n // 4, n // 2, n)),
            *(("steps", f"{40 * d:g} steps a decade", n, {"density": d}) for d in (0.25, 0.5, 2)),
            ("one grid", "40 steps a decade", n, {"grids": "one"}),
        ):
            seconds, found = pressed(pixels, hardness=hardness, **more)
            error = float(np.sqrt(np.mean(np.expm1(found - true) ** 2)))
            default = curve == "pixels" and pixels == n
            yield Point("laws", f"{name}: {curve}", setting, seconds, error, default)
        if hardness is None and find_spec("tamaas"):
            times, found = zip(*(by_tamaas(topo.heights) for topo in fine[:2]), strict=True)
            error = np.expm1(np.array(found) - true[:2, -BY_TAMAAS.size :])
            error = float(np.sqrt(np.mean(error**2)))
            yield Point("laws", "elastic: Tamaas", "6 pressures", float(np.mean(times)), error)


def by_tamaas(h: np.ndarray) -> tuple[float, np.ndarray]:
    """Seconds of two contacts at each of its pressures by Tamaas, and ln of the stiffness between.

    Lengths are over the side of the patch, pressures over E*.
    """
    import tamaas as tm

    tm.initialize(1)
    tm.set_log_level(tm.LogLevel.error)
    model = tm.Model(tm.model_type.basic_2d, [1.0, 1.0], list(h.shape))
    model.E, model.nu = 1.0, 0.0
    solver = tm.PolonskyKeerRey(model, np.ascontiguousarray(h / PATCH), 1e-12)
    solver.max_iter, solver.dump_freq = 20_000, 10**9
    loads = (BY_TAMAAS[:, None] * [0.98, 1.02] / E_STAR).ravel()
    start, d = time.perf_counter(), []
    for p in loads:
        solver.solve(p)
        d.append(float(np.mean(model["gap"])))
    steps = np.reshape(loads, (-1, 2)), np.reshape(d, (-1, 2))
    dp, dd = (np.diff(x, axis=1)[:, 0] for x in steps)
    return time.perf_counter() - start, np.log(-dp / dd * E_STAR / PATCH)


def brake(quick: bool) -> Iterator[Point]:
    """Size, kind and degree of cells."""

    def measured(cells: str, order: int, degree: int, factor: float) -> dict:
        case = {"cells": cells, "order": order, "degree": degree, "factor": factor}
        return bodies.run(bodies.measure_element, **case)

    finest = measured("hexahedra", 2, 2, 3.2 if quick else 1.5)
    curves = {
        ("tetrahedra", 1, 2): (3.2, 2.6) if quick else (2.6, 1.8, 1.3, 1.0),
        ("tetrahedra", 1, 1): () if quick else (1.8, 1.3, 1.0),
        ("hexahedra", 1, 2): () if quick else (3.2, 2.4, 1.8),
    }
    for (cells, order, degree), factors in curves.items():
        for factor in factors:
            r = measured(cells, order, degree, factor)
            seconds = r["assembly"] + r["factor"] + r["modes"]
            name = f"{cells}{' of degree 1' if degree == 1 else ''}"
            default = (cells, degree, factor) == ("tetrahedra", 2, 1.0)
            # Stiffer bodies have fewer modes below the frequency up to which they are computed.
            pairs = zip(r["frequency"], finest["frequency"], strict=False)
            shift = max(abs(f / fine - 1) for f, fine in pairs)
            force, exact = np.array(r["force"]), np.array(finest["force"])
            moved = np.linalg.norm(force - exact) / np.linalg.norm(exact)
            for what, error in (("frequencies", shift), ("forces", moved)):
                text = f"size {factor:g}, {r['dofs']} dofs"
                yield Point("brake", f"{name}: {what}", text, seconds, float(error), default)


def complex_modes(quick: bool) -> Iterator[Point]:
    """Tolerance and kept modes of the reduced model, full order, and SLEPc without a proof."""
    band = 2000.0 if quick else 8000.0
    changes = [
        "contact.pad_disc.gap = none", "samples.approaches = ['multi-scale']",
        "stages = ['equilibrium', 'stability', 'uncertainty']",
        "contact.pad_disc.law = { p0 = '2e5 Pa', u0 = '2e-6 m' }",
        *(["parts.disc.size='24 mm'", "parts.pad.size='14 mm'"] if quick else []),
    ]  # fmt: skip
    built = assemble_brake(read_scene(SCENES / "disc_brake_demo.toml", changes), MPI.COMM_SELF)
    for kind in ("undamped", "loss") if quick else ("undamped", "loss", "sliding"):
        more = reduction.damped_by(kind)
        scene = read_scene(SCENES / "disc_brake_demo.toml", [*changes, *more])
        full = None
        cases: list[tuple[str, float, float | None]]
        cases = [("tolerance", t, None) for t in (1e-5, 1e-3, 1e-7)]
        cases += [("kept modes", 1e-5, c) for c in (1.2, 1.4)] if kind == "undamped" else []
        for curve, tolerance, reach in cases:
            given = SimpleNamespace(
                band=band, tolerance=tolerance, cutoff=None if reach is None else reach * band
            )
            case = reduction.Case(scene, built, kind, 0.0, given)
            x, contact = case.sample(0)
            if full is None:
                start = time.perf_counter()
                full = case.full(x, contact)
                seconds = time.perf_counter() - start
                stated = float((full.error / np.abs(full.s)).max())
                yield Point("complex modes", f"{kind}: full order", "proved", seconds, stated)
                if kind == "undamped":
                    yield without_proof(case, contact, full)
            found = [case.model.modes(x, contact, reduction.ZETA) for _ in range(3)]
            error = float(reduction.compare(found[0], full)[0].max())
            text = f"{tolerance:g}" if reach is None else f"up to {reach:g} times the band"
            online = float(np.median([modes.seconds for modes in found]))
            default = curve == "tolerance" and tolerance == 1e-5
            yield Point("complex modes", f"{kind}: {curve}", text, online, error, default)


def without_proof(case: reduction.Case, contact, full) -> Point:
    """Shift-invert Arnoldi of SLEPc with MUMPS for as many right vectors, at its own tolerance."""
    b = case.b
    start = time.perf_counter()
    eps = SLEPc.EPS().create(MPI.COMM_SELF)
    K = tangent(case.K, b.N, b.T, b.w, contact.k, reduction.MU)
    eps.setOperators(petsc_matrix(K), petsc_matrix(case.M))
    eps.setProblemType(SLEPc.EPS.ProblemType.GNHEP)
    eps.setTarget(-((2 * np.pi * 0.3 * case.band[1]) ** 2))
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setDimensions(len(full) + 8)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    st.getKSP().getPC().setType("lu")
    st.getKSP().getPC().setFactorSolverType("mumps")
    eps.solve()
    squares = np.array([eps.getEigenvalue(i) for i in range(eps.getConverged())])
    seconds = time.perf_counter() - start
    exact = -(full.s**2)
    nearest = np.abs(squares[:, None] - exact).min(axis=0)
    error = float((0.5 * nearest / np.abs(exact)).max())
    return Point("complex modes", "undamped: SLEPc", f"{squares.size} found", seconds, error)


def probability(quick: bool) -> Iterator[Point]:
    """Samples, and changes of the scene."""
    n, few = (6, 6) if quick else (320, 40)
    scene = [
        "stages = ['surface', 'micro', 'equilibrium', 'stability', 'uncertainty']",
        "micro.scans = 0", "stability.verify = 0", "samples.approaches = ['multi-scale']",
        "samples.random.'contact.pad_disc.friction' = { law = 'uniform', min = 0.1, max = 0.4 }",
        *(["parts.disc.size='24 mm'", "parts.pad.size='14 mm'", "micro.laws=2",
           "micro.pixels=64"] if quick else []),
    ]  # fmt: skip

    def squeals(number: int, *changes: str) -> tuple[np.ndarray, float]:
        with tempfile.TemporaryDirectory() as folder:
            given = [*scene, f"samples.n = {number}", *changes]
            run(SCENES / "disc_brake_demo.toml", MPI.COMM_SELF, folder, given)
            hits = read_run(folder).squeal.squeal_modes("multi-scale")["sample"].unique()
            seconds = json.loads((Path(folder) / "summary.json").read_text())["seconds"]
        return np.isin(np.arange(number), hits), seconds["samples"] / number

    hits, each = squeals(n)
    for k in [k for k in (10, 20, 40, 80, 160, 320) if k <= n] or [n]:
        share = wilson(int(hits[:k].sum()), k)
        text = f"{k} samples: {hits[:k].mean():.3f}"
        half = 0.5 * (share.high - share.low)
        yield Point("probability", "half of the 95 % interval", text, k * each, half, k == 20)
    changes = {
        "mesh finer by 1.25": ["parts.disc.size='11.2 mm'", "parts.pad.size='5.6 mm'"],
        "hardness 400 MPa": ["micro.hardness='400 MPa'"],
        "another draw of laws": ["micro.seed=7"],
        "perfect contact": ["samples.approaches=['parametric']"],
    }  # fmt: skip
    for name, more in {} if quick else changes.items():
        moved, each = squeals(few, *more)
        shift = abs(float(moved.mean() - hits[:few].mean()))
        text = f"{few} samples: {moved.mean():.3f} for {hits[:few].mean():.3f}"
        # A probability of 0 or of one sample cannot be drawn on a logarithmic axis.
        yield Point("probability", name, text, few * each, max(shift, 0.5 / few))


def draw(points: list[Point], path: Path) -> None:
    """One panel for each stage; rings mark the defaults."""
    sizes = path.with_name("brake_sizes.csv")
    with house_style():
        figure = Figure(figsize=(9.6, 7.6 + 3.2 * sizes.exists()), layout="constrained")
        rows = figure.subfigures(2, 1, height_ratios=(7.6, 3.2)) if sizes.exists() else [figure]
        if sizes.exists():
            draw_sizes(rows[1], sizes)
        for axis, (panel, quantity) in zip(
            rows[0].subplots(2, 2).ravel(), PANELS.items(), strict=True
        ):
            own = [p for p in points if p.panel == panel]
            for i, curve in enumerate(dict.fromkeys(p.curve for p in own)):
                line = sorted((p.seconds, p.error) for p in own if p.curve == curve)
                # More curves than colours: a colour comes again with another marker.
                marker = MARKERS[(i + i // len(CYCLE)) % len(MARKERS)]
                style = marker + ("-" if len(line) > 1 else "")
                axis.loglog(
                    *zip(*line, strict=True), style, color=CYCLE[i % len(CYCLE)], label=curve, ms=5
                )
            marked = [(p.seconds, p.error) for p in own if p.default]
            if marked:
                axis.plot(*zip(*marked, strict=True), "o", ms=12, mfc="none", mec="#000000")
            axis.set(title=panel, xlabel="seconds", ylabel=f"error of {quantity}")
            axis.grid(alpha=0.25, which="both", linewidth=0.4)
            axis.legend(fontsize=6.5)
        figure.savefig(path, dpi=150, facecolor="white", metadata={"Software": None})


def draw_sizes(figure: Any, table: Path) -> None:
    """Seconds of the stages and bytes of brakes of several sizes."""
    with table.open() as file:
        rows = list(csv.DictReader(file))
    dofs = [float(row["dofs"]) for row in rows]
    axis = figure.subplots()
    beside = axis.twinx()
    for i, stage in enumerate(("brake", "micro", "offline", "samples", "results")):
        line = [float(row[stage]) for row in rows]
        axis.loglog(dofs, line, MARKERS[i] + "-", color=CYCLE[i], label=stage, ms=5)
    memory = [float(row["GB"]) for row in rows]
    beside.loglog(dofs, memory, "k:", label="memory [GB], right")
    axis.set(title="growth", xlabel="free dofs", ylabel="CPU seconds, one process")
    beside.set(ylabel="GB")
    beside.spines["right"].set_visible(True)
    axis.grid(alpha=0.25, which="both", linewidth=0.4)
    axis.legend(*(a + b for a, b in zip(
        axis.get_legend_handles_labels(), beside.get_legend_handles_labels(), strict=True
    )), fontsize=6.5)  # fmt: skip


def main() -> None:
    """Measure, write and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path())
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    start_log(0, level="WARNING")
    points = []
    for stage in (laws, brake, complex_modes, probability):
        for point in stage(given.quick):
            points.append(point)
            print(f"{point.panel:14s} {point.curve:36s} {point.setting:32s}"
                  f" {point.seconds:9.3f} s {point.error:9.1e}", flush=True)  # fmt: skip
    with (given.folder / "speed_against_error.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([field.name for field in fields(Point)])
        table.writerows(astuple(point) for point in points)
    draw(points, given.folder / "speed_against_error.png")


if __name__ == "__main__":
    main()
