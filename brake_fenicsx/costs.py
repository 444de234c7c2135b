"""What a run will cost: seconds and memory of each stage, estimated from its sizes alone.

Every constant is a measured figure of docs/benchmarks.md (tables of stages, of the size ladder, of
one equilibrium, of micro-contact), on one 2.6 GHz core with OpenBLAS on one thread; exponents are
the ladder's. With

    n free dofs, m contact elements, r real modes below 1.8 times the band, b modes in the band,
    v = 0.0213 s (n / 105e3)^1.22, one vector of a blocked solve,

    laws       0.05 s (pixels / 402)^2 + 0.2 s (min(pixels, 192) / 128)^2.5, each; periodic, where
               every product is one of all pixels, 0.85 s (pixels / 402)^2, with hardness 2 s
    brake      2.7 s (n / 105e3)^0.87
    offline    4.4 s (n / 105e3)^1.63 for the factor; then 8 r v for the real modes and 2.2 m v for
               the interface of the reduced model; without it 0.45 m v for the compliance;
               12 (a m + r) v for damping in it;
               0.10 m v for each moment at each point where materials change: a moment of degree
               g has C(d + g, d) points for d random constants, and two that check it; a times
               that where friction damps them
    samples    0.2 s (m / 1368)^2.5 an equilibrium;
               0.1 s (r / 150)^3 + 0.1 s (m / 1000)^2 its modes, reduced;
               1 + 2 a^2 times that with damping, for a = 1 + 1 (sliding) + 1 (slope);
               0.55 s (m / 1368)^2 the same and its bodies, where materials change,
               1 + 2 a times that with damping;
               45 s (n / 40.7e3)^0.8 b / 64 its modes at full order, 1.3 times that with damping
    sweep      as samples: of each approach's own line 2 solves for each value and 60 for events, of
               each sample that is followed 25
    memory     of one process: 0.2 GB + 16 kB n with a factor; 5 kB n more where materials change;
               30 kB n the solver at full order, 19 kB n more with damping;
               of a machine: 150 B m^2 + 8 B n r + 1 kB n the reduced model, and with damping
               96 B (a m + r)(2 m + r), 3 m with sliding; 4.9 B m^2 for each of the solves
               where materials change, and 1.2 kB n stiffness and mass. The first process holds
               that by itself while it is made. A process of run --share holds beside it 0.2 GB and
               the larger of 2.2 kB n (assembly) and 120 B (a m)^2 (a sample)

How many modes there are is not known before: b is taken as in the reference brake, 4.2 per kHz.
Within a factor of three of what was measured; a busy machine easily doubles it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.damping import active_terms, reduced_approaches
from brake_fenicsx.scene.scalars import changes_bodies

CORE = "one 2.6 GHz core"
MODES_PER_HZ = 4.2e-3
# Modes are denser higher up: of the reference brake 68 lie below 16 kHz, 180 real ones below 27.2.
CUTOFF = 1.8
REAL_MODES_PER_HZ = 6.0e-3
PICTURES = 4  # of unstable modes, for each approach
AGAIN = 10.0  # [s] for a factor of the bodies of a sample, to draw its equilibrium
# Degrees of the interpolation of each moment at the default tolerance, undamped and damped.
DEGREES = {False: (4, 3, 3, 2, 2, 1), True: (4, 3, 3, 3, 3, 2, 2, 2, 2, 1, 1)}


@dataclass(frozen=True, slots=True)
class Counts:
    """Sizes of a run that are known before it starts.

    Attributes:
        dofs: free dofs.
        elements: contact elements.
        samples: samples of all approaches.
        reduced: samples whose modes come from the reduced model of the scene's bodies.
        full: samples whose modes are found at full order.
        changing: samples whose modes come from the reduced model of bodies that change.
        damped: samples of ``full`` that are damped.
        damped_reduced: samples of ``reduced`` that are damped.
        damped_changing: samples of ``changing`` that are damped.
    """

    dofs: int = 0
    elements: int = 0
    samples: int = 0
    reduced: int = 0
    full: int = 0
    changing: int = 0
    damped: int = 0
    damped_reduced: int = 0
    damped_changing: int = 0


@dataclass(frozen=True, slots=True)
class Cost:
    """Estimated cost of one stage: seconds [s] on one core, peak memory of a process [GB].

    The processes of a machine hold the ``shared`` part of that memory [GB] once. ``lean`` is what a
    process of ``run --share`` holds beside that [GB], unless it verifies a sample at full order.
    """

    stage: str
    seconds: float
    gigabytes: float
    shared: float = 0.0
    lean: float = 0.0


def count_solves(scene: Scene, samples: dict[str, int]) -> Counts:
    """How the modes of the samples are found.

    Args:
        scene: the scene.
        samples: number of samples of each approach.

    Returns:
        Numbers of samples; among those at full order the ones that are verified.
    """
    total = sum(samples.values())
    stability = scene.stability if "stability" in scene.stages else None
    if stability is None:
        return Counts(samples=total)
    damped = [name for name in samples if active_terms(scene, name)]
    own = [name for name in samples if constants(scene) and scene.samples.takes_random(name)]
    reduced = reduced_approaches(scene, samples)
    chosen = [name for name in samples if name in reduced]
    verify = {name: min(stability.verify, samples[name]) for name in chosen[:1]}
    at_full = {name: 0 if name in chosen else n for name, n in samples.items()}
    at_full = {name: n + verify.get(name, 0) for name, n in at_full.items()}
    changing = sum(samples[name] for name in chosen if name in own)
    return Counts(
        samples=total, reduced=sum(samples[name] for name in chosen) - changing,
        full=sum(at_full.values()), changing=changing,
        damped=sum(at_full[name] for name in damped),
        damped_reduced=sum(samples[n] for n in chosen if n in damped and n not in own),
        damped_changing=sum(samples[n] for n in chosen if n in damped and n in own),
    )  # fmt: skip


def constants(scene: Scene) -> int:
    """Random and swept scalars of a scene that its bodies depend on."""
    return sum(changes_bodies(scene, name) for name in scene.varied)


def estimate(scene: Scene, counts: Counts) -> list[Cost]:
    """Cost of every stage that the scene names, in their order.

    Args:
        scene: the scene.
        counts: its sizes.

    Returns:
        Estimates; see the head of this module.
    """
    stages = scene.stages
    costs = []
    if "surface" in stages:
        scans = len(scene.surface.scans) if scene.surface else 0
        costs.append(Cost("surface", 0.1 * max(scans, 1), 0.2))
    if "micro" in stages:
        costs.append(Cost("micro", _laws(scene), 0.25))
    if "equilibrium" in stages:
        costs += _mechanics(scene, counts)
    if "report" in stages:
        maps = 4.0 if "micro" in stages else 0.0
        costs.append(Cost("report", 8.0 + maps, max([c.gigabytes for c in costs], default=0.3)))
    return costs


def cost_lines(costs: list[Cost], processes: int) -> list[str]:
    """What a person reads of the costs: time, memory, and how far to trust them.

    Args:
        costs: of each stage.
        processes: number of processes; each holds its own matrices, all share a reduced model.
    """
    if not costs:
        return []
    each = ", ".join(f"{c.stage} {_time(c.seconds)}" for c in costs)
    peak = max(c.gigabytes for c in costs)
    whole = max(processes * (c.gigabytes - c.shared) + c.shared for c in costs)
    every = f", {whole:.1f} GB on {processes} processes" if processes > 1 else ""
    lean = next((c for c in costs if c.lean), None)
    shares = "" if lean is None else (
        f"; a process of run --share {lean.lean:.1f} GB, and {lean.shared:.1f} GB once on each node"
    )  # fmt: skip
    return [
        f"memory: about {peak:.1f} GB{every}{shares}",
        f"time: about {_time(sum(c.seconds for c in costs))} on {CORE}: {each}",
        "both are estimates from measured runs, up to a factor of three off; nothing was run",
    ]


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s" if seconds >= 1 else "< 1 s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    if seconds < 2e5:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 86400:.3g} days" if seconds < 3e7 else f"{seconds / 31557600:.3g} years"


def _laws(scene: Scene) -> float:
    micro = scene.micro
    if micro is None:
        return 0.0
    number = micro.laws
    pixels = 402 if micro.pixels == "scan" else micro.pixels
    if micro.boundary == "periodic":
        return number * (0.85 if micro.hardness is None else 2.0) * (pixels / 402) ** 2
    # A surface, the law up to many touching points on its grid, the rest on one of 128.
    return number * (0.05 * (pixels / 402) ** 2 + 0.2 * min(pixels / 128, 1.5) ** 2.5)


def _mechanics(scene: Scene, c: Counts) -> list[Cost]:
    """Brake, what all samples share, the samples, and their fields and pictures."""
    n, m = c.dofs, c.elements
    top = scene.stability.band[1] if scene.stability else 0.0
    b = MODES_PER_HZ * top
    cutoff = (scene.stability.cutoff if scene.stability else None) or CUTOFF * top
    r = REAL_MODES_PER_HZ * cutoff
    vector = 0.0213 * (n / 105e3) ** 1.22
    shared = 4.4 * (n / 105e3) ** 1.63 + (
        8 * r * vector + 2.2 * m * vector if c.reduced or c.changing else 0.45 * m * vector
    )
    one = 0.2 * (m / 1368) ** 2.5
    reduced = c.reduced * (0.1 * (r / 150) ** 3 + 0.1 * (m / 1e3) ** 2)
    full = (c.full + 0.3 * c.damped) * 45 * (n / 40.7e3) ** 0.8 * b / 64
    held, model = 0.2 + 16e-6 * n, 0.0
    if c.reduced or c.changing:
        model = 150e-9 * m**2 + 8e-9 * n * r + 1e-6 * n
    else:
        held += 40e-9 * m**2
    lean = 0.0
    table = scene.stability.damping if scene.stability else None
    a = 1 + (bool(table.slope) + bool(table.sliding) if table else 0)
    series = 96e-9 * (a * m + r) * ((2 + bool(table and table.sliding)) * m + r)
    if c.damped_reduced:
        shared += 12 * (a * m + r) * vector
        reduced *= 1 + 2 * a**2 * c.damped_reduced / c.reduced
        model += series
    anew = 0.0
    if c.changing:
        d = constants(scene)
        rows = a if c.damped_changing else 1
        degrees = DEGREES[bool(c.damped_changing)]
        solves = sum(comb(d + degree, d) for degree in degrees) + 2 * len(degrees)
        shared += 0.10 * (solves - len(degrees)) * rows * m * vector
        reduced += (c.changing + 2 * a * c.damped_changing) * 0.55 * (m / 1368) ** 2
        model += (series if c.damped_changing else 0.0) + 4.9e-9 * solves * rows * m**2
        held += 5e-6 * n
        own = [a for a in scene.samples.approaches if scene.samples.takes_random(a)]
        anew = AGAIN * len(own) * (n / 152e3) ** 1.22
    if 0 < c.samples == c.reduced + c.changing:
        model += 1.2e-6 * n
        lean = max(0.2 + 2.2e-6 * n, 0.2 + 0.12e-6 * (a * m) ** 2)
    solver = 30e-6 * n if c.full else 0.0
    solver += 19e-6 * n if c.damped else 0.0
    peak = held + model + solver
    pictures = PICTURES * 2.5 * len(scene.samples.approaches) if top else 0.0
    written = 1.0 + (pictures + anew if "report" in scene.stages else 0.0)
    return [
        Cost("brake", 2.7 * (n / 105e3) ** 0.87, 0.2 + 4e-6 * n),
        Cost("offline", shared, held + model),
        Cost("samples", c.samples * one + reduced + full, peak, model, lean),
        *_sweep(scene, (c.samples * one + reduced + full) / max(c.samples, 1), held + model, model),
        Cost("results", written, held + model, model),
    ]


def _sweep(scene: Scene, each: float, gigabytes: float, shared: float) -> list[Cost]:
    """Lines of a sweep, at the mean cost of a sample."""
    sweep = scene.sweep
    if sweep is None:
        return []
    first = len(sweep.parameters[sweep.first].points)
    lines = 2 * (len(sweep.parameters[sweep.second].points) if sweep.second else 1)
    solves = lines * (2 * first + 60) + 25 * sweep.samples
    return [Cost("sweep", solves * each, gigabytes, shared)]
