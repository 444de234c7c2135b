"""Hardness of a lining from its compressibility curve: closure of a whole pad over the pressure.

The closure is the approach of the rough surface to the plane, with a hardness, plus the pressure
times the compliance of the lining's bulk, plus a constant of seating. Unloading is elastic, on the
surface that the largest pressure has left: its first slope is the stiffness of vibrations in series
with the bulk.

References: ISO 6310 and SAE J2468 (compressibility of brake linings).
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.stats import t as student

from brake_fenicsx.arguments import Array, Mask, number, positive
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import TextTable, reading
from brake_fenicsx.micro import halfspace, library
from brake_fenicsx.micro.loading import solve_contact

HARDNESSES = 3e7 * 2.0 ** np.arange(7)  # computed [Pa]; interpolated between
NODES = 10  # pressures computed of each branch
LOWEST = 0.02  # share of the largest pressure below which a pad is still being seated
PRESSURES, CLOSURES = (1e4, 2e7), (2e-6, 2e-3)  # largest ones of a test [Pa], [m]
WIDE = 4.0  # ratio of the ends of an interval beyond which the curve has not decided


@dataclass(frozen=True, slots=True)
class HardnessFit:
    """A hardness with its interval of 90 %.

    Attributes:
        hardness: best value [Pa].
        low: lower end of the interval [Pa].
        high: upper end of the interval [Pa].
        bulk_stiffness: pressure over the closure of the bulk [Pa/m]; infinite if none is seen.
        residual: root mean square of measured minus computed closures [m].
        doubts: what the curve cannot tell, one sentence each.
        seconds: wall-clock time [s].
    """

    hardness: float
    low: float
    high: float
    bulk_stiffness: float
    residual: float
    doubts: tuple[str, ...]
    seconds: float


def fit_hardness(
    curve: Array | str | Path, recipe: library.LawRecipe, bulk_stiffness: float | None = None,
    surfaces: int = 6, seed: int = 0,
) -> HardnessFit:  # fmt: skip
    """Fit the hardness to one cycle of pressing a pad against a plane.

    Args:
        curve: pressures [Pa] and closures [m] in the order of the test, loading and then unloading,
            shape (n, 2); or a CSV file of them in MPa and um under one line of names.
        recipe: surfaces of the pad and their modulus; its hardness is not read.
        bulk_stiffness: pressure over closure of the lining without its surface [Pa/m]; fitted if
            not given.
        surfaces: artificial surfaces that are pressed, two or more.
        seed: of the surfaces.

    Raises:
        SceneError: a curve that is no compressibility curve, or other wrong arguments.

    Example:
        >>> pad = given_statistics(10e-6, 0.0, 3.0)
        >>> settings = LawSettings(2.4e9, boundary="periodic", max_pressure=3e6)
        >>> recipe = LawRecipe(pad.bifractal, pad.hdf, settings, (64, 64))
        >>> hard = replace(recipe, settings=replace(settings, hardness=200e6))
        >>> laws, p = law_library(hard, 2, seed=0), np.geomspace(0.05e6, 2e6, 12)
        >>> d = np.array([laws.at_pressure(x).d.mean() for x in p])
        >>> curve = np.column_stack([p, p / 2e11 + d[0] - d])
        >>> fit = fit_hardness(curve, recipe, bulk_stiffness=2e11, surfaces=2)
        >>> f"{fit.hardness:.0e} Pa"
        '2e+08 Pa'
    """
    began = time.perf_counter()
    if number("surfaces", surfaces) < 2:
        raise SceneError(f"surfaces = {surfaces}; give two or more, their scatter is needed")
    if bulk_stiffness is not None:
        positive(bulk_stiffness=bulk_stiffness)
    p, closure, falling = _checked(curve)
    kept = p >= LOWEST * p.max()
    p, closure, falling = p[kept], closure[kept], falling[kept]
    nodes = np.geomspace(0.999 * p.min(), p.max(), NODES)
    hardnesses = HARDNESSES[1.2 * p.max() < HARDNESSES]
    table = np.array(
        [[_approach(recipe, seed, i, H, nodes) for H in hardnesses] for i in range(int(surfaces))]
    )
    branch = PchipInterpolator(np.log(nodes), table, axis=-1)(np.log(p))
    contact = np.where(falling, branch[:, :, 1], branch[:, :, 0])  # (surfaces, hardnesses, points)
    log_H = np.linspace(np.log(hardnesses[0]), np.log(hardnesses[-1]), 1001)
    every = CubicSpline(np.log(hardnesses), contact, axis=1)(log_H)
    weight, best, compliance, residual = _profile(every.mean(axis=0), p, closure, bulk_stiffness)
    centre = float(weight @ log_H)
    others = [
        log_H[_profile(np.delete(every, i, 0).mean(axis=0), p, closure, bulk_stiffness)[1]]
        for i in range(int(surfaces))
    ]
    scatter = np.sqrt((surfaces - 1.0) * np.var(others))  # of the mean of surfaces, jackknife
    spread = np.sqrt(weight @ (log_H - centre) ** 2)
    half = np.hypot(
        student.ppf(0.95, p.size - 3) * spread, student.ppf(0.95, surfaces - 1) * scatter
    )
    low, high = np.exp(centre - half), np.exp(centre + half)
    doubts = _doubts(p, falling, (low, high), (hardnesses[0], hardnesses[-1]), int((~kept).sum()))
    stiffness = 1.0 / compliance if compliance > 0.0 else np.inf
    seconds = time.perf_counter() - began
    hardness = float(np.exp(log_H[best]))
    return HardnessFit(hardness, float(low), float(high), stiffness, residual, doubts, seconds)


def _checked(curve: Array | str | Path) -> tuple[Array, Array, Mask]:
    """Pressures [Pa], closures [m], and which of them belong to unloading."""
    name = f"{curve}" if isinstance(curve, str | Path) else "curve"
    file = Path(curve) if isinstance(curve, str | Path) else None
    if file is not None:
        table = TextTable.read(file)
        data = np.column_stack([table.numbers(name) for name in table.heading])
        data = data * np.resize((1e6, 1e-6), data.shape[1])
    else:
        remedy = "not a table of pressures and closures; give numbers"
        with reading(None, "as numbers", remedy, at=f"{name}: "):
            data = np.asarray(curve, dtype=float)
    if data.ndim != 2 or data.shape[1] != 2 or not np.isfinite(data).all():
        raise SceneError(f"{name}: give finite pressures and closures, shape (n, 2)")
    p, closure = data.T
    top = int(p.argmax()) if p.size else 0
    if np.count_nonzero(p[: top + 1] >= LOWEST * p[top : top + 1]) < 5:
        raise SceneError(f"{name}: fewer than 5 points of loading; give more")
    largest = ("pressure", p[top], PRESSURES), ("closure", np.ptp(closure), CLOSURES)
    for what, value, (least, most) in largest:
        if not least <= value <= most:
            raise SceneError(f"""{name}: a {what} up to {value:.3g}, where a test has {least:g} to
                {most:g} in Pa and m (files: MPa and um); check the units""")
    loading = slice(0, top + 1)
    if np.corrcoef(p[loading], closure[loading])[0, 1] < 0.7 or p.min() < 0.0:
        raise SceneError(f"{name}: the closure does not rise with the pressure; check the columns")
    return p, closure, np.arange(p.size) > top


def _approach(recipe: library.LawRecipe, seed: int, i: int, hardness: float, nodes: Array) -> Array:
    """Approach of the plane [m] at the pressures while they rise and while they fall, (2, n)."""
    topo, settings = recipe.surface(seed, i), recipe.settings
    size, h = topo.size, topo.heights - topo.heights.mean()
    punch = 0.0
    if settings.boundary == "free":  # the sinking of the whole patch belongs to the bulk
        punch = halfspace.half_space_of(h, size, "free").punch * h.size / settings.E_star
    result = np.empty((2, nodes.size))
    start, base = np.zeros_like(h), h
    for branch, order in ((0, range(nodes.size)), (1, reversed(range(nodes.size)))):
        for j in order:
            found = solve_contact(
                base, size, settings.E_star, load=float(nodes[j] * np.prod(size)), start=start,
                boundary=settings.boundary, tol=settings.tolerance, hardness=hardness,
            )  # fmt: skip
            start = found.pressure
            result[branch, j] = -found.separation - base.mean() - punch * nodes[j]
        if branch == 0:  # the overlap left where it yields is gone from now on
            base = h + np.where(start >= hardness * (1.0 - 1e-12), found.gap, 0.0)
    return result


def _profile(
    contact: Array, p: Array, closure: Array, bulk_stiffness: float | None
) -> tuple[Array, int, float, float]:
    """Weight of every hardness, number of the best, compliance [m/Pa] and residual [m] there."""
    y = closure - contact
    known = 0.0 if bulk_stiffness is None else 1.0 / bulk_stiffness
    y = y - known * p
    y = y - y.mean(axis=1, keepdims=True)
    x = p - p.mean()
    slope = np.zeros(len(y)) if bulk_stiffness else np.maximum(y @ x / (x @ x), 0.0)
    squares = ((y - slope[:, None] * x) ** 2).sum(axis=1)
    best = int(squares.argmin())
    variance = squares[best] / (p.size - 3)
    weight = np.exp(-0.5 * (squares - squares[best]) / variance)
    residual = float(np.sqrt(squares[best] / p.size))
    return weight / weight.sum(), best, float(known + slope[best]), residual


def _doubts(
    p: Array, falling: Mask, interval: tuple[float, float], computed: tuple[float, float], cut: int
) -> tuple[str, ...]:
    """What the curve cannot tell."""
    low, high = interval
    cases = {
        "no unloading: loading alone hardly tells the hardness": falling.sum() < 3,
        "no points below 2 MPa, where the surface gives way": p.min() > 2e6,
        f"the interval is wider than a factor of {WIDE:g}": high > WIDE * low,
        f"the interval leaves the hardnesses computed, {computed[0] / 1e6:.0f} to"
        f" {computed[1] / 1e6:.0f} MPa": low < computed[0] or high > computed[1],
        f"{cut} points below {100 * LOWEST:g} % of the largest pressure were left out": cut > 0,
    }
    return tuple(text for text, holds in cases.items() if holds)
