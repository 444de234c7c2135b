"""A first scene of a mesh file: what the file says, with proposals where it says nothing.

Comments say what was guessed or proposed, and name the keywords that were not taken over.
"""

from __future__ import annotations

import json
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.meshing.abaqus_scope import find
from brake_fenicsx.macro.meshing.filemesh import Block, FileMesh
from brake_fenicsx.macro.meshing.meshfile import read_mesh_file
from brake_fenicsx.macro.meshing.rawmesh import CHANGING
from brake_fenicsx.scene.tables import dotted
from brake_fenicsx.scene.units import MODULI, factor_to_si, quantity_text, several

from .deck import Deck, Quantity, read_deck
from .faces import MADE, bodies_of, clean, proposed_motion

# Consistent units of length, mass and time; densities of solids [kg/m^3], lengths of brakes [m].
SYSTEMS = ("mm t s", "m kg s", "mm kg ms", "mm g ms", "inch slinch s")
DENSITIES, LENGTHS = (300.0, 25e3), (5e-3, 3.0)
# Exponents of length, mass and time.
_POWERS = {
    "m": (1, 0, 0), "kg": (0, 1, 0), "kg/m^3": (-3, 1, 0), "Pa": (-1, 1, -2), "N": (1, 1, -2),
    "N m": (2, 1, -2), "N/m": (0, 1, -2), "Pa/m": (-2, 1, -2),
}  # fmt: skip
# Section in whose place a keyword is named, by its start; [ties] for others.
_PLACES = {
    "supports": ("BOUNDARY", "TRANSFORM", "SPC", "BASE", "D"),
    "loads": ("CLOAD", "DLOAD", "DSLOAD", "FORCE", "MOMENT", "PLOAD", "SF", "TEMP", "GRAV"),
    "contact": ("CONTACT", "BC", "FRICTION", "SURFACE B", "CLEARANCE"), "motion": ("MOTION",),
    "springs": ("SPRING", "DASHPOT", "CONNECTOR"), "masses": ("MASS",),
    "materials": ("ELASTIC", "DAMPING", "MAT", "MP", "TB"), "parts": ("SOLID", "ELEMENT"),
}  # fmt: skip
# Sections about faces, and all in their order.
_ON_FACES = ("contact", "ties", "supports", "loads", "springs", "masses")
_ORDER = ("mesh", "mesh.groups", "parts", "materials", *_ON_FACES, "motion", "stability")
# A stiff penalty, friction, and faces that do not slide.
_SLIDES = {"law": {"linear": "2e13 Pa/m"}, "friction": 0.4}
_STUCK = {"law": _SLIDES["law"], "slip": "stuck", "tangential_stiffness": "1e12 Pa/m"}
_MISSING = '{ model = "isotropic", E = "207 GPa", nu = 0.28, rho = "7820 kg/m^3" }'
_HEAD = """\
# Written by brake-fenicsx init; comments say what is guessed or proposed, and what of the file is
# not taken over.
stages = {}
"""


def write_scene(deck: Path, scene: Path, units: Sequence[str] | None = None) -> str:
    """Write a first scene of a mesh file.

    Args:
        deck: the mesh file.
        scene: the scene to write.
        units: units of length, mass and time of the file; guessed if None.

    Returns:
        What was written, in one line.

    Raises:
        SceneError: the file cannot be read, the units are unknown, or the scene is there already.
    """
    if scene.exists():
        raise SceneError(f"{scene}: is there already; remove it, or name another file with -o")
    try:
        found = read_mesh_file(deck)
        draft = Draft(found, read_deck(found, deck.suffix), units)
        text = draft.scene(os.path.relpath(deck, scene.parent), "*" * (deck.suffix == ".inp"))
    except SceneError as error:
        raise SceneError(f"{deck}: {error}") from None
    scene.write_text(text)
    faces, left = len(draft.bodies.faces), text.count("# not taken over:")
    said = f"{several(len(draft.bodies.boundary), 'part')}, {several(faces, 'face')}"
    return f"wrote {scene}: {said}, {several(left, 'remark')} on what is not taken over"


class Draft:
    """Lines of a scene, section by section.

    Attributes:
        lines: section -> its lines.
        bodies: parts and faces of the file.
        units: of length, mass and time.
        parts: part -> layer -> material.
    """

    def __init__(self, found: FileMesh, deck: Deck, units: Sequence[str] | None):
        self.found, self.deck = found, deck
        self.units, self.why = (" ".join(units), "") if units else _guessed(found, deck)
        self.lines: dict[str, list[str]] = defaultdict(list)
        self.bodies = bodies_of(found, deck.sections, self.si(Quantity(1.0, "m")))
        self.parts: dict[str, dict[str, str]] = defaultdict(dict)
        for group, target in self.bodies.layers.items():
            part, _, layer = target.partition(".")
            name = deck.sections.get(group, clean(group))
            self.parts[part][layer] = find(deck.tables["materials"], name) or name

    def scene(self, file: str, sign: str) -> str:
        """The whole text.

        Args:
            file: path of the mesh file, from the folder of the scene.
            sign: "*" before the keywords of the file, or "".
        """
        placed = {section: self._placed(section) for section in _ON_FACES}
        groups = (*self.found.facet_groups, *self.found.node_groups)
        for group in [name for name in groups if not MADE.fullmatch(name)] or groups:
            if ";" in (why := self.bodies.faces_of(group)[1]):  # it has an area
                self.bodies.groups.append(f"# {json.dumps(group)}: {why}")
        self._write("mesh", {"file": file})
        said = f"of {self.units}{self.why and ', guessed from ' + self.why}"
        self._write("mesh", {"unit": self.units.split()[0]}, said)
        for group, target in self.bodies.layers.items():
            cells = several(len(self.found.cell_groups[group]), "cell")
            self._write("mesh.groups", {group: target}, cells)
        self.lines["mesh.groups"] += self.bodies.groups
        self._parts()
        self._contact(placed.pop("contact"), [t["faces"] for t in placed["ties"].values()])
        for section, table in placed.items():
            self._write(section, table)
        others = self._unread(sign)
        stages = ["equilibrium", "stability", "report"] if self.lines["stability"] else []
        text = [_HEAD.format(json.dumps(stages)), *others]
        for name in _ORDER:
            lines = self.lines[name]
            text += [f"[{name}]", *lines, ""] if lines else []
        return "\n".join(text)

    def si(self, q: Quantity) -> float:
        """A number of the file in SI units."""
        si = zip(self.units.split(), ("m", "kg", "s"), _POWERS[q.unit], strict=True)
        return float(q.value * np.prod([factor_to_si(u, s, "--units") ** n for u, s, n in si]))

    def toml(self, value: Any) -> str:
        """A value as TOML in one line."""
        if isinstance(value, Quantity):
            if not value.unit or not value.value:
                return f"{value.value:.8g}"
            return json.dumps(quantity_text(self.si(value), value.unit))
        if isinstance(value, dict):
            return f"{{ {', '.join(f'{dotted(k)} = {self.toml(v)}' for k, v in value.items())} }}"
        if isinstance(value, list | tuple):
            return f"[{', '.join(map(self.toml, value))}]"
        return json.dumps(value)

    def _write(self, section: str, table: dict[str, Any], comment: str = "") -> None:
        for key, value in table.items():
            more = f"   # {comment}" if comment else ""
            self.lines[section].append(f"{dotted(key)} = {self.toml(value)}{more}")

    def _lost(self, section: str, text: str) -> None:
        self.lines[section].append(f"# not taken over: {text}")

    def _placed(self, section: str) -> dict[str, Any]:
        """The tables of a section, on faces of the scene."""
        placed: dict[str, Any] = {}
        for name, keys in self.deck.tables[section].items():
            groups = keys.get("faces", [name])
            each = []
            for group in groups:
                faces, why = self.bodies.faces_of(group)
                each.append(faces)
                if why:
                    self._lost(section, f"{json.dumps(group)}: {why}")
            pairs = [[*pair] for pair in product(*each)]
            if len(pairs) > 1 and len(groups) > 1:
                pairs = [pair for pair in pairs if self.bodies.overlap(*pair)]
            elif len(pairs) > 1 and not {"along", "pressure"} & {*keys}:
                self._lost(section, f"{name}: of {', '.join(each[0])} together")
                continue
            for k, pair in enumerate(pairs):
                if len(groups) > 1:
                    placed[f"{clean(name)}{k + 1 if k else ''}"] = keys | {"faces": pair}
                elif section == "supports":
                    before = placed.get(pair[0], "")
                    before = "xyz" if before == "clamped" else before
                    held = sorted({*before, *keys["along"]} & {*"xyz"})
                    placed[pair[0]] = "clamped" if len(held) == 3 else held
                else:
                    placed[pair[0]] = placed.get(pair[0], {}) | keys
        return placed

    def _parts(self) -> None:
        """Parts and materials; a material that the file does not have is a comment."""
        said = {block.options.get("TYPE", "").upper() for block in self.deck.mesh.blocks}
        for kind, count in self.found.elements.items():
            if kind not in said:  # whose keywords are named
                self._lost("parts", f"{count} {kind} elements")
        for part, layers in self.parts.items():
            names = [*dict.fromkeys(layers.values())]
            self._write("parts", {part: {"material": names[0] if len(names) == 1 else layers}})
        for name in dict.fromkeys(m for layers in self.parts.values() for m in layers.values()):
            if own := self.deck.tables["materials"].get(name):
                self._write("materials", {name: own})
            else:
                self.lines["materials"].append(f"# missing: {dotted(name)} = {_MISSING}")

    def _contact(self, own: dict[str, Any], tied: list[list[str]]) -> None:
        """Contact with the moving part second, and what follows from it."""
        said = ""
        if not own:
            glued = [{*faces} for faces in tied]
            free = [[*pair] for pair in self.bodies.touching() if {*pair} not in glued]
            own = {"_".join(pair): {"faces": pair} for pair in free}
            said = "the faces touch; glued ones are [ties]"
        touching = sorted({face for keys in own.values() for face in keys["faces"]})
        if not touching:
            return
        moving, count = self._moving(touching), Counter[str]()
        for keys in own.values():
            faces = sorted(keys["faces"], key=lambda face: _part(face) == moving)
            name = "_".join(map(_part, faces))
            number = f"_{count[name]}" if count[name] else ""
            count[name] += 1
            law = self.deck.laws.get(keys.get("interaction", "").upper(), {})
            guess = _SLIDES if _part(faces[1]) == moving else _STUCK
            given = {key: law.get(key, value) for key, value in guess.items()}
            words = [word for word in (said, *(k for k in guess if k not in law)) if word]
            comment = f"proposed: {', '.join(words)}" if words else ""
            self._write("contact", {f"{name}{number}": {"faces": faces, **given}}, comment)
        self._write("motion", *proposed_motion(self.bodies, moving, touching))
        self._write("stability", {"band": ["0 Hz", "5 kHz"], "method": "reduced"}, "proposed")

    def _moving(self, touching: Sequence[str]) -> str:
        """The part with the largest faces in contact, of equal ones the stiffer: the disc."""
        area: dict[str, float] = defaultdict(float)
        for face in touching:
            area[_part(face)] += self.bodies.faces[face].areas.sum()
        known = self.deck.tables["materials"]
        own = {p: [known.get(m, {}) for m in self.parts[p].values()] for p in area}
        stiff = {part: max([0.0, *_moduli(tables)]) for part, tables in own.items()}
        return max(area, key=lambda part: (round(area[part], 9), stiff[part]))

    def _unread(self, sign: str) -> list[str]:
        """Put keywords that were not taken over in their places; a line on the others."""
        same: dict[tuple[str, str], list[Block]] = defaultdict(list)
        for block, why in self.deck.unread:
            same[block.keyword, why].append(block)
        others = []
        for (word, why), (first, *more) in same.items():
            said = f"{first.said} ({first.at}{f' and {len(more)} more' if more else ''})"
            places = (p for p, words in _PLACES.items() if word.startswith(words))
            if why or f"{sign}{word}" in CHANGING or word == "ELEMENT":
                self._lost(next(places, "ties"), f"{said}{why and ': ' + why}")
            else:
                others.append(f"{sign}{word} ({first.at})")
        return [f"# Ignored: {', '.join(others)}\n"] if others else []


def _part(face: str) -> str:
    return face.partition(".")[0]


def _moduli(materials: Iterable[dict[str, Any]]) -> list[float]:
    """All moduli of some materials, in the file's unit."""
    values = (v for own in materials for v in own.values())
    flat = (q for v in values for q in (v if type(v) is list else [v]))
    return [q.value for q in flat if isinstance(q, Quantity) and q.unit == "Pa"]


def _guessed(found: FileMesh, deck: Deck) -> tuple[str, str]:
    """Units with which densities, moduli and extent are usual ones, and what says so."""
    extent = float(np.ptp(found.points[np.unique(found.cells)], axis=0).max())
    own = deck.tables["materials"].items()
    rho = {name: c["rho"].value for name, c in own if c.get("rho", (0,))[0]}
    E = _moduli(c for _, c in own)
    for units in SYSTEMS:
        si = zip(units.split(), ("m", "kg", "s"), strict=True)
        m, kg, s = (factor_to_si(*pair, "--units") for pair in si)
        usual = LENGTHS[0] <= extent * m <= LENGTHS[1]
        usual &= all(DENSITIES[0] <= r * kg / m**3 <= DENSITIES[1] for r in rho.values())
        if usual and all(MODULI[0] <= e * kg / m / s**2 <= MODULI[1] for e in E):
            for name, r in rho.items():
                return units, f"the density {r:g} of {name}: {r * kg / m**3:.6g} kg/m^3"
            return units, f"the extent of {extent:g}"
    raise SceneError(
        f"--units: missing; no usual ones fit an extent of {extent:g} and the densities"
        f" {', '.join(f'{r:g}' for r in rho.values()) or '(none)'}; write such as --units mm t s"
    )
