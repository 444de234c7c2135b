"""Inputs of one sample: its point of the design, the values there, what they make.

All that differs from the scene in a sample follows from one mapping, dotted key -> SI value.

A draw that makes no brake (a stiffness that is not positive definite, a modulus that gives the laws
no E*, a negative friction or pressure) is rejected. The sample then draws a new point from its own
stream, again and again, so that nothing depends on other samples; only in the rigid designs (FAST,
Saltelli), whose points mean something only all together, it fails with its named error instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.build.distributions import quantile
from brake_fenicsx.build.material_table import by_material, nominal_value
from brake_fenicsx.errors import BrakeError, InaccurateResult, SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.samples_section import is_constant, split_key
from brake_fenicsx.scene.scalars import is_length

from .designs import RIGID, correlated, correlation_root, design_points, design_size

Array = NDArray[np.float64]

# Draws of one sample before its laws are called impossible.
MOST_DRAWS = 1000

# Approaches with a penalty in the place of the scene's laws and gaps.
PERFECT = ("classical", "parametric")

# Children of the scene's seed that seed the designs, far from the samples' own.
DESIGN_SEEDS = {"multi-scale": 2**32 - 1, "parametric": 2**32 - 2, "joint": 2**32 - 3}


@dataclass(frozen=True, slots=True)
class Inputs:
    """Inputs of a sample that differ from the scene.

    Attributes:
        values: value of each input by its key, in SI units.
        materials: stiffness of each changed material in its own axes [Pa], shape (6, 6).
        pressures: pressure of each changed load [Pa], by its face.
        rejected: draws that were rejected before this one.
    """

    values: dict[str, float]
    materials: dict[str, Array]
    pressures: dict[str, float]
    rejected: int = 0


def points_of(scene: Scene, approach: str) -> Array | None:
    """Design of an approach, shape (samples, inputs); None where each sample draws by itself."""
    samples = scene.samples
    if not samples.takes_random(approach):
        return None
    seed = np.random.SeedSequence(samples.seed, spawn_key=(DESIGN_SEEDS[approach],))
    return design_points(samples.plan(approach), len(samples.random), seed)


def size_of(scene: Scene, approach: str) -> int:
    """Samples of an approach that has random inputs or rough contact."""
    plan = scene.samples.plan(approach)
    if not scene.samples.takes_random(approach):
        return plan.n
    correlation_root(scene.samples.random, plan.design)
    return design_size(plan, len(scene.samples.random))


def draw_inputs(
    scene: Scene, approach: str, point: Array | None, rng: np.random.Generator
) -> Inputs:
    """Inputs of a sample.

    Args:
        scene: the scene.
        approach: the sample's approach.
        point: its point of the design; None: the first of the sample's own stream.
        rng: the sample's stream.

    Raises:
        InaccurateResult: the point of a rigid design is rejected, or every draw is.
    """
    random = dict(sorted(scene.samples.random.items()))
    nominal = {name: nominal_value(scene, name) for name in random}
    root = correlation_root(random, scene.samples.plan(approach).design)
    u = rng.random(len(random)) if point is None else point
    for rejected in range(MOST_DRAWS):
        values = {
            name: float(quantile(d, x, nominal[name]))
            for (name, d), x in zip(random.items(), correlated(u, root), strict=True)
        }
        try:
            return inputs_of(scene, approach, values, rejected)
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


def inputs_of(
    scene: Scene, approach: str, values: Mapping[str, float], rejected: int = 0
) -> Inputs:
    """Materials and loads of some values.

    Args:
        scene: the scene.
        approach: of the sample.
        values: by dotted key, SI.
        rejected: draws that were rejected before.

    Raises:
        SceneError: no brake has these values.
    """
    pressures = {}
    for name, value in values.items():
        section, table, last = split_key(name)
        if isinstance(value, str):
            raise SceneError(f"{name} = {value!r}: write a number, in SI units")
        if is_constant(name):
            continue
        if name == "motion.speed" and not value * nominal_value(scene, name) > 0:
            raise SceneError(f"{name} = {value:g}: must not be zero, and have the scene's sign")
        elif (last in ("penalty", "rho") or is_length(name)) and not value > 0:
            raise SceneError(f"{name} = {value:g}: must be positive")
        elif name != "motion.speed" and not value >= 0:
            raise SceneError(f"{name} = {value:g}: must be zero or more")
        if section == "loads":
            pressures[table] = value
    materials = _stiffnesses(scene, by_material(values))
    if materials and approach not in PERFECT:
        for interface in scaled_interfaces(scene):
            law_factor(scene, interface, materials)
    return Inputs(dict(values), materials, pressures, rejected)


def _stiffnesses(scene: Scene, groups: Mapping[str, Mapping[str, float]]) -> dict[str, Array]:
    if not groups:
        return {}
    from brake_fenicsx.build.material_table import varied_stiffness
    from brake_fenicsx.macro.material import Material

    found = {}
    for material, values in groups.items():
        table = scene.materials[material]
        try:
            found[material] = Material(varied_stiffness(table, values), table.rho).C
        except SceneError as error:
            raise SceneError(f"materials.{material}: {error}") from None
    return found


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
    raise SceneError(
        f"parts.{part}.material: which layer's modulus scales the laws of contact.{interface} is"
        " not said; call the layer lining"
    )


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
            logger.info(
                "contact.%s.law: pressures of the library times E*(sample) / E*(scene) of %s",
                name, material,
            )  # fmt: skip


def law_factor(scene: Scene, interface: str, materials: Mapping[str, Array]) -> float:
    """E*(sample) / E*(scene) of the material behind the laws of an interface.

    E* = E_3 / (1 - nu_13^2) as for the laws themselves. A half-space's pressures at given gaps are
    proportional to it, whatever the surface.
    """
    if not materials:
        return 1.0
    name = law_material(scene, interface)
    if name not in materials:
        return 1.0
    from brake_fenicsx.build.material_table import stiffness

    nominal = stiffness(scene.materials[name])
    return _modulus(name, materials[name]) / _modulus(name, nominal)


def _modulus(name: str, C: Array) -> float:
    from brake_fenicsx.macro.material import engineering_constants

    c = engineering_constants(C)
    # Beyond the 0.5 of an isotropic material: nu_13 grows as E_3 falls at fixed nu_31.
    if not abs(c["nu_xz"]) < 1:
        raise SceneError(
            f"materials.{name}: nu_13 = {c['nu_xz']:.4g}: E_3 / (1 - nu_13^2) is no modulus"
        )
    return float(c["E_z"] / (1 - c["nu_xz"] ** 2))
