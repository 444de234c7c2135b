"""A synthetic run directory, seeded: every file the report reads, small and of known content."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import run_tables as tables
from brake_fenicsx.folder.store import Store
from brake_fenicsx.micro import LawRecipe, LawSettings
from brake_fenicsx.report.figure_inputs import surface_arrays, surface_numbers
from brake_fenicsx.report.figures import make_figures
from brake_fenicsx.report.mode_cards import SHAPES
from brake_fenicsx.report.style import save
from brake_fenicsx.results.run import save_tables
from brake_fenicsx.results.tables import MODES, SAMPLES, RowTable, write_rows
from brake_fenicsx.surface import characterise, given_statistics, make_topography, synthesise

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


def contact_rows(rng: np.random.Generator, rings: int = 8, columns: int = 19) -> list[list]:
    """Two pads of 60 degrees, r 96-140 mm, in patches of one size."""
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
                    numbers = [x, y, z, 2.825e-3**2, g, 0.0, p, 3e5 * p, 9e5 * p]
                    rows.append([approach, 0, element, *numbers, law])
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
    settings = np.array(json.dumps({"E_star": E_STAR}))
    return {"d": d, "p": p, "k": p / u0, "seed": np.arange(30), "settings": settings}


def make_surface(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A scan with missing points and an artificial surface; parameters of the fit are given."""
    given = given_statistics(33.1e-6, -0.241, 3.6549, -2.0, -4.5, 3e4)
    scan = synthesise(given.spectrum, given.hdf, (64, 64), (1.8e-3, 1.4e-3), rng)
    z = scan.heights.copy()
    z[rng.random(z.shape) < 2e-3] = np.nan
    z[40:52, 60:] = np.nan
    stats = characterise(make_topography(z, scan.size), outlier_rule="none", spectrum="fit")
    recipe = LawRecipe(stats.spectrum, stats.hdf, LawSettings(E_STAR), (64, 64))
    known = surface_numbers(stats) | {
        "S_sk": -0.241, "c1": -2.01, "c1_error": 0.04, "c2": -4.47, "c2_error": 0.03, "q_c": 3e4,
        "ln_q_c_error": 0.03, "C0": 1.2e-18, "ln_C0_error": 0.1, "fit_rms": 0.2,
    }  # fmt: skip
    return surface_arrays(stats, recipe) | {"stats": np.array(json.dumps(known))}


def make_maps(surface: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    z, fractions = surface["artificial"], np.array([2e-4, 1e-3, 4e-3, 0.02, 0.08, 0.3])
    levels = np.quantile(z, 1 - fractions)
    pressures = np.array([np.maximum(z - level, 0.0) * 2e13 for level in levels])
    loads = pressures.mean(axis=(1, 2)) / E_STAR
    return {
        "heights": z, "size": surface["artificial_size"], "p_over_E": loads,
        "pressures": pressures, "area_fraction": fractions, "separation": levels,
    }  # fmt: skip


STABILITY = {"band": [0.0, 16000.0]}
SUMMARY = {
    "in_effect": {"stability": {**STABILITY, "tolerance": 1e-06}},
    "settings": {
        "stages": ["surface", "stability"], "loads": {"pad.piston": {"pressure": "5 bar"}},
        "samples": {"n": 60, "random": {"contact.c.friction": {"law": "normal", "sd": 0.05}}},
    },
    "reference_stiffness_Pa_per_m": 58e9,
    "versions": {
        "brake_fenicsx": "0.1.0", "dolfinx": "0.5.2", "note": "<script>alert(1)</script> & more",
    },
    "seeds": {"surface": 1, "laws": 2, "samples": 3},
    "seconds": {"surface": 1.2, "micro": 40.5, "equilibrium": 21.0, "uncertainty": 61.0},
    "peak_memory_mb": {"surface": 210.0, "micro": 330.0, "equilibrium": 2900.0},
    "counts": {"cells": 12345, "dofs": 67890, "contact_elements": 1110},
    "sweep": {"parameters": {"contact.pad_disc.friction": "", "loads.pad.piston.pressure": "Pa"}},
    "reduction": {"max_error": 1.3e-4, "median_error": 2.4e-6, "wrong_verdicts": 0},
}  # fmt: skip


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
    write_rows(directory / "sweep.csv", ("approach", "sample", "value", *tables.SWEEP), modes)
    write_rows(directory / "lock_in.csv", ("approach", "sample", *tables.EVENTS), events)
    for family in (None, 3):
        for x in values:
            hits = sum(at <= x for at in merged)
            curve.append(["multi-scale", family, x, 6, hits / 6, hits / 12, (hits + 6) / 12])
    write_rows(directory / "critical_curve.csv", tables.CURVE, curve)
    start = ["multi-scale", "contact.pad_disc.friction"]
    ends = [6, 6, 0, 0.3, 0.4, 0.3, 0.55, 0.55]
    write_rows(
        directory / "critical.csv", tables.CRITICAL, [[*start, f, 2e3, *ends] for f in (None, 3)]
    )
    chart = [
        [a, x, 1e5 * y, int(x > y), int(x > y), -max(x - y, 0.0)]
        for a in ("classical", "multi-scale") for x in values for y in (0.2, 0.4, 0.6)
    ]  # fmt: skip
    write_rows(directory / "chart.csv", tables.CHART, chart)


def make_run(directory: Path, seed: int = 7) -> Path:
    rng, surface = np.random.default_rng(seed), make_surface(np.random.default_rng(seed + 1))
    modes = mode_rows(rng)
    tasks = [(a, k) for a, n in SAMPLED.items() for k in range(n)]
    samples = [
        [a, k, "error: no equilibrium" if (a, k) == ("parametric", 39) else "ok", 100 + k, mu]
        for (a, k), mu in zip(tasks, rng.normal(0.5, 0.05, len(tasks)), strict=True)
    ]
    contact = contact_rows(rng)
    for name, columns, rows in (
        ("modes", MODES, modes),
        ("samples", (*SAMPLES, "contact.pad_disc.friction"), samples),
        ("sensitivity", tables.SENSITIVITY, sensitivity_rows()),
        ("contact", tables.CONTACT, contact),
        ("drivers", tables.DRIVERS, driver_rows()),
        ("drivers_contact", tables.CONTACT_DRIVERS, driver_map_rows(contact)),
    ):
        write_rows(directory / f"{name}.csv", columns, rows)
    write_sweep(directory)
    np.savez(directory / "laws.npz", **make_laws(rng))
    np.savez(directory / "surface.npz", **surface)
    np.savez(directory / "contact_maps.npz", **make_maps(surface))
    (directory / "summary.json").write_text(json.dumps(SUMMARY))
    scene = 'stages = ["surface"]\n[micro]\nE = "1983.3 MPa"  # <b>E</b>\n'
    (directory / "scene.toml").write_text(scene)
    return directory


@pytest.fixture(scope="session")
def cut_off() -> list[str]:
    """Names of the figures of ``drawn`` of which something lies beyond the edge."""
    return []


@pytest.fixture(scope="session")
def drawn(run_directory, tmp_path_factory, cut_off) -> tuple[Path, list[Path]]:
    """The same run with all its figures, and what was written."""
    directory = tmp_path_factory.mktemp("drawn") / "run & <one>"
    shutil.copytree(run_directory, directory)

    def saved(figure, folder, name):
        written = save(figure, folder, name)
        box, page = figure.get_tightbbox(), figure.bbox_inches
        if min(box.x0, box.y0) < -0.01 or np.any(box.max > page.max + 0.01):
            cut_off.append(name)
        return written

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("brake_fenicsx.report.figures.save", saved)
        return directory, make_figures(tables.read_run(directory))


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
    return make_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="session")
def shaped(drawn, tmp_path_factory) -> tuple[Path, list[list]]:
    """The drawn run with the animated pictures that a run would draw, and their rows."""
    directory = tmp_path_factory.mktemp("shaped") / "run"
    shutil.copytree(drawn[0], directory)
    folder = directory / "figures"
    for old in folder.glob("mode_*.png"):
        old.unlink()
    run, rows = tables.read_run(directory), []
    for approach in run.approaches:
        for mode in run.squeal.representatives(approach):
            name = f"mode_{approach}_{mode.frequency:05.0f}Hz"
            frames = [Image.new("RGB", (60, 40), colour) for colour in ("red", "blue")]
            frames[0].save(folder / f"{name}.webp", save_all=True, append_images=frames[1:])
            place = [approach, mode.family.number, mode.sample, mode.mode, mode.frequency]
            rows.append([*place, mode.damping, name, "disc", 7, "out of plane", 0.9])
    shapes = RowTable(tables.SHAPE_COLUMNS, rows).columns
    save_tables(Store(directory), SHAPES, {"shapes": shapes})
    return directory, rows
