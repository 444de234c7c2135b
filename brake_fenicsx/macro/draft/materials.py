"""Materials of a deck and the sets of cells that have them: Abaqus, Ansys, Nastran.

Each reader gives the reason why something of its keyword is not taken over, or None.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from brake_fenicsx.macro.meshing.abaqus_scope import find
from brake_fenicsx.macro.meshing.filemesh import Block

from .statements import Deck, Quantity, numbers

Reader = Callable[[Deck, Block], str | None]

# Constants of *ELASTIC by the start of its TYPE, in their order; places of the nine of an
# orthotropic material among the 21 of an anisotropic one.
_ELASTIC = {
    "ISO": ("E", "nu"),
    "ENG": ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23"),
    "ORT": ("C11", "C12", "C22", "C13", "C23", "C33", "C66", "C55", "C44"),
}
_ORTHOTROPIC = (0, 1, 2, 3, 4, 5, 9, 14, 20)
_ANSYS = {"EX": "E", "NUXY": "nu", "PRXY": "nu", "DENS": "rho"}


def _elastic(deck: Deck, block: Block) -> str | None:
    kind, given = block.options.get("TYPE", "ISOTROPIC").upper()[:3], numbers(block)
    if kind == "ANI":
        rest = [v for i, v in enumerate(given[:21]) if i not in _ORTHOTROPIC]
        if max(map(abs, rest)) > 1e-9 * max(given):
            return "anisotropic; no model of a scene has these constants"
        kind, given = "ORT", [given[i] for i in _ORTHOTROPIC]
    pairs = zip(_ELASTIC[kind], given, strict=False)
    c: dict[str, Any] = {n: Quantity(v, "" if n[0] == "n" else "Pa") for n, v in pairs}
    if kind == "ENG":
        axes = {"E": "E1 E2 E3", "nu": "nu12 nu13 nu23", "G": "G23 G13 G12"}
        c = {key: [c[name] for name in names.split()] for key, names in axes.items()}
    model = "isotropic" if kind == "ISO" else "orthotropic"
    deck.add("materials", deck.about, model=model, **c)
    more = kind == "ISO" and len(block.rows) > 1
    return "only the constants of the first temperature are taken over" if more else None


def _density(deck: Deck, block: Block) -> None:
    deck.add("materials", deck.about, rho=Quantity(numbers(block)[0], "kg/m^3"))


def _damping(deck: Deck, block: Block) -> str | None:
    if [*block.options] != ["STRUCTURAL"]:
        return "write stability.damping.rayleigh, of the whole brake"
    deck.add("materials", deck.about, loss=Quantity(float(block.options["STRUCTURAL"]), ""))
    return None


def _section(deck: Deck, block: Block) -> str | None:
    """A set of a part is one of each of its instances."""
    for group in deck.mesh.owned(block.options["ELSET"], block.scope):
        found = find(deck.mesh.cell_groups, group)
        if found is None:
            return "no solid is in this set"
        deck.sections[found] = block.options["MATERIAL"]
    turned = "write the axis of the part, along which forces and springs act then"
    return turned if "ORIENTATION" in block.options else None


def _constant(deck: Deck, block: Block) -> None:
    """MP, label, material, value; MPDATA, format, -, label, material, -, value."""
    words = block.rows[0]
    label, number, value = words[1:4] if block.keyword == "MP" else (*words[3:5], words[6])
    unit = {"E": "Pa", "rho": "kg/m^3"}.get(_ANSYS[label], "")
    keys = {_ANSYS[label]: Quantity(float(value), unit)}
    deck.add("materials", f"MAT{number}", model="isotropic", **keys)
    deck.sections[f"MAT{number}"] = f"MAT{number}"


def _card(deck: Deck, block: Block) -> None:
    """MAT1 and PSOLID, read by pyNastran."""
    from pyNastran.bdf.bdf import BDF

    model = BDF(debug=None)
    model.add_card_lines([line for (line,) in block.rows], block.keyword)
    for number, own in model.materials.items():
        keys = {"E": Quantity(own.e, "Pa"), "nu": Quantity(own.nu, "")}
        rho = Quantity(own.rho, "kg/m^3")
        deck.add("materials", f"MAT{number}", model="isotropic", rho=rho, **keys)
    deck.sections |= {str(number): f"MAT{own.mid}" for number, own in model.properties.items()}


ABAQUS: dict[str, Reader] = {
    "ELASTIC": _elastic, "DENSITY": _density, "DAMPING": _damping, "SOLID SECTION": _section,
}  # fmt: skip
ANSYS: dict[str, Reader] = {"MP": _constant, "MPDATA": _constant}
NASTRAN: dict[str, Reader] = {"MAT1": _card, "PSOLID": _card}
