"""Ties, contact, supports, loads and springs of a deck of Abaqus or CalculiX; supports of Ansys.

Each reader gives the reason why something of its keyword is not taken over, or None. What a file
holds beside its mesh is named where it is read as a mesh.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks import keywords, nastran
from brake_fenicsx.extras.decks.abaqus import held_along
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.meshing import filemesh, rawmesh
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh, listed

from .materials import ABAQUS, ANSYS, NASTRAN, SHELLS, Reader, of_solids, taken
from .statements import Deck, Quantity, axis_key, numbers

# Keywords that others refer to, also before they stand in the deck.
_FIRST = ("COUPLING", "KINEMATIC", "RIGID BODY", "ELEMENT", *nastran.SHELL_NODES)
# What an interaction has no more once its keyword is not understood.
_REPLACED = {"FRICTION": ("friction", "slip"), "SURFACE BEHAVIOR": ("law", "tied")}

# Sections of a scene that keywords may say something for.
_SECTIONS = ("ties", "contact", "supports", "loads", "springs", "masses")


def read_deck(mesh: FileMesh, suffix: str, solid: bool = False) -> Deck:
    """Read the keywords of a mesh file by its ending.

    Args:
        mesh: the file.
        suffix: its ending.
        solid: sections of shells are taken, and not refused.
    """
    deck = Deck(mesh, unread=[*mesh.lost], apart=[*mesh.apart])
    for name in (*mesh.node_groups, *mesh.facet_groups):
        sign, _, value = name.partition(" ")
        if sign in ("*BOUNDARY", "D"):
            deck.add("supports", name, along=value)
        elif sign == "*DLOAD" and float(value) > 0:
            deck.add("loads", name, pressure=Quantity(float(value), "Pa"))
    readers = _READERS.get(suffix, NASTRAN)
    harmless = keywords.HARMLESS["abaqus" if suffix == ".inp" else "nastran"]
    for block in sorted(mesh.blocks, key=lambda block: block.keyword not in _FIRST):
        if block.keyword in SHELLS and not (solid or of_solids(mesh, block)):
            kinds = ", ".join(f"{len(own)} {kind}" for kind, own in mesh.shells.items())
            raise SceneError(f"""{block.at}: {block.said}: shells ({kinds or "none are read"}) are
                no part of a scene; add --shells solid, which makes layers of solids of them, or
                remove this line if they only mark a face""")
        if block.keyword in harmless:
            continue
        reader = readers.get(block.keyword)
        said = "" if reader is None else _read(deck, block, reader, suffix == ".inp")
        if said is not None:
            deck.unread.append((block, said))
    _glue(deck)
    _say_rigid(deck)
    return deck


def _read(deck: Deck, block: DeckKeyword, reader: Reader, abaqus: bool) -> str | None:
    """Read a keyword: why it is not taken over, or None."""
    why, aside = keywords.doubts(block) if abaqus else (None, [])
    deck.unread += [(block, text) for text in aside]
    if why is not None:
        deck.forget(*_REPLACED.get(block.keyword, ()))
        return why
    try:
        return reader(deck, block)
    except SceneError:
        raise
    except ImportError as error:
        return f"needs {error.name}: pip install {error.name}"
    except (ValueError, IndexError, KeyError, SyntaxError):
        why = "its lines are not understood"
        if block.keyword in SHELLS:
            raise SceneError(f"{block.at}: {block.said}: {why}") from None
        return why


def _begin(deck: Deck, block: DeckKeyword) -> None:
    """The next keywords are about a material or an interaction; a new friction follows or none."""
    deck.about = block.options["NAME" if "NAME" in block.options else "INTERACTION"]
    if block.keyword == "CHANGE FRICTION":
        deck.forget(*_REPLACED["FRICTION"])
        if "AMPLITUDE" in block.options:
            deck.about = ""


def _pair(deck: Deck, block: DeckKeyword) -> str | None:
    """*TIE, *CONTACT PAIR and *CONTACT INCLUSIONS: two faces in a line."""
    apart = [{*map(str.upper, pair)} for pair in deck.apart]
    deck.general |= "ALLEXTERIOR" in block.options
    for faces in (row[:2] for row in block.rows):
        if len({*faces} - {""}) < 2:
            return "a face with itself, or with all others"
        if {*map(str.upper, faces)} in apart:
            continue
        keys: dict[str, Any] = {"faces": faces}
        section = "ties" if block.keyword == "TIE" or "TIED" in block.options else "contact"
        if section == "contact":
            keys["interaction"] = block.options.get("INTERACTION", "")
        elif given := block.options.get("POSITIONTOLERANCE"):
            keys["search"] = Quantity(float(given), "m")
        deck.add(section, block.options.get("NAME", "_".join(faces)), **keys)
    return None


def _exclusions(deck: Deck, block: DeckKeyword) -> str | None:
    deck.apart += [row for row in block.rows if all(row)]
    return None if all(map(all, block.rows)) else "write the [contact] of the surface with others"


def _assignment(deck: Deck, block: DeckKeyword) -> str | None:
    """Interaction of two surfaces of general contact, or of all; the last one counts."""
    for first, second, interaction in block.rows:
        if first and second:
            keys = {"faces": [first, second], "interaction": interaction}
            deck.add("contact", f"{first}_{second}", **keys)
        elif first or second:
            return f"{', '.join((first, second, interaction))}: write its [contact]"
        else:
            deck.interaction = interaction
    return None


def _glue(deck: Deck) -> None:
    """Pairs whose interaction is tied are ties."""
    for name, keys in [*deck.tables["contact"].items()]:
        if deck.laws.get(keys["interaction"].upper(), {}).get("tied"):
            del deck.tables["contact"][name]
            deck.add("ties", name, faces=keys["faces"])


def _behavior(deck: Deck, block: DeckKeyword) -> str | None:
    """*SURFACE BEHAVIOR of an interaction."""
    own, given = deck.forget("law", "tied"), numbers(block)
    kind = block.options.get("PRESSURE-OVERCLOSURE", "HARD").upper()
    own["tied"] = kind == "TIED"
    if kind == "LINEAR":
        own["law"] = {"linear": Quantity(given[0], "Pa/m")}
    if kind == "TIED" and given:
        return "write the stiffness of the tie"
    # CalculiX: the tension of faces apart, and how far apart they are still in contact.
    return "its first number is taken alone" if given[1:] else None


def _friction(deck: Deck, block: DeckKeyword) -> str | None:
    """*FRICTION of an interaction: a number, a falling one, or faces that stick."""
    own, given = deck.forget(*_REPLACED["FRICTION"]), numbers(block)
    if "ROUGH" in block.options:
        own["slip"] = "stuck"
    elif "EXPONENTIALDECAY" in block.options:
        # Abaqus: mu = mu_k + (mu_s - mu_k) exp(-d_c V); a scene has 1 / d_c.
        static, kinetic, rate = given
        if not rate > 0:
            return f"a decay constant of {rate:g}"
        decay = Quantity(1.0 / rate, "m/s")
        own["friction"] = {"static": static, "kinetic": kinetic, "decay": decay}
    else:
        # What else stands in the only line of a table is where it holds.
        own["friction"] = Quantity(given[0], "")
    return None


def _coupling(deck: Deck, block: DeckKeyword) -> None:
    face = block.options["SURFACE" if "SURFACE" in block.options else "NSET"]
    deck.about = deck.couplings[int(deck.nodes(block.options["REFNODE"])[0])] = face
    if block.keyword == "RIGID BODY":
        deck.rigid[face] = block


def _coupled_motion(deck: Deck, block: DeckKeyword) -> str | None:
    """Components of the last coupling: all displacements, or it is left out."""
    ends = [(int(row[0]), int(row[-1])) for row in block.rows]
    if ends and not {1, 2, 3} <= {c for first, last in ends for c in range(first, last + 1)}:
        deck.couplings = {n: face for n, face in deck.couplings.items() if face != deck.about}
        return "it couples some components alone: write [supports] or [springs]"
    if block.keyword == "KINEMATIC":
        deck.rigid[deck.about] = block
    return None


def _say_rigid(deck: Deck) -> None:
    """Faces that are rigid in the deck, which stiffens them unless they are clamped."""
    for face, block in deck.rigid.items():
        if deck.tables["supports"].get(face, {}).get("along") != "xyz":
            deck.unread.append((block, f"{face} is not rigid: give it a layer of stiff material"))


def _boundary(deck: Deck, block: DeckKeyword) -> str | None:
    """Supports, a row for each component."""
    said, held = None, dict[str, set[str]]()
    for word, component, _, value in block.rows:
        held.setdefault(word, set()).add(component)
        if float(value):
            said = "it moves its nodes, which the scene holds: write a displacement in [loads], or"
            said += " [motion] of the disc"
    for word, components in held.items():
        instance, _, number = word.rpartition(".")
        face = None if instance and number.isdigit() else deck.coupled(word)
        if face is not None and (len(components) < 6 or face not in deck.rigid):
            said = f"node {word} does not hold all points of {face}: write [supports] or [springs]"
        elif not (group := face or word).rpartition(".")[2].isdigit():
            along = {held_along([c]) for c in components} - {"r"}
            along |= {*deck.tables["supports"].get(group, {}).get("along", "")}
            deck.add("supports", group, along="".join(sorted(along)))
    if deck.shells and {*_hinged(held, deck)} & _of_shells_alone(deck.mesh):
        why = "shells that are held here may turn; their layers, held through the thickness, do not"
        deck.unread.append((block, why))
    return said


def _hinged(held: dict[str, set[str]], deck: Deck) -> Iterator[int]:
    """Nodes that are held along an axis, but may turn about one of the two others."""
    for word, components in held.items():
        turns = {str(3 + k) for c in {*"123"} & components for k in (1, 2, 3) if k != int(c)}
        numbered = word.rpartition(".")[2].isdigit() and not word.isdigit()
        if not (turns <= components or numbered):
            yield from map(int, deck.nodes(word))


def _of_shells_alone(mesh: FileMesh) -> set[int]:
    shells = {n for own in mesh.shells.values() for n in own.ravel().tolist()}
    return shells - {*mesh.cells.ravel().tolist()}


def _pressure(deck: Deck, block: DeckKeyword) -> str | None:
    """*DSLOAD; those of *DLOAD are groups of the file."""
    said = None
    for face, kind, value in block.rows:
        if float(value) < 0:
            said = f"{kind} of {value}: no pressure towards the body"
        elif block.keyword == "DSLOAD" and float(value):
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
        own = _axes(deck, "loads", face or word, kind, unit)
        own[c % 3] = Quantity(own[c % 3].value + float(value) * count, unit)
        if face is not None and c < 3:
            deck.levers[face].append((int(deck.nodes(word)[0]), np.eye(3)[c] * float(value)))
    return said


def _axes(deck: Deck, section: str, name: str, key: str, unit: str) -> list[Quantity]:
    """Three components of a key, zero until they are written."""
    zero = [Quantity(0.0, unit)] * 3
    own: list[Quantity] = deck.tables[section].setdefault(name, {}).setdefault(key, zero)
    return own


def _motion(deck: Deck, block: DeckKeyword) -> str | None:
    """*MOTION: a velocity, or an angular one about the axis from a point to another one."""
    ((name, speed, *rest),) = block.rows
    turns = "ROTATION" in block.options
    x = np.array([float(word or 0) for word in rest]).reshape(1 + turns, 3)
    along = x[-1] - x[0] * turns
    if not any(along) or not float(speed):
        return "it has no speed, no direction, or an axis with two equal points"
    keys: dict[str, Any] = {"axis": axis_key(along)} if turns else {"direction": listed(along)}
    if turns and any(x[0]):
        keys["point"] = [Quantity(v, "m") for v in listed(x[0])]
    deck.motion = name, keys | {"speed": Quantity(float(speed), "rad/s" if turns else "m/s")}
    return None


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
    (components, k), ends = block.rows, deck.ends[block.options["ELSET"].upper()]
    if len({*components} - {""}) != 1 or int(components[0]) > 3 or len(k) > 1 or not ends:
        return "not along an axis between faces that are coupled to its nodes: write [springs]"
    for faces in ends:
        name = "_".join(faces)
        own, c = _axes(deck, "springs", name, "stiffness", "N/m"), int(components[0]) - 1
        own[c] = Quantity(own[c].value + float(k[0]), "N/m")
        if len(faces) > 1:
            deck.add("springs", name, faces=faces)
    return None


def _mass(deck: Deck, block: DeckKeyword) -> str | None:
    ends = deck.ends[block.options["ELSET"].upper()]
    for (face,) in ends:
        deck.add("masses", face, mass=Quantity(numbers(block)[0], "kg"))
    return None if ends else "its node is not coupled to a face: write [masses]"


_READERS: dict[str, dict[str, Reader]] = {
    ".inp": {
        "MATERIAL": _begin, "SURFACE INTERACTION": _begin, "CHANGE FRICTION": _begin,
        **ABAQUS,
        "SURFACE BEHAVIOR": _behavior, "FRICTION": _friction, "TIE": _pair,
        "CONTACT PAIR": _pair, "CONTACT": taken, "CONTACT INCLUSIONS": _pair,
        "CONTACT EXCLUSIONS": _exclusions, "CONTACT PROPERTY ASSIGNMENT": _assignment,
        "COUPLING": _coupling, "RIGID BODY": _coupling, "KINEMATIC": _coupled_motion,
        "DISTRIBUTING": _coupled_motion, "BOUNDARY": _boundary, "DSLOAD": _pressure,
        "DLOAD": _pressure, "CLOAD": _force, "MOTION": _motion, "ELEMENT": _element,
        "SPRING": _spring, "MASS": _mass,
    },
    ".cdb": ANSYS,
}  # fmt: skip


def beside(
    file: Path, found: filemesh.FileMesh, faces: Mapping[str, Ints], used: Iterable[tuple[str, str]]
) -> rawmesh.Unread:
    """Keywords and elements of a mesh file beside its bodies and faces.

    Args:
        file: its path.
        found: the file.
        faces: face of the scene -> corner nodes of its facets.
        used: kind and name of each group that the scene names; shells of these mark faces.
    """
    deck, sign = read_deck(found, file.suffix, solid=True), "*" * (file.suffix == ".inp")
    sets = [name for kind, name in used if kind == "facets" and name in found.shell_sets]
    texts = _texts(found, deck, sets, sign)
    page = "howto_abaqus_deck" if sign else "coming_from_other_codes"
    line = f"{file.name}: not read: {', '.join(texts)}; docs/{page}.md says what to write instead"
    stated = []
    for section in _SECTIONS:
        for name, table in deck.tables[section].items():
            groups = table.get("faces", [name])
            on = tuple(frozenset(_faces_on(found, faces, group)) for group in groups)
            stated.append((file.name, rawmesh.Stated(section, f"[{section}] {name}", on)))
    return rawmesh.Unread((line,) if texts else (), tuple(stated))


def _texts(found: filemesh.FileMesh, deck: Deck, sets: Iterable[str], sign: str) -> list[str]:
    """Elements, but for shells of some sets, and keywords that are not read, with their numbers."""
    marks = [rawmesh.facet_keys(found.facet_groups[name]) for name in sets]
    marked = np.concatenate([np.zeros(0, dtype=np.uint64), *marks])
    elements = Counter[str]()
    for kind, shells in found.shells.items():
        keys = rawmesh.facet_keys(np.array([*map(filemesh.corners_of, shells)]))
        elements[kind] = int(np.count_nonzero(~np.isin(keys, marked)))
    # What an option adds to a keyword that is read has its line in the scene alone.
    unread = [
        b
        for b, why in deck.unread
        if b.keyword not in keywords.KNOWN or why not in keywords.doubts(b)[1]
    ]
    lost = {id(block) for block in unread}
    own = [block for block in found.blocks if block.keyword == "ELEMENT" and id(block) not in lost]
    read = {block.options.get("TYPE", "").upper() for block in own}
    elements |= {kind: n for kind, n in found.elements.items() if kind not in read}
    words = Counter(sign + block.keyword for block in unread if block.keyword != "ELEMENT")
    texts = [name if n == 1 else f"{n} {name}" for name, n in words.items()]
    if counts := [f"{n} {kind}" for kind, n in elements.items() if n]:
        *first, last = counts
        said = f"{', '.join(first)} and {last}" if first else last
        texts.insert(0, f"{said} element{'s' * (elements.total() > 1)}")
    return texts


def _faces_on(found: filemesh.FileMesh, faces: Mapping[str, Ints], group: str) -> list[str]:
    """Faces of the scene all of whose facets are in a group."""
    for kind, table in (("facets", found.facet_groups), ("nodes", found.node_groups)):
        if name := find(table, group):
            every = faces.items()
            return [n for n, own in every if own.size and found.inside(kind, name, own).all()]
    return []
