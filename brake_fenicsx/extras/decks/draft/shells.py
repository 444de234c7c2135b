"""Shells of a deck made solid: one element through the thickness of each layer of their section.

The nodes of a shell lie on its reference surface, at ``offset`` from its middle. A node x is lifted
to x + z d for each boundary z of a layer, with d . n = 1 for the normals n of its shells (least
squares where there are more than three), so that curved and folded layers keep their thickness.
Nodes at z = 0 are those of the file: what shares them with a shell shares them with its layer.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.abaqus_scope import FACES
from brake_fenicsx.meshing import rawmesh, swept
from brake_fenicsx.meshing.filemesh import FileMesh, listed, same_length

from .shell_surface import (
    ShellSection,
    ShellSurface,
    check_edges,
    directions,
    shared_nodes,
    shell_surface,
)


def solid_shells(found: FileMesh, sections: Sequence[ShellSection]) -> FileMesh:
    """The file with the shells of all sections as cells.

    Args:
        found: the file.
        sections: of its shells.

    Returns:
        A set of shells is one of cells, "SET.1", "SET.2" of several layers; a surface of shells is
        a face of the layer, "SURFACE.SPOS" and "SURFACE.SNEG" where it names no side, and
        "SET.SPOS", "SET.SNEG" are those of a set. Nodes through the thickness join the sets of
        nodes, but for nodes that shells share with solids.

    Raises:
        SceneError: shells and sections of which no layer can be made.
    """
    if not sections:
        raise SceneError("""--shells solid: the file has no *SHELL SECTION, PSHELL or PCOMP; leave
            the option out""")
    surface = shell_surface(found, sections)
    check_edges(surface, sections)
    solid = shared_nodes(found, surface, sections)
    direction = directions(surface, sections)
    order = 2 if found.cells.shape[1] > rawmesh.CORNERS[found.shape] else 1
    points, cells, groups = surface.points, [found.cells], dict(found.cell_groups)
    low, high = surface.corners.copy(), surface.corners.copy()
    columns: dict[int, Ints] = {}
    for z in dict.fromkeys(sections[i].levels for i in np.unique(surface.section)):
        own = np.isin(surface.section, [i for i, one in enumerate(sections) if one.levels == z])
        nodes, local = np.unique(surface.flat[own], return_inverse=True)
        local = local.reshape(-1, surface.flat.shape[1])
        corners = local[:, : low.shape[1]]
        fine = np.interp(np.arange(order * (len(z) - 1) + 1) / order, np.arange(len(z)), z)
        lift = surface.points[nodes] + fine[:, None, None] * direction[nodes]
        number = len(points) + np.arange(fine.size * nodes.size).reshape(fine.size, -1)
        number[fine == 0.0] = nodes
        points = np.concatenate([points, lift.reshape(-1, 3)])
        columns |= dict(zip(listed(nodes), number.T, strict=True))
        low[own], high[own] = number[0][corners], number[-1][corners]
        for k in range(len(z) - 1):
            new = swept.lifted(corners if order == 1 else local, nodes.size, order * k)
            which, start = (
                np.tile(surface.section[own], len(new) // len(local)),
                sum(map(len, cells)),
            )
            for i in np.unique(which):
                groups[sections[i].sets[k]] = start + np.flatnonzero(which == i)
            cells.append(number.reshape(-1)[new][:, : found.cells.shape[1]])
    return replace(
        found, points=points, cells=_right_handed(points, np.concatenate(cells), found.shape),
        cell_groups=groups, facet_groups=_faces(found, surface, sections, low, high), shell_sets={},
        node_groups={n: _deep(own, columns, solid) for n, own in found.node_groups.items()},
        shells={},
    )  # fmt: skip


def _right_handed(points: Array, cells: Ints, shape: str) -> Ints:
    """Tetrahedra of positive volume; hexahedra are so, lifted along their normals."""
    if shape == "tetrahedron":
        x = points[cells[:, :4]]
        wrong = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
        order = rawmesh.permuted(shape, 2 if cells.shape[1] > 4 else 1, (1, 0, 2, 3))
        cells[wrong] = cells[wrong][:, order]
    return cells


def _faces(
    found: FileMesh, surface: ShellSurface, sections: Sequence[ShellSection], low: Ints, high: Ints
) -> dict[str, Ints]:
    """Groups of facets, those on shells as faces of the layers."""
    groups: dict[str, Ints] = {}
    for name, facets in found.facet_groups.items():
        rest, sides = list[list[int]](), {"SPOS": list[list[int]](), "SNEG": list[list[int]]()}
        for key, row in zip(listed(rawmesh.facet_keys(facets)), listed(facets), strict=True):
            corners = [*dict.fromkeys(row)]
            if key not in surface.parts:
                rest.append(corners)
                continue
            a, b = surface.start[key]
            ahead = corners[(corners.index(a) + 1) % len(corners)] == b
            side, own = ("SPOS", high) if ahead else ("SNEG", low)
            sides[side] += listed(own[surface.parts[key]])
        if not found.shell_sets.get(name):  # others are cells
            if all(sides.values()):
                groups |= {f"{name}.{side}": np.array(own) for side, own in sides.items()}
            else:
                rest += sides["SPOS"] + sides["SNEG"]
        if rest:
            groups[name] = same_length(rest)
    for i, one in enumerate(sections):
        mine = surface.section == i
        for side, own in (("SPOS", high), ("SNEG", low)):
            groups.setdefault(f"{one.group}.{side}", own[mine])
    return groups


def _deep(nodes: Ints, columns: dict[int, Ints], solid: set[int]) -> Ints:
    """A set of nodes with all through the thickness of the layers, but for those on solids."""
    more = [columns[n] for n in listed(nodes) if n in columns and n not in solid]
    return np.unique(np.concatenate([nodes, *more]))


def write_abaqus(found: FileMesh, path: Path) -> None:
    """Write cells and groups as a flat .inp file, in the unit that they have."""
    shape, count = found.shape, found.cells.shape[1]
    corners, used = rawmesh.CORNERS[shape], np.unique(found.cells)
    # Middle nodes of Abaqus: lower, upper and upright edges, body, faces.
    n = len(FACES[shape][0])
    low = [(i, (i + 1) % n) for i in range(n)]
    high = [(i + 4, j + 4) for i, j in low if n == 4]
    upright = [(i, i + 4 if n == 4 else 3) for i in range(n)]
    middles = (*low, *high, *upright, range(8), *FACES[shape])[: count - corners]
    order = [*range(corners), *(rawmesh.MIDDLES[shape][frozenset(some)] for some in middles)]
    lines = ["** Written by brake-fenicsx init --shells solid", "*NODE"]
    rows = zip(listed(used), listed(found.points[used]), strict=True)
    lines += [f"{i + 1}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in rows]
    lines.append(f"*ELEMENT, TYPE=C3D{count}")
    for number, nodes in enumerate(listed(found.cells[:, order] + 1), 1):
        lines += _rows([number, *nodes])
    for word, groups in (("ELSET", found.cell_groups), ("NSET", found.node_groups)):
        for name, own in groups.items():
            kept = own if word == "ELSET" else own[np.isin(own, used)]
            if kept.size:
                lines += [f'*{word}, {word}="{name}"', *_rows(listed(np.unique(kept) + 1))]
    table = found.cells[:, np.array(FACES[shape])]
    keys, place = np.unique(rawmesh.facet_keys(table), return_index=True)
    for name, facets in found.facet_groups.items():
        at = place[np.isin(keys, rawmesh.facet_keys(facets))]
        if facets.shape[1] == table.shape[2] and at.size:
            cell, face = np.divmod(at, table.shape[1])
            lines.append(f'*SURFACE, NAME="{name}"')
            lines += [f"{c + 1}, S{f + 1}" for c, f in zip(listed(cell), listed(face), strict=True)]
    path.write_text("\n".join(lines) + "\n")


def _rows(numbers: list[int]) -> list[str]:
    """Numbers in lines of 16 at most, a comma at the end of all but the last."""
    rows = [numbers[i : i + 16] for i in range(0, len(numbers), 16)]
    ends = [","] * (len(rows) - 1) + [""]
    return [", ".join(map(str, row)) + end for row, end in zip(rows, ends, strict=True)]
