"""Make the seeded virtual pad scan of the demo scenes: ``python scripts/make_scan.py [FILE]``.

Not a measurement: a cut of an artificial surface with the statistics published for a brake pad
(S_q 33.1 um, S_sk -0.2410, S_ku 3.6549, slopes -2 and -4.5), to which the marks of an instrument
are added: mean height 25.6 um, tilt, white noise and missing points.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from brake_fenicsx.surface import given_statistics
from brake_fenicsx.surface.hdf import moments
from brake_fenicsx.surface.psd import half_plane_weights, wave_numbers
from brake_fenicsx.surface.readers import MISSING

SIZE = np.array([1.8e-3, 1.4e-3])  # [m]
PIXELS = (256, 256)
MEAN = 25.6e-6  # [m]
TILT = (4e-3, -2.5e-3)  # [m/m]
NOISE = 20e-9  # standard deviation [m]
HOLES = 60  # groups of missing points, one to nine pixels each
SCALE = 10e-9  # height of one count of the 16-bit integers [m]
TOLERANCE, GAIN = 4e-3, 0.4  # of the spectrum of the rings; exponent of their correction


def projected(
    power: np.ndarray, z: np.ndarray, shape: tuple[int, int], ring: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Surface of given heights whose rings have given powers, by alternating projections.

    Made without the program's own synthesis: amplitudes are imposed, heights put in the places of
    equal rank, and again (F. Perez-Rafols, A. Almqvist, Tribol. Int. 131 (2019) 591).
    """
    weights = np.broadcast_to(half_plane_weights(shape), power.shape)
    amplitude, f = np.sqrt(power), np.fft.rfft2(rng.standard_normal(shape))
    wanted = np.bincount(ring.ravel(), (weights * power).ravel())
    some, heights = wanted > 0, np.empty(shape)
    for _ in range(40):
        f *= np.divide(amplitude, np.abs(f), out=np.zeros_like(amplitude), where=np.abs(f) > 0)
        h = np.fft.irfft2(f, s=shape)
        levels = ((h - h.min()) * (65535 / (h.max() - h.min()))).astype(np.uint16)
        heights.ravel()[np.argsort(levels, axis=None, kind="stable")] = z
        f = np.fft.rfft2(heights)
        found = np.bincount(ring.ravel(), (weights * (f.real**2 + f.imag**2)).ravel())
        ratio = np.divide(found, wanted, out=np.ones_like(found), where=some)
        if np.sqrt(np.mean((ratio[some] - 1) ** 2)) <= TOLERANCE:
            break
        amplitude = amplitude * np.clip(ratio, 0.25, 4)[ring] ** -GAIN
    return heights


def virtual_scan(seed: int = 2023) -> tuple[np.ndarray, np.ndarray]:
    """Heights [m] with nan where missing, shape ``PIXELS``, and the clean heights [m]."""
    rng = np.random.default_rng(seed)
    paper = given_statistics(33.1e-6, -0.2410, 3.6549)
    # Twice as long as the scan: the cut has the steps at its edges that every real scan has.
    shape = (2 * PIXELS[0], 2 * PIXELS[1])
    q = wave_numbers(shape, 2 * SIZE)
    z = np.sort(paper.hdf.sample(shape[0] * shape[1], rng))
    z -= z.mean()
    C = paper.bifractal(q, "extend")
    power = z.size**2 * z.var() * C / np.sum(half_plane_weights(shape) * C)
    ring = np.rint(q / q[q > 0].min()).astype(int)
    cut = projected(power, z, shape, ring, rng)[: PIXELS[0], : PIXELS[1]]
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
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    default = Path(__file__).parent / "scenes" / "pad_scan.npz"
    words.add_argument("file", nargs="?", default=default, type=Path, metavar="FILE.npz")
    target = words.parse_args().file
    target.parent.mkdir(parents=True, exist_ok=True)
    main(target)
