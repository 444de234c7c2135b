"""Materials of a deck and the sets of cells that have them: Abaqus, Ansys, Nastran.

Each reader gives the reason why something of its keyword is not taken over, or None.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.meshing.abaqus_scope import find
from brake_fenicsx.macro.meshing.filemesh import DeckKeyword, FileMesh
from brake_fenicsx.macro.meshing.meshfile import SHELL_NODES, card_fields

from .shell_surface import ShellSection
from .statements import Deck, Quantity, numbers

Reader = Callable[[Deck, DeckKeyword], str | None]

# Constants of *ELASTIC by the start of its TYPE, in their order; places of the nine of an
# orthotropic material among the 21 of an anisotropic one.
_ELASTIC = {
    "ISO": ("E", "nu"),
    "ENG": ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23"),
    "ORT": ("C11", "C12", "C22", "C13", "C23", "C33", "C66", "C55", "C44"),
}
_ORTHOTROPIC = (0, 1, 2, 3, 4, 5, 9, 14, 20)
_ANSYS = {"EX": "E", "NUXY": "nu", "PRXY": "nu", "DENS": "rho"}


def _elastic(deck: Deck, block: DeckKeyword) -> str | None:
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


def _density(deck: Deck, block: DeckKeyword) -> None:
    deck.add("materials", deck.about, rho=Quantity(numbers(block)[0], "kg/m^3"))


def _damping(deck: Deck, block: DeckKeyword) -> str | None:
    if [*block.options] != ["STRUCTURAL"]:
        return "write stability.damping.rayleigh, of the whole brake"
    deck.add("materials", deck.about, loss=Quantity(float(block.options["STRUCTURAL"]), ""))
    return None


def _section(deck: Deck, block: DeckKeyword) -> str | None:
    """A set of a part is one of each of its instances."""
    for group in deck.mesh.owned(block.options["ELSET"], block.scope):
        found = find(deck.mesh.cell_groups, group)
        if found is None:
            return "no solid is in this set"
        deck.sections[found] = block.options["MATERIAL"]
    turned = "write the axis of the part, along which forces and springs act then"
    return turned if "ORIENTATION" in block.options else None


def of_solids(mesh: FileMesh, block: DeckKeyword) -> bool:
    """Whether a section is of continuum shells, which have the nodes of solids."""
    sets = mesh.owned(block.options.get("ELSET", ""), block.scope)
    return all(find(mesh.cell_groups, n) and not find(mesh.facet_groups, n) for n in sets)


def _shells(deck: Deck, block: DeckKeyword) -> str | None:
    """*SHELL SECTION: thickness, or for each layer thickness, points and material."""
    if of_solids(deck.mesh, block):
        return _section(deck, block)
    options, said = block.options, f"{block.at}: {block.said}"
    rows = [] if "NODAL THICKNESS" in options else block.rows
    if "COMPOSITE" in options:
        layers = [(float(t), material) for t, _, material, *_ in rows]
    else:
        layers = [(float(row[0] or 0), options["MATERIAL"]) for row in rows[:1]]
    words = {"SPOS": 0.5, "SNEG": -0.5}
    share = options.get("OFFSET", "0").upper()
    offset = (words[share] if share in words else float(share)) * sum(t for t, _ in layers)
    for group in deck.mesh.owned(options["ELSET"], block.scope):
        deck.add_shells(ShellSection(group, layers, offset, said))
    turned = "write the axis of the part, along which its material is turned"
    return turned if "ORIENTATION" in options else None


def _constant(deck: Deck, block: DeckKeyword) -> None:
    """MP, label, material, value; MPDATA, format, -, label, material, -, value."""
    words = block.rows[0]
    label, number, value = words[1:4] if block.keyword == "MP" else (*words[3:5], words[6])
    unit = {"E": "Pa", "rho": "kg/m^3"}.get(_ANSYS[label], "")
    keys = {_ANSYS[label]: Quantity(float(value), unit)}
    deck.add("materials", f"MAT{number}", model="isotropic", **keys)
    deck.sections[f"MAT{number}"] = f"MAT{number}"


def _card(deck: Deck, block: DeckKeyword) -> None:
    """MAT1, PSOLID, PSHELL and PCOMP, read by pyNastran."""
    from pyNastran.bdf.bdf import BDF

    model = BDF(debug=None)
    model.add_card_lines([line for (line,) in block.rows], block.keyword)
    for number, own in model.materials.items():
        keys = {"E": Quantity(own.e, "Pa"), "nu": Quantity(own.nu, "")}
        rho = Quantity(own.rho, "kg/m^3")
        deck.add("materials", f"MAT{number}", model="isotropic", rho=rho, **keys)
    for number, own in model.properties.items():
        if block.keyword == "PSOLID":
            deck.sections[str(number)] = f"MAT{own.mid}"
            continue
        plain = block.keyword == "PSHELL"
        # Of a symmetric laminate these are the plies of both halves.
        plies = [] if plain else zip(own.get_thicknesses(), own.get_material_ids(), strict=True)
        pairs = [(own.t, own.mid1)] if plain else plies
        layers = [(float(t or 0), f"MAT{mid}") for t, mid in pairs]
        said, total = f"{block.at}: {block.said}", sum(t for t, _ in layers)
        offset = 0.0 if plain or own.z0 is None else -own.z0 - 0.5 * total
        zoffs = [*deck.zoffs[str(number)], 0.0]
        if len(zoffs) > 2:
            raise SceneError(f"{said}: shells with several ZOFFS; give each a property of its own")
        deck.add_shells(ShellSection(str(number), layers, offset - zoffs[0], said))


def _zoffs(deck: Deck, block: DeckKeyword) -> None:
    """How far the middle of a shell of Nastran is from its grid points."""
    fields = card_fields([line for (line,) in block.rows])
    # Behind the nodes: thicknesses of a CQUAD8, an angle, the offset.
    at = 3 + SHELL_NODES[block.keyword] + 4 * (block.keyword == "CQUAD8")
    word = re.sub(r"(?<=[\d.])(?=[+-])", "e", "".join(fields[at : at + 1])) or "0"
    deck.zoffs[fields[1] or fields[0]].add(float(word))


def taken(deck: Deck, block: DeckKeyword) -> None:
    """Nothing of it is lost."""


ABAQUS: dict[str, Reader] = {
    "ELASTIC": _elastic, "DENSITY": _density, "DAMPING": _damping, "SOLID SECTION": _section,
    "SHELL SECTION": _shells, "SHELL GENERAL SECTION": _shells,
}  # fmt: skip
ANSYS: dict[str, Reader] = {"MP": _constant, "MPDATA": _constant}
NASTRAN: dict[str, Reader] = {
    **dict.fromkeys(SHELL_NODES, _zoffs),
    **dict.fromkeys(("MAT1", "PSOLID", "PSHELL", "PCOMP"), _card),
}
# Keywords that give shells a thickness.
SHELLS = ("SHELL SECTION", "SHELL GENERAL SECTION", "PSHELL", "PCOMP")
