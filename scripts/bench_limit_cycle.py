"""Limit cycle of a squealing block: harmonics, error, seconds; and its figure for the docs.

    python scripts/bench_limit_cycle.py                            table
    python scripts/bench_limit_cycle.py --branches                 how many branches reach a cycle
    python scripts/bench_limit_cycle.py --cost                     brakes: a branch over the modes
    python scripts/bench_limit_cycle.py --figure docs/limit_cycle.png    growth, cycles, time steps

Errors are those of the amplitude against 25 harmonics, and against time steps of the finite-element
matrices (tests/time_steps.py).
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from brake_fenicsx import prepare

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests"))
from time_steps import TimeSteps, measured  # noqa: E402

SCENE = ROOT / "scripts" / "scenes" / "squealing_block.toml"
TASK, OMEGA, STEP = ("multi-scale", 0), 92e3, 2.5e-7


def prepared(ratio, k=0, changes=()):
    """Model, sample, equilibrium and growing mode with a damping ratio at 14.6 kHz."""
    beta = f"stability.damping={{ rayleigh = ['0 1/s', '{2 * ratio / OMEGA:g} s'] }}"
    model = prepare(SCENE, ["samples.n=4", "limit_cycle={}", "countermeasures=[]", beta, *changes])
    task = (TASK[0], k)
    sample = model.study.sample(task)
    eq, modes = model.study.solved(task, {})
    return model.study, sample, eq, modes, int(np.argmax(modes.s.real))


def followed(given, harmonics, points):
    study, sample, eq, modes, mode = given
    cycles = study.beside["limit cycles"].sample(sample, eq)
    problem = cycles.problem(harmonics, points)
    return cycles.branch(problem, modes.s[mode], modes.right[:, mode], 20e-6)


def stepped(study, sample, eq, amplitude):
    C = sample.brake.C(sample.friction, eq.p)
    steps = TimeSteps(study.brake, eq, sample.laws, sample.friction.mu, C)
    weights = study.brake.w * (eq.p > 0)
    gaps = steps.run(0.04, STEP, amplitude)
    return measured(gaps, STEP, weights / weights.sum())


def table():
    given = prepared(0.01)
    study, sample, eq, modes, _ = given
    exact = followed(given, 25, 256).cycles[0].at
    start = time.perf_counter()
    judged = stepped(study, sample, eq, exact.amplitude)
    seconds = time.perf_counter() - start
    print("| harmonics | points | amplitude [um] | error | to time steps | f [Hz] | seconds |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for harmonics, points in ((1, 16), (3, 24), (5, 32), (7, 48), (9, 64), (13, 96)):
        start = time.perf_counter()
        at = followed(given, harmonics, points).cycles[0].at
        errors = at.amplitude / exact.amplitude - 1, at.amplitude / judged[0] - 1
        print(
            f"| {harmonics} | {points} | {1e6 * at.amplitude:.4f} | {errors[0]:+.1e} |"
            f" {errors[1]:+.1e} | {at.s.imag / 2 / np.pi:.1f} | {time.perf_counter() - start:.1f} |"
        )
    print(f"| time steps | | {1e6 * judged[0]:.4f} | | | {judged[1]:.1f} | {seconds:.1f} |")
    print(f"complex modes of the sample: {modes.seconds:.3f} s")


def branches():
    """Do branches reach a cycle, and go on to their end? Meshes, samples, harmonics, dampings."""
    print("| damped away | branches | with a cycle | to the end | points | seconds of one |")
    print("| --- | --- | --- | --- | --- | --- |")
    for share in (0.1, 0.25, 0.5, 0.75):
        rows = []
        for size in ("9 mm", "10 mm", "11 mm"):
            for k in range(4):
                changes = [f"parts.block.size='{size}'"]
                s = prepared(1e-9, k, changes)[3].s
                growing = s[np.argmax(s.real)]
                given = prepared(share * growing.real / growing.imag**2 * OMEGA, k, changes)
                for harmonics, points in ((5, 32), (9, 64)):
                    start = time.process_time()
                    branch = followed(given, harmonics, points)
                    seconds = time.process_time() - start
                    ended = len(branch.cycles) > 0, branch.end == "stable"
                    rows.append((*ended, len(branch.points), seconds))
        cycles, ends, points, seconds = zip(*rows, strict=True)
        print(
            f"| {share:g} | {len(rows)} | {sum(cycles)} | {sum(ends)} | {np.median(points):g},"
            f" {max(points)} at most | {np.median(seconds):.1f}, {max(seconds):.1f} at most |"
        )


def cost():
    """Processor seconds of the branch of the mode that grows most, over those of the modes."""
    print("| scene | damping beta [s] | patches | points | end | branch [s] | modes [s] | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for scene in ("disc_brake_demo.toml", "disc_brake.toml"):
        for beta in (0.0, 2e-8 if "demo" in scene else 1e-6):
            damping = f"stability.damping={{ rayleigh = ['0 1/s', '{beta:g} s'] }}"
            changes = ["samples.n=1", "limit_cycle={}", *([damping] if beta else [])]
            study = prepare(SCENE.with_name(scene), changes).study
            sample, linear = study.sample(TASK), []
            for _ in range(3):
                start = time.process_time()
                eq, modes = study.solved(TASK, {})
                linear.append(time.process_time() - start)
            start, mode = time.process_time(), int(np.argmax(modes.s.real))
            branch = followed((study, sample, eq, modes, mode), 5, 32)
            seconds, modes = time.process_time() - start, np.median(linear)
            print(
                f"| {scene} | {beta:g} | {study.brake.w.size} | {len(branch.points)} |"
                f" {branch.end} | {seconds:.1f} | {modes:.2f} | {seconds / modes:.1f} |"
            )


def figure(path):
    from brake_fenicsx.report.style import CYCLE, GREY, house_style, light_grid, new_figure

    with house_style():
        drawing, axes = new_figure(1, 1)
        axis = axes[0, 0]
        for colour, ratio in zip(CYCLE, (0.01, 0.015, 0.02), strict=False):
            given = prepared(ratio)
            study, sample, eq, *_ = given
            branch = followed(given, 9, 64)
            a = 1e6 * np.r_[branch.amplitude, [cycle.at.amplitude for cycle in branch.cycles]]
            alpha = np.r_[np.real(branch.s), np.zeros(len(branch.cycles))]
            order = np.argsort(a)
            label = f"damping ratio {100 * ratio:g} %"
            axis.plot(a[order], alpha[order], color=colour, label=label)
            for cycle in branch.cycles:
                axis.plot(1e6 * cycle.at.amplitude, 0, "o", color=colour)
                judged = stepped(study, sample, eq, 0.1 * cycle.at.amplitude)
                axis.plot(1e6 * judged[0], 0, "x", color="black", ms=8)
        axis.axhline(0.0, color=GREY, lw=0.8)
        axis.set_xlabel("amplitude of the gap, rms of patches [um]")
        axis.set_ylabel("growth rate alpha [1/s]")
        axis.legend()
        light_grid(axis)
        drawing.savefig(path, dpi=130, facecolor="white", metadata={"Software": None})


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("--figure", type=Path, metavar="FILE", help="draw the figure of the docs")
    words.add_argument("--branches", action="store_true", help="how many branches reach a cycle")
    words.add_argument("--cost", action="store_true", help="brakes: a branch over the modes")
    given = words.parse_args()
    if given.figure:
        figure(given.figure)
    elif given.branches:
        branches()
    else:
        cost() if given.cost else table()
