"""What a mesh file holds beside its mesh, which is not read: said, so that nothing is lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# Keywords that hold, join, load or move the bodies; others are materials, sections, steps, output.
CHANGING = frozenset({
    # Abaqus and CalculiX
    "*TIE", "*COUPLING", "*KINEMATIC COUPLING", "*DISTRIBUTING COUPLING", "*MPC", "*EQUATION",
    "*SHELL TO SOLID COUPLING", "*RIGID BODY", "*EMBEDDED ELEMENT", "*FASTENER", "*TRANSFORM",
    "*PRE-TENSION SECTION", "*CYCLIC SYMMETRY MODEL", "*NONSTRUCTURAL MASS", "*CONTACT",
    "*CONTACT PAIR", "*CLEARANCE", "*BOUNDARY", "*CLOAD", "*DLOAD", "*DSLOAD", "*TEMPERATURE",
    "*INITIAL CONDITIONS", "*BASE MOTION", "*MOTION",
    # Ansys
    "CE", "CP", "D", "F", "SF", "SFE", "BF", "BFE",
    # Nastran
    "CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S", "MPC", "MPCADD", "RBAR", "RBE1",
    "RBE2", "RBE3", "BCTABLE", "BCONTACT", "BGSET", "SPC", "SPC1", "SPCD", "FORCE", "MOMENT",
    "PLOAD", "PLOAD2", "PLOAD4", "GRAV", "RFORCE", "TEMP",
})  # fmt: skip


@dataclass(frozen=True, slots=True)
class Unread:
    """Lines on what is not read.

    Attributes:
        changing: elements and keywords that change the brake, a line for each file.
        other: materials, sections, steps and the like.
    """

    changing: tuple[str, ...] = ()
    other: tuple[str, ...] = ()


def unread(file: str, elements: Mapping[str, int], keywords: Mapping[str, int]) -> Unread:
    """Lines on what of a mesh file is in no body and no face.

    Args:
        file: name of the file.
        elements: kind of element -> number of them.
        keywords: keyword or command -> number of them.
    """
    changing = {name: n for name, n in keywords.items() if name in CHANGING}
    other = {name: n for name, n in keywords.items() if name not in CHANGING}
    lost = ", ".join([*_elements(elements), *_keywords(changing)])
    page = "howto_abaqus_deck" if file.endswith(".inp") else "coming_from_other_codes"
    said = f"{file}: not read: {lost}; docs/{page}.md says what to write instead"
    rest = f"{file}: ignored (defined in the scene instead): {', '.join(_keywords(other))}"
    return Unread((said,) if lost else (), (rest,) if other else ())


def _elements(numbers: Mapping[str, int]) -> list[str]:
    """Numbers of elements of each kind: "1 S3, 1 MASS and 2 SPRINGA elements"; none of none."""
    if not numbers:
        return []
    *first, last = (f"{n} {kind}" for kind, n in numbers.items())
    word = "element" if sum(numbers.values()) == 1 else "elements"
    return [f"{', '.join(first)} and {last} {word}" if first else f"{last} {word}"]


def _keywords(numbers: Mapping[str, int]) -> list[str]:
    """Keywords, with their number where there are several."""
    return [name if n == 1 else f"{n} {name}" for name, n in numbers.items()]
