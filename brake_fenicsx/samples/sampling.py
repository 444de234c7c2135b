"""What makes one sample: its seed, its inputs, its laws and critical gaps.

Sample k draws from child k of the scene's seed, so that any sample can be run again alone and
nothing depends on the number of processes. Rows of Saltelli's design share their roughness
(``designs``): they draw it from the child of one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from brake_fenicsx.build.material_table import nominal_value
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import FrictionLaw
from brake_fenicsx.macro.contact import Contact
from brake_fenicsx.macro.gap import EnrichedGap, draw_critical_gaps, draw_waviness
from brake_fenicsx.micro import (
    LawSteps,
    OneLaw,
    exponential_law,
    join_laws,
    linear_law,
    make_library,
    scaled_laws,
)
from brake_fenicsx.micro.law import Laws
from brake_fenicsx.scene import ContactTable, LawTable, Scene
from brake_fenicsx.scene.approaches import friction_of
from brake_fenicsx.scene.contact_section import LAWS
from brake_fenicsx.scene.scalars import SPEED

from .designs import roughness_of
from .inputs import PERFECT, Inputs, draw_inputs, inputs_of, law_factor, scaled_interfaces, size_of

if TYPE_CHECKING:
    from brake_fenicsx.surface.hdf import HeightDistribution
    from brake_fenicsx.surface.waviness import Waviness

Array = NDArray[np.float64]

# Keys of scalars that belong to no table of several.
PENALTY = "samples.classical.penalty"


@dataclass(frozen=True, slots=True)
class SampleInput:
    """Inputs of one sample.

    Attributes:
        seed: seed of its random numbers.
        laws: law and critical gap of each contact element.
        mu: friction coefficient of each contact element, shape (elements,).
        mu_equilibrium: the same in the equilibrium, 0 where the scene leaves friction out there.
        slope: mu'(V) of each element [s/m], 0 where friction does not depend on the speed.
        speed: sliding speed V of each element [m/s].
        random: scalars that differ from the scene, by dotted key, SI.
        materials: stiffness of each changed material in its own axes [Pa], shape (6, 6).
        pressures: pressure of each changed load [Pa], by its face.
        rejected: draws of the random inputs that were rejected.
    """

    seed: int
    laws: EnrichedGap
    mu: Array
    mu_equilibrium: Array
    slope: Array
    speed: Array
    random: dict[str, float]
    materials: dict[str, Array] = field(default_factory=dict)
    pressures: dict[str, float] = field(default_factory=dict)
    rejected: int = 0


def sample_seed(seed: int, k: int) -> int:
    """Seed of sample ``k``: child k of the scene's seed."""
    child = np.random.SeedSequence(seed, spawn_key=(k,))
    return int(child.generate_state(1, np.uint64)[0])


def _streams(seed: int) -> list[np.random.Generator]:
    """Streams of laws, gaps and random inputs."""
    return [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)]


def draw_sample(
    scene: Scene,
    approach: str,
    k: int,
    contact: Contact,
    library: Laws | None,
    hdf: HeightDistribution | None,
    point: Array | None = None,
    waviness: Waviness | None = None,
    values: Mapping[str, float] | None = None,
    laws: EnrichedGap | None = None,
    moved: Callable[[Mapping[str, float]], Contact] | None = None,
) -> SampleInput:
    """Inputs of sample ``k`` of an approach.

    Args:
        scene: the scene.
        approach: "multi-scale" and "joint" take the contact as the scene writes it; "classical"
            and "parametric" perfect contact: a stiff linear penalty, no critical gap; the scene's
            friction, or the classical one's own, where it is not random.
        k: number of the sample.
        contact: contact elements; their interfaces, sliding speeds, centres and normals are used.
        library: the laws, where the scene asks for them.
        hdf: height distribution, where critical gaps are drawn from it.
        point: the sample's point of a design, shape (inputs,); None: drawn from its own stream.
        waviness: field of the mean heights of patches, where critical gaps are drawn from it.
        values: scalars by dotted key, SI, in place of those that are drawn or the scene's.
        laws: laws and critical gaps of this sample, where they were drawn with the scene's moduli.
        moved: contact elements by the sample's scalars, where lengths move them: their speeds.

    Returns:
        The inputs.

    Raises:
        InaccurateResult: the point cannot be used and may not be replaced.
        SceneError: no brake has the given values.
    """
    seed, shared = sample_seed(scene.samples.seed, k), k
    if scene.samples.takes_random(approach):
        shared = roughness_of(scene.samples.plan(approach), len(scene.samples.random), k)
    # Each kind of draw has its own child, so that naming one does not change the others.
    law_rng, gap_rng, _ = _streams(sample_seed(scene.samples.seed, shared))
    random_rng = _streams(seed)[2]
    inputs = Inputs({}, {}, {})
    if scene.samples.takes_random(approach):
        inputs = draw_inputs(scene, approach, point, random_rng)
    if values:
        inputs = inputs_of(scene, approach, {**inputs.values, **values}, inputs.rejected)
    if approach in PERFECT:
        penalty = inputs.values.get(PENALTY, scene.samples.classical.penalty)
        laws = perfect_contact(penalty, contact.interface.size)
    elif laws is None or inputs.materials:
        laws = _rough(scene, contact, library, (hdf, waviness), inputs, (law_rng, gap_rng))
    speed = (contact if moved is None else moved(inputs.values)).speed
    if SPEED in inputs.values:
        speed = speed * (inputs.values[SPEED] / nominal_value(scene, SPEED))
    mu, slope = friction_coefficients(scene, contact.interface, speed, approach, inputs.values)
    in_equilibrium = np.array([t.friction_in_equilibrium for t in scene.contact.values()])
    return SampleInput(
        seed, laws, mu, mu * in_equilibrium[contact.interface], slope, speed,
        inputs.values, inputs.materials, inputs.pressures, inputs.rejected,
    )  # fmt: skip


def perfect_contact(penalty: float, elements: int) -> EnrichedGap:
    """A penalty [Pa/m] for every element, no critical gap."""
    index = np.zeros(elements, dtype=np.intp)
    return EnrichedGap(OneLaw(linear_law(penalty)), index, np.zeros(elements))


def friction_coefficients(
    scene: Scene,
    interface: NDArray[np.int64],
    speed: Array,
    approach: str,
    values: Mapping[str, float],
) -> tuple[Array, Array]:
    """Friction coefficient of each element and its slope mu'(V), shape (elements,)."""
    mu, slope = np.zeros((2, interface.size))
    for i, name in enumerate(scene.contact):
        own = interface == i
        value = values.get(f"contact.{name}.friction", friction_of(scene, approach, name))
        mu[own], slope[own] = coefficient(value, speed[own])
    return mu, slope


def _rough(
    scene: Scene,
    contact: Contact,
    library: Laws | None,
    heights: tuple[HeightDistribution | None, Waviness | None],
    inputs: Inputs,
    streams: tuple[np.random.Generator, np.random.Generator],
) -> EnrichedGap:
    """Law and critical gap of each element, the laws for the sample's modulus."""
    law_rng, gap_rng = streams
    interface = contact.interface
    parts: list[Laws] = []
    index, g_cr = np.zeros(interface.size, np.intp), np.zeros(interface.size)
    for i, (name, table) in enumerate(scene.contact.items()):
        own = interface == i
        chosen, numbers = _laws(table, library, int(own.sum()), law_rng)
        index[own] = numbers + sum(len(part) for part in parts)
        if inputs.materials and name in scaled_interfaces(scene):
            chosen = scaled_laws(chosen, law_factor(scene, name, inputs.materials))
        parts.append(chosen)
        if table.gap == "none":
            continue
        hdf, waviness = heights
        if table.gap == "hdf" and hdf is not None:
            g_cr[own] = draw_critical_gaps(hdf, int(own.sum()), gap_rng)
        elif table.gap == "waviness" and waviness is not None:
            g_cr[own] = draw_waviness(waviness, contact.points[own], contact.normal[own], gap_rng)
        else:
            raise SceneError(
                f'contact.{name}.gap = "{table.gap}": there are no heights; name the stage surface'
            )
    return EnrichedGap(join_laws(parts), index, g_cr)


def _laws(
    table: ContactTable, library: Laws | None, elements: int, rng: np.random.Generator
) -> tuple[Laws, NDArray[np.intp]]:
    """Laws of one interface, and the number of each element's."""
    if isinstance(table.law, LawTable):
        return one_law(table.law), np.zeros(elements, dtype=np.intp)
    if library is None:
        raise SceneError('contact.law = "library": there is no library; name the stage micro')
    return library, rng.integers(0, len(library), elements).astype(np.intp)


def coefficient(friction: float | FrictionLaw, speed: Array) -> tuple[Array, Array]:
    """Friction coefficient of contact elements at some speeds [m/s], and its slope [s/m]."""
    if isinstance(friction, float | int):
        return np.full(speed.shape, float(friction)), np.zeros(speed.shape)
    given = friction.coefficient(speed)
    two = np.full((2, *speed.shape), np.nan)
    with suppress(TypeError, ValueError):
        two[0], two[1] = given
    if not np.isfinite(two).all():
        raise SceneError(
            f"{type(friction).__name__}.coefficient returns {' '.join(repr(given).split())}; return"
            " mu and its slope [s/m], finite numbers for each speed"
        )
    return two[0], two[1]


def one_law(law: LawTable) -> OneLaw:
    """A scene's linear, exponential or measured law for all elements."""
    if law.steps:
        d, p = np.array(law.steps)
        # Slopes of ln p of the monotone cubic through the rows (Fritsch and Carlson).
        k = -p[::-1] * PchipInterpolator(d[::-1], np.log(p[::-1])).derivative()(d[::-1])
        return OneLaw(make_library([LawSteps(d, p, k[::-1])])[0])
    if law.linear is not None:
        return OneLaw(linear_law(law.linear))
    if law.p0 is None or law.u0 is None:
        raise SceneError(f"contact.law: write {LAWS}")
    return OneLaw(exponential_law(law.p0, law.u0))


def sample_count(scene: Scene, approach: str = "multi-scale") -> int:
    """Samples of an approach: many if the scene names uncertainty and something is random."""
    if approach == "classical" or "uncertainty" not in scene.stages:
        return 1
    drawn = scene.samples.plan(approach).rough or scene.samples.takes_random(approach)
    return size_of(scene, approach) if drawn else 1
