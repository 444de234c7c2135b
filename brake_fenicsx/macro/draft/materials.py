"""Materials, sections and interactions of a deck: Abaqus, CalculiX, Ansys, Nastran."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from brake_fenicsx.macro.meshing.filemesh import Block

from .statements import Deck, numbers

Reader = Callable[[Deck, Block], str | None]

# Constants of *ELASTIC by the start of its TYPE, in their order.
_ELASTIC = {
    "ISO": ("E", "nu"),
    "ENG": ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23"),
    "ORT": ("C11", "C12", "C22", "C13", "C23", "C33", "C66", "C55", "C44"),
}
# Stiffnesses that are equal in an isotropic material.
_EQUAL = (("C11", "C22"), ("C11", "C33"), ("C12", "C13"), ("C12", "C23"), ("C44", "C55"),
          ("C44", "C66"))  # fmt: skip
# Places of these stiffnesses among the 21 of an anisotropic material.
_ORTHOTROPIC = (0, 1, 2, 3, 4, 5, 9, 14, 20)
_LABELS = {
    "EX": "E1", "EY": "E2", "EZ": "E3", "NUXY": "nu12", "PRXY": "nu12", "PRXZ": "nu13",
    "PRYZ": "nu23", "GXY": "G12", "GXZ": "G13", "GYZ": "G23", "DENS": "rho",
}  # fmt: skip


def _begin(deck: Deck, block: Block) -> None:
    """A material, an interaction or a change of one, about which the next keywords are."""
    options = block.options
    deck.about = options["NAME"] if "NAME" in options else options["INTERACTION"]
    if block.keyword == "MATERIAL":
        deck.materials[deck.about] = {}


def _elastic(deck: Deck, block: Block) -> str | None:
    kind, given = block.options.get("TYPE", "ISOTROPIC").upper()[:3], numbers(block)
    if kind == "ANI":
        rest = [v for i, v in enumerate(given[:21]) if i not in _ORTHOTROPIC]
        if max(map(abs, rest)) > 1e-9 * max(map(abs, given[:21])):
            return "anisotropic; no model of a scene has these constants"
        kind, given = "ORT", [given[i] for i in _ORTHOTROPIC]
    c = dict(zip(_ELASTIC[kind], given, strict=False))
    if kind == "ENG":
        c = _axes(c)
    elif kind == "ORT" and np.allclose([c[a] - c[b] for a, b in _EQUAL], 0.0, atol=1e-7 * c["C11"]):
        a, b = c["C11"], c["C12"]
        if abs(a - b - 2 * c["C44"]) < 1e-7 * a:
            c = {"E": (a - b) * (a + 2 * b) / (a + b), "nu": b / (a + b)}
    deck.materials[deck.about] |= c
    more = kind == "ISO" and len(block.rows) > 1
    return "only the constants of the first temperature are taken over" if more else None


def _axes(c: dict[str, float]) -> dict[str, Any]:
    """Constants of a scene from those along and between axes."""
    names = {"E": "E1 E2 E3", "nu": "nu12 nu13 nu23", "G": "G23 G13 G12"}
    return {key: [c[name] for name in every.split()] for key, every in names.items()}


def _density(deck: Deck, block: Block) -> None:
    deck.materials[deck.about]["rho"] = numbers(block)[0]


def _damping(deck: Deck, block: Block) -> str | None:
    if [*block.options] != ["STRUCTURAL"]:
        return "write stability.damping.rayleigh, of the whole brake"
    deck.materials[deck.about]["loss"] = float(block.options["STRUCTURAL"])
    return None


def _section(deck: Deck, block: Block) -> str | None:
    angle, said = 0.0, None
    for group in deck.groups(block.options["ELSET"], block.scope):
        if "ORIENTATION" in block.options:
            angle, said = deck.angle(block.options["ORIENTATION"], group)
        deck.sections[group] = block.options["MATERIAL"], angle
    return said


def _orientation(deck: Deck, block: Block) -> None:
    deck.orientations[block.options["NAME"].upper()] = block


def _behaviour(deck: Deck, block: Block) -> str | None:
    kind = block.options.get("PRESSURE-OVERCLOSURE", "HARD").upper()
    if kind == "LINEAR":
        deck.interactions.setdefault(deck.about, {})["linear"] = numbers(block)[0]
    return None if kind in ("LINEAR", "HARD") else f"{kind.lower()}: write the law of the contact"


def _friction(deck: Deck, block: Block) -> None:
    own = deck.interactions.setdefault(deck.about, {})
    own["friction"] = max(own.get("friction", 0.0), numbers(block)[0])


def _constant(deck: Deck, block: Block) -> None:
    """MP, label, material, value; MPDATA, format, -, label, material, -, value."""
    words = block.rows[0]
    label, number, value = words[1:4] if block.keyword == "MP" else (*words[3:5], words[6])
    deck.materials.setdefault(f"MAT{number}", {})[_LABELS[label]] = float(value)
    deck.sections[f"MAT{number}"] = f"MAT{number}", 0.0


def of_ansys(c: dict[str, Any]) -> dict[str, Any]:
    """Constants of a scene: isotropic with EX alone."""
    own = {"rho": c["rho"]} if "rho" in c else {}
    if {*_ELASTIC["ENG"]} <= {*c}:
        return own | _axes(c)
    alone = not {"E2", "E3"} & {*c}
    return own | {k: c[n] for k, n in (("E", "E1"), ("nu", "nu12")) if alone and n in c}


def _card(deck: Deck, block: Block) -> str | None:
    """MAT1 and PSOLID, read by pyNastran."""
    from pyNastran.bdf.bdf import BDF

    model = BDF(debug=None)
    model.add_card_lines([line for (line,) in block.rows], block.keyword)
    for number, own in model.materials.items():
        deck.materials[f"MAT{number}"] = {"E": own.e, "nu": own.nu, "rho": own.rho}
    for number, own in model.properties.items():
        deck.sections[str(number)] = f"MAT{own.mid}", 0.0
    return None


def taken(deck: Deck, block: Block) -> None:
    """Nothing of it is lost."""


ABAQUS: dict[str, Reader] = {
    "MATERIAL": _begin, "SURFACE INTERACTION": _begin, "CHANGE FRICTION": _begin,
    "ELASTIC": _elastic, "DENSITY": _density, "DAMPING": _damping, "SOLID SECTION": _section,
    "ORIENTATION": _orientation, "SURFACE BEHAVIOR": _behaviour, "FRICTION": _friction,
}  # fmt: skip
ANSYS: dict[str, Reader] = {"MP": _constant, "MPDATA": _constant, "MPTEMP": taken}
NASTRAN: dict[str, Reader] = {"MAT1": _card, "PSOLID": _card}
