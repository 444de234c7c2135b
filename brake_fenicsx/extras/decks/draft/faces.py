"""Bodies and faces of a mesh file that nobody has named yet: groups that are proposed, what moves.

Bodies that share nodes are one part, each set of cells with a material a layer of it. A set of
nodes or a surface is a face of each part on whose boundary it lies; a facet has one face at most.
"""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain, combinations, count, takewhile
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from brake_fenicsx.arguments import Array, Ints, Mask
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.meshing.filemesh import FileMesh
from brake_fenicsx.meshing.groups import layers_of
from brake_fenicsx.meshing.rawmesh import CORNERS, EDGES, RawMesh, boundary, facet_keys
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.units import quantity_text, several

from .statements import axis_key

# Names that a program makes, where it has others.
MADE = re.compile(r"(Volume|Surface|Line)\d+|(.*\.)?_.*|\*.*|D \w+")
# Facets lie on each other within this share of their side, and face each other by this cosine.
APART, OPPOSED = 0.1, -0.9
# Share of a face that lies on another one, from which contact is proposed.
TOUCHING = 0.3

# Two sides of a round part differ by this share at most.
ROUND = 0.02


class BoundaryFacets(NamedTuple):
    """Facets of a part's boundary: corner nodes, area vectors outwards [m^2] and centres [m]."""

    corners: Ints
    vector: Array
    centre: Array

    @property
    def keys(self) -> NDArray[np.uint64]:
        """Number of each facet."""
        return facet_keys(self.corners)

    def where(self, which: Mask) -> BoundaryFacets:
        """Some of the facets."""
        return BoundaryFacets(self.corners[which], self.vector[which], self.centre[which])

    @property
    def areas(self) -> Array:
        """Area of each facet [m^2]."""
        return np.asarray(np.linalg.norm(self.vector, axis=1))

    def text(self) -> str:
        """Area and mean normal, for a person."""
        area, mean = self.areas.sum(), self.vector.sum(axis=0)
        length = np.linalg.norm(mean)
        middle = 1e3 * np.average(self.centre, axis=0, weights=self.areas)
        normal, place = (
            ", ".join(f"{v + 0.0:.4g}" for v in np.round(x, digits))
            for x, digits in ((mean / (length or 1.0), 2), (middle, 3))
        )
        plane = f"normal ({normal})" if length > 0.1 * area else "no common normal"
        return f"{1e6 * area:.4g} mm^2, {plane}, middle ({place}) mm"

    def lies_on(self, other: BoundaryFacets) -> float:
        """Share of the area that faces another face without a gap."""
        side = np.sqrt(other.areas.mean())
        away, near = cKDTree(other.centre).query(self.centre)
        n, m = (face.vector / face.areas[:, None] for face in (self, other))
        height = np.einsum("ij,ij->i", self.centre - other.centre[near], m[near])
        on = (away < side) & (np.abs(height) < APART * side)
        on &= np.einsum("ij,ij->i", n, m[near]) < OPPOSED
        return float(self.areas[on].sum() / self.areas.sum())


def clean(name: str) -> str:
    """A name of a file as one of a scene."""
    word = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return word if word[:1].isalpha() else f"set_{word}"


@dataclass(slots=True)
class FileParts:
    """Parts, layers and faces of a file, with the lines of [mesh.groups] that name them.

    Attributes:
        found: the file.
        mesh: its cells by part and layer, in metres.
        layers: group of cells -> "part.layer".
        boundary: of each part.
        faces: "part.face" -> facets.
        groups: lines of [mesh.groups] on faces.
    """

    found: FileMesh
    mesh: RawMesh
    layers: dict[str, str]
    boundary: dict[str, BoundaryFacets]
    faces: dict[str, BoundaryFacets] = field(default_factory=dict)
    groups: list[str] = field(default_factory=list)
    _of: dict[str, tuple[list[str], str]] = field(default_factory=dict)

    def faces_of(self, group: str) -> tuple[list[str], str]:
        """Names of the faces that a group is, named now if it has none; or why there is none."""
        if group not in self._of:
            # A surface of shells may have two sides.
            every = [group, *(f"{group}.{side}" for side in ("SPOS", "SNEG"))]
            several = [name for name in every if find(self.found.facet_groups, name)]
            own = [self._named(name) for name in several or [group]]
            names = [name for faces, _ in own for name in faces]
            self._of[group] = names, "" if len(own) > 1 and names else own[0][1]
        return self._of[group]

    def _named(self, group: str) -> tuple[list[str], str]:
        tables = {"facets": self.found.facet_groups, "nodes": self.found.node_groups}
        known = ((kind, find(table, group)) for kind, table in tables.items())
        kind, name = next(((kind, name) for kind, name in known if name), ("", ""))
        own = self._on_parts(kind, name) if kind else {}
        whole = any(len(f.corners) == len(self.boundary[p].corners) for p, f in own.items())
        if not kind:
            return [], "no surface or set of nodes"
        if not own or whole:
            return [], "the whole boundary of a part" if whole else "no facet of a boundary"
        names: dict[str, BoundaryFacets] = {}
        for part, face in own.items():
            same, twice = self._known(face)
            if twice and not same:
                return [], f"{face.text()}; shares facets with {twice}"
            stem = clean(name).removeprefix(f"{part}_") or "face"
            names[same or _free(f"{part}.{stem}", self.faces, "")] = face
        if not names.keys() <= self.faces.keys():
            sure = find(self.found.cell_groups, name) is None
            key = dotted(name if sure else f"{kind}:{name}")
            value = json.dumps(next(iter(names)) if len(names) == 1 else [*names])
            texts = "; ".join(face.text() for face in names.values())
            self.groups.append(f"{key} = {value}   # {texts}")
            self.faces |= names
        left = self._left(name, own.values()) if kind == "nodes" else 0
        return [*names], f"{several(left, 'node')} on no whole facet of it" if left else ""

    def _left(self, name: str, faces: Iterable[BoundaryFacets]) -> int:
        """Nodes of a set, corners and middles of edges, that its facets do not have."""
        edges, first = EDGES[self.found.shape], CORNERS[self.found.shape]
        own, on, used = np.zeros((3, len(self.found.points)), dtype=bool)
        own[self.found.node_groups[name]] = True
        cells = self.found.cells[own[self.found.cells].any(axis=1)]
        used[cells[:, : first + len(edges)]] = True
        on[np.concatenate([face.corners.ravel() for face in faces])] = True
        for place, ends in enumerate(edges[: cells.shape[1] - first], first):
            on[cells[on[cells[:, ends]].all(axis=1), place]] = True
        return int(np.count_nonzero(own & used & ~on))

    def _known(self, face: BoundaryFacets) -> tuple[str, str]:
        """Names of a face with these facets, and of one with some of them; "" without any."""
        shares = {n: np.isin(f.keys, face.keys) for n, f in self.faces.items()}
        same = (n for n, on in shares.items() if on.all() and on.size == len(face.corners))
        return next(same, ""), next((n for n, on in shares.items() if on.any()), "")

    def _on_parts(self, kind: str, name: str) -> dict[str, BoundaryFacets]:
        """Facets of a surface, or with all corners in a set of nodes, on the boundaries."""
        wanted = self.found.facet_groups[name] if kind == "facets" else np.zeros((0, 3), int)
        if kind == "facets" and wanted.shape[1] != 3 + (self.mesh.shape == "hexahedron"):
            return {}
        every = self.boundary.items()
        own = {p: face.where(self.found.inside(kind, name, face.corners)) for p, face in every}
        own = {part: face for part, face in own.items() if len(face.corners)}
        lost = sum(len(face.corners) for face in own.values()) < np.unique(facet_keys(wanted)).size
        return {} if lost else own

    def parts_with(self, nodes: Ints) -> set[str]:
        """Parts that have some of the nodes."""
        return {
            p for p in self.boundary if np.isin(self.mesh.cells[self.mesh.part(p)], nodes).any()
        }

    def touching(self) -> list[tuple[str, str]]:
        """Faces of different parts that lie on each other."""
        pairs = combinations(self.faces, 2)
        apart = ((a, b) for a, b in pairs if a.partition(".")[0] != b.partition(".")[0])
        return [pair for pair in apart if self.overlap(*pair) > TOUCHING]

    def overlap(self, first: str, second: str) -> float:
        """Share of a face that lies on another one, of the smaller face."""
        one, other = self.faces[first], self.faces[second]
        return max(one.lies_on(other), other.lies_on(one))


def _free(name: str, taken: Container[str], sign: str) -> str:
    """A name, with the first number that makes it one that is not taken."""
    tries = chain([name], (f"{name}{sign}{k}" for k in count(2)))
    return next(one for one in tries if one not in taken)


def bodies_of(found: FileMesh, sections: Iterable[str], metres: float) -> FileParts:
    """Parts and layers of a file.

    Args:
        found: the file.
        sections: groups of cells that have a material.
        metres: its unit of length [m].

    Raises:
        SceneError: the file names no cells.
    """
    groups = [name for name in sections if name in found.cell_groups] or _partition(found)
    if not groups:
        raise SceneError(f"no set of cells; write one for each part and layer{found.advice}")
    layers = _layer_names(found, groups)
    kinds = {group: ("cells", group) for group in groups}
    mesh = layers_of(found, metres * found.points, found.cells, dict(layers), kinds)
    return FileParts(found, mesh, layers, {part: _boundary(mesh, part) for part in mesh.parts()})


def _partition(found: FileMesh) -> list[str]:
    """Sets of cells that do not overlap: the small ones, or the large ones if they hold more."""
    best: tuple[int, list[str]] = (0, [])
    named = [name for name in found.cell_groups if not MADE.fullmatch(name)]
    for names, sign in ((named, 1), (named, -1), ([*found.cell_groups], 1)):
        free, taken = np.ones(len(found.cells), dtype=bool), []
        for name in sorted(names, key=lambda name: sign * len(found.cell_groups[name])):
            if free[found.cell_groups[name]].all():
                free[found.cell_groups[name]] = False
                taken.append(name)
        best = max(best, (int(np.count_nonzero(~free)), taken), key=lambda one: one[0])
    return [name for name in found.cell_groups if name in best[1]]


def _layer_names(found: FileMesh, groups: list[str]) -> dict[str, str]:
    """Group -> "part.layer"; groups whose cells share nodes are layers of one part."""
    rows = [np.unique(found.cells[found.cell_groups[group]]) for group in groups]
    ends = np.cumsum([0, *map(len, rows)])
    shape = len(rows), len(found.points)
    on = sp.csr_matrix((np.ones(ends[-1]), np.concatenate(rows), ends), shape)
    _, label = sp.csgraph.connected_components(on @ on.T, directed=False)
    names: dict[str, str] = {}
    for number in dict.fromkeys(label.tolist()):
        mine = [g for g, n in zip(groups, label, strict=True) if n == number]
        own = [clean(group) for group in mine]
        words = zip(*(name.split("_") for name in own), strict=False)
        part = "_".join(w[0] for w in takewhile(lambda w: len({*w}) == 1, words)) or own[0]
        owner = mine[0].rpartition(".")[0]
        part = re.sub(r"(?<=.)_(body|solid)$", "", part)
        part = clean(owner) if owner in found.instances else part
        part = _free(part, {target.partition(".")[0] for target in names.values()}, "_")
        layers = [name.removeprefix(f"{part}_") for name in own] if len(own) > 1 else ["body"]
        names |= {g: f"{part}.{layer}" for g, layer in zip(mine, layers, strict=True)}
    return {group: names[group] for group in groups}


def _boundary(mesh: RawMesh, part: str) -> BoundaryFacets:
    """Boundary facets of a part."""
    facets, cells = boundary(mesh, part)
    x = mesh.points[facets]
    # Half the product of the diagonals of a quadrilateral, of two sides of a triangle.
    vector = 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1])
    away = x.mean(axis=1) - mesh.points[mesh.corners[cells]].mean(axis=1)
    outwards = np.sign(np.einsum("ij,ij->i", vector, away))
    return BoundaryFacets(facets, vector * outwards[:, None], x.mean(axis=1))


def moving_part(bodies: FileParts, touching: Iterable[str], stiffness: Mapping[str, float]) -> str:
    """The part with the largest faces in contact, of equal ones the stiffer: the disc.

    Args:
        bodies: all parts.
        touching: faces in contact.
        stiffness: part -> modulus.
    """
    area: dict[str, float] = defaultdict(float)
    for face in touching:
        area[face.partition(".")[0]] += bodies.faces[face].areas.sum()
    return max(area, key=lambda part: (round(area[part], 9), stiffness[part]))


def proposed_motion(
    bodies: FileParts, part: str, touching: Iterable[str]
) -> tuple[dict[str, Any], str]:
    """Keys of [motion]: about the middle of a round part, or along the long side of another one.

    Args:
        bodies: all parts.
        part: the one that moves.
        touching: faces in contact.
    """
    own = [bodies.faces[face] for face in touching if face.startswith(f"{part}.")]
    vectors = np.concatenate([face.vector for face in own])
    weights = np.linalg.norm(vectors, axis=1)
    _, axes = np.linalg.eigh(vectors.T @ (vectors / weights[:, None]))
    whole, n = bodies.boundary[part], axes[:, 2]
    sides = np.ptp(whole.centre @ axes[:, :2], axis=0)
    if np.ptp(sides) > ROUND * sides.max():
        along = axes[:, int(np.argmax(sides))]
        return {"direction": _vector(along)}, f"proposed: the long side of {part}"
    keys: dict[str, Any] = {"axis": axis_key(_vector(n))}
    middle = np.average(whole.centre, axis=0, weights=whole.areas)
    if np.linalg.norm(middle - (middle @ n) * n) > ROUND * sides.max():
        keys["point"] = [quantity_text(float(x), "m") for x in middle]
    return keys | {"speed": "5 rad/s"}, f"proposed: across the contact faces of {part}"


def _vector(x: Array) -> list[float]:
    """A direction with rounded components, the largest one 1."""
    x = np.round(x / x[np.argmax(np.abs(x))], 3)
    return [float(v) + 0.0 for v in x]
