"""Own objects in place of keys of a scene: friction laws, damping terms, laws of random inputs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import Extensions
from brake_fenicsx.scene.damping import Damping
from brake_fenicsx.scene.scalars import check_scalar
from brake_fenicsx.scene.sections import Scene


def with_objects(scene: Scene, own: Extensions) -> Scene:
    """A scene with some objects.

    Args:
        scene: the scene.
        own: the objects.

    Raises:
        SceneError: there is no such interface or key, or no section for it.
    """
    given: list[tuple[object, str]] = [(law, "coefficient") for law in own.friction.values()]
    given += [(term, "matrix") for term in own.damping]
    given += [(law, "quantile") for law in own.random.values()]
    for one, method in given:
        if not callable(getattr(one, method, None)):
            raise SceneError(
                f"{scene.file}: extensions: an object of the type {type(one).__name__} has no"
                f" method {method!r}; see brake_fenicsx.extensions"
            )
    contact: dict[str, Any] = dict(scene.contact)
    for name, law in own.friction.items():
        if name not in contact:
            raise SceneError(
                f"{scene.file}: extensions: there is no interface {name!r}; there are"
                f" {', '.join(contact)}"
            )
        contact[name] = replace(contact[name], friction=law)
    stability = scene.stability
    if own.damping:
        if stability is None:
            raise SceneError(f"{scene.file}: extensions: damping needs the section [stability]")
        table = stability.damping or Damping()
        stability = replace(stability, damping=replace(table, own=tuple(own.damping)))
    random: dict[str, Any] = {**scene.samples.random, **own.random}
    samples = replace(scene.samples, random=random)
    changed = replace(scene, contact=contact, stability=stability, samples=samples)
    for name in own.random:
        check_scalar(changed, f"{scene.file}: extensions: {name}", name)
    return changed
