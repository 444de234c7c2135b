"""[stability.damping]: the damping terms of a scene, each only where it is named.

Their signs and derivations are in ``stability.damping`` and ``stability.gyroscopic``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.friction import depends_on_speed, one_friction, rubs, slides
from brake_fenicsx.scene.tables import dotted, key, shown
from brake_fenicsx.scene.units import to_si

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene

WHERE = "stability.damping"
TERMS = ("rayleigh", "loss", "sliding", "slope", "gyroscopic", "modal")


@dataclass(frozen=True, slots=True)
class ModalDamping:
    """[stability.damping.modal.PART]: damping ratio of the modes of a part.

    Attributes:
        ratio: damping ratio zeta, one number, or one for each frequency.
        frequency: rising frequencies of the ratios; linear between them, constant outside.
    """

    ratio: float | tuple[float, ...] = key(sign="zero", band=(0.0, 0.2))
    frequency: tuple[float, ...] = key("Hz", default=(), sign="zero")


@dataclass(frozen=True, slots=True)
class Damping:
    """[stability.damping]: terms of the damping.

    Attributes:
        rayleigh: alpha [1/s] of the mass and beta [s] of the elastic stiffness.
        loss: whether the loss factors of the materials act, ``materials.NAME.loss``.
        omega_ref: frequency at which the loss factors are exact, "2 kHz" or "12566 rad/s"; needed
            with loss.
        sliding: whether friction rotates with the direction of sliding.
        slope: whether friction changes with the speed of sliding.
        gyroscopic: whether the second bodies of the interfaces rotate; or the names of the rotating
            parts.
        modal: damping ratio of the modes of a part without contact; only for reduced models.
        own: terms of a user's own (``extensions.DampingTerm``).
    """

    rayleigh: tuple[float, ...] | None = key(default=None, units=("1/s", "s"), sign="zero")
    loss: bool = False
    omega_ref: str | None = key(default=None)
    sliding: bool = False
    slope: bool = False
    gyroscopic: bool | tuple[str, ...] = False
    modal: dict[str, ModalDamping] = field(default_factory=dict)
    own: tuple[Any, ...] = key(default=(), internal=True)

    @property
    def reference(self) -> float:
        """omega_ref [rad/s].

        Raises:
            SceneError: it is missing or not a frequency.
        """
        if self.omega_ref is None:
            raise SceneError(f'{WHERE}.loss: needs omega_ref, such as omega_ref = "2 kHz"')
        said = f"{WHERE}.omega_ref = {self.omega_ref!r}"
        try:
            value = to_si(self.omega_ref, "rad/s")
        except ValueError:
            raise SceneError(f'{said}: write a frequency, "2 kHz" or "12566 rad/s"') from None
        if not 0 < value < np.inf:
            raise SceneError(f"{said}: must be positive")
        return value


def turning_parts(scene: Scene) -> list[str]:
    """Parts that turn: those named, or those of the second faces of all interfaces."""
    stability = scene.stability
    named = stability.damping.gyroscopic if stability and stability.damping else False
    if not isinstance(named, bool):
        return list(named)
    second = (c.faces[1] for name, c in scene.contact.items() if slides(scene, name))
    return sorted({face.partition(".")[0] for face in second}) if named else []


def active_terms(scene: Scene, approach: str) -> tuple[str, ...]:
    """Names of the terms that act in the samples of an approach."""
    stability = scene.stability
    if stability is None or "stability" not in scene.stages:
        return ()
    table = stability.damping
    named = [n for n in (*TERMS, "own") if table and getattr(table, n)]
    if damped_springs(scene):
        named.append("springs")
    if damped_bodies(scene):
        named.append("matrices")
    left_out = set()
    if one_friction(scene, approach):
        left_out.add("slope")
    if not rubs(scene, approach):
        left_out.add("sliding")
    return tuple(n for n in named if n not in left_out)


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
    does not pay for a reduced model, but takes that of other approaches; a sweep, and damping
    ratios, which only a reduced model has, pay for all.

    Args:
        scene: the scene.
        counts: number of samples of each approach.
    """
    stability = scene.stability if "stability" in scene.stages else None
    if stability is None or stability.method != "reduced":
        return set()
    damped = {name: bool(active_terms(scene, name)) for name in counts}
    modal = stability.damping is not None and bool(stability.damping.modal)
    paid = {damped[name] for name, count in counts.items() if count > 1 or scene.sweep or modal}
    return {name for name in counts if damped[name] in paid}


def check_modal_names(table: Mapping[str, Any]) -> None:
    """Refuse a ratio that is written without its part.

    Args:
        table: the scene as it is written.

    Raises:
        SceneError: the key, its value, and the parts there are.
    """
    modal: Any = table
    for name in (*WHERE.split("."), "modal"):
        modal = modal.get(name) if isinstance(modal, dict) else None
    for name, value in modal.items() if isinstance(modal, dict) else ():
        if name in ("ratio", "frequency") and not isinstance(value, dict):
            parts = table.get("parts")
            known = ", ".join(parts) if isinstance(parts, dict) else "none"
            raise SceneError(
                f"{WHERE}.modal.{name} = {shown(value)}: {name!r} is no part; write"
                f" {WHERE}.modal.PART = {{ {name} = .. }}, PART one of {known}"
            )


def check_damping(scene: Scene) -> None:
    """Refuse terms that lack what they act on.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    table = scene.stability.damping if scene.stability else None
    if table is None:
        return
    _check_loss(scene, table)
    if not any(getattr(table, name) for name in (*TERMS, "own")):
        raise SceneError(
            f"{WHERE}: no term; name {', '.join(TERMS[:-1])} or {TERMS[-1]}, or leave the section"
            " out"
        )
    if table.rayleigh is not None and not any(table.rayleigh):
        raise SceneError(f"{WHERE}.rayleigh = [0, 0]: no damping; leave it out")
    _check_friction(scene, table)
    if table.gyroscopic:
        _check_turning(scene)
    if table.modal:
        _check_modal(scene, table.modal)


def _check_loss(scene: Scene, table: Damping) -> None:
    """Loss factors and their frequency belong together."""
    if not table.loss:
        if table.omega_ref is not None:
            raise SceneError(
                f"{WHERE}.omega_ref = {table.omega_ref!r}: has no meaning without loss = true"
            )
        return
    _ = table.reference
    if not any(scene.materials[name].loss for name in used_materials(scene)):
        raise SceneError(
            f"{WHERE}.loss: no material of a part has a loss factor; write materials.NAME.loss"
        )


def _check_friction(scene: Scene, table: Damping) -> None:
    """Terms of friction need friction, and its slope one that depends on the speed."""
    approaches = scene.samples.approaches
    if table.sliding and not any(rubs(scene, a) for a in approaches):
        raise SceneError(f"{WHERE}.sliding: there is no friction; write contact.NAME.friction")
    if not table.slope:
        return
    frictions = [c.friction for name, c in scene.contact.items() if slides(scene, name)]
    if not any(depends_on_speed(f) for f in frictions):
        raise SceneError(
            f"{WHERE}.slope: no friction depends on the speed; write"
            " contact.NAME.friction = { static = .., kinetic = .., decay = .. }"
        )
    if all(one_friction(scene, a) for a in approaches):
        raise SceneError(
            f"{WHERE}.slope: samples.classical.friction is one number in the approaches"
            f" {', '.join(approaches)}; leave it out, or name multi-scale or joint"
        )


def _check_turning(scene: Scene) -> None:
    """The gyroscopic term needs a rotation, and parts that turn."""
    motion = scene.motion
    if motion is None or motion.direction is not None:
        raise SceneError(
            f'{WHERE}.gyroscopic: needs a rotation; write motion.axis = "z" and motion.speed'
        )
    if not motion.rate:
        raise SceneError(f"motion.speed = {motion.speed!r}: {WHERE}.gyroscopic needs a rotation")
    for name in turning_parts(scene):
        if name not in scene.parts:
            raise SceneError(
                f"{WHERE}.gyroscopic: there is no part {name!r}; there are {', '.join(scene.parts)}"
            )
    turns = set(turning_parts(scene))
    joints = {f"ties.{name}": tie.faces for name, tie in scene.ties.items()}
    stuck = {f"contact.{n}": c.faces for n, c in scene.contact.items() if not slides(scene, n)}
    for where, faces in (joints | stuck).items():
        parts = {face.partition(".")[0] for face in faces}
        if (rests := parts - turns) and parts & turns:
            raise SceneError(
                f"{where}: {', '.join(rests)} does not turn, and the part that it is joined to"
                f" does; write {WHERE}.gyroscopic = {json.dumps(sorted(turns | parts))}"
            )


def _check_modal(scene: Scene, ratios: Mapping[str, ModalDamping]) -> None:
    """Ratios of parts that are there, in an analysis that has modes of the parts."""
    for name, given in ratios.items():
        where = f"{WHERE}.{dotted('modal', name)}"
        if name not in scene.parts:
            raise SceneError(
                f"{where}: there is no part {name!r}; there are {', '.join(scene.parts)}"
            )
        values = given.ratio if isinstance(given.ratio, tuple) else (given.ratio,)
        if not values or not all(value < 1 for value in values) or not any(values):
            raise SceneError(
                f"{where}.ratio = {given.ratio}: write damping ratios below 1, some above 0"
            )
        if len(given.frequency) != (len(values) if isinstance(given.ratio, tuple) else 0):
            raise SceneError(
                f"{where}: {len(given.frequency)} frequencies for {len(values)} ratios; write one"
                " ratio, or lists of as many of both"
            )
        if any(b <= a for a, b in pairwise(given.frequency)):
            raise SceneError(f"{where}.frequency: the frequencies must rise")
    stability = scene.stability
    if stability is None or "stability" not in scene.stages:
        return
    remedies = {
        'method = "reduced"': stability.method == "reduced",
        "verify = 0": stability.verify == 0,
        'on_tolerance = "warn"': stability.on_tolerance == "warn",
        "drivers = false": not stability.drivers,
    }
    for remedy, held in remedies.items():
        if not held:
            raise SceneError(
                f"{WHERE}.modal: ratios belong to the modes of the parts, which only the reduced"
                f" model has; write stability.{remedy}, or name rayleigh or loss"
            )


def used_materials(scene: Scene) -> set[str]:
    """Materials of the parts."""
    used: set[str] = set()
    for part in scene.parts.values():
        if part.matrices is not None:
            continue
        used |= {part.material} if isinstance(part.material, str) else {*part.material.values()}
    return used
