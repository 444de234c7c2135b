"""Ties, contact, supports, loads and springs of a deck of Abaqus or CalculiX; supports of Ansys.

Each reader gives the reason why something of its keyword is not taken over, or None.
"""

from __future__ import annotations

from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.meshing.abaqus import held_along
from brake_fenicsx.macro.meshing.filemesh import DeckKeyword, FileMesh
from brake_fenicsx.macro.meshing.meshfile import SHELL_NODES

from .materials import ABAQUS, ANSYS, NASTRAN, SHELLS, Reader, of_solids, taken
from .statements import Deck, Quantity, numbers

# Keywords that others refer to, also before they stand in the deck.
_FIRST = ("COUPLING", "RIGID BODY", "ELEMENT", *SHELL_NODES)


def read_deck(mesh: FileMesh, suffix: str, solid: bool = False) -> Deck:
    """Read the keywords of a mesh file by its ending.

    Args:
        mesh: the file.
        suffix: its ending.
        solid: sections of shells are taken, and not refused.
    """
    deck = Deck(mesh)
    for name in (*mesh.node_groups, *mesh.facet_groups):
        sign, _, value = name.partition(" ")
        if sign in ("*BOUNDARY", "D"):
            deck.add("supports", name, along=value)
        elif sign == "*DLOAD" and float(value) > 0:
            deck.add("loads", name, pressure=Quantity(float(value), "Pa"))
    readers = _READERS.get(suffix, _READERS[""])
    for block in mesh.blocks:
        if block.keyword in SHELLS and not (solid or of_solids(mesh, block)):
            kinds = ", ".join(f"{len(own)} {kind}" for kind, own in mesh.shells.items())
            raise SceneError(
                f"{block.at}: {block.said}: shells ({kinds or 'none are read'}) are no part of a"
                " scene; add --shells solid, which makes layers of solids of them, or remove this"
                " line if they only mark a face"
            )
    for block in sorted(mesh.blocks, key=lambda block: block.keyword not in _FIRST):
        try:
            said = readers[block.keyword](deck, block) if block.keyword in readers else ""
        except SceneError:
            raise
        except (ValueError, IndexError, KeyError, SyntaxError):
            said = "its lines are not understood"
            if block.keyword in SHELLS:
                raise SceneError(f"{block.at}: {block.said}: {said}") from None
        except ImportError as error:
            said = f"needs {error.name}: pip install {error.name}"
        if said is not None:
            deck.unread.append((block, said))
    return deck


def _begin(deck: Deck, block: DeckKeyword) -> None:
    deck.about = block.options["NAME" if "NAME" in block.options else "INTERACTION"]


def _pair(deck: Deck, block: DeckKeyword) -> str | None:
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


def _law(deck: Deck, block: DeckKeyword) -> str | None:
    """*FRICTION and *SURFACE BEHAVIOR of an interaction; of several frictions the largest."""
    own = deck.laws[deck.about.upper()]
    kind = block.options.get("PRESSURE-OVERCLOSURE", "HARD").upper()
    if block.keyword == "FRICTION":
        own["friction"] = max(
            own.get("friction", Quantity(0.0, "")), Quantity(numbers(block)[0], "")
        )
    elif kind == "LINEAR":
        own["law"] = {"linear": Quantity(numbers(block)[0], "Pa/m")}
    return None if kind in ("LINEAR", "HARD") else "write the law of the contact"


def _coupling(deck: Deck, block: DeckKeyword) -> None:
    options = {name.replace(" ", ""): value for name, value in block.options.items()}
    face = options["SURFACE" if "SURFACE" in options else "NSET"]
    deck.couplings[int(deck.nodes(options["REFNODE"])[0])] = face


def _boundary(deck: Deck, block: DeckKeyword) -> str | None:
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


def _pressure(deck: Deck, block: DeckKeyword) -> str | None:
    """*DSLOAD; those of *DLOAD are groups of the file."""
    said = None
    for face, kind, value, *_ in block.rows:
        if kind.upper()[:1] != "P" or float(value) <= 0:
            said = f"{kind} of {value}: no pressure towards the body"
        elif block.keyword == "DSLOAD":
            deck.add("loads", face, pressure=Quantity(float(value), "Pa"))
    return said


def _force(deck: Deck, block: DeckKeyword) -> str | None:
    """On all nodes of a set, or on the node that a face is coupled to."""
    said = None
    for word, component, value in block.rows:
        face, count, c = deck.coupled(word), deck.nodes(word).size, int(component) - 1
        if face is None and (count == 1 or c > 2):
            said = f"node {word} is not coupled to a face: write a force of [loads]"
            continue
        kind, unit = (("force", "N"), ("moment", "N m"))[c > 2]
        # That of a later step takes the place of an earlier one.
        own = _axes(deck, "loads", face or word, kind, unit)
        own[c % 3] = Quantity(float(value) * count, unit)
    return said


def _axes(deck: Deck, section: str, name: str, key: str, unit: str) -> list[Quantity]:
    """Three components of a key, zero until they are written."""
    zero = [Quantity(0.0, unit)] * 3
    own: list[Quantity] = deck.tables[section].setdefault(name, {}).setdefault(key, zero)
    return own


def _element(deck: Deck, block: DeckKeyword) -> str | None:
    """Springs and masses at reference nodes."""
    if not block.options.get("TYPE", "").upper().startswith(("SPRING", "MASS")):
        return ""
    for row in block.rows:
        faces = [deck.couplings.get(deck.mesh.numbers[int(word)]) for word in row[1:]]
        if None in faces:
            return "its nodes are not coupled to faces: write [springs] or [masses]"
        deck.ends[block.options["ELSET"].upper()].append([str(face) for face in faces])
    return None


def _spring(deck: Deck, block: DeckKeyword) -> str | None:
    (components, (k, *_)), ends = block.rows[:2], deck.ends[block.options["ELSET"].upper()]
    if len({*components} - {""}) != 1 or int(components[0]) > 3 or not ends:
        return "not along an axis between faces that are coupled to its nodes: write [springs]"
    for faces in ends:
        name = "_".join(faces)
        own, c = _axes(deck, "springs", name, "stiffness", "N/m"), int(components[0]) - 1
        own[c] = Quantity(own[c].value + float(k), "N/m")
        if len(faces) > 1:
            deck.add("springs", name, faces=faces)
    return None


def _mass(deck: Deck, block: DeckKeyword) -> str | None:
    ends = deck.ends[block.options["ELSET"].upper()]
    for (face,) in ends:
        deck.add("masses", face, mass=Quantity(numbers(block)[0], "kg"))
    return None if ends else "its node is not coupled to a face: write [masses]"


def _node_held(deck: Deck, block: DeckKeyword) -> str | None:
    _, _, direction, value, *_ = block.rows[0]
    taken = direction in ("UX", "UY", "UZ") and not float(value or 0)
    return None if taken else "not a displacement of zero"


_READERS: dict[str, dict[str, Reader]] = {
    ".inp": {
        "MATERIAL": _begin, "SURFACE INTERACTION": _begin, "CHANGE FRICTION": _begin,
        **ABAQUS,
        "SURFACE BEHAVIOR": _law, "FRICTION": _law, "TIE": _pair,
        "CONTACT PAIR": _pair, "COUPLING": _coupling, "RIGID BODY": _coupling, "KINEMATIC": taken,
        "DISTRIBUTING": taken, "BOUNDARY": _boundary, "DSLOAD": _pressure, "DLOAD": _pressure,
        "CLOAD": _force, "ELEMENT": _element, "SPRING": _spring, "MASS": _mass, "HEADING": taken,
        "STEP": taken, "STATIC": taken, "FREQUENCY": taken, "COMPLEX FREQUENCY": taken,
    },
    ".cdb": {**ANSYS, "MPTEMP": taken, "D": _node_held},
    "": NASTRAN,
}  # fmt: skip
