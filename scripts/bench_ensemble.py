#!/usr/bin/env python3
"""Studies of many samples: samples and processes against seconds and width of the intervals.

    scripts/bench_ensemble.py run [SCENE] [--samples 10 20 40] [--processes 1 2] [--set KEY=VALUE]
    scripts/bench_ensemble.py intervals     width and coverage of the intervals of indices
    scripts/bench_ensemble.py merge [SCENE] [--samples 10240 102400] [--processes 1]
    scripts/bench_ensemble.py states [SCENE] [--samples 4] [--set KEY=VALUE]
    scripts/bench_ensemble.py rare RESULTS [--limit 0.001]
    scripts/bench_ensemble.py sizes [--cells 1.8 1 0.76 0.6] [--samples 20] [--processes 2] [--cpu]

``run`` starts every row from nothing (cold: mesh, laws, basis and samples) and then once more on
the folder it left, without its samples (cached: laws and basis are read). Full order is the median
of the samples solved both ways (``stability.verify``), times the number of samples: extrapolated.
``width`` is that of the probability of any instability, 95 %; ``index`` the widest interval of a
first-order index of the whole band.

``merge`` computes 1024 samples, writes them again under other numbers until there are as many as
named, and runs the scene on what it wrote: tables and page alone. In the options {n} stands for the
number of samples.

``states`` prints seconds of this process for a sample in its own state, and in 25 states of a
dynamometer test beside it: five pressures and five temperatures, on which friction and a modulus
depend.

``rare`` reads modes.csv of a finished run: in how many samples each frequency squeals, in how many
of the first 300, which sample is the first, and the scatter of its share over blocks of 50 samples
in units of the binomial standard deviation.

``sizes`` runs the reference brake, multi-scale, with cells of other sizes than the scene's: its
unknowns, contact elements, seconds of each stage, memory of all processes where it is largest and
the largest stated error; then the exponents over the unknowns. ``--cpu``: one process, and seconds
of its processor, for a machine that does other work as well. ``--csv`` keeps the table.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from brake_fenicsx.folder.sample_files import BLOCK, COLUMNS, arrays_of_bytes, bytes_of_arrays

HERE = Path(__file__).parent
SCENE = HERE / "scenes" / "disc_brake_demo.toml"
RESOLVED = HERE / "scenes" / "disc_brake_resolved.toml"
REAL = 4 * BLOCK  # samples that are computed
CELLS = {"disc.size": 7.0, "pad.size": 4.5, "pad.plate_size": 5.0}  # of the reference brake [mm]
MAIN = "import sys; from brake_fenicsx.cli import main; sys.exit(main(sys.argv[1:]))"
BY_CPU = "import time; time.perf_counter = time.process_time; " + MAIN
ROOT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


def study(
    scene: Path, out: Path, samples: int, processes: int, sets: list[str],
    cache: Path | None = None, flags: tuple[str, ...] = (), program: str = MAIN,
) -> float:  # fmt: skip
    """Run a study and return its seconds."""
    parallel = ["mpirun", "-n", str(processes), "--oversubscribe"] if processes > 1 else []
    words = [*parallel, sys.executable, "-c", program, "run", str(scene), "-o", str(out), *flags]
    words += ["--cache", str(cache)] if cache else []
    for change in [f"samples.n={samples}", *sets]:
        words += ["--set", change]
    start = time.perf_counter()
    done = subprocess.run(words, capture_output=True, text=True, env=os.environ | ROOT)
    if done.returncode:
        sys.exit(done.stderr[-2000:])
    return time.perf_counter() - start


def table(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file; none if there is no such file."""
    if not path.exists():
        return []
    with path.open() as file:
        return list(csv.DictReader(file))


def facts(out: Path) -> dict[str, Any]:
    """Seconds per sample, memory and interval widths of a finished study."""
    summary = json.loads((out / "summary.json").read_text())
    whole = next(r for r in table(out / "probabilities.csv") if r["scope"] == "band")
    found = [r for r in table(out / "sensitivity.csv") if r["where"] == whole["where"]]
    widths = [float(r["first_high"]) - float(r["first_low"]) for r in found if r["first_high"]]
    own = summary["samples"][whole["approach"]]
    full = [float(np.load(f)["stability_seconds"]) for f in out.glob("samples/verify-*.npz")]
    return {
        "memory": max(summary["process_memory_mb"].values()),
        "sample": own["seconds_per_stability"] + own["seconds_per_equilibrium"],
        "full": float(np.median(full)) if full else float("nan"),
        "width": float(whole["high"]) - float(whole["low"]),
        "index": max(widths, default=float("nan")),
    }


def run(args: argparse.Namespace) -> None:
    """One row for each number of samples and of processes."""
    print(
        f"{args.scene.stem}\n{'samples':>8}{'proc.':>6}{'cold s':>8}{'cached s':>9}{'s/sample':>9}"
        f"{'full s':>8}{'ratio':>7}{'MB/proc.':>9}{'width':>7}{'index':>7}"
    )
    for n in args.samples:
        for processes in args.processes:
            with tempfile.TemporaryDirectory() as folder:
                out = Path(folder) / "out"
                cold = study(args.scene, out, n, processes, args.set)
                f = facts(out)
                shutil.rmtree(out / "samples")
                cached = study(args.scene, out, n, processes, args.set)
            full = f["full"] * n / processes
            print(
                f"{n:8d}{processes:6d}{cold:8.1f}{cached:9.1f}{f['sample']:9.3f}{full:8.0f}"
                f"{full / cold:7.1f}{f['memory']:9.0f}{f['width']:7.3f}{f['index']:7.3f}",
                flush=True,
            )


def merge(args: argparse.Namespace) -> None:
    """One row for each number of samples: seconds and memory from finished samples to the page."""
    with nullcontext(args.folder) if args.folder else tempfile.TemporaryDirectory() as folder:
        first = Path(folder) / "first"
        if not (first / "summary.json").exists():
            study(args.scene, first, REAL, args.processes, named(args.set, REAL))
        print(
            f"{args.scene.stem}\n{'samples':>8}{'modes':>9}{'results s':>10}{'pictures s':>11}"
            f"{'page s':>7}{'peak MB':>8}{'files':>6}{'GB':>6}"
        )
        for n in args.samples:
            out = Path(folder) / f"{n}"
            if not out.exists():
                shutil.copytree(first, out, ignore=shutil.ignore_patterns("samples"))
                (out / "samples").mkdir()
                shutil.copy(first / "samples" / "families.npz", out / "samples")
                for block in range(n // BLOCK):
                    write_again(first / "samples", out / "samples", block)
            study(args.scene, out, n, args.processes, named(args.set, n))
            summary = json.loads((out / "summary.json").read_text())
            seconds, memory = summary["seconds"], summary["process_memory_mb"]
            files = [file for file in out.rglob("*") if file.is_file()]
            print(
                f"{n:8d}{sum(about['modes'] for about in summary['samples'].values()):9d}"
                f"{seconds['results']:10.1f}{seconds['pictures']:11.1f}{seconds['report']:7.1f}{max(memory.values()):8.0f}"
                f"{len(files):6d}{sum(file.stat().st_size for file in files) / 1e9:6.1f}",
                flush=True,
            )
            if not args.folder:
                shutil.rmtree(out)


def named(options: list[str], samples: int) -> list[str]:
    """Options with the number of samples where they name it."""
    return [text.replace("{n}", str(samples)) for text in options]


def write_again(source: Path, target: Path, block: int) -> None:
    """Write an archive of the first samples once more, as another block."""
    archives = sorted(source.glob("*.zip"))
    archive = archives[block % len(archives)]
    name, start, _ = archive.stem.rsplit("-", 2)
    shift = block * BLOCK - int(start)
    copy = target / f"{name}-{block * BLOCK:05d}-{block * BLOCK + BLOCK - 1:05d}.zip"
    with zipfile.ZipFile(archive) as old, zipfile.ZipFile(copy, "w") as new:
        new.comment = old.comment
        for member in old.namelist():
            content = old.read(member)
            if member == COLUMNS:
                arrays = arrays_of_bytes(content)
                content = bytes_of_arrays(arrays | {"numbers": arrays["numbers"] + shift})
            else:
                number = int(member.removesuffix(".npz").rsplit("-", 1)[1])
                member = f"{name}-{number + shift:05d}.npz"
            new.writestr(zipfile.ZipInfo(member), content)


def intervals(args: argparse.Namespace) -> None:
    """First-order indices of Ishigami's function: error, width and coverage of the intervals."""
    from brake_fenicsx.results.ensemble_statistics import indices
    from brake_fenicsx.samples.designs import design_points, design_size
    from brake_fenicsx.scene.samples_section import Plan

    a, b = 7.0, 0.1
    variance = a**2 / 8 + b * np.pi**4 / 5 + b**2 * np.pi**8 / 18 + 0.5
    exact = np.array([0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8, 0.0]) / variance
    print(
        f"{'design':>16}{'samples':>8}{'error':>8}{'width':>8}{'coverage':>9}   x_1, x_2, 60 seeds"
    )
    for design in ("fast", "saltelli", "rbd-fast", "random"):
        # FAST needs 200 points for each of three inputs and three curves.
        for n in (1800, 5400) if design == "fast" else (300, 1000, 3000):
            plan = Plan(n, design, 3)
            error, width, hits = [], [], []
            for seed in range(60):
                points = design_points(plan, 3, np.random.SeedSequence(seed))
                if points is None:
                    points = np.random.default_rng(seed).random((n, 3))
                x = np.pi * (2 * points - 1)
                y = np.sin(x[:, 0]) * (1 + b * x[:, 2] ** 4) + a * np.sin(x[:, 1]) ** 2
                found = indices(plan, x, y, np.ones(y.size, dtype=bool))
                off = np.abs(found.first - exact)[:2]
                error.append(off)
                width.append(2 * found.first_half[:2])
                hits.append(off <= found.first_half[:2])
            print(
                f"{design:>16}{design_size(plan, 3):8d}{np.mean(error):8.3f}{np.mean(width):8.3f}"
                f"{np.mean(hits):9.2f}"
            )


def states(args: argparse.Namespace) -> None:
    """One row for each sample but the first, which others start from; then the mean."""
    from brake_fenicsx import prepare

    with tempfile.TemporaryDirectory() as folder:
        mu, lining = Path(folder) / "mu.csv", Path(folder) / "lining.csv"
        axes = "pressure [bar],temperature [degC]"
        mu.write_text(
            f"{axes},contact.pad_disc.friction\n5,20,0.4\n5,300,0.5\n40,20,0.45\n40,300,0.35\n"
        )
        lining.write_text("temperature [degC],materials.lining.C33 [GPa]\n20,2.27\n300,1.9\n")
        grid = "'pressure [bar]'=['5','10','15','25','40'],"
        grid += " 'temperature [degC]'=['20','90','160','230','300']"
        given = [
            f"samples.n={args.samples}", "samples.approaches=['multi-scale']", *args.set,
            f"states={{ grid={{ {grid} }}, tables=['{mu}', '{lining}'] }}",
        ]  # fmt: skip
        study, rows = prepare(args.scene, given).study, []
        print(f"{args.scene.stem}\n{'sample':>8}{'one s':>8}{'25 s':>8}{'ratio':>7}")
        for k in range(args.samples):
            row, every = [], study.beside
            for study.beside in ({}, every):
                start = time.process_time()
                study.work(("multi-scale", k))
                row.append(time.process_time() - start)
            if k:
                rows.append(row)
                print(f"{k:8d}{row[0]:8.2f}{row[1]:8.2f}{row[1] / row[0]:7.1f}", flush=True)
        one, many = np.mean(rows, axis=0)
        print(f"{'mean':>8}{one:8.2f}{many:8.2f}{many / one:7.1f}")


def rare(args: argparse.Namespace) -> None:
    """One row for each frequency that squeals; frequencies less than 25 Hz apart are one."""
    rows = table(args.results / "modes.csv")
    n = 1 + max(int(row["sample"]) for row in rows)
    grown = (row for row in rows if row["verdict"] == "unstable")
    loud = [(float(r["frequency_hz"]), int(r["sample"])) for r in grown
            if float(r["damping"]) < -args.limit]  # fmt: skip
    print_rare(np.array(sorted(loud)), n)


def print_rare(loud: np.ndarray, n: int) -> None:
    """Print frequencies [Hz] and samples, rising in frequency, shape (modes, 2), of n samples."""
    print(f"{'Hz':>8}{'samples':>9}{'of 300':>8}{'first':>7}{'scatter':>9}   {n} samples")
    for group in np.split(loud, 1 + np.flatnonzero(np.diff(loud[:, 0]) > 25.0)):
        heard = np.zeros(n)
        heard[group[:, 1].astype(int)] = 1.0
        p, blocks = heard.mean(), heard[: n // 50 * 50].reshape(-1, 50).mean(axis=1)
        binomial = np.sqrt(p * (1 - p) / 50)
        scatter = blocks.std(ddof=1) / binomial if binomial and blocks.size > 1 else np.nan
        print(
            f"{np.median(group[:, 0]):8.0f}{int(heard.sum()):9d}{int(heard[:300].sum()):8d}"
            f"{int(heard.argmax()):7d}{scatter:9.2f}"
        )


def sizes(args: argparse.Namespace) -> None:
    """One row for each size of cells, then how seconds and bytes grow."""
    scene, rows = HERE / "scenes" / "disc_brake.toml", []
    names = ("brake", "micro", "offline", "samples", "results", "whole", "GB")
    head = "".join(f"{name:>9}" for name in names)
    print(f"{'dofs':>8}{'elements':>9}{head}{'error':>10}   seconds", flush=True)
    for factor in args.cells:
        given = [f"parts.{k}='{v * factor:g} mm'" for k, v in CELLS.items()]
        given += ["samples.approaches=['multi-scale']", "stability.verify=0", *args.set]
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out"
            processes, program = (1, BY_CPU) if args.cpu else (args.processes, MAIN)
            flags = ("--no-pictures",)
            study(scene, out, args.samples, processes, given, flags=flags, program=program)
            found = json.loads((out / "summary.json").read_text())
        seconds, memory = found["seconds"], max(found["peak_memory_mb"].values()) / 1e3
        row = [*(seconds[n] for n in names[:5]), sum(seconds[n] for n in names[:5]), memory]
        rows.append([found["dofs"], found["contact_elements"], *row,
                     found["samples"]["multi-scale"]["largest_error"]])  # fmt: skip
        text = "".join(f"{x:9.1f}" for x in row)
        print(f"{rows[-1][0]:8d}{rows[-1][1]:9d}{text}{rows[-1][-1]:10.1e}", flush=True)
    if args.csv:
        with args.csv.open("w", newline="") as file:
            csv.writer(file).writerows([["dofs", "elements", *names, "error"], *rows])
    if len(rows) > 1:
        logs = np.log(np.array(rows))
        grown = [np.polyfit(logs[:, 0], logs[:, j], 1)[0] for j in range(1, 9)]
        text = "".join(f"{x:9.2f}" for x in grown[1:])
        print(f"{'exponent':>8}{grown[0]:9.2f}{text}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("run")
    one.add_argument("scene", nargs="?", type=Path, default=SCENE)
    one.add_argument("--samples", type=int, nargs="+", default=[20, 60])
    one.add_argument("--processes", type=int, nargs="+", default=[1, 2])
    one.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    one.set_defaults(do=run)
    commands.add_parser("intervals").set_defaults(do=intervals)
    two = commands.add_parser("merge")
    two.add_argument("scene", nargs="?", type=Path, default=SCENE)
    two.add_argument("--samples", type=int, nargs="+", default=[10240, 102400])
    two.add_argument("--processes", type=int, default=1)
    two.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    two.add_argument("--folder", type=Path, help="keep what is written here, and use it again")
    two.set_defaults(do=merge)
    three = commands.add_parser("states")
    three.add_argument("scene", nargs="?", type=Path, default=RESOLVED)
    three.add_argument("--samples", type=int, default=4)
    three.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    three.set_defaults(do=states)
    four = commands.add_parser("rare")
    four.add_argument("results", type=Path)
    four.add_argument("--limit", type=float, default=0.001, help="of the damping")
    four.set_defaults(do=rare)
    five = commands.add_parser("sizes")
    five.add_argument("--cells", type=float, nargs="+", default=[1.8, 1.0, 0.76, 0.6])
    five.add_argument("--samples", type=int, default=20)
    five.add_argument("--processes", type=int, default=2)
    five.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    five.add_argument("--cpu", action="store_true")
    five.add_argument("--csv", type=Path)
    five.set_defaults(do=sizes)
    args = parser.parse_args()
    args.do(args)


if __name__ == "__main__":
    main()
