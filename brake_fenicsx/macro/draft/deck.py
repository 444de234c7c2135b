"""Ties, contact, supports and loads of a deck: keywords of Abaqus and CalculiX, supports of Ansys.

Numbers stay in the units of the deck. What is not taken over is listed with a reason.
"""

from __future__ import annotations

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.meshing.abaqus import held_along
from brake_fenicsx.macro.meshing.filemesh import Block, FileMesh

from .materials import ABAQUS, ANSYS, NASTRAN, Reader, of_ansys, taken
from .statements import Deck, numbers

# Keywords that others refer to, also before they stand in the deck.
_FIRST = ("TRANSFORM", "ORIENTATION", "COUPLING", "RIGID BODY", "ELEMENT")


def read_deck(mesh: FileMesh, suffix: str) -> Deck:
    """Read the keywords of a mesh file.

    Args:
        mesh: the file.
        suffix: its ending.
    """
    deck = Deck(mesh)
    for name in (*mesh.node_groups, *mesh.facet_groups):
        sign, _, value = name.partition(" ")
        if sign in ("*BOUNDARY", "D"):
            deck.held[name] = value
        elif sign == "*DLOAD" and float(value) > 0:
            deck.loads[name] = {"pressure": float(value)}
    readers = _READERS.get(suffix, NASTRAN)
    order = {word: i for i, word in enumerate(_FIRST)}
    for block in sorted(mesh.blocks, key=lambda block: order.get(block.keyword, len(order))):
        try:
            said = readers[block.keyword](deck, block) if block.keyword in readers else ""
        except (ValueError, IndexError, KeyError):
            said = "its lines are not understood"
        except ImportError as error:
            said = f"needs {error.name}: pip install {error.name}"
        if said is not None:
            deck.unread.append((block, said))
    if suffix == ".cdb":
        deck.materials = {name: of_ansys(c) for name, c in deck.materials.items()}
    return deck


def _shells(deck: Deck, block: Block) -> None:
    raise SceneError(
        f"{block.at}: {block.said}: shells are not read; mesh them as solids, or remove this line"
        " if they only mark a face"
    )


def _tie(deck: Deck, block: Block) -> None:
    search = block.options.get("POSITION TOLERANCE")
    for first, second in block.rows:
        name = block.options.get("NAME", f"tie_{len(deck.ties) + 1}")
        deck.ties[name] = first, second, float(search) if search else None


def _pair(deck: Deck, block: Block) -> str | None:
    name = block.options.get("INTERACTION", "")
    pairs = [(row[0], row[1], name) for row in block.rows if len(row) > 1 and row[0] != row[1]]
    deck.pairs += pairs
    return None if len(pairs) == len(block.rows) else "contact of a face with itself"


def _coupling(deck: Deck, block: Block) -> None:
    options = block.options
    face = options["SURFACE"] if "SURFACE" in options else options["NSET"]
    deck.couplings[int(deck.nodes(options["REF NODE"])[0])] = face


def _boundary(deck: Deck, block: Block) -> str | None:
    said = None
    for word, *row in block.rows:
        along, face = held_along(row), deck.coupled(word)
        if not along:
            said = "it moves its nodes: write a displacement in [loads], or [motion] of the disc"
        elif face is not None and along == "xyzr":
            deck.held[face] = "xyz"
        elif face is not None:
            said = f"node {word} holds {face} but for some motions: write [supports] or [springs]"
        elif deck.turned and along[:3] != "xyz":
            said = "its axes may be those of a *TRANSFORM"
        elif not word.isdigit():
            deck.held[word] = "".join(sorted({*deck.held.get(word, ""), *along} - {"r"}))
    return said


def _pressure(deck: Deck, block: Block) -> str | None:
    """*DSLOAD; those of *DLOAD are groups of the file."""
    said = None
    for face, kind, value, *_ in block.rows:
        if kind.upper()[:1] != "P" or float(value) <= 0:
            said = f"{kind} of {value}: no pressure towards the body"
        elif block.keyword == "DSLOAD":
            deck.loads[face] = {"pressure": float(value)}
    return said


def _force(deck: Deck, block: Block) -> str | None:
    """On all nodes of a set, or on the node that a face is coupled to."""
    said = None
    for word, component, value in block.rows:
        face, nodes = deck.coupled(word), deck.nodes(word)
        if face is None and (nodes.size == 1 or int(component) > 3):
            said = f"node {word} is not coupled to a face: write a force of [loads]"
            continue
        kind, place = ("force", "moment")[int(component) > 3], (int(component) - 1) % 3
        own = deck.loads.setdefault(face or word, {}).setdefault(kind, [0.0, 0.0, 0.0])
        own[place] += float(value) * nodes.size
    return said


def _element(deck: Deck, block: Block) -> str | None:
    if not block.options.get("TYPE", "").upper().startswith(("SPRING", "MASS")):
        return ""
    ends = [[deck.couplings.get(deck.mesh.numbers[int(n)]) for n in row[1:]] for row in block.rows]
    deck.ends.setdefault(block.options["ELSET"].upper(), []).extend(ends)
    return None


def _spring(deck: Deck, block: Block) -> str | None:
    ends, (components, (k, *_)) = deck.ends[block.options["ELSET"].upper()], block.rows[:2]
    if (
        len({*components} - {""}) != 1
        or int(components[0]) > 3
        or any(None in faces for faces in ends)
    ):
        return "not along an axis between faces that are coupled to its nodes: write [springs]"
    for faces in ends:
        own = deck.springs.setdefault(tuple(map(str, faces)), [0.0, 0.0, 0.0])
        own[int(components[0]) - 1] += float(k)
    return None


def _mass(deck: Deck, block: Block) -> str | None:
    ends = deck.ends[block.options["ELSET"].upper()]
    if any(None in faces for faces in ends):
        return "its node is not coupled to a face: write [masses]"
    for (face,) in ends:
        deck.masses[str(face)] = deck.masses.get(str(face), 0.0) + numbers(block)[0]
    return None


def _motion(deck: Deck, block: Block) -> str | None:
    if "ROTATION" not in block.options:
        return "write [motion] with a direction"
    speed, *x = map(float, block.rows[0][1:8])
    deck.axis = x[:3], [b - a for a, b in zip(x[:3], x[3:], strict=True)], speed
    return None


def _transform(deck: Deck, block: Block) -> str:
    deck.turned = True
    return "supports along some of its axes are left out"


def _node_held(deck: Deck, block: Block) -> str | None:
    taken = block.rows[0][2] in ("UX", "UY", "UZ") and not float(block.rows[0][3] or 0)
    return None if taken else "not a displacement of zero"


_ABAQUS: dict[str, Reader] = {
    **ABAQUS, "SHELL SECTION": _shells, "TIE": _tie, "CONTACT PAIR": _pair, "COUPLING": _coupling,
    "RIGID BODY": _coupling, "KINEMATIC": taken, "DISTRIBUTING": taken, "BOUNDARY": _boundary,
    "DSLOAD": _pressure, "DLOAD": _pressure, "CLOAD": _force, "ELEMENT": _element,
    "SPRING": _spring, "MASS": _mass, "MOTION": _motion, "TRANSFORM": _transform,
    "HEADING": taken, "STEP": taken, "STATIC": taken, "FREQUENCY": taken,
    "COMPLEX FREQUENCY": taken,
}  # fmt: skip
_READERS = {".inp": _ABAQUS, ".cdb": ANSYS | {"D": _node_held}}
