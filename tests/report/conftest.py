"""A synthetic run directory, seeded: every file the report reads, small and of known content."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from brake_fenicsx.folder.store import Store
from brake_fenicsx.report.figures import make_figures
from brake_fenicsx.report.mode_cards import SHAPES
from brake_fenicsx.results.run import save_tables
from brake_fenicsx.results.tables import MODES, SAMPLES, RowTable, write_rows
from run_tables import (
    CHART,
    CONTACT,
    CONTACT_DRIVERS,
    CRITICAL,
    CURVE,
    DRIVERS,
    EVENTS,
    SENSITIVITY,
    SHAPE_COLUMNS,
    SWEEP,
    read_run,
)

E_STAR = 2373.4e6
SAMPLED = {"classical": 1, "parametric": 40, "multi-scale": 60}


def mode_rows(rng: np.random.Generator) -> list[list]:
    """Stable modes on the axis, and pairs that merge in some of the samples."""
    rows = []
    for approach, n in SAMPLED.items():
        for sample in range(n):
            base = np.sort(rng.uniform(800.0, 15500.0, 24))
            pairs = [(1930.0, 0.8), (4480.0, 0.5), (7210.0, 0.25), (11800.0, 0.08)]
            for mode, f in enumerate(base):
                rows.append(_mode(approach, sample, mode, f, 1e-12 * rng.normal(), -1, rng))
            for family, (f, chance) in enumerate(pairs):
                hit = family < 2 if n == 1 else rng.random() < chance
                growth = 1e-2 * rng.lognormal(-0.5, 0.5) if hit else 0.0
                if n > 1:
                    f *= 1 + 0.01 * rng.normal()
                for sign in (-1.0, 1.0):
                    mode += 1
                    rows.append(_mode(approach, sample, mode, f, sign * growth, family, rng))
    return rows


def _mode(approach, sample, mode, f, damping, family, rng):
    verdict = "neutral" if abs(damping) < 1e-8 else "unstable" if damping < 0 else "stable"
    real = -0.5 * damping * 2 * np.pi * f
    small = 10.0 ** rng.uniform(-13, -10), 10.0 ** rng.uniform(-8, -5)
    condition = float(rng.lognormal(0.5, 0.5) + 1)
    return [approach, sample, mode, f, real, damping, *small, condition, verdict, family]


def sensitivity_rows() -> list[list]:
    """Two inputs for the whole band and a family, the second without total indices."""
    rows = []
    for scope, where, f in (("band", "0-16000", 8000.0), ("family", "0", 1930.0)):
        for name, first in (("contact.pad_disc.friction", 0.7), ("materials.lining.E_3", 0.15)):
            index = [first, first - 0.1, first + 0.1]
            total = index if scope == "band" else [None] * 3
            place = ["parametric", 0.0, scope, where, f, "growth", name]
            rows.append([*place, *index, *total, "FAST", 40, 1])
    return rows


def contact_rows(rng: np.random.Generator, rings: int = 15, columns: int = 37) -> list[list]:
    """Two pads of 60 degrees, r 96-140 mm, patches of about 2.8 mm."""
    rows = []
    for approach in SAMPLED:
        element = 0
        for z in (0.010, -0.010):
            for r in np.linspace(0.0975, 0.1385, rings):
                for t in np.linspace(-0.5, 0.5, columns):
                    smooth = 2.1e5 * (1 + 0.6 * t) * (1 - 60 * (r - 0.118) ** 2)
                    rough = rng.lognormal(-0.4, 0.9) * (rng.random() > 0.2)
                    p = smooth if approach == "classical" else smooth * rough
                    x, y = r * np.sin(t), r * np.cos(t)
                    g, law = -p / 2e13, -1 if approach == "classical" else element % 30
                    k = 3e5 * p
                    rows.append(
                        [approach, 0, element, x, y, z, 2.825e-3**2, g, 0.0, p, k, 3 * k, law]
                    )
                    element += 1
    return rows


def driver_rows() -> list[list]:
    """Two modes of the first sample and their medians; a derivative that is not trusted."""
    rows = []
    for approach, sample, family, mode in (
        ("classical", 0, 0, 25), ("classical", 0, 1, 27), ("multi-scale", 0, 0, 25),
        ("multi-scale", "median", 0, None), ("multi-scale", "median", 1, None),
    ):  # fmt: skip
        kinds = [("pad_disc", "friction"), ("pad.piston", "load"), ("all", "contact stiffness")]
        if sample == 0:
            kinds += [("disc.body", k) for k in ("stiffness", "mass", "loss factor")]
        for j, (parameter, kind) in enumerate(kinds):
            d = [300.0 - 200.0 * j, 40.0, -0.01]
            trusted, count = "no" if j == 3 else "yes", 1 if sample == 0 else 40
            numbers = [1930.0 * (1 + family), 60.0, -0.01, 2.0, parameter, kind, *d, trusted, count]
            rows.append([approach, sample, family, mode, *numbers])
    return rows


def driver_map_rows(contact: list[list]) -> list[list]:
    """Derivatives and work of one mode in every contact element of a first sample."""
    modes = {"classical": 25, "multi-scale": 25}
    return [
        [row[0], 0, modes[row[0]], row[2], 0.1 * row[3], 0.2, 1e-3 * row[9] / 2e5]
        for row in contact
        if row[0] in modes
    ]


def make_laws(rng: np.random.Generator) -> dict[str, np.ndarray]:
    p = np.tile(np.geomspace(1e-6, 0.1, 60) * E_STAR, (30, 1))
    u0, first = rng.normal(12e-6, 1e-6, (30, 1)), rng.normal(95e-6, 7e-6, (30, 1))
    d = first - u0 * np.log(p / p[0, 0])
    return {"d": d, "p": p, "k": p / u0, "seed": np.arange(30), "E_star": np.array(E_STAR)}


def rough(rng, shape, size, s_q, slope=-3.2):
    q = np.hypot(
        *np.meshgrid(
            *(np.fft.fftfreq(n, l / n) for n, l in zip(shape, size, strict=True)), indexing="ij"
        )
    )
    q[0, 0] = np.inf
    filtered = np.fft.fft2(rng.normal(size=shape)) * np.maximum(q, 1.5 / size[0]) ** (slope / 2)
    z = np.fft.ifft2(filtered).real
    return s_q * (z - z.mean()) / z.std()


def radial(z, size):
    n = z.shape[0]
    power = (
        np.abs(np.fft.fft2(np.nan_to_num(z))) ** 2 * size[0] * size[1] / z.size**2 / (4 * np.pi**2)
    )
    kx, ky = (2 * np.pi * np.fft.fftfreq(m, l / m) for m, l in zip(z.shape, size, strict=True))
    k = np.hypot(kx[:, None], ky)
    edges = np.geomspace(2 * np.pi / size[0], k.max() / 1.5, n // 6)
    found = np.digitize(k, edges)
    c = np.array(
        [power[found == j].mean() if np.any(found == j) else 0.0 for j in range(1, len(edges))]
    )
    return np.sqrt(edges[1:] * edges[:-1]), c


def density(z):
    values, edges = np.histogram(z[np.isfinite(z)], bins=60, density=True)
    return (edges[1:] + edges[:-1]) / 2, np.convolve(values, [0.25, 0.5, 0.25], "same")


def make_surface(rng: np.random.Generator, n: int = 256) -> dict[str, np.ndarray]:
    size, made_size = np.array([1.8e-3, 1.4e-3]), np.array([2.825e-3, 2.825e-3])
    z = rough(rng, (n, n), size, 33.1e-6)
    q, c = radial(z, size)
    z[rng.random(z.shape) < 2e-3] = np.nan
    z[40:52, 60:70] = np.nan
    made = rough(rng, (128, 128), made_size, 33.1e-6)
    made_q, made_c = radial(made, made_size)
    usable = c > 0
    slope = np.polyfit(np.log(q[usable]), np.log(c[usable]), 1)
    stats = {
        "mean": 0.0,
        "median": float(np.nanmedian(z)),
        "S_q": float(np.nanstd(z)),
        "S_sk": -0.241,
        "S_ku": 3.6549,
        "c1": -2.01,
        "c1_error": 0.04,
        "c2": -4.47,
        "c2_error": 0.03,
        "q_c": 3.0e4,
        "ln_q_c_error": 0.03,
        "C0": 1.2e-18,
        "ln_C0_error": 0.1,
        "fit_rms": 0.2,
    }
    (hdf_z, hdf), (made_z, made_hdf) = density(z), density(made)
    return {
        "heights": z,
        "size": size,
        "q": q,
        "C": c,
        "q_band": np.array([7e3, 3e5]),
        "fit_q": q[usable],
        "fit_C": np.exp(np.polyval(slope, np.log(q[usable]))),
        "hdf_z": hdf_z,
        "hdf_density": hdf,
        "artificial": made,
        "artificial_size": made_size,
        "artificial_q": made_q,
        "artificial_C": made_c,
        "artificial_hdf_z": made_z,
        "artificial_hdf_density": made_hdf,
        "stats": np.array(json.dumps(stats)),
    }


def make_maps(rng: np.random.Generator, n: int = 512) -> dict[str, np.ndarray]:
    size = np.array([2.825e-3, 2.825e-3])
    z = rough(rng, (n, n), size, 33.1e-6)
    fractions = np.array([2e-4, 1e-3, 4e-3, 0.02, 0.08, 0.3])
    levels = np.quantile(z, 1 - fractions)
    pressures = np.array([np.maximum(z - level, 0.0) * 2e13 for level in levels])
    return {
        "heights": z,
        "size": size,
        "p_over_E": pressures.mean(axis=(1, 2)) / E_STAR,
        "pressures": pressures,
        "area_fraction": fractions,
        "separation": levels,
    }


SUMMARY = {
    "in_effect": {"stability": {"band": [0.0, 16000.0], "tolerance": 1e-06}},
    "settings": {
        "stability": {"band": [0.0, 16000.0], "method": "reduced"},
        "samples": {"n": 60, "seed": 1},
    },
    "versions": {
        "brake_fenicsx": "0.1.0",
        "dolfinx": "0.5.2",
        "note": "<script>alert(1)</script> & more",
    },
    "seeds": {"surface": 1, "laws": 2, "samples": 3},
    "seconds": {
        "surface": 1.2,
        "micro": 40.5,
        "equilibrium": 21.0,
        "stability": 7.75,
        "uncertainty": 61.0,
    },
    "peak_memory_mb": {
        "surface": 210.0,
        "micro": 330.0,
        "equilibrium": 2900.0,
        "stability": 3100.0,
    },
    "counts": {"cells": 12345, "dofs": 67890, "contact_elements": 1110},
    "sweep": {"parameters": {"contact.pad_disc.friction": "", "loads.pad.piston.pressure": "Pa"}},
    "reduction": {"max_error": 1.3e-4, "median_error": 2.4e-6, "wrong_verdicts": 0},
}


def write_sweep(directory: Path) -> None:
    """Tables of a sweep over friction: two modes near 2 kHz that merge, later in each sample."""
    modes, events, curve = [], [], []
    values = np.linspace(0.0, 0.8, 9)
    merged = [0.3 + 0.05 * k for k in range(6)]
    for approach, sample, at in (
        ("classical", None, 0.4), ("multi-scale", None, 0.3),
        *(("multi-scale", k, x) for k, x in enumerate(merged)),
    ):  # fmt: skip
        for point, x in enumerate(values):
            root = np.sqrt(complex(at - x))
            for branch, sign in enumerate((-1, 1)):
                s = 2j * np.pi * (2000 + 200 * sign * root)
                damping = -2 * s.real / s.imag + 0.0
                verdict = "unstable" if s.real > 0 else "stable"
                row = [x, point, branch, s.imag / (2 * np.pi), s.real, damping, 1e-3, verdict]
                modes.append([approach, sample, *row])
        kinds = ("merging", "onset of squeal") if sample is None else ("onset of squeal",)
        events += [[approach, sample, kind, at, 1e-4, 2e3, 0.0, 0, 1, 3] for kind in kinds]
    write_rows(directory / "sweep.csv", ("approach", "sample", "value", *SWEEP), modes)
    write_rows(directory / "lock_in.csv", ("approach", "sample", *EVENTS), events)
    for family in (None, 3):
        for x in values:
            hits = sum(at <= x for at in merged)
            curve.append(["multi-scale", family, x, 6, hits / 6, hits / 12, (hits + 6) / 12])
    write_rows(directory / "critical_curve.csv", CURVE, curve)
    start = ["multi-scale", "contact.pad_disc.friction"]
    ends = [6, 6, 0, 0.3, 0.4, 0.3, 0.55, 0.55]
    write_rows(directory / "critical.csv", CRITICAL, [[*start, f, 2e3, *ends] for f in (None, 3)])
    chart = [
        [a, x, 1e5 * y, int(x > y), int(x > y), -max(x - y, 0.0)]
        for a in ("classical", "multi-scale") for x in values for y in (0.2, 0.4, 0.6)
    ]  # fmt: skip
    write_rows(directory / "chart.csv", CHART, chart)


def make_run(directory: Path, seed: int = 7, small: bool = False) -> Path:
    rng = np.random.default_rng(seed)
    directory.mkdir(parents=True, exist_ok=True)
    write_rows(directory / "modes.csv", MODES, mode_rows(rng))
    samples = [
        [
            a,
            k,
            "error: no equilibrium" if (a, k) == ("parametric", 39) else "ok",
            100 + k,
            rng.normal(0.5, 0.05),
        ]
        for a, n in SAMPLED.items()
        for k in range(n)
    ]
    write_rows(directory / "samples.csv", [*SAMPLES, "contact.pad_disc.friction"], samples)
    write_rows(directory / "sensitivity.csv", SENSITIVITY, sensitivity_rows())
    contact = contact_rows(rng, *((8, 19) if small else (15, 37)))
    write_rows(directory / "contact.csv", CONTACT, contact)
    write_rows(directory / "drivers.csv", DRIVERS, driver_rows())
    write_rows(directory / "drivers_contact.csv", CONTACT_DRIVERS, driver_map_rows(contact))
    write_sweep(directory)
    np.savez(directory / "laws.npz", **make_laws(rng))
    np.savez(directory / "surface.npz", **make_surface(rng, 64 if small else 256))
    np.savez(directory / "contact_maps.npz", **make_maps(rng, 64 if small else 512))
    (directory / "summary.json").write_text(json.dumps(SUMMARY))
    (directory / "scene.toml").write_text(
        'stages = ["surface"]\n[micro]\nE = "1983.3 MPa"  # <b>E</b>\n'
    )
    return directory


@pytest.fixture(scope="session")
def drawn(run_directory, tmp_path_factory) -> tuple[Path, list[Path]]:
    """The same run with all its figures, and what was written."""
    directory = tmp_path_factory.mktemp("drawn") / "run & <one>"
    shutil.copytree(run_directory, directory)
    return directory, make_figures(read_run(directory))


@pytest.fixture(scope="session")
def save_scan():
    """Writes the surface of a run: given heights, and what always stands beside them."""

    def save(directory: Path, heights, size) -> None:
        np.savez(
            directory / "surface.npz", heights=heights, size=size, stats=np.array("{}"),
            hdf_z=[-1e-6, 1e-6], hdf_density=[5e5, 5e5], fit_q=[1e3, 1e5], fit_C=[1e-15, 1e-20],
            q_band=[1e3, 1e5],
        )  # fmt: skip

    return save


@pytest.fixture(scope="session")
def run_directory(tmp_path_factory) -> Path:
    """One complete synthetic run, not to be changed by a test."""
    return make_run(tmp_path_factory.mktemp("run"), small=True)


@pytest.fixture(scope="session")
def shaped(drawn, tmp_path_factory) -> tuple[Path, list[list]]:
    """The drawn run with the animated pictures that a run would draw, and their rows."""
    directory = tmp_path_factory.mktemp("shaped") / "run"
    shutil.copytree(drawn[0], directory)
    folder = directory / "figures"
    for old in folder.glob("mode_*.png"):
        old.unlink()
    run, rows = read_run(directory), []
    for approach in run.approaches:
        for mode in run.squeal.representatives(approach):
            name = f"mode_{approach}_{mode.frequency:05.0f}Hz"
            frames = [Image.new("RGB", (60, 40), colour) for colour in ("red", "blue")]
            frames[0].save(folder / f"{name}.webp", save_all=True, append_images=frames[1:])
            place = [approach, mode.family.number, mode.sample, mode.mode, mode.frequency]
            rows.append([*place, mode.damping, name, "disc", 7, "out of plane", 0.9])
    shapes = RowTable(SHAPE_COLUMNS, rows).columns
    save_tables(Store(directory), SHAPES, {"shapes": shapes})
    return directory, rows
