"""Tables of the surface stage: ``python scripts/bench_surface.py [speed | spectra | rings]``.

``speed``: seconds and errors of artificial surfaces, and of the characterisation of scans of known
statistics with the errors of what comes back. One thread; median wall-clock seconds of one surface.

``spectra``: artificial surfaces with the fitted and with the measured spectrum against the scans in
BRAKE_FENICSX_SCANS and the pad scan: octaves of the spectrum, S_q and rms slope of cuts that are
levelled like the scan; and the spectrum of ten cuts of a known surface against the truth.

``rings``: what scans show of the pad's spectrum by groups of waves, over every wave by itself:
CPU seconds of the first time and of the next ones, and the errors of rings; CPU seconds of
``characterise``.
"""

from __future__ import annotations

import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import argparse  # noqa: E402
import logging  # noqa: E402
import resource  # noqa: E402
import time  # noqa: E402
from dataclasses import replace  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402

from brake_fenicsx.surface import (  # noqa: E402
    RadialPsd,
    SurfaceStatistics,
    Topography,
    characterise,
    given_statistics,
    make_topography,
    radial_psd,
    read_topography,
    synthesise,
)
from brake_fenicsx.surface import psd as psd_module  # noqa: E402
from brake_fenicsx.surface.hdf import gradients  # noqa: E402
from brake_fenicsx.surface.topography import form  # noqa: E402

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
PAD = Path(__file__).parent / "scenes" / "pad_scan.npz"
PIXEL = 2.825e-3 / 128
KINDS = ("fit", "measured")
HEAD = ("what", "pixels", "seeds", "seconds", "peak MB", "error PSD")
MORE = ("error c1", "error c2", "error q_c", "error S_q")


def row(*cells: object) -> None:
    texts = [f"{c:.3g}" if isinstance(c, float) else str(c) for c in cells]
    print(" | ".join(f"{t:>12}" for t in texts), flush=True)


def peak_megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def synthesis(n: int, seeds: int) -> None:
    """The first surface prepares the family and is not counted."""
    seconds, error = [], 0.0
    for seed in range(seeds + 1):
        rng = np.random.default_rng(seed)
        start = time.perf_counter()
        topo = synthesise(PAPER.bifractal, PAPER.hdf, (n, n), (2.825e-3, 2.825e-3), rng)
        seconds.append(time.perf_counter() - start)
        assert topo.record is not None
        error = topo.record.psd_error
    row("family", n, 1, seconds[0], peak_megabytes(), error, *4 * "-")
    row("surface", n, seeds, float(np.median(seconds[1:])), peak_megabytes(), error, *4 * "-")


def recovery(n: int, cut: bool, seeds: int = 20) -> None:
    """Errors of the mean over the seeds, and in brackets the scatter of one scan."""
    seconds, found = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        whole = 2 * n if cut else n
        size = (whole * PIXEL, whole * PIXEL)
        shape = (whole, whole)
        topo = synthesise(PAPER.bifractal, PAPER.hdf, shape, size, rng, "extend", "scan")
        if cut:
            topo = make_topography(topo.heights[:n, :n], (n * PIXEL, n * PIXEL))
        start = time.perf_counter()
        stats = characterise(topo)
        seconds.append(time.perf_counter() - start)
        fit = stats.bifractal
        found.append([fit.c1 + 2.0, fit.c2 + 4.5, fit.q_c / 30e3 - 1, stats.S_q / 33.1e-6 - 1])
    mean, scatter = np.mean(found, axis=0), np.std(found, axis=0)
    cells = [f"{m:+.3f} ({s:.3f})" for m, s in zip(mean, scatter, strict=True)]
    what = "cut" if cut else "periodic"
    row(what, n, seeds, float(np.median(seconds)), peak_megabytes(), "-", *cells)


def worst_octave(scan: RadialPsd, C: np.ndarray) -> float:
    """Largest factor between the variance in an octave of the reliable band and that of a scan."""
    power = (scan.q * np.gradient(scan.q))[scan.reliable]
    octave = np.floor(np.log2(scan.q[scan.reliable] / scan.q[scan.reliable][0])).astype(int)
    some = np.bincount(octave) > 2
    own, other = (np.bincount(octave, power * d[scan.reliable])[some] for d in (scan.C, C))
    return float(np.exp(np.max(np.abs(np.log(other / own)))))


def cuts(stats: SurfaceStatistics, surfaces: int) -> list[Topography]:
    """Levelled quarters of artificial surfaces twice as long as a scan."""
    (scan,), found = stats.topographies, []
    nx, ny = scan.shape
    size = (2 * scan.size[0], 2 * scan.size[1])
    for seed in range(surfaces):
        rng = np.random.default_rng(seed)
        h = synthesise(stats.spectrum, stats.hdf, (2 * nx, 2 * ny), size, rng).heights
        for i, j in ((0, 0), (nx, 0), (0, ny), (nx, ny)):
            part = make_topography(h[i : i + nx, j : j + ny], (scan.size[0], scan.size[1]))
            found.append(replace(part, heights=part.heights - form(part, stats.level)))
    return found


def spectra(surfaces: int = 8) -> None:
    files = [(PAD, "plane")]
    if folder := os.environ.get("BRAKE_FENICSX_SCANS"):
        files += [(f, "second-order") for f in sorted(Path(folder).glob("*.*"))]
    print("| scan | worst octave: fit | measured | S_q: fit | measured | slope: fit | measured |")
    print("|" + " --- |" * 7)
    for file, level in files:
        if file.suffix == ".md":
            continue
        octave, S_q, slope = [], [], []
        for kind in KINDS:
            stats = characterise(read_topography(file), level, spectrum=kind)
            (scan,) = stats.topographies
            assert stats.psd is not None
            parts = cuts(stats, surfaces)
            octave.append(worst_octave(stats.psd, radial_psd(parts).C))
            S_q.append(np.sqrt(np.mean([t.heights.var() for t in parts])) / stats.S_q)
            own = [gradients(t.heights, t.pixel)[0] for t in (scan, *parts)]
            slope.append(np.sqrt(np.mean(np.square(own[1:]))) / own[0])
        cells = " | ".join(f"{v:.2f}" for v in (*octave, *S_q, *slope))
        print(f"| {file.name.partition('_')[0]} | {cells} |", flush=True)
    known = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        h = synthesise(PAPER.bifractal, PAPER.hdf, (512, 512), (3.6e-3, 3.6e-3), rng).heights
        scan = make_topography(h[:256, :256], (1.8e-3, 1.8e-3))
        both = [characterise(scan, spectrum=kind) for kind in KINDS]
        q = np.geomspace(*both[0].bifractal.band, 100)
        known.append([np.log(s.spectrum(q) / PAPER.bifractal(q, "flat")) for s in both])
    fit, measured = np.exp(np.sqrt(np.mean(np.square(known), axis=(0, 2))))
    print(f"known truth, rms factor over the band: fit {fit:.2f}, measured {measured:.2f}")


def speed() -> None:
    row(*HEAD, *MORE)
    for n, seeds in ((128, 50), (402, 20), (512, 10), (1024, 5), (2048, 2)):
        synthesis(n, seeds)
    for n in (128, 256, 512):
        recovery(n, cut=False)
        recovery(n, cut=True)


def rings() -> None:
    """Seconds and errors of ``seen_in_scans``, over the width of its groups."""
    spectrum = characterise(read_topography(PAD)).spectrum
    row("pixels", "1 / width", "first [s]", "then [s]", "largest", "rms", "characterise [s]")
    for n in (256, 512, 1000, 2000):
        topo = synthesise(spectrum, PAPER.hdf, (n, n), (1e-3, 1e-3), np.random.default_rng(0))
        topo = make_topography(topo.heights, topo.size)
        start = time.process_time()
        characterise(topo)
        whole, exact = time.process_time() - start, None
        for width in (1.0 / n, 1.0 / 96, 1.0 / 48, 1.0 / 24):
            psd_module.GROUP = width
            psd_module._groups.cache_clear()
            times = [time.process_time()]
            for _ in range(2):
                seen = psd_module.seen_in_scans(spectrum, topo)
                times.append(time.process_time())
            exact = seen if exact is None else exact
            miss, spent = seen / exact - 1.0, np.diff(times)
            row(n, 1.0 / width, float(spent[0]), float(spent[1]), float(np.abs(miss).max()),
                float(np.sqrt(np.mean(miss**2))), whole)  # fmt: skip


def main() -> None:
    logging.getLogger("brake_fenicsx").setLevel(logging.ERROR)
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("table", choices=("speed", "spectra", "rings"), nargs="?", default="speed")
    {"speed": speed, "spectra": spectra, "rings": rings}[words.parse_args().table]()


if __name__ == "__main__":
    main()
