#!/usr/bin/env python3
"""Laws at the pressures of braking: speed against error, seven tables.

    scripts/bench_laws.py pixels [--surfaces 20]      resolution, with bias and scatter kept apart
    scripts/bench_laws.py hardness [--surfaces 10]    stiffness of loading and of vibrations
    scripts/bench_laws.py grids [--surfaces 4]        a cascade of grids over one grid
    scripts/bench_laws.py range [--surfaces 4]        laws to a low pressure over whole laws
    scripts/bench_laws.py band [--surfaces 10]        the loads of the band over scans alone
    scripts/bench_laws.py scans                       measured surfaces and artificial ones
    scripts/bench_laws.py direction [--surfaces 12]   isotropic and directional artificial surfaces

``pixels``: the same surfaces of 804 x 804 pixels, low-passed to fewer ("bias": median and rms of
k over that of 804 on one grid), then surfaces drawn on each grid ("drawn": median and scatter of
k). ``range``: the demo's surfaces with and without a hardness; largest error of p, k and v over
those of the whole law, up to the pressure. ``band``: patches of scans drawn anew, by whole laws
and pressed at the loads of the band over scans alone: CPU seconds, and errors of k and v over those
of one grid in small steps. ``scans`` reads the folder named by BRAKE_FENICSX_SCANS: every window of
a scan is pressed, and five artificial surfaces of the same size, spectrum and
variance; k at p = 1e-4 E* h'_rms over that of the window. ``direction`` reads it too: k and v at
0.2 MPa, with a hardness of 200 MPa, of artificial surfaces over those of the scan itself, whole and
of two quarters, each by its spectrum.
"""

from __future__ import annotations

import argparse
import logging
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import get_args

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.micro import LawRecipe, LawSettings, LawSteps, make_library
from brake_fenicsx.micro.law_of_surface import Grids, law_steps, low_passed
from brake_fenicsx.micro.library import PRESSURES as PRESSURES_OF_BAND
from brake_fenicsx.micro.library import loads_of, stiffness
from brake_fenicsx.surface import (
    characterise,
    make_topography,
    read_topography,
    resampled,
    synthesise,
)
from brake_fenicsx.surface.hdf import gradients
from brake_fenicsx.surface.topography import Topography, fill

SCAN = Path(__file__).parent / "scenes" / "pad_scan.npz"
PATCH, E_STAR = 2.825e-3, 2373.4e6
SIZE = (PATCH, PATCH)
PRESSURES = np.array([0.05e6, 0.2e6, 1e6, 5e6])
WINDOWS = {
    "wyko_wli_736x480.opd": 240, "alicona_200x296.al3d": 200, "truemap_300x300.tmd": 150,
    "sensofar_768x576.plu": 256, "matrix_text.txt": 75,
}  # fmt: skip


def at_pressures(
    topo: Topography,
    at: np.ndarray | None = None,
    hardness: float | None = None,
    grids: Grids = "cascade",
) -> np.ndarray:
    """Rows d [m], k and v [Pa/m] at the pressures, p at separations over the pressures, the rest.

    The last row holds first touch [m] and seconds.
    """
    start = time.perf_counter()
    law = law_steps(topo, LawSettings(E_STAR, 6e6, steps=20, hardness=hardness, grids=grids))
    d, p, k, v = law[:4]
    seconds = time.perf_counter() - start
    x = np.log(PRESSURES)
    rows = [np.interp(x, np.log(p), d)]
    rows += [np.exp(np.interp(x, np.log(p), np.log(values))) for values in (k, v)]
    known = rows[0] if at is None else at
    rows.append(np.exp(np.interp(-known, -d, np.log(p))) / PRESSURES)
    return np.array([*rows, [d[0] + 2 * p[0] / k[0], seconds, 0.0, 0.0]])


def cells(values: np.ndarray, digits: str = ".2f") -> str:
    return " ".join(f"{v:{digits}}" for v in values)


def pixels(surfaces: int) -> None:
    stats = characterise(read_topography(SCAN))
    fine = [synthesise(stats.spectrum, stats.hdf, (804, 804), SIZE, np.random.default_rng(s))
            for s in range(surfaces)]  # fmt: skip
    S_q = float(np.mean([topo.heights.std() for topo in fine]))
    true = np.array([at_pressures(topo, grids="one") for topo in fine])
    print(f"p = {cells(PRESSURES / 1e6)} MPa; S_q {1e6 * S_q:.1f} um; {surfaces} surfaces")
    print("| pixels | k / k(804): median | rms | p / p(804) at equal d | first touch / S_q"
          " | drawn: k [1e10 Pa/m] | scatter | surface [s] | law [s] |")  # fmt: skip
    print("|" + " --- |" * 9)
    for n in (64, 128, 256, 402, 804):
        same = np.array([
            at_pressures(
                make_topography(low_passed(t.heights, (n, n)), SIZE, periodic=True)
                if n < 804 else t, d,
            )
            for t, d in zip(fine, true[:, 0], strict=True)
        ])  # fmt: skip
        ratio = same[:, 1] / true[:, 1]
        start = time.perf_counter()
        drawn = [
            synthesise(stats.spectrum, stats.hdf, (n, n), SIZE, np.random.default_rng(1000 + s))
            for s in range(surfaces)
        ]
        made = (time.perf_counter() - start) / surfaces
        own = np.array([at_pressures(topo) for topo in drawn])
        print(
            f"| {n} | {cells(np.median(ratio, axis=0))}"
            f" | {cells(np.sqrt(np.mean((ratio - 1) ** 2, axis=0)))}"
            f" | {cells(np.median(same[:, 3], axis=0))} | {np.mean(own[:, 4, 0]) / S_q:.2f}"
            f" | {cells(np.median(own[:, 1], axis=0) / 1e10)}"
            f" | {cells(own[:, 1].std(axis=0) / own[:, 1].mean(axis=0))}"
            f" | {made:.3f} | {np.median(own[:, 4, 1]):.3f} |",
            flush=True,
        )


def hardness(surfaces: int) -> None:
    stats = characterise(read_topography(SCAN))
    print(f"p = {cells(PRESSURES / 1e6)} MPa; medians of {surfaces} surfaces")
    print("| hardness [MPa] | pixels | d / S_q | k [1e10 Pa/m] | k of vibrations | law [s] |")
    print("|" + " --- |" * 6)
    for hard in (None, 800e6, 400e6, 200e6, 100e6):
        for n in (128, 256, 402):
            found = []
            for s in range(surfaces):
                topo = synthesise(stats.spectrum, stats.hdf, (n, n), SIZE, np.random.default_rng(s))
                found.append(at_pressures(topo, hardness=hard))
            d, k, v, _, rest = np.median(found, axis=0)
            text = "elastic" if hard is None else f"{hard / 1e6:.0f}"
            S_q = topo.record.S_q if topo.record else np.nan
            print(
                f"| {text} | {n} | {cells(d / S_q)} | {cells(k / 1e10)} | {cells(v / 1e10)}"
                f" | {rest[1]:.2f} |",
                flush=True,
            )


def grids(surfaces: int) -> None:
    stats = characterise(read_topography(SCAN))
    print(
        f"p = {cells(PRESSURES / 1e6)} MPa; smallest and largest of {surfaces} surfaces, 405 pixels"
    )
    print("| hardness [MPa] | k, cascade over one grid | k of vibrations |")
    print("|" + " --- |" * 3)
    for hard in (None, 200e6):
        ratios = []
        for s in range(surfaces):
            rng = np.random.default_rng(s)
            topo = synthesise(stats.spectrum, stats.hdf, (405, 405), SIZE, rng)
            cascade, one = (at_pressures(topo, hardness=hard, grids=g) for g in get_args(Grids))
            ratios.append(cascade[1:3] / one[1:3])
        text = "elastic" if hard is None else f"{hard / 1e6:.0f}"
        spans = [
            f"{cells(a)} to {cells(b)}"
            for a, b in zip(np.min(ratios, axis=0), np.max(ratios, axis=0), strict=True)
        ]
        print(f"| {text} | {' | '.join(spans)} |", flush=True)


def braking(heights: np.ndarray, size: np.ndarray, p: float) -> tuple[float, float]:
    """Ln k and separation [m] at the mean pressure p of a surface with E* = 1 GPa."""
    h = make_topography(heights, (float(size[0]), float(size[1])))
    d, pressure, k, *_ = law_steps(h, LawSettings(1e9, 3 * p, p / 100, steps=20))
    x = np.log(pressure)
    return float(np.interp(np.log(p), x, np.log(k))), float(np.interp(np.log(p), x, d))


def scans() -> None:
    folder = Path(os.environ["BRAKE_FENICSX_SCANS"])
    ways = [(d, s) for s in ("measured", "fit") for d in ("measured", "johnson", "normal")]
    print("| scan | windows | scatter of ln k |" + "".join(f" {d}, {s} |" for d, s in ways))
    print("|" + " --- |" * (3 + len(ways)))
    every: list[list[float]] = []
    for file, n in WINDOWS.items():
        scan = read_topography(folder / file)
        corners = [(i, j) for i in range(0, scan.shape[0] - n + 1, n)
                   for j in range(0, scan.shape[1] - n + 1, n)][:6]  # fmt: skip
        ratios, own = [], []
        for i, j in corners:
            part = make_topography(scan.heights[i : i + n, j : j + n], tuple(scan.pixel * n))
            try:
                kinds = {way: characterise(part, distribution=way[0], spectrum=way[1])
                         for way in ways}  # fmt: skip
            except BrakeError:
                continue
            levelled = kinds[ways[0]].topography
            assert levelled is not None
            h = fill(levelled.heights)
            p = 1e-4 * gradients(h, part.pixel)[0] * 1e9
            real, _ = braking(h, part.size, p)
            row = []
            for stats in kinds.values():
                twins = [
                    synthesise(stats.spectrum, stats.hdf, (n, n), tuple(part.size),
                               np.random.default_rng(s), variance="scan").heights
                    for s in range(5)
                ]  # fmt: skip
                row.append(np.median([braking(t, part.size, p)[0] for t in twins]) - real)
            ratios.append(row)
            own.append(real)
        middle = np.median(ratios, axis=0)
        every.append(list(middle))
        scatter = f"{np.std(own):.2f}" if len(own) > 1 else "-"
        print(f"| {file.partition('_')[0]} | {len(own)} | {scatter} |"
              + "".join(f" {np.exp(m):.2f} |" for m in middle), flush=True)  # fmt: skip
    mean = np.mean(np.abs(every), axis=0)
    print("| mean of abs(ln) | | |" + "".join(f" {m:.2f} |" for m in mean))


def direction(surfaces: int) -> None:
    folder, kinds = Path(os.environ["BRAKE_FENICSX_SCANS"]), ("measured", "directional")
    files = [*(folder / file for file in WINDOWS), SCAN]
    print(
        f"p = 0.2 MPa, hardness 200 MPa; medians of {surfaces} surfaces, and scatter of ln k, ln v"
    )
    print("| scan | pixels | anisotropy | k, isotropic | directional | v, isotropic | directional"
          " | scatter of k, v | one surface and law [s] |")  # fmt: skip
    print("|" + " --- |" * 9)
    errors = []
    for file in files:
        whole = read_topography(file)
        n, m = (s // 2 for s in whole.shape)
        corners = [(0, 0, *whole.shape), (0, 0, n, m), (n, m, n, m)]
        for i, j, nx, ny in corners:
            size = (float(whole.pixel[0] * nx), float(whole.pixel[1] * ny))
            part = make_topography(whole.heights[i : i + nx, j : j + ny], size)
            found, start = [], time.perf_counter()
            for kind in kinds:
                stats = characterise(part, "second-order", spectrum=kind)
                (scan,) = stats.topographies
                same = make_topography(fill(scan.heights), size)
                real = np.log(at_pressures(same, hardness=200e6)[1:3, 1])
                drawn = [
                    synthesise(stats.spectrum, stats.hdf, (nx, ny), size, np.random.default_rng(s))
                    for s in range(surfaces)
                ]
                laws = [at_pressures(h, hardness=200e6)[1:3, 1] for h in drawn]
                found.append(np.log(laws) - real)
            seconds = (time.perf_counter() - start) / (2 * surfaces + 2)
            middle, scatter = np.median(found, axis=1), np.std(found, axis=1).mean(axis=0)
            errors.append(middle)
            print(f"| {file.name.partition('_')[0]} | {nx} x {ny} | {stats.anisotropy:.2f}"
                  f" | {' | '.join(f'{r:.2f}' for r in np.exp(middle.T).ravel())}"
                  f" | {cells(scatter)} | {seconds:.2f} |", flush=True)  # fmt: skip
    for name, those in (("whole scans", errors[::3]), ("all", errors)):
        text = " | ".join(f"{e:.3f}" for e in np.mean(np.abs(those), axis=0).T.ravel())
        print(f"| {name}, mean of abs(ln) | | | {text} | | |")


def ranges(surfaces: int) -> None:
    """Laws to several pressures beside whole ones."""
    stats = characterise(read_topography(SCAN))
    print("| hardness [MPa] | to [MPa] | steps | CPU s | over the whole law | largest error |\n"
          "| ---: | ---: | ---: | ---: | ---: | ---: |")  # fmt: skip
    for hardness, pixels in ((200e6, 401), (None, 128)):
        how = LawSettings(E_STAR, hardness=hardness)
        recipe = LawRecipe(stats.spectrum, stats.hdf, how, (pixels, pixels), SIZE)
        whole: list[LawSteps] = []
        for pressure in (np.inf, 4e6, 2e6, 1e6, 0.5e6):
            start = time.process_time()
            laws = [recipe.law(1, i, pressure) for i in range(surfaces)]
            seconds = (time.process_time() - start) / surfaces
            if not whole:
                whole, first = laws, seconds
            error = 0.0
            for ours, theirs in zip(laws, whole, strict=True):
                d = ours.d[ours.p <= pressure]
                one, other = make_library([ours])[0], make_library([theirs])[0]
                error = max(error, *(
                    float(np.abs(getattr(one, name)(d) / getattr(other, name)(d) - 1).max())
                    for name in ("pressure", "stiffness", "vibration")
                ))  # fmt: skip
            to = min(pressure, how.highest) / 1e6
            print(f"| {'-' if hardness is None else round(hardness / 1e6)} | {to:.3g}"
                  f" | {np.mean([len(law.d) for law in laws]):.0f} | {seconds:.2f}"
                  f" | {seconds / first:.2f} | {error:.0e} |", flush=True)  # fmt: skip


def band(surfaces: int) -> None:
    """Patches of draws, by whole laws and at the loads of the band alone."""
    stats = characterise(read_topography(SCAN))
    print("| hardness [MPa] | pixels | way | scan [s] | law [s] | k: rms | largest | v: rms"
          " | largest |\n|" + " --- |" * 9)  # fmt: skip
    for hardness, pixels in ((200e6, 401), (None, 401)):
        how = LawSettings(E_STAR, hardness=hardness)
        side, loads = pixels * stats.pixel, loads_of(how)
        recipe = LawRecipe(stats.spectrum, stats.hdf, how, (pixels, pixels), (side, side))
        ways = {
            "truth": ("one", {"only": np.geomspace(loads[0], loads[-1], 150)}),
            "whole law": ("cascade", {"pressure": 2.0 * PRESSURES_OF_BAND[-1]}),
            "loads alone": ("cascade", {"only": loads}),
        }
        draws, seconds, values = [], [], []
        for i in range(surfaces):
            start = time.process_time()
            other = resampled(stats, np.random.default_rng(i))
            draws.append(time.process_time() - start)
            patch = replace(recipe, psd=other.spectrum, hdf=other.hdf).surface(1, i)
            for grids, at in ways.values():
                start = time.process_time()
                law = law_steps(patch, replace(how, grids=grids), **at)
                seconds.append(time.process_time() - start)
                values.append(np.log(stiffness(law)))
        spent, table = np.reshape(seconds, (surfaces, 3)), np.reshape(values, (surfaces, 3, 2, -1))
        for j, way in enumerate(ways):
            miss = table[:, j] - table[:, 0]
            errors = np.stack([np.sqrt(np.mean(miss**2, (0, 2))), np.abs(miss).max((0, 2))], 1)
            print(f"| {'-' if hardness is None else round(hardness / 1e6)} | {pixels} | {way}"
                  f" | {np.median(draws):.3f} | {np.median(spent[:, j]):.3f}"
                  f" | {' | '.join(f'{e:.4f}' for e in errors.ravel())} |", flush=True)  # fmt: skip


def main() -> None:
    logging.getLogger("brake_fenicsx").setLevel(logging.ERROR)
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument(
        "table", choices=("pixels", "hardness", "grids", "range", "band", "scans", "direction")
    )
    words.add_argument("--surfaces", default=20, type=int)
    asked = words.parse_args()
    if asked.table == "scans":
        scans()
    else:
        tables = {
            "pixels": pixels, "hardness": hardness, "grids": grids, "range": ranges,
            "band": band, "direction": direction,
        }  # fmt: skip
        tables[asked.table](asked.surfaces)


if __name__ == "__main__":
    main()
