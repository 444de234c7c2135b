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
from brake_fenicsx.macro.gap import EnrichedGap, draw_critical_gaps
from brake_fenicsx.micro import OneLaw, exponential_law, linear_law
from brake_fenicsx.micro.law import Laws
from brake_fenicsx.scene import Distribution, Law, Scene
from brake_fenicsx.surface.hdf import HeightDistribution

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SampleInput:
    """Inputs of one sample.

    Attributes:
        seed: seed of its random numbers.
        laws: law and critical gap of each contact element.
        mu: friction coefficient.
        mu_equilibrium: the same in the equilibrium, 0 where the scene leaves friction out there.
        random: random inputs of the scene by name.
    """

    seed: int
    laws: EnrichedGap
    mu: float
    mu_equilibrium: float
    random: dict[str, float]


def sample_seed(seed: int, k: int) -> int:
    """Seed of sample ``k``: child k of the scene's seed."""
    child = np.random.SeedSequence(seed, spawn_key=(k,))
    return int(child.generate_state(1, np.uint64)[0])


def draw_sample(
    scene: Scene,
    approach: str,
    k: int,
    elements: int,
    library: Laws | None,
    hdf: HeightDistribution | None,
) -> SampleInput:
    """Inputs of sample ``k`` of an approach.

    Args:
        scene: the scene.
        approach: "multi-scale" (the contact as the scene writes it) or "classical" (perfect
            contact: a stiff linear penalty, no critical gap, the classical friction).
        k: number of the sample.
        elements: number of contact elements.
        library: the laws, where the scene asks for them.
        hdf: height distribution, where critical gaps are drawn from it.

    Returns:
        The inputs.
    """
    contact = next(iter(scene.contact.values()))
    seed = sample_seed(scene.samples.seed, k)
    zero = np.zeros(elements)
    index = np.zeros(elements, dtype=np.intp)
    if approach == "classical":
        classical = scene.samples.classical
        laws = EnrichedGap(OneLaw(linear_law(classical.penalty)), index, zero)
        mu = classical.friction
        return SampleInput(seed, laws, mu, mu * contact.friction_in_equilibrium, {})
    # Each kind of draw has its own child, so that naming one does not change the others.
    children = np.random.SeedSequence(seed).spawn(3)
    law_rng, gap_rng, random_rng = (np.random.default_rng(child) for child in children)
    chosen = library
    if isinstance(contact.law, Law):
        chosen = analytic_law(contact.law)
    elif library is not None:
        index = law_rng.integers(0, len(library), elements).astype(np.intp)
    if chosen is None:
        raise SceneError('contact.law = "library": there is no library; name the stage micro')
    g_cr = zero
    if contact.gap == "hdf":
        if hdf is None:
            raise SceneError('contact.gap = "hdf": there are no heights; name the stage surface')
        g_cr = draw_critical_gaps(hdf, elements, gap_rng)
    inputs = {name: draw(d, random_rng) for name, d in sorted(scene.samples.random.items())}
    mu = inputs.get(f"contact.{next(iter(scene.contact))}.friction", contact.friction)
    laws = EnrichedGap(chosen, index, g_cr)
    return SampleInput(seed, laws, mu, mu * contact.friction_in_equilibrium, inputs)


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
    contact = next(iter(scene.contact.values()))
    random = contact.law == "library" or contact.gap == "hdf" or bool(scene.samples.random)
    return scene.samples.n if random and "uncertainty" in scene.stages else 1
