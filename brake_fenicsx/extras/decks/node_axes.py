"""Supports and forces along turned axes of their nodes, as such along x, y and z where they are.

The axes of *TRANSFORM of Abaqus and CalculiX, and of nodes of Ansys that are turned by angles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import DeckKeyword

from .abaqus_keywords import doubts
from .abaqus_scope import Scope

Array = NDArray[np.float64]
# An axis is x, y or z within this cosine.
_ALONG = 1.0 - 1e-9
TURNED = "along axes of its nodes that are not x, y and z"


def component_along(axes: Array, component: int) -> tuple[int, float] | None:
    """The global axis, 0 to 2, that a turned axis lies on, and its sign; None of one in between.

    Args:
        axes: the three axes as rows.
        component: which of them, 0 to 2.
    """
    along = axes[component]
    place = int(np.argmax(np.abs(along)))
    return (place, float(np.sign(along[place]))) if abs(along[place]) > _ALONG else None


def along_global(
    whole: Scope, blocks: Sequence[DeckKeyword]
) -> tuple[list[DeckKeyword], list[tuple[DeckKeyword, str]]]:
    """Rows of *BOUNDARY and *CLOAD with global components.

    Args:
        whole: the assembly.
        blocks: what is in force, a row for each component.

    Returns:
        All blocks but *TRANSFORM, and what is left out, and why.
    """
    kept, lost = list[DeckKeyword](), list[tuple[DeckKeyword, str]]()
    frames = list[Array | None]()
    frame_of: dict[int, int] = {}
    for block in (b for b in blocks if b.keyword == "TRANSFORM"):
        try:
            nodes = whole.members(whole.nsets, [block.options["NSET"]], "")
            why = doubts(block)[0]
            lost += [(block, why)] if why else []
            known = not (block.scope or why)
            known &= block.options.get("TYPE", "R").upper() == "R"
            frames.append(_frame(block.rows[0]) if known else None)
            frame_of |= dict.fromkeys(nodes, len(frames) - 1)
        except (ValueError, IndexError, KeyError):
            lost.append((block, "its nodes or axes are not understood"))
    for block in (b for b in blocks if b.keyword != "TRANSFORM"):
        if not frame_of or block.keyword not in ("BOUNDARY", "CLOAD"):
            kept.append(block)
            continue
        rows, held = [], dict[str, set[str]]()
        for name, component, *_, value in block.rows:
            if block.keyword == "BOUNDARY" and not float(value):
                held.setdefault(name, set()).add(component)
        for row in block.rows:
            try:
                if held.get(row[0], set()) >= {"1", "2", "3"}:
                    rows.append(row)  # along whatever axes
                else:
                    rows.append(_global_row(whole, frames, frame_of, row))
            except SceneError as error:
                lost.append((block, f"{', '.join(row[:2])}: {error}"))
        kept += [replace(block, rows=rows)] if rows else []
    return kept, lost


def _global_row(
    whole: Scope, frames: Sequence[Array | None], frame_of: Mapping[int, int], row: list[str]
) -> list[str]:
    """A row with its global component."""
    try:
        used = {frame_of.get(n, -1) for n in whole.members(whole.nsets, row[:1], "")}
    except SceneError:
        return row  # what is wrong with the set is said where it is used
    if used <= {-1}:
        return row
    frame = frames[next(iter(used))] if len(used) == 1 else None
    rotation, c = divmod(int(row[1]) - 1, 3)
    found = None if frame is None else component_along(frame, c)
    if found is None:
        raise SceneError(TURNED)
    component = str(found[0] + 1 + 3 * rotation)
    value = repr(found[1] * float(row[-1]))
    return [row[0], component, *([component] if len(row) == 4 else []), value]


def _frame(row: Sequence[str]) -> Array:
    """Axes as rows of *TRANSFORM, TYPE=R: a point on the first one, a point in the plane of two."""
    a, b = np.array([float(word) for word in row]).reshape(2, 3)
    z = np.cross(a, b)
    axes = np.array([a, np.cross(z, a), z])
    length = np.linalg.norm(axes, axis=1)
    if not length.all():
        raise SceneError("two axes are parallel")
    return np.asarray(axes / length[:, None])
