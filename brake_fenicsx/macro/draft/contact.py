"""Contact and motion of a first scene: which part turns, the order of the faces, the axis."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from brake_fenicsx.scene.units import quantity_text

if TYPE_CHECKING:
    from .text import Draft

# A stiff penalty, friction, and a tangential stiffness of faces that do not slide.
LAW, FRICTION, STUCK = "2e13 Pa/m", 0.4, "1e12 Pa/m"
# Two sides of a round part differ by this at most; components of an axis that are zero.
ROUND, ZERO = 0.02, 1e-3


def contact_lines(draft: Draft) -> list[str]:
    """[contact]: the moving part second; of two that do not move the softer one first."""
    moving, lines = moving_part(draft), []
    names: dict[str, int] = {}
    for first, second, interaction in draft.pairs:
        pair = sorted((first, second), key=lambda face: _rank(draft, face, moving))
        parts = [face.partition(".")[0] for face in pair]
        name = "_".join(parts)
        names[name] = names.get(name, 0) + 1
        law = draft.deck.interactions.get(interaction, {})
        said = "the second face moves" if moving in parts else "the softer part first"
        if not draft.deck.pairs:
            said += "; proposed since the faces touch; glued ones are [ties]"
        mu = law.get("friction", FRICTION)
        k = draft.text(law["linear"], "Pa/m") if "linear" in law else json.dumps(LAW)
        lines += [
            f"[contact.{name}{names[name] if names[name] > 1 else ''}]",
            f"faces = {json.dumps(pair)}   # {said}",
            f"law = {{ linear = {k} }}{'' if 'linear' in law else '   # perfect contact'}",
        ]
        if moving in parts:
            lines.append(f"friction = {mu:g}{'' if 'friction' in law else '   # proposed'}")
        else:
            lines += [
                'slip = "stuck"   # proposed: neither part moves',
                f"tangential_stiffness = {json.dumps(STUCK)}",
            ]
    return lines


def moving_part(draft: Draft) -> str:
    """The part with the largest area in contact, which is the disc."""
    area: dict[str, float] = {}
    for face in {face for *pair, _ in draft.pairs for face in pair}:
        part = face.partition(".")[0]
        area[part] = area.get(part, 0.0) + draft.bodies.faces[face].areas.sum()
    return max(area, key=lambda part: (round(area[part], 9), _stiffness(draft, part)))


def _stiffness(draft: Draft, part: str) -> float:
    """Largest modulus of a part, in the file's unit; 0 if it is unknown."""
    own = (draft.deck.materials.get(name, {}) for name in draft.layers[part].values())
    return max(float(np.max(c.get("E", c.get("C11", 0.0)))) for c in own)


def _rank(draft: Draft, face: str, moving: str) -> Any:
    part = face.partition(".")[0]
    return part == moving, _stiffness(draft, part)


def motion_lines(draft: Draft) -> list[str]:
    """[motion]: the axis of the deck; or that of a round part, or the long side of another one."""
    part, si = moving_part(draft), draft.si
    if draft.deck.axis is not None:
        point, axis, speed = draft.deck.axis
        rate = draft.si(1.0, "rad/s") * speed
        return [
            _axis(np.array(axis)),
            _point([si(x, "m") for x in point]),
            f'speed = "{rate:.6g} rad/s"',
        ]
    touching = {face for *pair, _ in draft.pairs for face in pair}
    own = [draft.bodies.faces[face] for face in touching if face.partition(".")[0] == part]
    vectors = np.concatenate([face.vector for face in own])
    weights = np.linalg.norm(vectors, axis=1)
    _, axes = np.linalg.eigh(vectors.T @ (vectors / weights[:, None]))
    boundary = draft.bodies.boundary[part]
    sides = np.ptp(boundary.centre @ axes, axis=0)
    low, high = sorted(sides[:2])
    if high - low > ROUND * high:
        along = axes[:, int(np.argmax(sides[:2]))]
        return [f"direction = {_vector(along)}   # proposed: the long side of {part}"]
    n, x = axes[:, 2], np.average(boundary.centre, axis=0, weights=boundary.areas)
    aside = np.linalg.norm(x - (x @ n) * n) > ROUND * high
    said = f"proposed: normal to the contact faces of {part}, through its middle"
    return [
        f"{_axis(n)}   # {said}",
        *([_point(x)] if aside else []),
        'speed = "5 rad/s"   # proposed',
    ]


def _vector(x: Any) -> str:
    """A direction with rounded components, the largest one positive."""
    x = np.where(np.abs(x) < ZERO * np.abs(x).max(), 0.0, x)
    x = x / (np.abs(x).max() * np.sign(x[np.argmax(np.abs(x))]))
    return f"[{', '.join(f'{v + 0.0:.6g}' for v in x)}]"


def _axis(x: Any) -> str:
    names = {"[1, 0, 0]": '"x"', "[0, 1, 0]": '"y"', "[0, 0, 1]": '"z"'}
    return f"axis = {names.get(_vector(x), _vector(x))}"


def _point(x: Any) -> str:
    return f"point = [{', '.join(json.dumps(quantity_text(v, 'm')) for v in x)}]"
