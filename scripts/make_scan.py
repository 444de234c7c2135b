"""Make the seeded virtual pad scan of the demo scenes: ``python scripts/make_scan.py [FILE]``.

Not a measurement: a cut of an artificial surface with the statistics published for a brake pad
(S_q 33.1 um, S_sk -0.2410, S_ku 3.6549, slopes -2 and -4.5), to which the marks of an instrument
are added: mean height 25.6 um, tilt, white noise and missing points.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from brake_fenicsx.surface import given_statistics, synthesise
from brake_fenicsx.surface.hdf import moments
from brake_fenicsx.surface.readers import MISSING

SIZE = np.array([1.8e-3, 1.4e-3])  # [m]
PIXELS = (256, 256)
MEAN = 25.6e-6  # [m]
TILT = (4e-3, -2.5e-3)  # [m/m]
NOISE = 20e-9  # standard deviation [m]
HOLES = 60  # groups of missing points, one to nine pixels each
SCALE = 10e-9  # height of one count of the 16-bit integers [m]


def virtual_scan(seed: int = 2023) -> tuple[np.ndarray, np.ndarray]:
    """Heights [m] with nan where missing, shape ``PIXELS``, and the clean heights [m]."""
    rng = np.random.default_rng(seed)
    paper = given_statistics(33.1e-6, -0.2410, 3.6549)
    # Twice as long as the scan: the cut has the steps at its edges that every real scan has.
    whole = synthesise(
        paper.bifractal, paper.hdf, (2 * PIXELS[0], 2 * PIXELS[1]), tuple(2 * SIZE), rng,
        low="extend", method="projection", variance="scan", tolerance=4e-3,
    )  # fmt: skip
    cut = whole.heights[: PIXELS[0], : PIXELS[1]]
    # The four moments are those of the cut: impose the distribution once more on its ranks.
    order = np.argsort(cut, axis=None)
    clean = np.empty(cut.size)
    clean[order] = paper.hdf.ppf((np.arange(cut.size) + 0.5) / cut.size)
    clean = clean.reshape(cut.shape)
    x, y = (np.arange(n) * length / n for n, length in zip(PIXELS, SIZE, strict=True))
    heights = clean + MEAN + TILT[0] * (x[:, None] - x.mean()) + TILT[1] * (y - y.mean())
    heights += rng.normal(0.0, NOISE, PIXELS)
    for i, j in rng.integers(0, PIXELS[0], (HOLES, 2)):
        heights[i : i + rng.integers(1, 4), j : j + rng.integers(1, 4)] = np.nan
    return heights, clean


def main(path: Path) -> None:
    heights, clean = virtual_scan()
    counts = np.where(np.isnan(heights), MISSING, np.rint(np.nan_to_num(heights) / SCALE))
    np.savez_compressed(path, heights=counts.astype(np.int16), scale=SCALE, size=SIZE)
    _, S_q, S_sk, S_ku = moments(clean.ravel())
    print(f"{path}: {path.stat().st_size / 1024:.0f} kB, {np.isnan(heights).sum()} points missing")
    print(f"clean cut: S_q {S_q * 1e6:.2f} um, S_sk {S_sk:.4f}, S_ku {S_ku:.4f}")


if __name__ == "__main__":
    default = Path(__file__).parent / "scenes" / "pad_scan.npz"
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    target.parent.mkdir(parents=True, exist_ok=True)
    main(target)
