"""A first scene of a mesh file: what the file says, with proposals where it says nothing.

Comments say what was guessed or proposed, and name every keyword that was not taken over.
"""

import json
import os
from collections import Counter, defaultdict
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks import abaqus_scope, keywords
from brake_fenicsx.meshing import filemesh, meshfile
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.units import several

from .deck import read_deck
from .faces import MADE, bodies_of, clean, moving_part, proposed_motion
from .shells import solid_shells, write_abaqus
from .statements import Deck, Quantity, guessed_units, moduli, si, toml

# Sections about faces, and all in their order.
_ON_FACES = ("contact", "ties", "supports", "loads", "springs", "masses")
_ORDER = ("mesh", "mesh.groups", "parts", "materials", *_ON_FACES, "motion", "stability")
# A stiff penalty, friction, and faces that do not slide.
_SLIDES = {"law": {"linear": "2e13 Pa/m"}, "friction": 0.4}
_STUCK = {"law": _SLIDES["law"], "slip": "stuck", "tangential_stiffness": "1e12 Pa/m"}
_MISSING = '{ model = "isotropic", E = "207 GPa", nu = 0.28, rho = "7820 kg/m^3" }'
_HEAD = """\
# Written by brake-fenicsx init; comments say what is guessed or proposed, and what of the file is
# not taken over.{}
stages = {}
"""
_BAND = "5 kHz"
NEAR = 0.01  # distance of a reference node from the middle of its face, over a side
SAID = 8  # remarks on the terminal


def write_scene(
    deck: Path, scene: Path, units: Sequence[str] | None = None, solid: bool = False
) -> str:
    """Write a first scene of a mesh file.

    Args:
        deck: the mesh file.
        scene: the scene to write.
        units: units of length, mass and time of the file; guessed if None.
        solid: shells become layers of solids, in a mesh file beside the scene.

    Returns:
        What was written, in one line.

    Raises:
        SceneError: the file cannot be read, the units are unknown, or the scene is there already.
    """
    if deck.suffix == ".toml":
        raise SceneError(f"{deck}: is a scene; give the mesh file that it is to be of")
    mesh = scene.with_name(f"{scene.stem}_solid.inp") if solid else deck
    for file in (scene, mesh)[: 1 + solid]:
        if file.exists():
            raise SceneError(f"{file}: is there already; name another file with -o")
    try:
        found = meshfile.read_mesh_file(deck)
        read = read_deck(found, deck.suffix, solid)
        if solid:
            found = solid_shells(found, read.shells)
        if not len(found.cells):
            raise SceneError(filemesh.NO_CELLS)
        draft = Draft(found, read, units)
        text = draft.scene(os.path.relpath(mesh, scene.parent))
    except SceneError as error:
        raise SceneError(f"{deck}: {error}") from None
    if solid:
        write_abaqus(found, mesh)
    scene.write_text(text)
    faces = len(draft.bodies.faces)
    left = [line[2:] for line in text.splitlines() if line.startswith("# not taken over:")]
    made = f" and {mesh}" * solid
    said = f"{several(len(draft.bodies.boundary), 'part')}, {several(faces, 'face')}"
    more = [f"and {len(left) - SAID} more, as comments of the scene"] if len(left) > SAID else []
    return "\n".join([f"wrote {scene}{made}: {said}", *left[:SAID], *more])


class Draft:
    """Lines of a scene, section by section.

    Attributes:
        lines: section -> its lines.
        bodies: parts and faces of the file.
        units: of length, mass and time.
        parts: part -> layer -> material.
    """

    def __init__(self, found: filemesh.FileMesh, deck: Deck, units: Sequence[str] | None):
        self.found, self.deck = found, deck
        self.units, self.why = (" ".join(units), "") if units else guessed_units(found, deck)
        self.lines: dict[str, list[str]] = defaultdict(list)
        self.bodies = bodies_of(found, deck.sections, si(Quantity(1.0, "m"), self.units))
        self.parts: dict[str, dict[str, str]] = defaultdict(dict)
        for group, target in self.bodies.layers.items():
            part, _, layer = target.partition(".")
            name = deck.sections.get(group, clean(group))
            self.parts[part][layer] = abaqus_scope.find(deck.tables["materials"], name) or name

    def scene(self, file: str) -> str:
        """The whole text.

        Args:
            file: path of the mesh file, from the folder of the scene.
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
        tied = {face for tie in placed["ties"].values() for face in tie["faces"]}
        self._contact(placed.pop("contact"), tied)
        for section, table in placed.items():
            self._write(section, table)
        stages = ["equilibrium", "stability", "report"] if self.lines["stability"] else []
        self._unread()
        step = self.found.step and f"\n# The scene is of {self.found.step}."
        text = [_HEAD.format(step, json.dumps(stages))]
        for name in _ORDER:
            lines = self.lines[name]
            text += [f"[{name}]", *lines, ""] if lines else []
        return "\n".join(text)

    def _write(self, section: str, table: dict[str, Any], comment: str = "") -> None:
        for key, value in table.items():
            more = f"   # {comment}" if comment else ""
            self.lines[section].append(f"{dotted(key)} = {toml(value, self.units)}{more}")

    def _lost(self, section: str, text: str) -> None:
        self.lines[section].append(f"# not taken over: {text}")

    def _placed(self, section: str) -> dict[str, Any]:
        """The tables of a section, on faces of the scene."""
        placed: dict[str, Any] = {}
        for name, keys in self.deck.tables[section].items():
            for k, faces in enumerate(self._faces(section, name, keys)):
                if len(faces) > 1:
                    placed[f"{clean(name)}{k + 1 if k else ''}"] = keys | {"faces": faces}
                elif section == "supports":
                    before = placed.get(faces[0], "")
                    before = "xyz" if before == "clamped" else before
                    held = sorted({*before, *keys["along"]} & {*"xyz"})
                    placed[faces[0]] = "clamped" if len(held) == 3 else held
                elif section == "loads" and (before := placed.get(faces[0])):
                    both = " and ".join({**before, **keys})
                    self._lost(section, f"{name}: {both} twice on {faces[0]}: write their sum")
                else:
                    levered = self._levered(section, name, faces[0], keys)
                    placed[faces[0]] = placed.get(faces[0], {}) | levered
        return placed

    def _levered(self, section: str, name: str, face: str, keys: dict[str, Any]) -> dict[str, Any]:
        """Keys of what acts at a reference node away from the middle of its face."""
        own, unit = self.bodies.faces[face], si(Quantity(1.0, "m"), self.units)
        middle = np.average(own.centre, axis=0, weights=own.areas) / unit
        near, x = NEAR * np.sqrt(own.areas.sum()) / unit, self.found.points
        nodes = [node for node, group in self.deck.couplings.items() if group == name]
        if all(np.linalg.norm(x[node] - middle) <= near for node in nodes):
            return keys
        levers = [np.cross(x[node] - middle, force) for node, force in self.deck.levers[name]]
        if section != "loads":
            self._lost(section, f"{name}: its node is away from the middle of {face}")
        elif levers:
            given = keys.get("moment", [Quantity(0.0, "N m")] * 3)
            pairs = zip(given, filemesh.listed(np.sum(levers, axis=0)), strict=True)
            keys = keys | {"moment": [Quantity(q.value + more, "N m") for q, more in pairs]}
        return keys

    def _faces(self, section: str, name: str, keys: dict[str, Any]) -> list[list[str]]:
        """Faces, or pairs of them, of the scene that a table is on."""
        groups, each = keys.get("faces", [name]), []
        for group in groups:
            faces, why = self.bodies.faces_of(group)
            each.append(faces)
            if why:
                self._lost(section, f"{json.dumps(group)}: {why}")
        pairs = [[*pair] for pair in product(*each)]
        if len(pairs) > 1 and len(groups) > 1:
            pairs = [pair for pair in pairs if self.bodies.overlap(*pair)]
            if not pairs:
                self._lost(section, f"{name}: its faces do not lie on each other")
        elif len(pairs) > 1 and not {"along", "pressure"} & {*keys}:
            self._lost(section, f"{name}: of {', '.join(each[0])} together")
            return []
        return pairs

    def _parts(self) -> None:
        """Parts and materials; a material that the file does not have is a comment."""
        said = {block.options.get("TYPE", "").upper() for block in self.deck.mesh.blocks}
        for kind, count in self.found.elements.items():
            if kind not in said:  # whose keywords are named
                self._lost("parts", f"{count} {kind} elements")
        left = len(self.found.cells) - len(self.bodies.mesh.cells)
        if left:
            self._lost("parts", f"{several(left, 'cell')} without a material or a set")
        for part, layers in self.parts.items():
            names = [*dict.fromkeys(layers.values())]
            value = {"material": names[0] if len(names) == 1 else layers}
            comment = "layers share nodes; faces that slide need [mesh.split]"
            self._write("parts", {part: value}, comment if len(layers) > 1 else "")
        for name in dict.fromkeys(m for layers in self.parts.values() for m in layers.values()):
            own = self.deck.tables["materials"].get(name, {})
            if "model" in own:
                self._write("materials", {name: own})
            else:
                there = ", ".join(label for label in self.deck.constants.get(name, {}) if label)
                more = f"; the file has {there}" if there else ""
                self.lines["materials"].append(f"# missing: {dotted(name)} = {_MISSING}{more}")

    def _contact(self, own: dict[str, Any], tied: set[str]) -> None:
        """Contact with the moving part second, and what follows from it."""
        proposed = self._proposed(own, tied) if not own or self.deck.general else {}
        touching = sorted({f for keys in (own | proposed).values() for f in keys["faces"]})
        if not touching:
            return
        moving, motion = self._moving(touching)
        count = Counter[str]()
        for key, keys in (own | proposed).items():
            faces = sorted(keys["faces"], key=lambda face: _part(face) == moving)
            both = "_".join(map(_part, faces))
            number = f"_{count[both]}" if count[both] else ""
            count[both] += 1
            law = self.deck.laws.get((keys.get("interaction") or self.deck.interaction).upper(), {})
            slides = _part(faces[1]) == moving and "slip" not in law
            guess = _SLIDES if slides else _STUCK
            words = ["the faces touch; glued ones are [ties]"] if key in proposed else []
            words += [name for name in guess if name not in law]
            comment = f"proposed: {', '.join(words)}" if words else ""
            table = {"faces": faces} | {name: law.get(name, value) for name, value in guess.items()}
            self._write("contact", {f"{both}{number}": table}, comment)
        said = proposed_motion(self.bodies, moving, touching)
        self._write("motion", *((motion, "") if motion else said))
        self._stability()

    def _proposed(self, own: dict[str, Any], tied: set[str]) -> dict[str, Any]:
        """Contact of faces that lie on each other, but for those of the deck, its ties and gaps."""
        known = [{*keys["faces"]} for keys in own.values()]
        for pair in self.deck.apart:
            known += [{*faces} for faces in product(*(self.bodies.faces_of(n)[0] for n in pair))]
            self.lines["contact"].append(f"# out of contact: {', '.join(pair)}")
        free = (pair for pair in self.bodies.touching() if not tied & {*pair})
        return {"_".join(pair): {"faces": [*pair]} for pair in free if {*pair} not in known}

    def _moving(self, touching: list[str]) -> tuple[str, dict[str, Any] | None]:
        """The part that moves, and how the deck says that it does."""
        if self.deck.motion:
            name, motion = self.deck.motion
            parts = self.bodies.parts_with(self.deck.nodes(name)) & {*map(_part, touching)}
            if len(parts) == 1:
                return parts.pop(), motion
        else:
            motion = None
        materials = self.deck.tables["materials"]
        own = {p: [materials.get(m, {}) for m in v.values()] for p, v in self.parts.items()}
        stiff = {part: max([0.0, *moduli(tables)]) for part, tables in own.items()}
        return moving_part(self.bodies, touching, stiff), motion

    def _stability(self) -> None:
        """The band that the file asks modes of, and loss factors if a material has one."""
        low, high = self.found.band or (0.0, 0.0)
        band = [Quantity(low, "Hz") if low else "0 Hz", Quantity(high, "Hz") if high else _BAND]
        self._write("stability", {"band": band}, "" if high else "proposed")
        self._write("stability", {"method": "reduced"}, "proposed")
        used = [m for layers in self.parts.values() for m in layers.values()]
        if any("loss" in self.deck.tables["materials"].get(name, {}) for name in used):
            middle = Quantity(0.5 * high, "Hz") if high else "2.5 kHz"
            damping = {"loss": True, "omega_ref": middle}
            self._write("stability", {"damping": damping}, "proposed: omega_ref, of the loss")

    def _unread(self) -> None:
        """Put keywords that were not taken over in their places."""
        same: dict[tuple[str, str], list[filemesh.DeckKeyword]] = defaultdict(list)
        for block, why in self.deck.unread:
            same[block.keyword, why].append(block)
        for (word, why), (first, *more) in same.items():
            said = f"{first.said} ({first.at}{f' and {len(more)} more' if more else ''})"
            places = (
                p
                for p, starts in keywords.TABLES["places"].items()
                if word in starts or word.startswith(tuple(s for s in starts if len(s) > 2))
            )
            place = next(places, "ties")
            self._lost(place, f"{said}{why and ': ' + why}")


def _part(face: str) -> str:
    return face.partition(".")[0]
