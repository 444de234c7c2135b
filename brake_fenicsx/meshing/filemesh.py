"""What a mesh file holds, before its groups become parts and faces."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from brake_fenicsx.arguments import AnyArray, Array, Ints, Mask
from brake_fenicsx.errors import SceneError

from .rawmesh import CORNERS, FACETS, MIDDLES, facet_keys, facet_nodes_of_cell

# Kind of cell of meshio, Abaqus and Ansys -> (shape, nodes).
SOLIDS = {
    "tetra": ("tetrahedron", 4), "tetra10": ("tetrahedron", 10),
    "hexahedron": ("hexahedron", 8), "hexahedron20": ("hexahedron", 20),
    "hexahedron27": ("hexahedron", 27),
}  # fmt: skip
NO_CELLS = "the file has no tetrahedra or hexahedra; export the solid elements"
# Nodes and elements of an instance of a deck are numbered from a multiple of it on.
FAR = 10**10


@dataclass(slots=True)
class DeckKeyword:
    """A keyword of a deck that is no part of its mesh, and what stands below it.

    Attributes:
        keyword: in capitals, without asterisk; the name of a command or card of other decks.
        options: what follows the keyword, names in capitals.
        rows: words of its data lines.
        said: its first line.
        at: where it stands, "brake.inp:12".
        scope: the part or instance that it is in; "" for none.
    """

    keyword: str
    options: dict[str, str]
    rows: list[list[str]]
    said: str
    at: str
    scope: str = ""


@dataclass(slots=True)
class FileMesh:
    """Cells and groups of a mesh file; nodes of a cell in gmsh's order.

    Attributes:
        points: positions in the file's unit, shape (nodes, 3).
        shape: "tetrahedron" or "hexahedron".
        cells: nodes of each cell, shape (cells, nodes of a cell).
        cell_groups: name -> numbers of cells.
        facet_groups: name -> corner nodes of facets.
        node_groups: name -> nodes.
        shell_sets: names of those facet groups that are of shells alone -> whether they are sets
            of elements, no surfaces.
        shells: kind of shell or membrane -> nodes of each, shape (shells, 3, 4, 6 or 8).
        elements: kind of element that is not read -> number of them.
        blocks: keywords, commands or cards that are no part of the mesh, those in force at the
            step that the scene is of.
        lost: keyword that is not taken over, and why.
        step: the step that the scene is of, in words.
        band: lowest and highest frequency that it asks modes of.
        apart: pairs of surfaces that are taken out of contact.
        mass_factor: by which densities of the file are multiplied.
        labels: number of each cell in the file; its place from 1 on of files without numbers.
        numbers: number of a node in the file -> its place in ``points``.
        instances: instance of an assembly -> its part.
        advice: what to do where a group is missing, as the end of a sentence.
    """

    points: Array
    shape: str
    cells: Ints
    cell_groups: dict[str, Ints] = field(default_factory=dict)
    facet_groups: dict[str, Ints] = field(default_factory=dict)
    node_groups: dict[str, Ints] = field(default_factory=dict)
    shell_sets: dict[str, bool] = field(default_factory=dict)
    shells: dict[str, Ints] = field(default_factory=dict)
    elements: Mapping[str, int] = field(default_factory=dict)
    blocks: list[DeckKeyword] = field(default_factory=list)
    lost: list[tuple[DeckKeyword, str]] = field(default_factory=list)
    step: str = ""
    band: tuple[float, float] | None = None
    apart: list[list[str]] = field(default_factory=list)
    mass_factor: float = 1.0
    labels: Sequence[int] = ()
    numbers: Mapping[int, int] = field(default_factory=dict)
    instances: Mapping[str, str] = field(default_factory=dict)
    advice: str = ""

    def name_of(self, cell: int) -> int:
        """Number of a cell in the file or, of a deck, in its part."""
        return self.labels[cell] % FAR if self.labels else cell + 1

    def owned(self, name: str, scope: str) -> list[str]:
        """Names here of a set of a part, an instance, or the assembly ("")."""
        parts = self.instances.items()
        owners = [own for own, part in parts if scope.upper() in (part.upper(), own.upper())]
        return [f"{own}.{name}" for own in owners] or [name]

    def placed(self, rows: Iterable[Sequence[int]]) -> list[list[int]]:
        """Places of nodes for rows of their numbers in the file."""
        return [[self.numbers[n] for n in row] for row in rows]

    def inside(self, kind: str, name: str, facets: Ints) -> Mask:
        """Which facets are in a group.

        Args:
            kind: "facets", or "nodes": all corners of a facet are in the set.
            name: of the group.
            facets: corner nodes, shape (facets, corners).
        """
        if kind == "nodes":
            return np.asarray(np.isin(facets, self.node_groups[name]).all(axis=1))
        return np.isin(facet_keys(facets), facet_keys(self.facet_groups[name]))


def same_length(rows: Iterable[Sequence[int]]) -> Ints:
    """Corner nodes of facets; of triangles among quadrilaterals the largest number comes twice.

    So their key is that of the triangle.
    """
    table = [*rows]
    width = max(map(len, table))
    return np.array([[*row, *[max(row)] * (width - len(row))] for row in table])


def listed(x: AnyArray) -> Any:
    """An array as nested lists, of whatever shape."""
    return x.tolist()


def corners_of(shell: list[int]) -> list[int]:
    """Corner nodes of a shell of 3, 4, 6 or 8 nodes."""
    return shell[: 3 if len(shell) in (3, 6) else 4]


def numbered(
    nodes: Mapping[int, Sequence[float]],
    solids: Mapping[int, tuple[str, list[int]]],
    skins: Mapping[int, tuple[str, list[int]]],
    elements: Mapping[str, Sequence[int]],
    nodesets: Mapping[str, Sequence[int]],
) -> FileMesh:
    """Nodes, cells and shells of a deck and the groups of them, numbered from 0.

    Args:
        nodes: number -> position.
        solids: number -> kind and numbers of the nodes.
        skins: the same of shells.
        elements: name of a group -> numbers of elements, of others too.
        nodesets: name of a group -> numbers of nodes.

    Raises:
        SceneError: cells of several kinds, or a node that is not there.
    """
    kind = one_kind((kind for kind, _ in solids.values()), (len(own) for _, own in skins.values()))
    shape, count = SOLIDS[kind]
    place = {number: i for i, number in enumerate(nodes)}
    cell = {number: i for i, number in enumerate(solids)}
    try:
        cells = np.array([[place[n] for n in own] for _, own in solids.values()])
    except KeyError as error:
        raise SceneError(f"node {error.args[0] % FAR} of an element is not defined") from None
    points, cells = np.array(list(nodes.values()), float), cells.reshape(-1, count).astype(np.int64)
    mesh = FileMesh(
        points, shape, in_gmsh_order(points, cells, shape), numbers=place, labels=[*solids]
    )
    _add_groups(mesh, cell, skins, elements, nodesets)
    return mesh


def _add_groups(
    mesh: FileMesh, cell: Mapping[int, int], skins: Mapping[int, tuple[str, list[int]]],
    elements: Mapping[str, Sequence[int]], nodesets: Mapping[str, Sequence[int]],
) -> None:  # fmt: skip
    """Add groups and shells to a mesh, see ``numbered``; cell: number -> place."""
    for name, numbers in elements.items():
        if own := [cell[n] for n in numbers if n in cell]:
            mesh.cell_groups[name] = np.array(own)
        if faces := mesh.placed(corners_of(skins[n][1]) for n in numbers if n in skins):
            mesh.facet_groups[name] = same_length(faces)
            mesh.shell_sets[name] = True
    for kind in dict.fromkeys(kind for kind, _ in skins.values()):
        mesh.shells[kind] = np.array(mesh.placed(own for one, own in skins.values() if one == kind))
    for name, numbers in nodesets.items():
        (own,) = mesh.placed([[n for n in numbers if n in mesh.numbers]])
        mesh.node_groups[name] = np.array(own, dtype=np.int64)


def each_once(mesh: FileMesh, merge: bool) -> None:
    """Look for cells with the same corners, and for cells that have one of them twice.

    Args:
        mesh: the file, without copies afterwards.
        merge: a copy is another name of its cell, as gmsh 2.2 writes those of two groups.

    Raises:
        SceneError: copies that are no names, or collapsed cells.
    """
    corners = np.sort(mesh.cells[:, : CORNERS[mesh.shape]], axis=1)
    if (flat := np.flatnonzero((np.diff(corners, axis=1) == 0).any(axis=1))).size:
        raise SceneError(f"""element {mesh.name_of(int(flat[0]))} has a corner twice ({flat.size}
            such elements); mesh without collapsed cells""")
    _, first, place = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    if first.size == len(mesh.cells):
        return
    place = place.reshape(-1)
    if not merge:
        copy = int(np.setdiff1d(np.arange(place.size), first)[0])
        both = [int(first[place[copy]]), copy]
        one, two = map(mesh.name_of, both)
        copies = place.size - first.size
        raise SceneError(f"""elements {one} and {two} have the same corners ({copies} such copies in
            all); remove one of each pair""")
    order = np.argsort(first)
    number = np.argsort(order)[place]
    mesh.cells = mesh.cells[first[order]]
    mesh.cell_groups = {name: np.unique(number[own]) for name, own in mesh.cell_groups.items()}


def held_nodes(sign: str, held: Iterable[tuple[int, str]]) -> dict[str, list[int]]:
    """Nodes that a deck holds by their numbers, as sets: "*BOUNDARY xy" of those held along both.

    Args:
        sign: the keyword.
        held: number of a node and directions in which it is held.
    """
    along: dict[int, set[str]] = {}
    for number, directions in held:
        along.setdefault(number, set()).update(directions)
    sets: dict[str, list[int]] = {}
    for number, every in along.items():
        # Rotations of a node of solids mean nothing.
        if name := "".join(sorted(every - {"r"})):
            sets.setdefault(f"{sign} {name}", []).append(number)
    return sets


def in_gmsh_order(points: Array, cells: Ints, shape: str) -> Ints:
    """Cells of any program with nodes in gmsh's order: a middle node belongs to what it is next to.

    Each program has an order of its own for those of edges, faces and body, and readers differ from
    programs: meshio gives 20-node hexahedra of Exodus as in the file, not as in VTK (5.3.5).

    Args:
        points: positions, shape (nodes, 3).
        cells: nodes of each cell, corners first, shape (cells, nodes of a cell).
        shape: of the cells.

    Raises:
        SceneError: middle nodes are at no edges or faces.
    """
    n, x = CORNERS[shape], points[cells]
    order = [*range(n)]
    for some in [*MIDDLES[shape]][: cells.shape[1] - n]:
        centre = x[:, [*some]].mean(axis=1)[:, None]
        order.append(n + int(np.linalg.norm(x[:, n:] - centre, axis=2).sum(axis=0).argmin()))
    if len({*order}) < len(order) and len(cells):
        raise SceneError("middle nodes of its cells lie at no edges or faces of them")
    return np.asarray(cells[:, order])


def one_kind(kinds: Iterable[str], shells: Iterable[int] = ()) -> str:
    """The kind of all solid cells of a file, or that of layers made of its shells.

    Args:
        kinds: of the solid cells.
        shells: number of nodes of each shell.

    Raises:
        SceneError: there are several kinds, or none.
    """
    found, nodes = sorted(set(kinds)), {*shells}
    if not found and not nodes:
        raise SceneError(NO_CELLS)
    if not found:
        names = ("tetra10", "hexahedron20") if nodes & {6, 8} else ("tetra", "hexahedron")
        return names[nodes <= {4, 8}]
    if len(found) > 1 or found[0] not in SOLIDS:
        raise SceneError(f"""the file has cells of kind {", ".join(found)}; write all of one kind:
            {", ".join(SOLIDS)}""")
    return found[0]


def completed(points: Array, cells: Ints) -> tuple[Array, Ints]:
    """20-node hexahedra with the middle nodes of faces and body that serendipity implies.

    Args:
        points: positions, shape (nodes, 3).
        cells: 20 nodes of each hexahedron in gmsh's order.

    Returns:
        The points with the new ones behind, and 27 nodes of each cell.
    """
    facets = cells[:, np.array(FACETS["hexahedron"])]
    middles = np.array([facet_nodes_of_cell("hexahedron", f)[4:8] for f in FACETS["hexahedron"]])
    x = points[cells]
    centres = 0.5 * x[:, middles].sum(axis=2) - 0.25 * points[facets].sum(axis=2)
    _, first, number = np.unique(facet_keys(facets), return_index=True, return_inverse=True)
    shared = centres.reshape(-1, 3)[first]
    body = 0.25 * x[:, 8:20].sum(axis=1) - 0.25 * x[:, :8].sum(axis=1)
    start = len(points)
    number = number.reshape(len(cells), 6) + start
    own = start + len(shared) + np.arange(len(cells))
    return np.concatenate([points, shared, body]), np.column_stack([cells, number, own])
