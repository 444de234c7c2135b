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


# Keyword, with + if it opens others; its options with any value, none ("=") or a pattern of values;
# fewest and most words of a data line; fewest and most data lines, "-" for any number; options that
# are named, and what to do. A line that begins with a blank goes on from the one before.
_TABLE = """
STEP+; NAME INC UNSYMM AMPLITUDE EXTRAPOLATION CONVERTSDI SOLVER NLGEOM=NO; 1 80; 0 -; NLGEOM
 PERTURBATION: the stiffness by the stresses of the equilibrium and large displacements are in no
 scene
STATIC+; DIRECT SOLVER STABILIZE ALLSDTOL CONTINUE FACTOR; 1 4; 0 1
FREQUENCY+; EIGENSOLVER SOLVER NORMALIZATION STORAGE GLOBAL SIM NSET; 1 9; 0 1
COMPLEX FREQUENCY+; UNSTABLEMODESONLY LEFTEIGENVECTORS FRICTIONDAMPING=NO; 1 4; 0 1;
 FRICTIONDAMPING: write stability.damping.sliding, or slope
AMPLITUDE; NAME DEFINITION=TABULAR TIME=(STEP|TOTAL)TIME VALUE=RELATIVE; 1 8; 1 -
MODEL CHANGE; TYPE=CONTACTPAIR ADD= REMOVE=; 2 2; 1 -
BOUNDARY; AMPLITUDE OP=NEW|MOD TYPE=DISPLACEMENT; 2 4; 0 -
CLOAD; AMPLITUDE OP=NEW|MOD; 3 3; 0 -
DLOAD; AMPLITUDE OP=NEW|MOD; 2 9; 0 -
DSLOAD; AMPLITUDE OP=NEW|MOD; 2 9; 0 -
TRANSFORM; NSET TYPE=[RCS]; 6 6; 1 1
MOTION; ROTATION= TRANSLATION= TYPE=VELOCITY; 4 8; 1 1
SURFACE INTERACTION+; NAME; 0 1; 0 1
CHANGE FRICTION+; INTERACTION; 0 0; 0 -; RESET: write the friction, AMPLITUDE: write the friction at
 the end of the step
FRICTION; ROUGH= EXPONENTIALDECAY= SLIPTOLERANCE ELASTICSLIP LAGRANGE; 1 4; 0 1
SURFACE BEHAVIOR; PRESSURE-OVERCLOSURE=HARD|LINEAR|TIED AUGMENTEDLAGRANGE DIRECT PENALTY; 1 3; 0 1
CONTACT PAIR; INTERACTION SMALLSLIDING NOTHICKNESS CPSET TRACKING HCRIT WEIGHT SLIDINGTRANSITION
 SMOOTH SUPPLEMENTARYCONSTRAINTS MECHANICALCONSTRAINT TIED=
 TYPE=(NODE|SURFACE)TOSURFACE|(PG)?(LIN)?MORTAR|MASSLESS; 1 2; 0 -; ADJUST: the nodes stay where
 they are
TIE; NAME POSITIONTOLERANCE ADJUST TYPE NOROTATION NOTHICKNESS; 2 2; 0 -
CONTACT+; ; 0 0; 0 -
CONTACT INCLUSIONS; ALLEXTERIOR=; 2 2; 0 -
CONTACT EXCLUSIONS; ; 2 2; 0 -
CONTACT PROPERTY ASSIGNMENT; ; 3 3; 0 -
COUPLING; CONSTRAINTNAME REFNODE SURFACE; 0 0; 0 -
RIGID BODY; REFNODE ROTNODE NSET; 0 0; 0 -
KINEMATIC; ; 1 2; 0 -
DISTRIBUTING; COUPLING ROTATIONALCOUPLING; 0 0; 0 -
ELEMENT; TYPE ELSET; 1 99; 0 -
SPRING; ELSET; 1 2; 2 2
MASS; ELSET; 1 1; 1 1
MATERIAL+; NAME; 0 0; 0 -
ELASTIC; TYPE=ISO.*|ENG.*|ORTHO.*|ANISO.*; 1 8; 1 3
DENSITY; ; 1 2; 1 1
DAMPING; STRUCTURAL; 0 0; 0 -; ALPHA BETA: write stability.damping.rayleigh, of the whole brake
SOLID SECTION; ELSET MATERIAL CONTROLS; 0 3; 0 1; ORIENTATION: write the axis of the part, along
 which its forces and springs act then
SHELL SECTION; ELSET MATERIAL COMPOSITE OFFSET SECTIONINTEGRATION NODALTHICKNESS POISSON TEMPERATURE
 CONTROLS; 1 9; 0 -; ORIENTATION: write the axis of the part, along which its forces and springs act
 then
"""


def _known(row: str) -> tuple[str, Known]:
    """A keyword of the table."""
    name, options, words, lines, *aside = (cell.strip() for cell in row.split(";"))
    given = (word.partition("=") for word in options.split())
    fewest, most = lines.split()
    said = re.findall(r"((?:[A-Z]+ ?)+): (.*?)(?:, (?=[A-Z]+: )|$)", " ".join(aside))
    known = Known(
        {option: pattern if sign else ".*" for option, sign, pattern in given},
        {option: text for options, text in said for option in options.split()},
        (int(words.split()[0]), int(words.split()[1])),
        (int(fewest), MANY if most == "-" else int(most)),
        opens=name.endswith("+"),
    )
    return name.rstrip("+"), known


KNOWN = dict(map(_known, _TABLE.strip().replace("\n ", " ").split("\n")))
KNOWN["SHELL GENERAL SECTION"] = KNOWN["SHELL SECTION"]
# Keywords of which nothing is lost: output, and what others name.
_SILENT = """
HEADING, PREPRINT, RESTART, OUTPUT, ELEMENT OUTPUT, NODE OUTPUT, CONTACT OUTPUT, ENERGY OUTPUT,
MODAL OUTPUT, NODE PRINT, EL PRINT, CONTACT PRINT, ENERGY PRINT, MODAL PRINT, SECTION PRINT,
NODE FILE, EL FILE, ELEMENT FILE, CONTACT FILE, ENERGY FILE, MODAL FILE, FILE FORMAT, FILE OUTPUT,
MONITOR, PRINT, TIME POINTS, DIAGNOSTICS, CONTROLS, SOLVER CONTROLS, SECTION CONTROLS, ORIENTATION
"""
HARMLESS = frozenset(word.strip() for word in _SILENT.split(","))
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
