"""Speed against error of the surface stage, one table: ``python scripts/bench_surface.py``.

Rows: artificial surfaces (pixels, iterations allowed) with the rms error of the radial PSD, and the
characterisation of scans of known statistics with the errors of what comes back. One thread;
median wall-clock seconds of one surface.
"""

from __future__ import annotations

import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import resource  # noqa: E402
import time  # noqa: E402

import numpy as np  # noqa: E402

from brake_fenicsx.surface import (  # noqa: E402
    characterise,
    given_statistics,
    make_topography,
    synthesise,
)

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
PIXEL = 2.825e-3 / 128
HEAD = ("what", "pixels", "iterations", "seeds", "seconds", "peak MB", "error PSD", "worst PSD")
MORE = ("error c1", "error c2", "error q_c", "error S_q")


def row(*cells: object) -> None:
    texts = [f"{c:.3g}" if isinstance(c, float) else str(c) for c in cells]
    print(" | ".join(f"{t:>12}" for t in texts), flush=True)


def peak_megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def synthesis(n: int, iterations: int, seeds: int) -> None:
    seconds, errors, used = [], [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        start = time.perf_counter()
        topo = synthesise(
            PAPER.bifractal, PAPER.hdf, (n, n), (2.825e-3, 2.825e-3), rng, method="projection",
            tolerance=4e-3, max_iterations=iterations,
        )  # fmt: skip
        seconds.append(time.perf_counter() - start)
        assert topo.record is not None
        errors.append(topo.record.psd_error)
        used.append(topo.record.iterations)
    row(
        "synthesise", n, f"{np.median(used):.0f} of {iterations}", seeds,
        float(np.median(seconds)), peak_megabytes(), float(np.median(errors)), max(errors),
        "-", "-", "-", "-",
    )  # fmt: skip


def recovery(n: int, cut: bool, seeds: int = 20) -> None:
    """Errors of the mean over the seeds, and in brackets the scatter of one scan."""
    seconds, found = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        whole = 2 * n if cut else n
        size = (whole * PIXEL, whole * PIXEL)
        topo = synthesise(
            PAPER.bifractal, PAPER.hdf, (whole, whole), size, rng, "extend", "projection", "scan",
            4e-3,
        )  # fmt: skip
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
    row(what, n, "-", seeds, float(np.median(seconds)), peak_megabytes(), "-", "-", *cells)


def main() -> None:
    row(*HEAD, *MORE)
    for iterations in (1, 2, 5, 10, 40):
        synthesis(128, iterations, 50)
    for n, seeds in ((64, 50), (256, 20), (512, 5), (2048, 1)):
        synthesis(n, 40, seeds)
    for n in (128, 256, 512):
        recovery(n, cut=False)
        recovery(n, cut=True)


if __name__ == "__main__":
    main()
