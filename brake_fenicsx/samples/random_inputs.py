"""Inputs of one sample: its point of the design, and the values there.

A draw that makes no brake (a stiffness that is not positive definite, a modulus that gives the laws
no E*, a negative friction or pressure) is rejected. The sample then draws a new point from its own
stream, again and again, so that nothing depends on other samples; only in the rigid designs (FAST,
Saltelli), whose points mean something only all together, it fails with its named error instead.
"""

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.build.material_table import nominal_value, stiffness
from brake_fenicsx.build.values import Values, quantile
from brake_fenicsx.errors import BrakeError, InaccurateResult, SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro.material import engineering_constants
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.samples_section import is_constant, split_key

from .designs import RIGID, correlated, correlation_root, design_points

# Draws of one sample before its laws are called impossible.
MOST_DRAWS = 1000

# Approaches with a penalty in the place of the scene's laws and gaps.
PERFECT = ("classical", "parametric")

# Children of the scene's seed that seed the designs, far from the samples' own.
DESIGN_SEEDS = {"multi-scale": 2**32 - 1, "parametric": 2**32 - 2, "joint": 2**32 - 3}


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
    nominal = {name: nominal_value(scene, name) for name in random}
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
    nominal = stiffness(values.scene.materials[name])
    return _modulus(name, values.stiffness(name)) / _modulus(name, nominal)


def _modulus(name: str, C: Array) -> float:
    c = engineering_constants(C)
    # Beyond the 0.5 of an isotropic material: nu_13 grows as E_3 falls at fixed nu_31.
    if not abs(c["nu_xz"]) < 1:
        raise SceneError(
            f"materials.{name}: nu_13 = {c['nu_xz']:.4g}: E_3 / (1 - nu_13^2) is no modulus"
        )
    return float(c["E_z"] / (1 - c["nu_xz"] ** 2))
