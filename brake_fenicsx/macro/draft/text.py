"""A first scene of a mesh file: what the file says, with proposals where it says nothing.

Comments say what was guessed or proposed, and name the keywords that were not taken over.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
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

from .contact import contact_lines, motion_lines
from .deck import read_deck
from .faces import MADE, bodies_of, clean
from .statements import Deck

# Consistent units of length, mass and time; densities of solids [kg/m^3], lengths of brakes [m].
SYSTEMS = ("mm t s", "m kg s", "mm kg ms", "mm g ms", "inch slinch s")
DENSITIES, LENGTHS = (300.0, 25e3), (5e-3, 3.0)
# Exponents of length, mass and time.
_POWERS = {
    "m": (1, 0, 0), "kg": (0, 1, 0), "kg/m^3": (-3, 1, 0), "Pa": (-1, 1, -2), "N": (1, 1, -2),
    "N m": (2, 1, -2), "N/m": (0, 1, -2), "Pa/m": (-2, 1, -2),
    "rad/s": (0, 0, -1),
}  # fmt: skip
# Section of a scene in whose place a keyword is named, by its start.
_PLACES = {
    "BOUNDARY": "supports", "TRANSFORM": "supports", "SPC": "supports", "BASE": "supports",
    "D": "supports", "CLOAD": "loads", "DLOAD": "loads", "DSLOAD": "loads", "FORCE": "loads",
    "MOMENT": "loads", "PLOAD": "loads", "SF": "loads", "TEMP": "loads", "GRAV": "loads",
    "CONTACT": "contact", "BCTABLE": "contact", "BCONTACT": "contact", "FRICTION": "contact",
    "SURFACE BEHAVIOR": "contact", "CLEARANCE": "contact", "SPRING": "springs",
    "DASHPOT": "springs", "CONNECTOR": "springs", "MASS": "masses", "ELASTIC": "materials",
    "DAMPING": "materials", "MAT": "materials", "MP": "materials", "TB": "materials",
    "SOLID SECTION": "parts", "ELEMENT": "parts", "MOTION": "motion", "MAT1": "materials",
}  # fmt: skip
SECTIONS = ("mesh", "mesh.groups", "parts", "materials", "ties", "contact", "supports", "springs",
            "masses", "loads", "motion", "stability")  # fmt: skip
_UNITS = {"nu": "", "loss": "", "rho": "kg/m^3", "pressure": "Pa", "force": "N", "moment": "N m"}
UNKNOWN = '# model = "isotropic"\n# E = "207 GPa"\n# nu = 0.28\n# rho = "7820 kg/m^3"'


def write_scene(deck: Path, scene: Path, units: Sequence[str] | None = None) -> str:
    """Write a first scene of a mesh file.

    Args:
        deck: the mesh file.
        scene: the scene to write.
        units: units of length, mass and time of the file; guessed if None.

    Returns:
        What the scene holds, in one line.

    Raises:
        SceneError: the file cannot be read, the units are unknown, or the scene is there already.
    """
    if scene.exists():
        raise SceneError(f"{scene}: is there already; remove it, or name another file with -o")
    try:
        found = read_mesh_file(deck)
        draft = Draft(found, read_deck(found, deck.suffix), units)
    except SceneError as error:
        raise SceneError(f"{deck}: {error}") from None
    text = draft.scene(os.path.relpath(deck, scene.parent), deck.suffix)
    scene.write_text(text)
    counts = [
        several(len(draft.bodies.boundary), "part"), several(len(draft.bodies.faces), "face"),
        several(len(draft.pairs), "contact"), several(text.count("# not taken over"), "remark"),
    ]  # fmt: skip
    return f"wrote {scene}: {', '.join(counts)} on what was not taken over; units {draft.units}"


class Draft:
    """Lines of a scene, section by section."""

    def __init__(self, found: FileMesh, deck: Deck, units: Sequence[str] | None):
        self.found, self.deck = found, deck
        self.units, self.why = (" ".join(units), "") if units else _guessed(found, deck)
        self.lines: dict[str, list[str]] = {name: [] for name in SECTIONS}
        self.bodies = bodies_of(found, deck.sections, self.si(1.0, "m"))
        self.layers: dict[str, dict[str, str]] = {}
        for group, target in self.bodies.layers.items():
            part, _, layer = target.partition(".")
            name = deck.sections.get(group, ("", 0.0))[0]
            material = find(deck.materials, name) or clean(name or group)
            self.layers.setdefault(part, {})[layer] = material
        self.pairs: list[tuple[str, str, str]] = []
        self.tied: set[tuple[str, str]] = set()

    def scene(self, file: str, suffix: str) -> str:
        """The whole text.

        Args:
            file: path of the mesh file, from the folder of the scene.
            suffix: its ending.
        """
        self._parts()
        for name, (a, b, search) in self.deck.ties.items():
            self._tie(name, a, b, search)
        for a, b, name in self.deck.pairs:
            self.pairs += [(f, g, name) for f, g in self._meeting(a, b, "contact")]
        self._on_faces()
        groups = (*self.found.facet_groups, *self.found.node_groups)
        for group in [name for name in groups if not MADE.fullmatch(name)] or groups:
            why = self.bodies.faces_of(group)[1]
            if ";" in why:  # it has an area
                self.bodies.groups.append(f"# {json.dumps(group)}: {why}")
        if not self.deck.pairs:
            self.pairs = [(*pair, "") for pair in self.bodies.touching() if pair not in self.tied]
        if self.pairs:
            self.lines["contact"] += contact_lines(self)
            self.lines["motion"] += motion_lines(self)
            self.lines["stability"] += [
                'band = ["0 Hz", "5 kHz"]   # proposed',
                'method = "reduced"',
            ]
        self._mesh(file)
        others = self._unread("" if suffix != ".inp" else "*")
        stages = '["equilibrium", "stability", "report"]' if self.pairs else "[]   # no contact"
        head = [
            f"# Written by brake-fenicsx init from {file}; comments say what is proposed.",
            f"stages = {stages}",
        ]
        for name, lines in self.lines.items():
            own = ("mesh", "mesh.groups", "supports", "loads", "motion", "stability")
            title = [f"[{name}]"] if name in own and any(line[0] != "#" for line in lines) else []
            head += ["", *title, *lines] if lines else []
        return re.sub(r"(?<=[^\n])\n(?=\[|# missing)", "\n\n", "\n".join([*head, *others, ""]))

    def si(self, value: float, unit: str) -> float:
        """A number of the file in SI units."""
        si = zip(self.units.split(), ("m", "kg", "s"), _POWERS[unit], strict=True)
        return float(value * np.prod([factor_to_si(u, s, "--units") ** n for u, s, n in si]))

    def text(self, value: Any, unit: str) -> str:
        """A number of the file, or several, as TOML."""
        if isinstance(value, list):
            return f"[{', '.join(self.text(v, unit) for v in value)}]"
        if not unit or not value:
            return f"{value:.8g}"
        return json.dumps(quantity_text(self.si(value, unit), unit))

    def faces(self, group: str, section: str) -> list[str]:
        """Faces that a group is; a comment if there are none."""
        names, why = self.bodies.faces_of(group)
        if not names:
            self.lines[section].append(f"# not taken over: {json.dumps(group)}: {why}")
        return names

    def _mesh(self, file: str) -> None:
        said = f"with {self.units}{self.why and ', guessed from ' + self.why}"
        unit = json.dumps(self.units.split()[0])
        self.lines["mesh"] += [f"file = {json.dumps(file)}", f"unit = {unit}   # {said}"]
        for group, target in self.bodies.layers.items():
            cells = several(len(self.found.cell_groups[group]), "cell")
            self.lines["mesh.groups"].append(
                f"{json.dumps(group)} = {json.dumps(target)}   # {cells}"
            )
        self.lines["mesh.groups"] += self.bodies.groups

    def _parts(self) -> None:
        """Parts and materials; constants that the file does not have are a comment."""
        lines = self.lines["parts"]
        for kind, count in self.found.elements.items():
            lines.append(f"# not taken over: {count} {kind} elements")
        for part, layers in self.layers.items():
            one = len({*layers.values()}) == 1
            inner = ", ".join(f"{layer} = {json.dumps(m)}" for layer, m in layers.items())
            material = json.dumps(next(iter(layers.values()))) if one else f"{{ {inner} }}"
            lines += [f"[parts.{part}]", f"material = {material}"]
            if self.angle(part):
                lines.append(f'axis = "{self.angle(part):g} deg"')
        for name in dict.fromkeys(m for layers in self.layers.values() for m in layers.values()):
            own = self.deck.materials.get(name, {})
            if not own:
                self.lines["materials"] += [f"# missing: [{dotted('materials', name)}]", UNKNOWN]
                continue
            single = not isinstance(own.get("E"), list) and "C22" not in own
            self.lines["materials"] += [
                f"[{dotted('materials', name)}]",
                f'model = "{"isotropic" if single else "orthotropic"}"',
                *(
                    f"{key} = {self.text(value, _UNITS.get(key, 'Pa'))}"
                    for key, value in own.items()
                ),
            ]

    def angle(self, part: str) -> float:
        """Angle of axis 1 of a part: that of its first layer with axes of its own [deg]."""
        own = (g for g, target in self.bodies.layers.items() if target.startswith(f"{part}."))
        angles = (self.deck.sections.get(group, ("", 0.0))[1] for group in own)
        return next((angle for angle in angles if angle), 0.0)

    def _meeting(self, first: str, second: str, section: str) -> list[tuple[str, str]]:
        """Faces of two groups, pair by pair; of several those that lie on each other."""
        pairs = [*product(self.faces(first, section), self.faces(second, section))]
        touching = [(a, b) for a, b in pairs if self.bodies.overlap(a, b)]
        return touching if len(pairs) > 1 else pairs

    def _tie(self, name: str, first: str, second: str, search: float | None) -> None:
        for k, pair in enumerate(self._meeting(first, second, "ties")):
            self.tied |= {pair, pair[::-1]}
            self.lines["ties"].append(f"[{dotted('ties', f'{name}_{k + 1}' if k else name)}]")
            self.lines["ties"].append(f"faces = {json.dumps(pair)}")
            if search:
                self.lines["ties"].append(f"search = {self.text(search, 'm')}")

    def _on_faces(self) -> None:
        """Supports, loads, springs and masses."""
        held: dict[str, set[str]] = {}
        for group, along in self.deck.held.items():
            for face in self.faces(group, "supports"):
                held.setdefault(face, set()).update(along)
        for face, every in held.items():
            said = "clamped" if len(every) == 3 else sorted(every)
            self.lines["supports"].append(f"{json.dumps(face)} = {json.dumps(said)}")
        for group, load in self.deck.loads.items():
            faces = self.faces(group, "loads")
            if "pressure" not in load and len(faces) > 1:
                self.lines["loads"].append(
                    f"# not taken over: a force on {', '.join(faces)} together"
                )
                continue
            for face in faces:
                given = {k: self._along(face, v) for k, v in load.items()}
                inner = ", ".join(f"{k} = {self.text(v, _UNITS[k])}" for k, v in given.items())
                self.lines["loads"].append(f"{json.dumps(face)} = {{ {inner} }}")
        for groups, stiffness in self.deck.springs.items():
            ends = [self.faces(group, "springs")[:1] for group in groups]
            name = "_".join(clean(group) for group in groups)
            if all(ends):
                pair = [face for (face,) in ends]
                title = dotted("springs", pair[0] if len(pair) == 1 else name)
                faces = [f"faces = {json.dumps(pair)}"] if len(pair) > 1 else []
                k = self.text(stiffness, "N/m")
                self.lines["springs"] += [f"[{title}]", *faces, f"stiffness = {k}"]
        for group, mass in self.deck.masses.items():
            for face in self.faces(group, "masses")[:1]:
                self.lines["masses"] += [
                    f"[{dotted('masses', face)}]",
                    f"mass = {self.text(mass, 'kg')}",
                ]

    def _along(self, face: str, value: Any) -> Any:
        """A vector along axes 1 and 2 of the face's part and along z."""
        if not isinstance(value, list):
            return value
        angle = np.radians(self.angle(face.partition(".")[0]))
        x, y, z = value
        c, s = np.cos(angle), np.sin(angle)
        return [float(c * x + s * y), float(c * y - s * x), z]

    def _unread(self, sign: str) -> list[str]:
        """Put keywords that were not taken over in their places; lines on the others."""
        same: dict[tuple[str, str], list[Block]] = {}
        for block, why in self.deck.unread:
            same.setdefault((block.keyword, why), []).append(block)
        others = []
        for (word, why), blocks in same.items():
            first, count = blocks[0], len(blocks)
            said = first.said if count == 1 else f"{count} {sign}{word}, the first"
            place = next(
                (_PLACES[k] for k in sorted(_PLACES, key=len, reverse=True) if word.startswith(k)),
                "ties",
            )
            if why or f"{sign}{word}" in CHANGING or word == "ELEMENT":
                self.lines[place].append(
                    f"# not taken over: {said} ({first.at}){why and ': ' + why}"
                )
            else:
                others.append(f"{sign}{word} ({first.at})")
        return ["", f"# Ignored: {', '.join(others)}"] if others else []


def _guessed(found: FileMesh, deck: Deck) -> tuple[str, str]:
    """Units of a file in which densities, moduli and extent are usual ones, and what says so."""
    extent = float(np.ptp(found.points[np.unique(found.cells)], axis=0).max())
    rho = {name: own["rho"] for name, own in deck.materials.items() if own.get("rho")}
    E = [np.max(own.get("E", own.get("C11", 0.0))) for own in deck.materials.values()]
    for units in SYSTEMS:
        m, kg, s = (
            factor_to_si(u, si, "--units")
            for u, si in zip(units.split(), ("m", "kg", "s"), strict=True)
        )
        usual = LENGTHS[0] <= extent * m <= LENGTHS[1]
        usual &= all(DENSITIES[0] <= r * kg / m**3 <= DENSITIES[1] for r in rho.values())
        usual &= all(MODULI[0] <= e * kg / m / s**2 <= MODULI[1] for e in E if e)
        if usual:
            said = [
                f"the density {r:g} of {name}: {r * kg / m**3:.6g} kg/m^3"
                for name, r in rho.items()
            ]
            return units, said[0] if said else f"the extent of {extent:g}"
    raise SceneError(
        f"--units: missing; no usual ones fit an extent of {extent:g} and the densities"
        f" {', '.join(f'{r:g}' for r in rho.values()) or '(none)'}; write such as --units mm t s"
    )
