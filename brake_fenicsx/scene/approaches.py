"""What acts in the samples of each approach: friction, damping, and the method of the modes."""

from collections.abc import Mapping
from typing import Any

from brake_fenicsx.extensions import beside_samples

from .contact_section import Friction
from .scene import Scene
from .stability_section import TERMS

# Approaches of perfect contact.
PERFECT = frozenset({"classical", "parametric"})


def one_friction(scene: Scene, approach: str) -> bool:
    """Whether friction of an approach is samples.classical.friction, whatever the contact says."""
    return approach in PERFECT and scene.samples.classical.friction is not None


def slides(scene: Scene, interface: str) -> bool:
    """Whether the faces of an interface slide along the scene's motion, or else stick."""
    return scene.contact[interface].slip == "motion"


def friction_of(scene: Scene, approach: str, interface: str) -> float | Friction:
    """Friction of an interface in the samples of an approach, where it is not random.

    Faces that stick have none: it is no more than a limit there (``macro.contact_elements``).
    """
    if not slides(scene, interface):
        return 0.0
    classical = scene.samples.classical.friction if approach in PERFECT else None
    return scene.contact[interface].friction if classical is None else classical


def depends_on_speed(friction: Any) -> bool:
    """Whether a coefficient, a table of it or a law of a user's own may change with the speed."""
    if isinstance(friction, float | int):
        return False
    return bool(getattr(friction, "static", 1.0) != getattr(friction, "kinetic", 0.0))


def rubs(scene: Scene, approach: str) -> bool:
    """Whether some element of an approach's samples has friction."""
    other = [*scene.samples.random] if scene.samples.takes_random(approach) else []
    other += [*scene.sweep.parameters] if scene.sweep else []
    other += scene.spanned
    if any(name.endswith(".friction") for name in other):
        return True
    mu = (friction_of(scene, approach, name) for name in scene.contact)
    return any(f if isinstance(f, float | int) else depends_on_speed(f) or f.static for f in mu)


def friction_texts(scene: Scene) -> dict[str, str]:
    """Friction coefficient of each approach as text, by interface where they differ."""
    texts = {}
    for approach in scene.samples.approaches:
        each = {name: _text(scene, approach, name) for name in scene.contact}
        named = [f"{text} ({name})" for name, text in each.items()]
        texts[approach] = ", ".join(named if len({*each.values()}) > 1 else {*each.values()})
    return texts


def listed(scene: Scene) -> str:
    """Friction of each approach in one line."""
    texts = friction_texts(scene)
    return ", ".join(f"{scene.spoken(name)} {text or 'none'}" for name, text in texts.items())


def _text(scene: Scene, approach: str, interface: str) -> str:
    if not slides(scene, interface):
        return "stuck"
    law = scene.samples.random.get(f"contact.{interface}.friction")
    if law is not None and scene.samples.takes_random(approach):
        return "random"
    f = friction_of(scene, approach, interface)
    if isinstance(f, float | int):
        return f"{f:g}"
    return f"{f.static:g} to {f.kinetic:g}" if hasattr(f, "static") else repr(f)


def turning_parts(scene: Scene) -> list[str]:
    """Parts that turn: those named, or those of the second faces of all interfaces."""
    named = scene.damping.gyroscopic if scene.damping else False
    if not isinstance(named, bool):
        return list(named)
    second = (c.faces[1] for name, c in scene.contact.items() if slides(scene, name))
    return sorted({face.partition(".")[0] for face in second}) if named else []


def active_terms(scene: Scene, approach: str) -> tuple[str, ...]:
    """Names of the terms that act in the samples of an approach."""
    table = scene.damping
    if scene.stability is None or "stability" not in scene.stages:
        return ()
    there = {name: table and getattr(table, name) for name in (*TERMS, "own")}
    there |= {"springs": damped_springs(scene), "matrices": damped_bodies(scene)}
    idle = {"slope": one_friction(scene, approach), "sliding": not rubs(scene, approach)}
    return tuple(name for name, acts in there.items() if acts and not idle.get(name))


def damped_springs(scene: Scene) -> dict[str, tuple[float, ...]]:
    """Springs with dashpots, and the damping of these [N s/m]."""
    return {n: s.damping for n, s in scene.springs.items() if s.damping is not None}


def damped_bodies(scene: Scene) -> dict[str, str]:
    """Bodies given by matrices that have a damping, and the file of it."""
    given = {name: part.matrices for name, part in scene.parts.items()}
    return {name: m.damping for name, m in given.items() if m and m.damping is not None}


def reduced_approaches(scene: Scene, counts: Mapping[str, int]) -> set[str]:
    """Approaches whose modes a reduced model gives, if the bodies admit one.

    One serves all approaches whose samples something damps, and one all others. A sample alone
    does not pay for a reduced model, but takes that of other approaches; a sweep, and what only a
    reduced model has (damping ratios, what extras compute beside samples), pay for all.

    Args:
        scene: the scene.
        counts: number of samples of each approach.
    """
    if not _reduced(scene):
        return set()
    damped = {name: bool(active_terms(scene, name)) for name in counts}
    modal = bool(scene.damping and scene.damping.modal)
    asked = bool(scene.sweep or modal or beside_samples(scene))
    paid = {damped[name] for name, count in counts.items() if count > 1 or asked}
    return {name for name in counts if damped[name] in paid}


def lone_samples(scene: Scene, counts: Mapping[str, int]) -> list[str]:
    """Approaches with a single sample that full order takes although the scene says "reduced"."""
    reduced = reduced_approaches(scene, counts)
    return [name for name in counts if _reduced(scene) and name not in reduced]


def _reduced(scene: Scene) -> bool:
    """Whether the scene asks for modes of a reduced model."""
    stability = scene.stability if "stability" in scene.stages else None
    return stability is not None and stability.method == "reduced"


def used_materials(scene: Scene) -> set[str]:
    """Materials of the parts."""
    return {name for part in scene.parts.values() for name in part.materials}
