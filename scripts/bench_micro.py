"""Speed against error of the micro-contact, one table: ``python scripts/bench_micro.py``.

Rows: one contact from a cold start (grid, boundary, load, tolerance), 20 loads one after the other,
a law, a library, and the error the grid itself makes at braking pressure. Errors are relative to a
solution with tolerance 1e-12 on the same grid, or, for the grid study, to the finest grid. One
thread; wall-clock seconds.
``--all`` adds the grids of 512 and 1024 pixels. ContactMechanics, Tamaas (extra ``peers``) and
ASPHER (``pip install aspher``) run along where they are installed, on the same contact; ``--peers``
prints their rows alone.
"""

from __future__ import annotations

import argparse
import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import resource  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Iterator  # noqa: E402
from importlib.util import find_spec  # noqa: E402

import numpy as np  # noqa: E402

from brake_fenicsx.arguments import Array  # noqa: E402
from brake_fenicsx.micro import (  # noqa: E402
    LawRecipe,
    LawSettings,
    contact_law,
    law_library,
    plane_strain_modulus,
    solve_contact,
)
from brake_fenicsx.micro.halfspace import half_space  # noqa: E402
from brake_fenicsx.surface import (  # noqa: E402
    Topography,
    given_statistics,
    synthesise,
)

PAPER = given_statistics(33.1e-6, -0.2410, 3.6549)
SIZE = (2.825e-3, 2.825e-3)
AREA = SIZE[0] * SIZE[1]
E_STAR = plane_strain_modulus(1983.3e6, 0.4054)
HEAD = ("what", "pixels", "boundary", "p/E*", "tolerance", "seconds", "peak MB", "steps")
ERRORS = ("error p", "error area", "error d/S_q")


def surface(n: int, seed: int = 0) -> Topography:
    rng = np.random.default_rng(seed)
    return synthesise(PAPER.bifractal, PAPER.hdf, (n, n), SIZE, rng, "extend", "scan")


def row(*cells: object) -> None:
    texts = [f"{c:.3g}" if isinstance(c, float) else str(c) for c in cells]
    print(" | ".join(f"{t:>12}" for t in texts), flush=True)


def peak_megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def contacts(sizes: list[int]) -> None:
    for n in sizes:
        topo = surface(n)
        for boundary in ("free", "periodic"):
            solve_contact(topo.heights, SIZE, E_STAR, load=1.0, boundary=boundary)  # plans, kernel
            for level in (0.02, 0.1):
                load = level * E_STAR * AREA
                settings = {"load": load, "boundary": boundary, "solver": "pcg"}
                exact = None
                for tol in (1e-12, 1e-2, 1e-4, 1e-6, 1e-8):
                    found = solve_contact(topo.heights, SIZE, E_STAR, tol=tol, **settings)
                    exact = exact or found
                    norm = np.linalg.norm(exact.pressure)
                    errors = (
                        float(np.linalg.norm(found.pressure - exact.pressure) / norm),
                        abs(found.area_fraction / exact.area_fraction - 1.0),
                        abs(found.separation - exact.separation) / PAPER.S_q,
                    )
                    row(
                        "contact", n, boundary, level, tol, found.seconds, peak_megabytes(),
                        found.iterations, *errors,
                    )  # fmt: skip


def loads(sizes: list[int]) -> None:
    """20 loads from 2e-4 to 0.1 E*, each from the last; duality gap over F S_q at most 1e-6.

    The last columns: that gap, the same gap over the work, and the share of the time that the
    products alone would take.
    """
    for n, periodic in _pairs(sizes):
        topo, boundary = surface(n), "periodic" if periodic else "free"
        tolerance = 1.1e-6 if periodic else 1.2e-7
        space = half_space((n, n), (SIZE[0] / n, SIZE[1] / n), boundary)
        settings = {"boundary": boundary, "tol": tolerance}
        solve_contact(topo.heights, SIZE, 1.0, load=0.1 * AREA, **settings)  # plans, kernel
        product = min(_seconds(space.apply, np.ones((n, n))) for _ in range(10))
        before, start, found = space.products, time.perf_counter(), []
        for level in np.geomspace(2e-4, 0.1, 20):
            last = found[-1].pressure if found else None
            found.append(
                solve_contact(topo.heights, SIZE, 1.0, load=level * AREA, start=last, **settings)
            )
        seconds, count = time.perf_counter() - start, space.products - before
        row(
            "20 loads", n, boundary, "to 0.1", tolerance, seconds, peak_megabytes(), count,
            f"gap {max(f.gap_residual for f in found):.1e}",
            f"work {max(f.residual for f in found):.1e}",
            f"products {count * product / seconds:.2f}",
        )  # fmt: skip


def _seconds(call: Callable[[np.ndarray], object], argument: np.ndarray) -> float:
    start = time.perf_counter()
    call(argument)
    return time.perf_counter() - start


def laws(sizes: list[int]) -> None:
    for n in sizes:
        topo = surface(n)
        contact_law(topo, E_STAR, max_pressure=1e-3 * E_STAR)  # kernel and plans
        fine = (
            contact_law(topo, E_STAR, steps=200, tolerance=1e-8, grids="one") if n <= 256 else None
        )
        for steps in (20, 40, 80):
            start = time.perf_counter()
            law = contact_law(topo, E_STAR, steps=steps, grids="one")
            seconds = time.perf_counter() - start
            errors: tuple[object, ...] = ("-", "-", "-")
            if fine is not None:
                d = np.linspace(fine.steps[0][-1], fine.steps[0][0], 20001)
                d = d[fine.pressure(d) <= 0.1 * E_STAR]
                p = float(np.abs(law.pressure(d) / fine.pressure(d) - 1.0).max())
                k = float(np.abs(law.stiffness(d) / fine.stiffness(d) - 1.0).max())
                errors = (p, "-", f"k: {k:.3g}")
            row(
                "law", n, "free", "to 0.1", 1e-6, seconds, peak_megabytes(),
                len(law.steps[0]), *errors,
            )  # fmt: skip


def libraries(n_laws: int) -> None:
    recipe = LawRecipe(PAPER.bifractal, PAPER.hdf, LawSettings(E_STAR))
    start = time.perf_counter()
    law_library(recipe, n_laws, seed=1)
    seconds = time.perf_counter() - start
    row(
        f"{n_laws} laws", 128, "free", "to 0.1", 1e-6, seconds, peak_megabytes(), "-", "-", "-", "-"
    )


def peers(sizes: list[int]) -> None:
    """One contact from a cold start by every program that is installed, and how they agree."""
    programs = {
        "ContactMechanics": by_contact_mechanics, "tamaas": by_tamaas, "aspher": by_aspher
    }  # fmt: skip
    there = {name: solve for name, solve in programs.items() if find_spec(name)}
    for name in programs.keys() - there.keys():
        print(f"{name} is not installed: no rows")
    for n, periodic in _pairs(sizes):
        topo, name = surface(n), "periodic" if periodic else "free"
        h = topo.heights - topo.heights.mean()
        given = {"load": 0.1 * AREA, "boundary": name, "solver": "pcg"}
        solve_contact(h, SIZE, 1.0, tol=1e-2, **given)  # plans, kernel
        exact = solve_contact(h, SIZE, 1.0, tol=1e-12, **given).pressure

        def told(
            program: str, seconds: float, p: Array, exact: Array = exact, size: int = n,
            boundary: str = name,
        ) -> None:  # fmt: skip
            error = float(np.linalg.norm(p - exact) / np.linalg.norm(exact))
            row(program, size, boundary, 0.1, "-", seconds, peak_megabytes(), "-", error, "-", "-")

        for tol in (1e-6, 1e-8):
            ours = solve_contact(h, SIZE, 1.0, tol=tol, **given)
            told(f"here, {tol:g}", ours.seconds, ours.pressure)
        for program, solve in there.items():
            if periodic or program != "tamaas":
                told(program, *solve(h, periodic))


def by_contact_mechanics(h: Array, periodic: bool) -> tuple[float, Array]:
    """Seconds and pressures over E* by ContactMechanics."""
    import ContactMechanics
    from SurfaceTopography import Topography as PeerTopography

    periodic_kind = ContactMechanics.PeriodicFFTElasticHalfSpace
    kind = periodic_kind if periodic else ContactMechanics.FreeFFTElasticHalfSpace
    half = kind(h.shape, 1.0, SIZE)
    heights = PeerTopography(h, SIZE, periodic=periodic)
    system = ContactMechanics.Systems.NonSmoothContactSystem(half, heights)
    start = time.perf_counter()
    system.minimize_proxy(external_force=0.1 * AREA, pentol=1e-7 * PAPER.S_q, maxiter=1000)
    seconds = time.perf_counter() - start
    return seconds, np.abs(np.asarray(half.force))[: len(h), : len(h)] / (AREA / h.size)


def by_tamaas(h: Array, _periodic: bool = True) -> tuple[float, Array]:
    """Seconds and pressures over E* by Tamaas, which is given lengths over the side of the patch.

    Its half-space is periodic, and its tolerance has the units of the model.
    """
    import tamaas

    tamaas.initialize(1)
    tamaas.set_log_level(tamaas.LogLevel.error)
    model = tamaas.Model(tamaas.model_type.basic_2d, [1.0, 1.0], list(h.shape))
    model.E, model.nu = 1.0, 0.0
    solver = tamaas.PolonskyKeerRey(model, np.ascontiguousarray(h / SIZE[0]), 1e-10)
    solver.max_iter, solver.dump_freq = 20_000, 10**9
    start = time.perf_counter()
    solver.solve(0.1)
    return time.perf_counter() - start, np.array(model.traction)


def by_aspher(h: Array, periodic: bool) -> tuple[float, Array]:
    """Seconds and pressures over E* by ASPHER, from coarse grids to the finest, with exact FFTs."""
    import aspher

    size, backend = {"grid_size": len(h), "domain_size": SIZE[0]}, "periodic" if periodic else "fft"
    start = time.perf_counter()
    found = aspher.solve_nested(
        gap=-h.ravel(), p_nominal=0.1, coarsest=32, tol=1e-8, backend=backend, **size
    )
    return time.perf_counter() - start, np.reshape(found.pressure, h.shape)


def _pairs(sizes: list[int]) -> Iterator[tuple[int, bool]]:
    for n in sizes:
        yield n, False
        yield n, True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--all", action="store_true", help="512 and 1024 pixels too")
    parser.add_argument("--peers", action="store_true", help="the rows of all programs alone")
    arguments = parser.parse_args()
    sizes = [64, 128, 256, 512, 1024] if arguments.all else [64, 128, 256]
    row(*HEAD, *ERRORS)
    if arguments.peers:
        peers(sizes[:4])
        return
    contacts(sizes)
    loads(sizes[:4])
    laws(sizes[:4])
    libraries(100)
    peers(sizes[:4])


if __name__ == "__main__":
    main()
