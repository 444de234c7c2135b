"""What is understood of the keywords of Abaqus and CalculiX: their options and data lines.

What is not in this table is named with its line and left out; nothing is read by half. Names of
options and their values stand without blanks, which CalculiX ignores.

Reference: Abaqus Keywords Reference Guide 2024; G. Dhondt, CalculiX CrunchiX user's manual 2.21.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from brake_fenicsx.meshing.filemesh import DeckKeyword

MANY = 10**9
_STRESS = "the stiffness by the stresses of the equilibrium and large displacements are in no scene"


class Known(NamedTuple):
    """What is understood of a keyword.

    Attributes:
        options: option -> pattern of its values.
        aside: option that is named, but without which the rest holds -> what to do.
        words: fewest and most words of a data line.
        lines: fewest and most data lines.
        opens: whether the next keywords belong to it, so that it is never left out.
    """

    options: Mapping[str, str] = {}
    aside: Mapping[str, str] = {}
    words: tuple[int, int] = (0, 0)
    lines: tuple[int, int] = (0, MANY)
    opens: bool = False


def _any(*names: str) -> dict[str, str]:
    return dict.fromkeys(names, ".*")


_LOAD = _any("AMPLITUDE") | {"OP": "NEW|MOD"}
_SHELL = _any("ELSET", "MATERIAL", "COMPOSITE", "OFFSET", "SECTIONINTEGRATION", "NODALTHICKNESS",
              "POISSON", "TEMPERATURE", "CONTROLS")  # fmt: skip
_ORIENTATION = {
    "ORIENTATION": "write the axis of the part, along which its forces and springs act then"
}
KNOWN: dict[str, Known] = {
    # Steps
    "STEP": Known(
        _any("NAME", "INC", "UNSYMM", "AMPLITUDE", "EXTRAPOLATION", "CONVERTSDI", "SOLVER")
        | {"NLGEOM": "NO"}, {"NLGEOM": _STRESS, "PERTURBATION": _STRESS}, (1, 80), opens=True,
    ),
    "STATIC": Known(
        _any("DIRECT", "SOLVER", "STABILIZE", "ALLSDTOL", "CONTINUE", "FACTOR"), {}, (1, 4), (0, 1),
        opens=True,
    ),
    "FREQUENCY": Known(
        _any("EIGENSOLVER", "SOLVER", "NORMALIZATION", "STORAGE", "GLOBAL", "SIM", "NSET"), {},
        (1, 9), (0, 1), opens=True,
    ),
    "COMPLEX FREQUENCY": Known(
        _any("UNSTABLEMODESONLY", "LEFTEIGENVECTORS") | {"FRICTIONDAMPING": "NO"},
        {"FRICTIONDAMPING": "write stability.damping.sliding, or slope"}, (1, 4), (0, 1),
        opens=True,
    ),
    "AMPLITUDE": Known(
        _any("NAME") | {"DEFINITION": "TABULAR", "TIME": "(STEP|TOTAL)TIME", "VALUE": "RELATIVE"},
        {}, (1, 8), (1, MANY),
    ),
    "MODEL CHANGE": Known(
        {"TYPE": "CONTACTPAIR", "ADD": "", "REMOVE": ""}, {}, (2, 2), (1, MANY)
    ),
    # Supports and loads
    "BOUNDARY": Known(_LOAD | {"TYPE": "DISPLACEMENT"}, {}, (2, 4)),
    "CLOAD": Known(_LOAD, {}, (3, 3)),
    "DLOAD": Known(_LOAD, {}, (2, 9)),
    "DSLOAD": Known(_LOAD, {}, (2, 9)),
    "TRANSFORM": Known(_any("NSET") | {"TYPE": "[RCS]"}, {}, (6, 6), (1, 1)),
    "MOTION": Known(
        {"ROTATION": "", "TRANSLATION": "", "TYPE": "VELOCITY"}, {}, (4, 8), (1, 1)
    ),
    # Contact and joints
    "SURFACE INTERACTION": Known(_any("NAME"), {}, (0, 1), (0, 1), opens=True),
    "CHANGE FRICTION": Known(
        _any("INTERACTION"),
        {"RESET": "write the friction", "AMPLITUDE": "write the friction at the end of the step"},
        opens=True,
    ),
    "FRICTION": Known(
        {"ROUGH": "", "EXPONENTIALDECAY": ""} | _any("SLIPTOLERANCE", "ELASTICSLIP", "LAGRANGE"),
        {}, (1, 4), (0, 1),
    ),
    "SURFACE BEHAVIOR": Known(
        {"PRESSURE-OVERCLOSURE": "HARD|LINEAR|TIED"} | _any("AUGMENTEDLAGRANGE", "DIRECT",
                                                            "PENALTY"), {}, (1, 1), (0, 1),
    ),
    "CONTACT PAIR": Known(
        _any("INTERACTION", "SMALLSLIDING", "NOTHICKNESS", "CPSET", "TRACKING", "HCRIT", "WEIGHT",
             "SLIDINGTRANSITION", "SMOOTH", "SUPPLEMENTARYCONSTRAINTS", "MECHANICALCONSTRAINT")
        | {"TIED": "", "TYPE": "(NODE|SURFACE)TOSURFACE|(PG)?(LIN)?MORTAR|MASSLESS"},
        {"ADJUST": "the nodes stay where they are"}, (1, 2),
    ),
    "TIE": Known(
        _any("NAME", "POSITIONTOLERANCE", "ADJUST", "TYPE", "NOROTATION", "NOTHICKNESS"), {}, (2, 2)
    ),
    "CONTACT": Known(opens=True),
    "CONTACT INCLUSIONS": Known({"ALLEXTERIOR": ""}, {}, (2, 2)),
    "CONTACT EXCLUSIONS": Known({}, {}, (2, 2)),
    "CONTACT PROPERTY ASSIGNMENT": Known({}, {}, (3, 3)),
    "COUPLING": Known(_any("CONSTRAINTNAME", "REFNODE", "SURFACE")),
    "RIGID BODY": Known(_any("REFNODE", "ROTNODE", "NSET")),
    "KINEMATIC": Known({}, {}, (1, 2)),
    "DISTRIBUTING": Known(_any("COUPLING", "ROTATIONALCOUPLING")),
    "ELEMENT": Known(_any("TYPE", "ELSET"), {}, (1, 99)),
    "SPRING": Known(_any("ELSET"), {}, (1, 2), (2, 2)),
    "MASS": Known(_any("ELSET"), {}, (1, 1), (1, 1)),
    # Materials and sections
    "MATERIAL": Known(_any("NAME"), opens=True),
    "ELASTIC": Known({"TYPE": "ISO.*|ENG.*|ORTHO.*|ANISO.*"}, {}, (1, 8), (1, 3)),
    "DENSITY": Known({}, {}, (1, 2), (1, 1)),
    "DAMPING": Known(
        _any("STRUCTURAL"),
        dict.fromkeys(("ALPHA", "BETA"), "write stability.damping.rayleigh, of the whole brake"),
    ),
    "SOLID SECTION": Known(_any("ELSET", "MATERIAL", "CONTROLS"), _ORIENTATION, (0, 3), (0, 1)),
    "SHELL SECTION": Known(_SHELL, _ORIENTATION, (1, 9)),
    "SHELL GENERAL SECTION": Known(_SHELL, _ORIENTATION, (1, 9)),
}  # fmt: skip
# Keywords of which nothing is lost: output, and what others name.
HARMLESS = frozenset({
    "HEADING", "PREPRINT", "RESTART", "OUTPUT", "ELEMENT OUTPUT", "NODE OUTPUT", "CONTACT OUTPUT",
    "ENERGY OUTPUT", "MODAL OUTPUT", "NODE PRINT", "EL PRINT", "CONTACT PRINT", "ENERGY PRINT",
    "MODAL PRINT", "SECTION PRINT", "NODE FILE", "EL FILE", "ELEMENT FILE", "CONTACT FILE",
    "ENERGY FILE", "MODAL FILE", "FILE FORMAT", "FILE OUTPUT", "MONITOR", "PRINT", "TIME POINTS",
    "DIAGNOSTICS", "CONTROLS", "SOLVER CONTROLS", "SECTION CONTROLS", "ORIENTATION",
})  # fmt: skip
_ENDS = ("END STEP", "END PART", "END INSTANCE", "END ASSEMBLY")
_PLAIN = {name.replace(" ", ""): name for name in (*KNOWN, *HARMLESS, *_ENDS)}


def keyword_of(text: str) -> str:
    """A keyword in capitals; without its blanks it is the same one."""
    word = " ".join(text.split()).upper()
    return _PLAIN.get(word.replace(" ", ""), word)


def doubts(block: DeckKeyword) -> tuple[str | None, list[str]]:
    """What of a block is not understood.

    Args:
        block: of a keyword of ``KNOWN``.

    Returns:
        Why the whole block is left out, or None; and what else of it is left out.
    """
    known, why, aside = KNOWN[block.keyword], None, list[str]()
    for name, value in block.options.items():
        given = "".join(value.split()).upper()
        if name in known.options and re.fullmatch(known.options[name], given):
            continue
        said = f"{name} = {value}" if value else name
        if name in known.aside:
            aside.append(f"{said}: {known.aside[name]}")
        elif known.opens:
            aside.append(f"{said} is not understood")
        else:
            why = f"{said} is not understood"
    (fewest, most), (low, high) = known.words, known.lines
    wrong = [row for row in block.rows if not fewest <= len(row) <= most]
    if why is None and (wrong or not low <= len(block.rows) <= high):
        line = f"its line {', '.join(wrong[0])!r}" if wrong else f"{len(block.rows)} data lines"
        why = f"{line} {'is' if wrong else 'are'} not understood"
    if known.opens and why:
        return None, [*aside, why]
    return why, aside
