"""Groups of a mesh file to parts, layers and faces; bodies that share nodes are split."""

import difflib
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import extras, load

from .filemesh import NO_CELLS, FileMesh, completed
from .meshfile import read_mesh_file
from .rawmesh import (
    RawMesh,
    exterior_facets,
    facet_keys,
    facet_nodes,
    orientation,
    turned,
    without_unused_nodes,
)

Faces = dict[str, Ints]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class GroupedFile:
    """A mesh file and what its groups are.

    Attributes:
        folder: from which the file is named.
        file: its name.
        unit: unit of its lengths.
        metres: that unit [m].
        extent: smallest and largest accepted extent of the mesh [m].
        groups: group of the file -> "part.layer" of cells, "part.face" or several of facets, nodes.
        split: face whose nodes are duplicated -> face of the other body with the original nodes.
    """

    folder: Path
    file: str
    unit: str
    metres: float
    extent: tuple[float, ...]
    groups: Mapping[str, str | list[str]]
    split: Mapping[str, str] = field(default_factory=dict)


def mesh_of_file(
    given: GroupedFile, parts: Iterable[str], displaced: tuple[str, str] | None = None
) -> RawMesh:
    """Read a mesh file and name its parts and faces.

    Args:
        given: the file and its groups.
        parts: names of the parts that have no builder.
        displaced: a file with other places of the same nodes, and the key that names it.

    Returns:
        The mesh in metres, right-handed, bodies apart.

    Raises:
        SceneError: the file, its unit, a group or a cell is wrong.
    """
    found = _read(given.folder, given.file, "mesh.file")
    if displaced is not None:
        other = _read(given.folder, *displaced)
        sizes = [(len(mesh.points), len(mesh.cells)) for mesh in (other, found)]
        same = sizes[0] == sizes[1] and np.array_equal(other.cells, found.cells)
        if not same or [*other.numbers] != [*found.numbers]:
            raise SceneError(f"""{displaced[1]} = {displaced[0]!r}: is another mesh ({sizes[0][0]}
                nodes and {sizes[0][1]} cells, in mesh.file {sizes[1][0]} and {sizes[1][1]}) or is
                numbered otherwise; move nodes of mesh.file and export it again""")
        found = replace(found, points=other.points)
    cells, points = found.cells, found.points * given.metres
    _check_extent(points[np.unique(cells)], given)
    if cells.shape[1] == 20:
        points, cells = completed(points, cells)
    kinds = {group: _kind(found, group, target) for group, target in given.groups.items()}
    mesh = layers_of(found, points, cells, given.groups, kinds)
    _check_names(mesh, parts)
    faces: Faces = {}
    for group, target in given.groups.items():
        if kinds[group][0] != "cells":
            faces |= _faces(found, mesh, group, target, kinds[group])
    file = Path(given.file)
    for extra in extras():
        if extra.unread and file.suffix in extra.readers:
            unread = load(extra.unread)(file, found, faces, kinds.values())
            mesh = replace(mesh, unread=unread)
    return without_unused_nodes(_turned_right(_apart(mesh, faces, given.split)))


def _read(folder: Path, file: str, key: str) -> FileMesh:
    try:
        found = read_mesh_file(folder / file)
        if not len(found.cells):
            raise SceneError(NO_CELLS)
    except SceneError as error:
        raise SceneError(f"{key} = {file!r}: {error}") from None
    return found


def _check_extent(used: Array, given: GroupedFile) -> None:
    """Refuse a mesh whose extent tells of a wrong unit; its nodes in use [m]."""
    extent, (low, high) = float(np.ptp(used, axis=0).max()), given.extent
    if not low <= extent <= high:
        raise SceneError(f"""mesh.unit = {given.unit!r}: the mesh would be {extent:.3g} m long, not
            between {low:g} m and {high:g} m; correct the unit, or widen mesh.extent""")


def _kind(found: FileMesh, group: str, target: str | list[str]) -> tuple[str, str]:
    """What a group of the scene is in the file: "cells", "facets" or "nodes", and its name.

    A name that stands for several may be told apart as "cells:NAME", "facets:NAME", "nodes:NAME".
    """
    tables = {kind: getattr(found, f"{kind[:-1]}_groups") for kind in ("cells", "facets", "nodes")}
    prefix, colon, rest = group.partition(":")
    if colon and prefix in tables:
        tables, group = {prefix: tables[prefix]}, rest
    for plain in (str, lambda name: name.strip('"').upper()):
        for kind, groups in tables.items():
            for name in groups:
                if plain(name) == plain(group):
                    return kind, name
    known = sorted({name for groups in tables.values() for name in groups})
    near = difflib.get_close_matches(group, known, 1)
    there = f"there are {', '.join(known) or 'none'}{found.advice}"
    hint = f"did you mean {near[0]!r}?" if near else there
    raise SceneError(f'mesh.groups."{group}" = {target!r}: no such group in the file; {hint}')


def layers_of(
    found: FileMesh, points: Array, cells: Ints, groups: Mapping[str, str | list[str]], kinds: dict
) -> RawMesh:
    """Cells of the named groups only."""
    tag = np.zeros(len(cells), dtype=np.int64)
    layers: dict[str, int] = {}
    for group, target in groups.items():
        kind, name = kinds[group]
        if kind != "cells":
            continue
        if not isinstance(target, str):
            raise SceneError(f"""mesh.groups."{group}" = {target!r}: a group of cells is in one
                part; write "{target[0]}" """)
        own = found.cell_groups[name]
        number = layers.setdefault(target, len(layers) + 1)
        taken = np.unique(tag[own][(tag[own] > 0) & (tag[own] != number)])
        if taken.size:
            other = next(layer for layer, t in layers.items() if t == taken[0])
            raise SceneError(f"""mesh.groups."{group}" = {target!r}: some of its cells are in
                {other!r} already; name groups that do not overlap""")
        tag[own] = number
    if not layers:
        raise SceneError(f"""mesh.groups: no group of cells is named; there are
            {", ".join(sorted(found.cell_groups)) or "none in the file" + found.advice}""")
    left = int(np.count_nonzero(tag == 0))
    if left:
        logger.info("%d cells of the mesh file are in no named group and left out", left)
    none = np.zeros((0, 3 if found.shape == "tetrahedron" else 4), dtype=np.int64)
    keep = tag > 0
    return RawMesh(
        points, found.shape, cells[keep], tag[keep], none, np.zeros(0, np.int64), layers, {}
    )


def _check_names(mesh: RawMesh, parts: Iterable[str]) -> None:
    """Every part of the scene without builder is in the groups, and no other."""
    wanted, there = list(parts), mesh.parts()
    for name in there:
        if name not in wanted:
            near = difflib.get_close_matches(name, wanted, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"write [parts.{name}]"
            raise SceneError(f"mesh.groups: there is no part {name!r} without builder; {hint}")
    for name in wanted:
        if name not in there:
            raise SceneError(f"""parts.{name}: neither builder nor cells; give it a builder, or name
                its cells in mesh.groups as "{name}.LAYER" """)


def _faces(
    found: FileMesh, mesh: RawMesh, group: str, target: str | list[str], kind: tuple[str, str]
) -> Faces:
    """Corner nodes of the facets of a face, or of one on each of several parts.

    They are taken from the boundary of its part.
    """
    where, faces = f'mesh.groups."{group}" = {target!r}', Faces()
    boundaries = []
    for face in [target] if isinstance(target, str) else target:
        part = face.partition(".")[0]
        if part not in mesh.parts():
            raise SceneError(f"{where}: no part {part!r} has cells in the file")
        boundary = exterior_facets(mesh, part)
        if kind[0] == "facets" and found.facet_groups[kind[1]].shape[1] != boundary.shape[1]:
            raise SceneError(f"{where}: its facets are no faces of the cells")
        inside = found.inside(*kind, boundary)
        if kind[0] == "nodes" and not inside.any():
            raise SceneError(f"""{where}: no facet of the boundary of {part!r} has all its corners
                in this set of nodes""")
        faces[face] = boundary[inside]
        boundaries.append(facet_keys(boundary))
    if kind[0] == "facets":
        keys = np.unique(facet_keys(found.facet_groups[kind[1]]))
        missing = int(np.count_nonzero(~np.isin(keys, np.concatenate(boundaries))))
        empty = [face for face, own in faces.items() if not len(own)]
        if missing or not keys.size or empty:
            parts = ", ".join(repr(face.partition(".")[0]) for face in empty or faces)
            raise SceneError(f"""{where}: {missing or keys.size} of {keys.size} facets do not lie on
                the boundary of {parts}""")
    return faces


def _apart(mesh: RawMesh, faces: Faces, split: Mapping[str, str]) -> RawMesh:
    """The mesh with its faces, and nodes doubled where that is asked for.

    Args:
        mesh: cells without faces.
        faces: face name -> corner nodes of its facets.
        split: face on the body that gets new nodes -> face on the body that keeps them.
    """
    cells, points = mesh.cells.copy(), mesh.points
    moved: dict[str, Ints] = {}
    for face, other in split.items():
        if face not in faces:
            raise SceneError(f"""mesh.split."{face}": no such face; there are
                {", ".join(sorted(faces))}""")
        part, partner = face.partition(".")[0], other.partition(".")[0]
        own = mesh.part(part)
        rest = np.unique(cells[mesh.part(partner)])
        on_face = _all_nodes(mesh, part, faces[face])
        double = np.intersect1d(on_face, rest)
        if double.size == 0:
            raise SceneError(f"""mesh.split."{face}" = {other!r}: the bodies share no node there;
                leave it out""")
        facets = faces[face]
        both = facets[np.isin(facet_keys(facets), facet_keys(exterior_facets(mesh, partner)))]
        faces[other] = _together(faces.get(other), both)
        number = moved.setdefault(part, np.arange(len(mesh.points)))
        double = double[number[double] == double]
        number[double] = len(points) + np.arange(double.size)
        points = np.concatenate([points, points[double]])
        cells[own] = number[mesh.cells[own]]
    _check_apart(mesh, cells)
    all_facets, tags = [mesh.facets], [mesh.facet_tag]
    names: dict[str, int] = {}
    for name, own_facets in faces.items():
        part = name.partition(".")[0]
        names[name] = len(names) + 1
        all_facets.append(moved[part][own_facets] if part in moved else own_facets)
        tags.append(np.full(len(own_facets), names[name]))
    _check_once(all_facets, tags, names)
    return replace(
        mesh,
        points=points,
        cells=cells,
        facets=np.concatenate(all_facets),
        facet_tag=np.concatenate(tags),
        faces=names,
    )


def _all_nodes(mesh: RawMesh, part: str, facets: Ints) -> Ints:
    """Nodes of some facets of a part, middle nodes included."""
    own = mesh.part(part)
    only = replace(mesh, cells=mesh.cells[own], cell_tag=mesh.cell_tag[own], facets=facets)
    return np.unique(facet_nodes(only))


def _together(one: Ints | None, two: Ints) -> Ints:
    """Facets of both, each once."""
    both = two if one is None else np.concatenate([one, two])
    _, first = np.unique(facet_keys(both), return_index=True)
    return np.asarray(both[np.sort(first)])


def _check_apart(mesh: RawMesh, cells: Ints) -> None:
    """Bodies may not share nodes."""
    nodes = {name: np.unique(cells[mesh.part(name)]) for name in mesh.parts()}
    names = list(nodes)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            shared = np.intersect1d(nodes[a], nodes[b]).size
            if shared:
                raise SceneError(f"""mesh.split: parts {a!r} and {b!r} share {shared} nodes; double
                    them as mesh.split = {{ "{a}.FACE" = "{b}.FACE" }}, or make them layers of one
                    part""")


def _check_once(facets: list[Ints], tags: list[Ints], names: Mapping[str, int]) -> None:
    """A facet has one name."""
    keys, tag = facet_keys(np.concatenate(facets)), np.concatenate(tags)
    order = np.argsort(keys, kind="stable")
    twice = np.flatnonzero(np.diff(keys[order].astype(np.int64)) == 0)
    if twice.size:
        a, b = (next(n for n, t in names.items() if t == tag[order[twice[0] + k]]) for k in (0, 1))
        raise SceneError(f"""mesh.groups: faces {a!r} and {b!r} have {twice.size} facets in common;
            a facet may have one name""")


def _turned_right(mesh: RawMesh) -> RawMesh:
    """Cells written in the left-handed order are turned, and said so."""
    wrong = orientation(mesh) < 0
    if wrong.any():
        logger.info("%d cells of the mesh file were left-handed and are turned", int(wrong.sum()))
        mesh = turned(mesh, wrong)
    return mesh
