"""What a deck says of a brake beside its mesh: tables of a scene on groups of the file.

Keywords of Abaqus and CalculiX; materials of Ansys and Nastran, supports of Ansys. Each reader
gives the reason why something of its keyword is not taken over, or None.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.meshing.abaqus import held_along
from brake_fenicsx.macro.meshing.abaqus_scope import find
from brake_fenicsx.macro.meshing.filemesh import Block, FileMesh

# Constants of *ELASTIC by the start of its TYPE, in their order; places of the nine of an
# orthotropic material among the 21 of an anisotropic one.
_ELASTIC = {
    "ISO": ("E", "nu"),
    "ENG": ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23"),
    "ORT": ("C11", "C12", "C22", "C13", "C23", "C33", "C66", "C55", "C44"),
}
_ORTHOTROPIC = (0, 1, 2, 3, 4, 5, 9, 14, 20)
_ANSYS = {"EX": "E", "NUXY": "nu", "PRXY": "nu", "DENS": "rho"}
# Keywords that others refer to, also before they stand in the deck.
_FIRST = ("COUPLING", "RIGID BODY", "ELEMENT")


class Quantity(NamedTuple):
    """A number in the file's unit, and its SI unit."""

    value: float
    unit: str


@dataclass(slots=True)
class Deck:
    """Statements of a deck.

    Attributes:
        mesh: the file.
        tables: section of a scene -> name, or group of a face -> its keys.
        sections: group of cells -> material.
        laws: name of an interaction -> keys of a contact.
        couplings: place of a reference node -> group of the face.
        ends: set of springs or masses -> faces that the nodes of each are coupled to.
        about: material or interaction that the next keywords are about.
        unread: keyword that is not taken over, and why; "" without a reason.
    """

    mesh: FileMesh
    tables: dict[str, dict[str, Any]] = field(default_factory=lambda: defaultdict(dict))
    sections: dict[str, str] = field(default_factory=dict)
    laws: dict[str, dict[str, Any]] = field(default_factory=lambda: defaultdict(dict))
    couplings: dict[int, str] = field(default_factory=dict)
    ends: dict[str, list[list[str]]] = field(default_factory=lambda: defaultdict(list))
    about: str = ""
    unread: list[tuple[Block, str]] = field(default_factory=list)

    def add(self, section: str, name: str, **keys: Any) -> None:
        """Write keys of a table of a scene."""
        self.tables[section].setdefault(name, {}).update(keys)

    def nodes(self, name: str) -> NDArray[np.int64]:
        """Nodes of a set, or the one of a number."""
        if name.isdigit():
            return np.array([self.mesh.numbers[int(name)]])
        return self.mesh.node_groups[find(self.mesh.node_groups, name) or name]

    def coupled(self, name: str) -> str | None:
        """The face that is coupled to a reference node."""
        nodes = self.nodes(name)
        return self.couplings.get(int(nodes[0])) if nodes.size == 1 else None


def read_deck(mesh: FileMesh, suffix: str) -> Deck:
    """Read the keywords of a mesh file by its ending."""
    deck = Deck(mesh)
    for name in (*mesh.node_groups, *mesh.facet_groups):
        sign, _, value = name.partition(" ")
        if sign in ("*BOUNDARY", "D"):
            deck.add("supports", name, along=value)
        elif sign == "*DLOAD" and float(value) > 0:
            deck.add("loads", name, pressure=Quantity(float(value), "Pa"))
    readers = _READERS.get(suffix, _READERS[""])
    for block in mesh.blocks:
        if block.keyword == "SHELL SECTION":
            raise SceneError(
                f"{block.at}: {block.said}: shells are not read; mesh them as solids, or remove"
                " this line if they only mark a face"
            )
    for block in sorted(mesh.blocks, key=lambda block: block.keyword not in _FIRST):
        try:
            said = readers[block.keyword](deck, block) if block.keyword in readers else ""
        except (ValueError, IndexError, KeyError):
            said = "its lines are not understood"
        except ImportError as error:
            said = f"needs {error.name}: pip install {error.name}"
        if said is not None:
            deck.unread.append((block, said))
    return deck


def _numbers(block: Block) -> list[float]:
    return [float(word) for row in block.rows for word in row if word]


def _begin(deck: Deck, block: Block) -> None:
    deck.about = block.options["NAME" if "NAME" in block.options else "INTERACTION"]


def _elastic(deck: Deck, block: Block) -> str | None:
    kind, given = block.options.get("TYPE", "ISOTROPIC").upper()[:3], _numbers(block)
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
    deck.add("materials", deck.about, rho=Quantity(_numbers(block)[0], "kg/m^3"))


def _damping(deck: Deck, block: Block) -> str | None:
    if [*block.options] != ["STRUCTURAL"]:
        return "write stability.damping.rayleigh, of the whole brake"
    deck.add("materials", deck.about, loss=Quantity(float(block.options["STRUCTURAL"]), ""))
    return None


def _section(deck: Deck, block: Block) -> str | None:
    """A set of a part is one of each of its instances."""
    for group in deck.mesh.owned(block.options["ELSET"], block.scope):
        deck.sections[group] = block.options["MATERIAL"]
    turned = "write the axis of the part, along which forces and springs act then"
    return turned if "ORIENTATION" in block.options else None


def _pair(deck: Deck, block: Block) -> str | None:
    """*TIE and *CONTACT PAIR: two faces in a line."""
    section, keys = "ties", dict[str, Any]()
    if block.keyword == "CONTACT PAIR":
        section, keys["interaction"] = "contact", block.options.get("INTERACTION", "")
    elif given := block.options.get("POSITION TOLERANCE"):
        keys["search"] = Quantity(float(given), "m")
    for faces in (row[:2] for row in block.rows):
        if len({*faces}) < 2:
            return "a face with itself"
        deck.add(section, block.options.get("NAME", "_".join(faces)), faces=faces, **keys)
    return None


def _law(deck: Deck, block: Block) -> str | None:
    """*FRICTION and *SURFACE BEHAVIOR of an interaction; of several frictions the largest."""
    own = deck.laws[deck.about.upper()]
    kind = block.options.get("PRESSURE-OVERCLOSURE", "HARD").upper()
    if block.keyword == "FRICTION":
        own["friction"] = max(
            own.get("friction", Quantity(0.0, "")), Quantity(_numbers(block)[0], "")
        )
    elif kind == "LINEAR":
        own["law"] = {"linear": Quantity(_numbers(block)[0], "Pa/m")}
    return None if kind in ("LINEAR", "HARD") else "write the law of the contact"


def _coupling(deck: Deck, block: Block) -> None:
    face = block.options["SURFACE" if "SURFACE" in block.options else "NSET"]
    deck.couplings[int(deck.nodes(block.options["REF NODE"])[0])] = face


def _boundary(deck: Deck, block: Block) -> str | None:
    said = None
    for word, *row in block.rows:
        along, face = held_along(row), deck.coupled(word)
        group = face or word
        if not along:
            said = "it moves its nodes: write a displacement in [loads], or [motion] of the disc"
        elif face is not None and along != "xyzr":
            said = f"node {word} holds {face} but for some motions: write [supports] or [springs]"
        elif not group.isdigit():
            before = deck.tables["supports"].get(group, {}).get("along", "")
            deck.add("supports", group, along="".join(sorted({*before, *along} - {"r"})))
    return said


def _pressure(deck: Deck, block: Block) -> str | None:
    """*DSLOAD; those of *DLOAD are groups of the file."""
    said = None
    for face, kind, value, *_ in block.rows:
        if kind.upper()[:1] != "P" or float(value) <= 0:
            said = f"{kind} of {value}: no pressure towards the body"
        elif block.keyword == "DSLOAD":
            deck.add("loads", face, pressure=Quantity(float(value), "Pa"))
    return said


def _force(deck: Deck, block: Block) -> str | None:
    """On all nodes of a set, or on the node that a face is coupled to."""
    said = None
    for word, component, value in block.rows:
        face, count, c = deck.coupled(word), deck.nodes(word).size, int(component) - 1
        if face is None and (count == 1 or c > 2):
            said = f"node {word} is not coupled to a face: write a force of [loads]"
            continue
        kind, unit = (("force", "N"), ("moment", "N m"))[c > 2]
        _along_axis(deck, "loads", face or word, kind, c % 3, Quantity(float(value) * count, unit))
    return said


def _along_axis(deck: Deck, section: str, name: str, key: str, c: int, q: Quantity) -> None:
    """Add to one of three components."""
    own = deck.tables[section].setdefault(name, {}).setdefault(key, [Quantity(0.0, q.unit)] * 3)
    deck.tables[section][name][key] = [
        Quantity(v.value + q.value * (i == c), q.unit) for i, v in enumerate(own)
    ]


def _element(deck: Deck, block: Block) -> str | None:
    """Springs and masses at reference nodes."""
    if not block.options.get("TYPE", "").upper().startswith(("SPRING", "MASS")):
        return ""
    for row in block.rows:
        nodes = [deck.mesh.numbers[int(word)] for word in row[1:]]
        deck.ends[block.options["ELSET"].upper()].append([deck.couplings[n] for n in nodes])
    return None


def _spring(deck: Deck, block: Block) -> str | None:
    (components, (k, *_)), ends = block.rows[:2], deck.ends[block.options["ELSET"].upper()]
    if len({*components} - {""}) != 1 or int(components[0]) > 3 or not ends:
        return "not along an axis between faces that are coupled to its nodes: write [springs]"
    for faces in ends:
        name = "_".join(faces)
        _along_axis(
            deck, "springs", name, "stiffness", int(components[0]) - 1, Quantity(float(k), "N/m")
        )
        if len(faces) > 1:
            deck.add("springs", name, faces=faces)
    return None


def _mass(deck: Deck, block: Block) -> str | None:
    ends = deck.ends[block.options["ELSET"].upper()]
    for (face,) in ends:
        deck.add("masses", face, mass=Quantity(_numbers(block)[0], "kg"))
    return None if ends else "its node is not coupled to a face: write [masses]"


def _constant(deck: Deck, block: Block) -> None:
    """MP, label, material, value; MPDATA, format, -, label, material, -, value."""
    words = block.rows[0]
    label, number, value = words[1:4] if block.keyword == "MP" else (*words[3:5], words[6])
    unit = {"E": "Pa", "rho": "kg/m^3"}.get(_ANSYS[label], "")
    keys = {_ANSYS[label]: Quantity(float(value), unit)}
    deck.add("materials", f"MAT{number}", model="isotropic", **keys)
    deck.sections[f"MAT{number}"] = f"MAT{number}"


def _node_held(deck: Deck, block: Block) -> str | None:
    _, _, direction, value, *_ = block.rows[0]
    taken = direction in ("UX", "UY", "UZ") and not float(value or 0)
    return None if taken else "not a displacement of zero"


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


def _taken(deck: Deck, block: Block) -> None:
    """Nothing of it is lost."""


_READERS: dict[str, dict[str, Callable[[Deck, Block], str | None]]] = {
    ".inp": {
        "MATERIAL": _begin, "SURFACE INTERACTION": _begin, "CHANGE FRICTION": _begin,
        "ELASTIC": _elastic, "DENSITY": _density, "DAMPING": _damping, "SOLID SECTION": _section,
        "SURFACE BEHAVIOR": _law, "FRICTION": _law, "TIE": _pair,
        "CONTACT PAIR": _pair, "COUPLING": _coupling, "RIGID BODY": _coupling, "KINEMATIC": _taken,
        "DISTRIBUTING": _taken, "BOUNDARY": _boundary, "DSLOAD": _pressure, "DLOAD": _pressure,
        "CLOAD": _force, "ELEMENT": _element, "SPRING": _spring, "MASS": _mass, "HEADING": _taken,
        "STEP": _taken, "STATIC": _taken, "FREQUENCY": _taken, "COMPLEX FREQUENCY": _taken,
    },
    ".cdb": {"MP": _constant, "MPDATA": _constant, "MPTEMP": _taken, "D": _node_held},
    "": {"MAT1": _card, "PSOLID": _card},
}  # fmt: skip
