"""Rules that hold between the sections of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

from brake_fenicsx.errors import SceneError
from brake_fenicsx.units import to_si

if TYPE_CHECKING:
    from brake_fenicsx.scene import Contact, Scene


# Stages that build on another one.
PREDECESSORS = (
    ("micro", "surface"),
    ("stability", "equilibrium"),
    ("uncertainty", "equilibrium"),
)


def check_consistent(s: Scene) -> None:
    """Refuse scenes whose sections contradict each other.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    _check_stages(s)
    _check_parts(s)
    for name, contact in s.contact.items():
        _check_contact(s, f"contact.{name}", contact)
    _check_motion(s)
    for name in s.samples.random:
        owner = {f"contact.{c}.friction": table for c, table in s.contact.items()}.get(name)
        if owner is None:
            raise SceneError(
                f'samples.random."{name}": only contact.NAME.friction may be random so far'
            )
        if not isinstance(owner.friction, float | int):
            raise SceneError(f'samples.random."{name}": {name} is a table; write one number there')


def _check_stages(s: Scene) -> None:
    """Every stage has its section and the stages it builds on."""
    sections = {"surface": "surface", "micro": "micro", "equilibrium": "contact"}
    sections["stability"] = "stability"
    for stage, section in sections.items():
        if stage in s.stages and not getattr(s, section):
            raise SceneError(f"stages: {stage!r} needs a section [{section}]")
    for stage, before in PREDECESSORS:
        if stage in s.stages and before not in s.stages:
            raise SceneError(f"stages: {stage!r} needs {before!r}")
    if "surface" in s.stages and s.surface:
        scan = s.surface.scan
        if not scan and not s.surface.statistics:
            raise SceneError("surface: name a scan or statistics")
        if scan and not s.path(scan).is_file():
            raise SceneError(
                f"surface.scan = {scan!r}: no such file; paths start at the scene's folder"
            )
    if s.stability and (len(s.stability.band) != 2 or s.stability.band[0] >= s.stability.band[1]):
        raise SceneError(f"stability.band = {list(s.stability.band)!r} Hz: write [lowest, highest]")


def _check_parts(s: Scene) -> None:
    """Every part's material is there."""
    for name, part in s.parts.items():
        used = [part.material] if isinstance(part.material, str) else part.material.values()
        for material in used:
            if material not in s.materials:
                raise SceneError(
                    f"parts.{name}.material = {material!r}: there is no [materials.{material}]"
                )


def _check_contact(s: Scene, where: str, contact: Contact) -> None:
    """Two faces, and a law and gaps that some stage provides."""
    if len(contact.faces) != 2:
        raise SceneError(
            f"{where}.faces = {list(contact.faces)!r}: write two faces, the pad's first"
        )
    if isinstance(contact.law, str):
        if contact.law != "library":
            raise SceneError(
                f'{where}.law = {contact.law!r}: write "library", {{ linear = "2e13 Pa/m" }}'
                " or { p0 = .., u0 = .. }"
            )
        if "micro" not in s.stages and "multi-scale" in s.samples.approaches:
            raise SceneError(f'{where}.law = "library": needs the stages surface and micro')
    elif contact.law.linear is None and (contact.law.p0 is None or contact.law.u0 is None):
        raise SceneError(f"{where}.law: write {{ linear = .. }} or {{ p0 = .., u0 = .. }}")
    if contact.gap == "hdf" and "surface" not in s.stages:
        raise SceneError(f'{where}.gap = "hdf": needs the stage surface')


def _check_motion(s: Scene) -> None:
    """Friction has a direction, and the speed the right unit."""
    sliding = any(c.friction for c in s.contact.values()) or "classical" in s.samples.approaches
    if "equilibrium" in s.stages and sliding and s.motion is None:
        raise SceneError("motion: friction needs a section [motion]")
    if s.motion:
        try:
            to_si(s.motion.speed, "m/s" if s.motion.direction else "rad/s")
        except ValueError as error:
            raise SceneError(f"motion.speed = {s.motion.speed!r}: {error}") from None
