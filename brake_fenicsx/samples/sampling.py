"""What makes one sample: its seed, its inputs, its laws and critical gaps.

Sample k draws from child k of the scene's seed, so that any sample can be run again alone and
nothing depends on the number of processes. Rows of Saltelli's design share their roughness
(``designs``): they draw it from the child of one of them.

A draw that makes no brake (a stiffness that is not positive definite, a modulus that gives the laws
no E*, a negative friction or pressure) is rejected. The sample then draws a new point from its own
stream, again and again, so that nothing depends on other samples; only in the rigid designs (FAST,
Saltelli), whose points mean something only all together, it fails with its named error instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PchipInterpolator

from brake_fenicsx import micro
from brake_fenicsx.arguments import Array, Index
from brake_fenicsx.build import material_table, parametric
from brake_fenicsx.build.values import Values, quantile
from brake_fenicsx.errors import BrakeError, InaccurateResult, SceneError
from brake_fenicsx.extensions import FrictionLaw
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro import contact_forces
from brake_fenicsx.macro.contact_elements import Contact
from brake_fenicsx.macro.material import engineering_constants
from brake_fenicsx.micro.law import Laws
from brake_fenicsx.scene import ContactTable, LawTable, Scene
from brake_fenicsx.scene.contact_section import LAWS
from brake_fenicsx.scene.samples_section import is_constant, split_key
from brake_fenicsx.scene.scalars import SPEED
from brake_fenicsx.scene.scene import friction_of

from .designs import RIGID, correlated, correlation_root, design_points, design_size, roughness_of

if TYPE_CHECKING:
    from brake_fenicsx.surface.hdf import HeightDistribution
    from brake_fenicsx.surface.spectrum import Waviness

PENALTY = "samples.classical.penalty"

# Draws of one sample before its laws are called impossible.
MOST_DRAWS = 1000

# Approaches with a penalty in the place of the scene's laws and gaps.
PERFECT = ("classical", "parametric")

# Children of the scene's seed that seed the designs, far from the samples' own.
DESIGN_SEEDS = {"multi-scale": 2**32 - 1, "parametric": 2**32 - 2, "joint": 2**32 - 3}


@dataclass(frozen=True, slots=True)
class Roughness:
    """What samples draw of a surface; None what the scene does not ask for.

    Attributes:
        library: pressure-gap laws.
        hdf: height distribution, for critical gaps.
        waviness: mean heights of patches, likewise.
    """

    library: Laws | None = None
    hdf: HeightDistribution | None = None
    waviness: Waviness | None = None


SMOOTH = Roughness()


@dataclass(frozen=True, slots=True)
class SampleInput:
    """One sample, before its equilibrium is known.

    Attributes:
        approach: "multi-scale", "classical", "parametric" or "joint".
        seed: seed of its random numbers.
        brake: its brake.
        laws: law and critical gap of each contact element.
        friction: of each contact element.
        rejected: draws of the random inputs that were rejected.
    """

    approach: str
    seed: int
    brake: parametric.BrakeAt
    laws: contact_forces.EnrichedGap
    friction: contact_forces.SlidingFriction
    rejected: int = 0

    @property
    def values(self) -> Values:
        """Scalars that differ from the scene, by dotted key, SI."""
        return self.brake.values


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
    at: Callable[[Values], parametric.BrakeAt],
    rough: Roughness = SMOOTH,
    point: Array | None = None,
    zones: Mapping[str, Roughness] = MappingProxyType({}),
) -> SampleInput:
    """Sample ``k`` of an approach.

    Args:
        scene: the scene.
        approach: "multi-scale" and "joint" take the contact as the scene writes it; "classical"
            and "parametric" perfect contact: a stiff linear penalty, no critical gap; the scene's
            friction, or the classical one's own, where it is not random.
        k: number of the sample.
        at: the brake at some values; interfaces, sliding speeds, centres and normals of its contact
            elements are used.
        rough: what is drawn of the surface, as far as the scene asks for it.
        point: the sample's point of a design, shape (inputs,); None: drawn from its own stream.
        zones: interfaces that have a surface of their own.

    Raises:
        InaccurateResult: the point cannot be used and may not be replaced.
    """
    seed, shared = sample_seed(scene.samples.seed, k), k
    drawn, rejected = Values(scene), 0
    if scene.samples.takes_random(approach):
        shared = roughness_of(scene.samples.plan(approach), len(scene.samples.random), k)
        drawn, rejected = draw_inputs(scene, approach, point, _streams(seed)[2])
    brake = at(drawn)
    if approach in PERFECT:
        none = np.zeros(brake.contact.interface.size)
        laws = contact_forces.EnrichedGap(_penalty(drawn), none.astype(np.intp), none)
    else:
        # Each kind of draw has its own child, so that naming one does not change the others.
        streams = _streams(sample_seed(scene.samples.seed, shared))
        laws = _rough(brake, rough, zones, (streams[0], streams[1]))
    friction = friction_of_contact(brake.contact, approach, drawn)
    return SampleInput(approach, seed, brake, laws, friction, rejected)


def at_values(sample: SampleInput, values: Mapping[str, float]) -> SampleInput:
    """A sample with other values of some scalars, and all else as it was drawn.

    Args:
        sample: the sample.
        values: scalars by dotted key, SI, in place of those that were drawn or the scene's.

    Raises:
        SceneError: no brake has them.
    """
    scene, approach, laws = sample.values.scene, sample.approach, sample.laws
    given = Values(scene, {**sample.values, **values})
    check_values(approach, given)
    brake = sample.brake.reference.at(given)
    if approach in PERFECT:
        laws = replace(laws, laws=_penalty(given))
    else:
        scaled = scaled_interfaces(scene) if given.materials else ()
        factor, factors = law_factor, dict.fromkeys(scene.contact, 1.0)
        factors |= {n: factor(n, given) / factor(n, sample.values) for n in scaled}
        if {*factors.values()} != {1.0}:
            parts = [micro.scaled_laws(laws.laws, x) for x in factors.values()]
            index = laws.index + brake.reference.contact.interface * len(laws.laws)
            laws = replace(laws, laws=micro.join_laws(parts), index=index)
    friction = friction_of_contact(brake.contact, approach, given)
    return replace(sample, brake=brake, laws=laws, friction=friction)


def _penalty(values: Values) -> Laws:
    """Law of perfect contact."""
    usual = values.scene.samples.classical.penalty
    return micro.OneLaw(micro.linear_law(values.get(PENALTY, usual)))


def friction_of_contact(
    contact: Contact, approach: str, values: Values
) -> contact_forces.SlidingFriction:
    """Friction of contact elements at their sliding speeds.

    Args:
        contact: their interfaces, and their sliding speeds at the speed of the scene.
        approach: of the sample.
        values: of its scalars.
    """
    speed = contact.speed * values.ratio(SPEED)
    tables = values.scene.contact.values()
    braking = np.array([t.friction_in_equilibrium for t in tables], dtype=bool)
    given = friction_law(contact, approach, values)(speed)
    return contact_forces.SlidingFriction(*given, speed, braking[contact.interface])


def friction_law(contact: Contact, approach: str, values: Values) -> contact_forces.Coefficient:
    """Friction of contact elements by their slip speeds; arguments as above."""
    scene, interface = values.scene, contact.interface

    def law(speed: Array) -> tuple[Array, Array]:
        mu, slope = np.zeros((2, *speed.shape))
        for i, name in enumerate(scene.contact):
            own = interface == i
            value = values.get(f"contact.{name}.friction", friction_of(scene, approach, name))
            mu[own], slope[own] = coefficient(value, speed[own])
        return mu, slope

    return law


def _rough(
    brake: parametric.BrakeAt,
    whole: Roughness,
    zones: Mapping[str, Roughness],
    streams: tuple[np.random.Generator, np.random.Generator],
) -> contact_forces.EnrichedGap:
    """Law and critical gap of each element, the laws for the sample's modulus."""
    contact, values, scene = brake.reference.contact, brake.values, brake.values.scene
    law_rng, gap_rng = streams
    interface = contact.interface
    parts: list[Laws] = []
    index, g_cr = np.zeros(interface.size, np.intp), np.zeros(interface.size)
    for i, (name, table) in enumerate(scene.contact.items()):
        own, rough = interface == i, zones.get(name, whole)
        chosen, numbers = _laws(table, rough.library, int(own.sum()), law_rng)
        index[own] = numbers + sum(len(part) for part in parts)
        if values.materials and name in scaled_interfaces(scene):
            chosen = micro.scaled_laws(chosen, law_factor(name, values))
        parts.append(chosen)
        if table.gap == "none":
            continue
        if table.gap == "hdf" and rough.hdf is not None:
            g_cr[own] = contact_forces.draw_critical_gaps(rough.hdf, int(own.sum()), gap_rng)
        elif table.gap == "waviness" and rough.waviness is not None:
            places = contact.points[own], contact.normal[own]
            g_cr[own] = contact_forces.draw_waviness(rough.waviness, *places, gap_rng)
        else:
            raise SceneError(f"""contact.{name}.gap = "{table.gap}": there are no heights; name the
                stage surface""")
    return contact_forces.EnrichedGap(micro.join_laws(parts), index, g_cr)


def _laws(
    table: ContactTable, library: Laws | None, elements: int, rng: np.random.Generator
) -> tuple[Laws, Index]:
    """Laws of one interface, and the number of each element's."""
    if isinstance(table.law, LawTable):
        return one_law(table.law), np.zeros(elements, dtype=np.intp)
    if not isinstance(table.law, str):  # of a user's own
        return micro.OneLaw(table.law), np.zeros(elements, dtype=np.intp)
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
        raise SceneError(f"""{type(friction).__name__}.coefficient returns
            {" ".join(repr(given).split())}; return mu and its slope [s/m], finite numbers for each
            speed""")
    return two[0], two[1]


def one_law(law: LawTable) -> micro.OneLaw:
    """A scene's linear, exponential or measured law for all elements."""
    if law.steps:
        d, p = np.array(law.steps)
        # Slopes of ln p of the monotone cubic through the rows (Fritsch and Carlson).
        k = -p[::-1] * PchipInterpolator(d[::-1], np.log(p[::-1])).derivative()(d[::-1])
        return micro.OneLaw(micro.make_library([micro.LawSteps(d, p, k[::-1])])[0])
    if law.linear is not None:
        return micro.OneLaw(micro.linear_law(law.linear))
    if law.p0 is None or law.u0 is None:
        raise SceneError(f"contact.law: write {LAWS}")
    return micro.OneLaw(micro.exponential_law(law.p0, law.u0))


def sample_count(scene: Scene, approach: str = "multi-scale") -> int:
    """Samples of an approach: many if the scene names uncertainty and something is random."""
    samples = scene.samples
    if approach == "classical" or "uncertainty" not in scene.stages:
        return 1
    plan = samples.plan(approach)
    if not samples.takes_random(approach):
        return plan.n if plan.rough else 1
    correlation_root(samples.random, plan.design)
    return design_size(plan, len(samples.random))


def points_of(scene: Scene, approach: str) -> Array | None:
    """Design of an approach, shape (samples, inputs); None where each sample draws by itself."""
    samples = scene.samples
    if not samples.takes_random(approach):
        return None
    seed = np.random.SeedSequence(samples.seed, spawn_key=(DESIGN_SEEDS[approach],))
    return design_points(samples.plan(approach), len(samples.random), seed)


def draw_inputs(
    scene: Scene, approach: str, point: Array | None, rng: np.random.Generator
) -> tuple[Values, int]:
    """Values of a sample, and how many draws were rejected before these.

    Args:
        scene: the scene.
        approach: the sample's approach.
        point: its point of the design; None: the first of the sample's own stream.
        rng: the sample's stream.

    Raises:
        InaccurateResult: the point of a rigid design is rejected, or every draw is.
    """
    random = dict(sorted(scene.samples.random.items()))
    nominal = {name: material_table.nominal_value(scene, name) for name in random}
    root = correlation_root(random, scene.samples.plan(approach).design)
    u = rng.random(len(random)) if point is None else point
    for rejected in range(MOST_DRAWS):
        drawn = zip(random.items(), correlated(u, root), strict=True)
        values = Values(
            scene, {name: float(quantile(d, x, nominal[name])) for (name, d), x in drawn}
        )
        try:
            check_values(approach, values)
            return values, rejected
        except BrakeError as error:
            reason = error
        if scene.samples.plan(approach).design in RIGID:
            refused = InaccurateResult(f"draw rejected: {reason}")
            break
        u = rng.random(len(random))
    else:
        refused = InaccurateResult(f"all of {MOST_DRAWS} draws rejected, the last one: {reason}")
    names, numbers = np.array([*values], dtype=str), np.array([*values.values()])
    refused.known = {"random_names": names, "random": numbers}
    raise refused


def check_values(approach: str, values: Values) -> None:
    """Refuse values that no brake has, or no laws of its contact.

    Args:
        approach: of the sample.
        values: of its scalars.

    Raises:
        SceneError: no brake has these values.
    """
    values.check()
    if values.materials and approach not in PERFECT:
        for interface in scaled_interfaces(values.scene):
            law_factor(interface, values)


def law_material(scene: Scene, interface: str) -> str:
    """Material whose modulus the laws of an interface stand for: the pad's at its contact face.

    Raises:
        SceneError: the pad has layers of several materials, and none is called lining.
    """
    part = scene.contact[interface].faces[0].partition(".")[0]
    material = scene.parts[part].material
    if isinstance(material, str):
        return material
    if "lining" in material:
        return material["lining"]
    if len(set(material.values())) == 1:
        return next(iter(material.values()))
    raise SceneError(f"""parts.{part}.material: which layer's modulus scales the laws of
        contact.{interface} is not said; call the layer lining""")


def scaled_interfaces(scene: Scene) -> list[str]:
    """Interfaces with computed laws; those that a scene writes stay as written in all samples.

    Raises:
        SceneError: which material the laws scale with is not said.
    """
    found = [name for name, table in scene.contact.items() if isinstance(table.law, str)]
    for name in found:
        law_material(scene, name)
    return found


def note_laws(scene: Scene) -> None:
    """Say which laws follow the moduli that are random or swept."""
    changing = {split_key(name)[1] for name in scene.varied if is_constant(name)}
    followed = scaled_interfaces(scene) if changing else []
    for name in scene.contact if changing else ():
        if name not in followed:
            logger.info("contact.%s.law: as written, whatever the moduli of a sample", name)
        elif (material := law_material(scene, name)) in changing:
            said = "contact.%s.law: pressures of the library times E*(sample) / E*(scene) of %s"
            logger.info(said, name, material)


def law_factor(interface: str, values: Values) -> float:
    """E*(sample) / E*(scene) of the material behind the laws of an interface.

    E* = E_3 / (1 - nu_13^2) as for the laws themselves. A half-space's pressures at given gaps are
    proportional to it, whatever the surface.
    """
    name = law_material(values.scene, interface) if values.materials else ""
    if name not in values.materials:
        return 1.0
    nominal = material_table.stiffness(values.scene.materials[name])
    return _modulus(name, values.stiffness(name)) / _modulus(name, nominal)


def _modulus(name: str, C: Array) -> float:
    c = engineering_constants(C)
    # Beyond the 0.5 of an isotropic material: nu_13 grows as E_3 falls at fixed nu_31.
    if not abs(c["nu_xz"]) < 1:
        raise SceneError(f"""materials.{name}: nu_13 = {c["nu_xz"]:.4g}: E_3 / (1 - nu_13^2) is no
            modulus""")
    return float(c["E_z"] / (1 - c["nu_xz"] ** 2))
