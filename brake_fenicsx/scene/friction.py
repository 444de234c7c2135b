"""Friction of each approach: that of the scene, or the classical one's own number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from brake_fenicsx.scene.contact import Friction
    from brake_fenicsx.scene.sections import Scene

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

    Faces that stick have none: their coefficient is no more than a limit (``macro.stuck``).
    """
    if not slides(scene, interface):
        return 0.0
    classical = scene.samples.classical.friction
    if approach in PERFECT and classical is not None:
        return classical
    return scene.contact[interface].friction


def depends_on_speed(friction: Any) -> bool:
    """Whether a coefficient, a table of it or a law of a user's own may change with the speed."""
    if isinstance(friction, float | int):
        return False
    return bool(getattr(friction, "static", 1.0) != getattr(friction, "kinetic", 0.0))


def rubs(scene: Scene, approach: str) -> bool:
    """Whether some element of an approach's samples has friction."""
    other = [*scene.samples.random] if scene.samples.takes_random(approach) else []
    other += [*scene.sweep.parameters] if scene.sweep else []
    if any(name.endswith(".friction") for name in other):
        return True
    mu = (friction_of(scene, approach, name) for name in scene.contact)
    return any(f if isinstance(f, float | int) else depends_on_speed(f) or f.static for f in mu)


def friction_texts(scene: Scene) -> dict[str, str]:
    """Friction coefficient of each approach as text, by interface where they differ."""
    texts = {}
    for approach in scene.samples.approaches:
        each = {name: _text(scene, approach, name) for name in scene.contact}
        if len({*each.values()}) != 1:
            each = {name: f"{text} ({name})" for name, text in each.items()}
        texts[approach] = ", ".join(dict.fromkeys(each.values()))
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
