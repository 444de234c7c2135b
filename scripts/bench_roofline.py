#!/usr/bin/env python3
"""Roofline of a study: what its three largest stages do, against what this machine can do.

    scripts/bench_roofline.py [SCENE] [--samples 4] [--set KEY=VALUE ...]

One process. First the machine: dgemm and LU of 1500 rows [Gflop/s], copying 200 MB [GB/s]. Then the
scene's laws, its reduced model and some samples of its first approach, from nothing. Columns: part;
seconds; seconds of all of its stage; operations [Gflop] and their rate, as a share of dgemm's;
bytes that have to pass through the memory [GB] and their rate, as a share of copying; seconds over
the limit, which is the longer one of dgemm and copying, and for transforms bare pairs of the whole
padded grid by measured plans of FFTW. Operations of a transform of N points are 2.5 N log2 N; of a
factor what MUMPS counts; of a solve four for each entry of the factor, which is read twice for each
block of columns.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pyfftw
import scipy.linalg as la

from brake_fenicsx.macro import solver
from brake_fenicsx.micro import halfspace
from brake_fenicsx.stability.substructures import reduced_model
from brake_fenicsx.stability.substructures import sample as online
from brake_fenicsx.stability.substructures.sample import BlockMatrix
from brake_fenicsx.stability.substructures.sample_problem import Quotient

SCENE = Path(__file__).parent / "scenes" / "disc_brake.toml"


@dataclass
class Part:
    """What a part did: seconds, operations, bytes that have to pass the memory, bare seconds."""

    seconds: float = 0.0
    flops: float = 0.0
    size: float = 0.0
    bare: float = 0.0


parts: dict[tuple[str, str], Part] = {}
stages: dict[str, float] = {}


def add(stage: str, name: str, start: float, flops: float, size: float, bare: float = 0.0) -> None:
    """Count a piece of work that began at ``start``."""
    part = parts.setdefault((stage, name), Part())
    part.seconds += time.perf_counter() - start
    part.bare += bare
    part.flops += flops
    part.size += size


def wrap(owner: Any, name: str, count: Callable[..., tuple[str, str, float, float]]) -> None:
    """Count each call of a function by what ``count`` says of its arguments and result."""
    inner, within = getattr(owner, name), False

    def outer(*args: Any, **kwargs: Any) -> Any:
        nonlocal within
        if within:  # A function that calls itself is counted once.
            return inner(*args, **kwargs)
        within, start = True, time.perf_counter()
        try:
            result = inner(*args, **kwargs)
        finally:
            within = False
        stage, what, flops, size = count(result, *args)
        add(stage, what, start, flops, size)
        return result

    setattr(owner, name, outer)


def measured(work: Callable[[], Any], amount: float, times: int = 5) -> float:
    """Rate of the fastest of some runs."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return amount / min(seconds)


def machine(n: int = 1500, size: int = 25_000_000) -> tuple[float, float, float]:
    """Rates of dgemm and LU [flop/s] and of copying [B/s]."""
    A = np.random.default_rng(0).normal(size=(n, n))
    a, b = np.ones(size), np.zeros(size)
    return (
        measured(lambda: A @ A, 2 * n**3),
        measured(lambda: la.lu_factor(A, check_finite=False), 2 / 3 * n**3),
        measured(lambda: np.copyto(b, a), 16 * size),
    )


def entries(factor: solver.Factor) -> float:
    """Entries of a factor."""
    number = factor._F.getMumpsInfog(29)
    return float(number if number > 0 else -1e6 * number)


def count_factors() -> None:
    """Factors and solves of the bodies."""

    def factor(_: None, self: solver.Factor) -> tuple[str, str, float, float]:
        return "offline", "factors (MUMPS)", self._F.getMumpsRinfog(3), 8 * entries(self)

    def solve(x: Any, self: solver.Factor, b: Any) -> tuple[str, str, float, float]:
        columns = 1 if x.ndim == 1 else x.shape[1]
        blocks = -(-columns // solver.BLOCK)
        return "offline", "solves", 4 * entries(self) * columns, 16 * entries(self) * blocks

    wrap(solver.Factor, "_factor", factor)
    wrap(solver.Factor, "solve", solve)


def bare_pair(shape: tuple[int, int]) -> float:
    """Seconds of a transform of a real grid forth and back, by measured plans."""
    real = pyfftw.zeros_aligned(shape, "float64")
    waves = pyfftw.zeros_aligned((shape[0], shape[1] // 2 + 1), "complex128")
    forth = pyfftw.FFTW(real, waves, axes=(0, 1))
    back = pyfftw.FFTW(waves, real, axes=(0, 1), direction="FFTW_BACKWARD")
    return 1.0 / measured(lambda: (forth.execute(), back.execute()), 1.0, 20)


def count_transforms() -> None:
    """Products with the influence of a half-space."""
    make = halfspace._product

    def product(shape: Any, padded: Any, symbol: Any) -> Any:
        inner, points = make(shape, padded, symbol), float(np.prod(padded))
        bare = bare_pair(padded)

        class Counted:
            def __call__(self, *p: Any) -> Any:
                start = time.perf_counter()
                result = inner(*p)
                flops = 2 * 2.5 * points * np.log2(points) + 6 * points
                # Forth and back, along rows and along columns: read and written, half of a complex.
                add("micro", "products by FFT", start, flops, 4 * 16 * points, bare)
                return result

        return Counted()

    halfspace._product = product


def count_samples() -> None:
    """Parts of a reduced sample."""

    def square(self: online.Sample) -> float:
        return float(len(self.rows.followed) * self.closed.count) ** 2

    def assembly(b: BlockMatrix, *args: Any) -> tuple[str, str, float, float]:
        # Each value is read once in single precision, and written in double.
        return "samples", "assembly of D", 0.0, 12.0 * sum(A.size for A in b.D)

    def quotient(q: Quotient, self: online.Sample, *args: Any) -> tuple[str, str, float, float]:
        # One step of either vector; more only where a zero lies next to a pole.
        columns, products = 2 * q.slope.size, 2 * len(self.E) + 2
        return (
            "samples",
            "two-sided quotient",
            2 * square(self) * columns * products,
            (8 * square(self) * products),
        )

    wrap(online, "assembled", assembly)
    wrap(online.Sample, "quotient", quotient)
    wrap(reduced_model, "zeros", lambda *_: ("samples", "zeros of T", 0.0, 0.0))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--set", action="append", default=[])
    args = parser.parse_args()
    dgemm, lu, copying = machine()
    print(
        f"dgemm {dgemm / 1e9:.0f} Gflop/s, LU {lu / 1e9:.0f} Gflop/s, copy {copying / 1e9:.1f} GB/s"
    )
    count_factors(), count_transforms(), count_samples()
    from brake_fenicsx import prepare
    from brake_fenicsx.stages import Run

    runs: list[Run] = []
    create = Run.__init__

    def init(self: Run, *values: Any, **more: Any) -> None:
        create(self, *values, **more)
        runs.append(self)

    Run.__init__ = init  # type: ignore[method-assign]
    rough = ["samples.approaches=['multi-scale']", "stability.verify=0"]
    model = prepare(args.scene, [*rough, *args.set])
    stages.update(runs[0].seconds)
    start = time.perf_counter()
    for k in range(args.samples):
        eq, _ = model.equilibrium_and_modes(sample=k)
        part = parts.setdefault(("samples", "equilibrium"), Part())
        part.seconds += eq.seconds
        m = float(np.count_nonzero(eq.p))
        # An LU factor of the closed elements in each iteration, in single precision.
        part.flops += 2 / 3 * m**3 * sum(eq.iterations)
        part.size += 8 * m**2 * sum(eq.iterations)
    stages["samples"] = time.perf_counter() - start
    print(f"{'part':<32}{'s':>8}{'of':>8}{'Gflop':>9}{'Gflop/s':>9}{'dgemm':>7}"
          f"{'GB':>8}{'GB/s':>7}{'copy':>7}{'over limit':>11}")  # fmt: skip
    for (stage, name), p in sorted(parts.items(), key=lambda item: item[0][0]):
        rate, width = p.flops / p.seconds, p.size / p.seconds
        limit = p.bare or max(p.flops / dgemm, p.size / copying)
        print(f"{stage + ': ' + name:<32}{p.seconds:8.2f}{stages.get(stage, 0.0):8.2f}"
              f"{p.flops / 1e9:9.1f}{rate / 1e9:9.1f}{rate / dgemm:7.0%}"
              f"{p.size / 1e9:8.1f}{width / 1e9:7.1f}{width / copying:7.0%}"
              f"{f'{p.seconds / limit:.1f}' if limit else '-':>11}")  # fmt: skip


if __name__ == "__main__":
    main()
