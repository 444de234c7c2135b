"""[stability.damping]: the damping terms of a scene, each only where it is named.

Their signs and derivations are in ``stability.damping_matrices``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import beside_samples
from brake_fenicsx.scene.friction import depends_on_speed, one_friction, rubs, slides
from brake_fenicsx.scene.tables import dotted, key, shown
from brake_fenicsx.scene.units import to_si

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Scene

WHERE = "stability.damping"
TERMS = ("rayleigh", "loss", "sliding", "slope", "gyroscopic", "modal")
TERM_NAMES = f"{', '.join(TERMS[:-1])} or {TERMS[-1]}"


@dataclass(frozen=True, slots=True)
class ModalDamping:
    """[stability.damping.modal.PART]: damping ratio of the modes of a part.

    Attributes:
        ratio: damping ratio zeta, one number, or one for each frequency.
        frequency: rising frequencies of the ratios; linear between them, constant outside.
    """

    ratio: float | tuple[float, ...] = key(sign="zero", band=(0.0, 0.2))
    frequency: tuple[float, ...] = key("Hz", default=(), sign="zero")

    def contradictions(self) -> Iterator[str]:
        """Ratios below 1, and as many rising frequencies where there are several."""
        values = self.ratio if isinstance(self.ratio, tuple) else (self.ratio,)
        if not values or not all(value < 1 for value in values) or not any(values):
            yield f".ratio = {self.ratio}: write damping ratios below 1, some above 0"
        if len(self.frequency) != (len(values) if isinstance(self.ratio, tuple) else 0):
            yield (
                f": {len(self.frequency)} frequencies for {len(values)} ratios; write one ratio,"
                " or lists of as many of both"
            )
        if any(b <= a for a, b in pairwise(self.frequency)):
            yield ".frequency: the frequencies must rise"


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
        """omega_ref [rad/s]."""
        return to_si(self.omega_ref, "rad/s")

    def contradictions(self) -> Iterator[str]:
        """Some term; loss factors and their frequency belong together."""
        written = f".omega_ref = {self.omega_ref!r}"
        if self.omega_ref is not None and not self.loss:
            yield f"{written}: has no meaning without loss = true"
        if self.omega_ref is None and self.loss:
            yield '.loss: needs omega_ref, such as omega_ref = "2 kHz"'
        if self.omega_ref is not None:
            try:
                if not self.reference > 0:
                    yield f"{written}: must be positive"
            except ValueError:
                yield f'{written}: write a frequency, "2 kHz" or "12566 rad/s"'
        if not any(getattr(self, name) for name in TERMS):
            yield f": no term; name {TERM_NAMES}, or leave the section out"
        if self.rayleigh is not None and not any(self.rayleigh):
            yield ".rayleigh = [0, 0]: no damping; leave it out"


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
    named = [n for n in (*TERMS, "own") if table and getattr(table, n)]
    if damped_springs(scene):
        named.append("springs")
    if damped_bodies(scene):
        named.append("matrices")
    idle = {"slope": one_friction(scene, approach), "sliding": not rubs(scene, approach)}
    return tuple(n for n in named if not idle.get(n))


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
    stability = scene.stability if "stability" in scene.stages else None
    if stability is None or stability.method != "reduced":
        return set()
    damped = {name: bool(active_terms(scene, name)) for name in counts}
    modal = bool(scene.damping and scene.damping.modal)
    asked = bool(scene.sweep or modal or beside_samples(scene))
    paid = {damped[name] for name, count in counts.items() if count > 1 or asked}
    return {name for name in counts if damped[name] in paid}


def lone_samples(scene: Scene, counts: Mapping[str, int]) -> list[str]:
    """Approaches with a single sample that full order takes although the scene says "reduced"."""
    stability = scene.stability if "stability" in scene.stages else None
    if stability is None or stability.method != "reduced":
        return []
    return [name for name in counts if name not in reduced_approaches(scene, counts)]


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


def damping_mistakes(scene: Scene) -> Iterator[str]:
    """Terms that lack what they act on."""
    table = scene.damping
    if "stability" in scene.stages and not (table and table.loss):
        for name in sorted(used_materials(scene)):
            if loss := scene.materials[name].loss:
                yield (
                    f"{dotted('materials', name, 'loss')} = {loss:g}: acts only with {WHERE}.loss ="
                    f" true; write it, with {WHERE}.omega_ref, or leave the loss factor out"
                )
    if table is None:
        return
    if table.loss and not any(scene.materials[name].loss for name in used_materials(scene)):
        yield f"{WHERE}.loss: no material of a part has a loss factor; write materials.NAME.loss"
    yield from _friction(scene, table)
    if table.gyroscopic:
        yield from _turning(scene)
    for name in table.modal:
        if name not in scene.parts:
            yield f"{WHERE}.{dotted('modal', name)}: {_no_part(scene, name)}"
    if table.modal and "stability" in scene.stages:
        yield from _modal(scene)


def _no_part(scene: Scene, name: str) -> str:
    return f"there is no part {name!r}; there are {', '.join(scene.parts)}"


def _friction(scene: Scene, table: Damping) -> Iterator[str]:
    """Terms of friction need friction, and its slope one that depends on the speed."""
    approaches = scene.samples.approaches
    if table.sliding and not any(rubs(scene, a) for a in approaches):
        yield f"{WHERE}.sliding: there is no friction; write contact.NAME.friction"
    if not table.slope:
        return
    if not any(depends_on_speed(c.friction) for n, c in scene.contact.items() if slides(scene, n)):
        yield (
            f"{WHERE}.slope: no friction depends on the speed; write"
            " contact.NAME.friction = { static = .., kinetic = .., decay = .. }"
        )
    if all(one_friction(scene, a) for a in approaches):
        yield (
            f"{WHERE}.slope: samples.classical.friction is one number in the approaches"
            f" {', '.join(approaches)}; leave it out, or name multi-scale or joint"
        )


def _turning(scene: Scene) -> Iterator[str]:
    """The gyroscopic term needs a rotation, and parts that turn."""
    motion, turns = scene.motion, {*turning_parts(scene)}
    if motion is None or motion.direction is not None:
        yield f'{WHERE}.gyroscopic: needs a rotation; write motion.axis = "z" and motion.speed'
    elif not motion.rate:
        yield f"motion.speed = {motion.speed!r}: {WHERE}.gyroscopic needs a rotation"
    for name in turning_parts(scene):
        if name not in scene.parts:
            yield f"{WHERE}.gyroscopic: {_no_part(scene, name)}"
    joints = {f"ties.{name}": tie.faces for name, tie in scene.ties.items()}
    stuck = {f"contact.{n}": c.faces for n, c in scene.contact.items() if not slides(scene, n)}
    for where, faces in (joints | stuck).items():
        parts = {face.partition(".")[0] for face in faces}
        if (rests := parts - turns) and parts & turns:
            yield (
                f"{where}: {', '.join(rests)} does not turn, and the part that it is joined to"
                f" does; write {WHERE}.gyroscopic = {json.dumps(sorted(turns | parts))}"
            )


def _modal(scene: Scene) -> Iterator[str]:
    """Ratios of modes of the parts, in an analysis that has such modes."""
    stability = scene.stability
    wanted = {"method": "reduced", "verify": 0, "on_tolerance": "warn", "drivers": False}
    for name, value in wanted.items():
        if getattr(stability, name) != value:
            yield (
                f"{WHERE}.modal: ratios belong to the modes of the parts, which only the reduced"
                f" model has; write stability.{name} = {json.dumps(value)}, or name rayleigh or"
                " loss"
            )


def used_materials(scene: Scene) -> set[str]:
    """Materials of the parts."""
    return {name for part in scene.parts.values() for name in part.materials}
