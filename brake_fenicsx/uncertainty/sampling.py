"""What makes one sample: its seed, its random inputs, its laws and critical gaps.

Sample k draws from child k of the scene's seed, so that any sample can be run again alone and
nothing depends on the number of processes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.contact import Contact
from brake_fenicsx.macro.friction import velocity_friction
from brake_fenicsx.macro.gap import EnrichedGap, draw_critical_gaps
from brake_fenicsx.micro import OneLaw, exponential_law, linear_law
from brake_fenicsx.micro.joined import join_laws
from brake_fenicsx.micro.law import Laws
from brake_fenicsx.scene import Contact as ContactTable
from brake_fenicsx.scene import Distribution, Friction, Law, Scene
from brake_fenicsx.surface.hdf import HeightDistribution

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SampleInput:
    """Inputs of one sample.

    Attributes:
        seed: seed of its random numbers.
        laws: law and critical gap of each contact element.
        mu: friction coefficient of each contact element, shape (elements,).
        mu_equilibrium: the same in the equilibrium, 0 where the scene leaves friction out there.
        random: random inputs of the scene by name.
    """

    seed: int
    laws: EnrichedGap
    mu: Array
    mu_equilibrium: Array
    random: dict[str, float]


def sample_seed(seed: int, k: int) -> int:
    """Seed of sample ``k``: child k of the scene's seed."""
    child = np.random.SeedSequence(seed, spawn_key=(k,))
    return int(child.generate_state(1, np.uint64)[0])


def draw_sample(
    scene: Scene,
    approach: str,
    k: int,
    contact: Contact,
    library: Laws | None,
    hdf: HeightDistribution | None,
) -> SampleInput:
    """Inputs of sample ``k`` of an approach.

    Args:
        scene: the scene.
        approach: "multi-scale" (the contact as the scene writes it) or "classical" (perfect
            contact: a stiff linear penalty, no critical gap, the classical friction).
        k: number of the sample.
        contact: contact elements; only their interfaces and sliding speeds are used.
        library: the laws, where the scene asks for them.
        hdf: height distribution, where critical gaps are drawn from it.

    Returns:
        The inputs.
    """
    seed = sample_seed(scene.samples.seed, k)
    elements = contact.interface.size
    tables = list(scene.contact.items())
    in_equilibrium = np.array([t.friction_in_equilibrium for _, t in tables])[contact.interface]
    if approach == "classical":
        classical = scene.samples.classical
        index = np.zeros(elements, dtype=np.intp)
        laws = EnrichedGap(OneLaw(linear_law(classical.penalty)), index, np.zeros(elements))
        mu = np.full(elements, classical.friction)
        return SampleInput(seed, laws, mu, mu * in_equilibrium, {})
    # Each kind of draw has its own child, so that naming one does not change the others.
    children = np.random.SeedSequence(seed).spawn(3)
    law_rng, gap_rng, random_rng = (np.random.default_rng(child) for child in children)
    inputs = {name: draw(d, random_rng) for name, d in sorted(scene.samples.random.items())}
    parts: list[Laws] = []
    index, g_cr, mu = np.zeros(elements, np.intp), np.zeros(elements), np.zeros(elements)
    for i, (name, table) in enumerate(tables):
        own = contact.interface == i
        chosen, numbers = _laws(table, library, int(own.sum()), law_rng)
        index[own] = numbers + sum(len(part) for part in parts)
        parts.append(chosen)
        if table.gap == "hdf":
            if hdf is None:
                raise SceneError(
                    f'contact.{name}.gap = "hdf": there are no heights; name the stage surface'
                )
            g_cr[own] = draw_critical_gaps(hdf, int(own.sum()), gap_rng)
        value = inputs.get(f"contact.{name}.friction", table.friction)
        mu[own] = coefficient(value, contact.speed[own])
    laws = EnrichedGap(join_laws(parts), index, g_cr)
    return SampleInput(seed, laws, mu, mu * in_equilibrium, inputs)


def _laws(
    table: ContactTable, library: Laws | None, elements: int, rng: np.random.Generator
) -> tuple[Laws, NDArray[np.intp]]:
    """Laws of one interface, and the number of each element's."""
    if isinstance(table.law, Law):
        return analytic_law(table.law), np.zeros(elements, dtype=np.intp)
    if library is None:
        raise SceneError('contact.law = "library": there is no library; name the stage micro')
    return library, rng.integers(0, len(library), elements).astype(np.intp)


def coefficient(friction: float | Friction, speed: Array) -> Array:
    """Friction coefficient of contact elements that slide at some speeds [m/s]."""
    if isinstance(friction, Friction):
        return velocity_friction(speed, friction.static, friction.kinetic, friction.decay)[0]
    return np.full(speed.shape, float(friction))


def analytic_law(law: Law) -> OneLaw:
    """A scene's linear or exponential law for all elements."""
    if law.linear is not None:
        return OneLaw(linear_law(law.linear))
    if law.p0 is None or law.u0 is None:
        raise SceneError("contact.law: write { linear = .. } or { p0 = .., u0 = .. }")
    return OneLaw(exponential_law(law.p0, law.u0))


def draw(d: Distribution, rng: np.random.Generator) -> float:
    """One value of a distribution, by inversion so that truncation wastes no draw."""
    u = rng.random()
    if d.law == "uniform":
        return float(d.min + u * (d.max - d.min))
    if d.mean is None or d.sd is None:
        raise SceneError("samples.random: a normal law needs mean and sd")
    a, b = (d.min - d.mean) / d.sd, (d.max - d.mean) / d.sd
    return float(stats.truncnorm.ppf(u, a, b, loc=d.mean, scale=d.sd))


def sample_count(scene: Scene) -> int:
    """Samples of the multi-scale approach: many if the scene names uncertainty and has some."""
    tables = scene.contact.values()
    rough = any(c.law == "library" or c.gap == "hdf" for c in tables)
    random = rough or bool(scene.samples.random)
    return scene.samples.n if random and "uncertainty" in scene.stages else 1
