"""[extensions] of a scene: classes of a user's own in place of its keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import Extensions, own_class
from brake_fenicsx.scene.keys import dotted, read_table, shown
from brake_fenicsx.scene.scalars import check_scalar
from brake_fenicsx.scene.scene import ExtensionsTable, Scene
from brake_fenicsx.scene.stability_section import Damping

# What objects of each kind must do.
METHODS = {
    "contact": ("pressure", "stiffness", "vibration"),
    "friction": ("coefficient",),
    "damping": ("matrix",),
    "random": ("quantile",),
}


@dataclass(frozen=True, slots=True)
class _Alone:
    extensions: ExtensionsTable


def own_objects(table: Mapping[str, Any], folder: Path) -> tuple[Extensions, dict[str, Any]]:
    """Objects of the section [extensions] of a scene as it is written, and classes of builders.

    Raises:
        SceneError: the key, the name, and why it cannot be used.
    """
    if "extensions" not in table:
        return Extensions(), {}
    named = read_table(_Alone, {"extensions": table["extensions"]}).extensions
    made: dict[str, dict[str, Any]] = {}
    marks: dict[str, Any] = {}
    for kind in (*METHODS, "builders", "figures"):
        made[kind] = {}
        for name, written in getattr(named, kind).items():
            given = {"use": written} if isinstance(written, str) else written
            where = f"{dotted('extensions', kind, name)} = {shown(written)}"
            try:
                found, about = own_class(str(given.get("use", "")), folder, named.allow)
                if kind in METHODS:
                    found = found(**{k: v for k, v in given.items() if k != "use"})
                made[kind][name] = found
            except (ValueError, TypeError) as error:
                raise SceneError(f"{where}: {error}") from None
            if kind != "figures":
                marks[f"{kind}.{name}"] = [given, *about]
    builders = made.pop("builders")
    objects: dict[str, Any] = {**made, "damping": [*made["damping"].values()], "marks": marks}
    return Extensions(**objects), builders


def with_objects(scene: Scene, own: Extensions) -> Scene:
    """A scene with some objects.

    Args:
        scene: the scene.
        own: the objects.

    Raises:
        SceneError: there is no such interface or key, or no section for it.
    """
    at = f"{scene.file}: extensions"
    for kind, methods in METHODS.items():
        given = getattr(own, kind)
        for one in given.values() if isinstance(given, Mapping) else given:
            for method in methods:
                if not callable(getattr(one, method, None)):
                    raise SceneError(f"""{at}: an object of the type {type(one).__name__} has no
                        method {method!r}; see brake_fenicsx.extensions""")
    contact = dict(scene.contact)
    for key, laws in (("law", own.contact), ("friction", own.friction)):
        for name, law in laws.items():
            if name not in contact:
                raise SceneError(f"""{at}: there is no interface {name!r}; there are
                    {", ".join(contact)}""")
            table: Any = {key: law}
            contact[name] = replace(contact[name], **table)
    stability = scene.stability
    if own.damping:
        if stability is None:
            raise SceneError(f"{at}: damping needs the section [stability]")
        table = stability.damping or Damping()
        terms = (*table.own, *own.damping)
        stability = replace(stability, damping=replace(table, own=terms))
    random: dict[str, Any] = {**scene.samples.random, **own.random}
    samples = replace(scene.samples, random=random)
    changed = replace(scene, contact=contact, stability=stability, samples=samples)
    for name in own.random:
        check_scalar(changed, f"{at}: {name}", name)
    return changed
