"""A mesh with its groups as a flat deck of Abaqus."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from brake_fenicsx.extras.decks.abaqus_scope import FACES
from brake_fenicsx.meshing.filemesh import FileMesh, gmsh_order, listed
from brake_fenicsx.meshing.rawmesh import facet_keys


def write_abaqus(found: FileMesh, path: Path) -> None:
    """Write cells and groups as a flat .inp file, in the unit that they have."""
    shape, count = found.shape, found.cells.shape[1]
    order, used = np.argsort(gmsh_order(shape, count)), np.unique(found.cells)
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
    keys, place = np.unique(facet_keys(table), return_index=True)
    for name, facets in found.facet_groups.items():
        at = place[np.isin(keys, facet_keys(facets))]
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
