"""Supports and forces along turned axes of their nodes, as such along x, y and z where they are.

The axes of *TRANSFORM of Abaqus and CalculiX, and of nodes of Ansys that are turned by angles.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import DeckKeyword

from . import abaqus_scope, keywords

Frame = tuple[tuple[float, ...], ...]
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
    whole: abaqus_scope.Scope, blocks: Sequence[DeckKeyword]
) -> tuple[list[DeckKeyword], list[tuple[DeckKeyword, str]]]:
    """Rows of *BOUNDARY and *CLOAD with global components.

    Args:
        whole: the assembly.
        blocks: what is in force, a row for each component.

    Returns:
        All blocks but *TRANSFORM, and what is left out, and why.
    """
    kept, lost, frame_of = list[DeckKeyword](), list[tuple[DeckKeyword, str]](), dict[int, Frame]()
    for block in (b for b in blocks if b.keyword == "TRANSFORM"):
        try:
            nodes = whole.members(whole.nsets, [block.options["NSET"]], "")
            if why := keywords.doubts(block)[0]:
                lost.append((block, why))
            plain = not (block.scope or why) and block.options.get("TYPE", "R").upper() == "R"
            frame_of |= dict.fromkeys(nodes, _frame(block.rows[0]) if plain else ())
        except (ValueError, IndexError, KeyError):
            lost.append((block, "its nodes or axes are not understood"))
    for block in (b for b in blocks if b.keyword != "TRANSFORM"):
        if frame_of and block.keyword in ("BOUNDARY", "CLOAD"):
            block = replace(block, rows=[*_global_rows(whole, frame_of, block, lost)])
            if not block.rows:
                continue
        kept.append(block)
    return kept, lost


def _global_rows(
    whole: abaqus_scope.Scope, frame_of: Mapping[int, Frame], block: DeckKeyword,
    lost: list[tuple[DeckKeyword, str]],
) -> Iterator[list[str]]:  # fmt: skip
    """Rows of a block with their global components; those that have none are lost."""
    held = {(row[0], row[1]) for row in block.rows if not float(row[-1])}
    for name, component, *rest in block.rows:
        rotation, c = divmod(int(component) - 1, 3)
        frame = _frame_of(whole, frame_of, name)
        clamped = block.keyword == "BOUNDARY" and {(name, word) for word in "123"} <= held
        if clamped or frame is None:  # along whatever axes
            yield [name, component, *rest]
        elif frame and (found := component_along(np.array(frame), c)):
            word = str(found[0] + 1 + 3 * rotation)
            last = [word] if len(rest) == 2 else []  # of *BOUNDARY, first and last component
            yield [name, word, *last, repr(found[1] * float(rest[-1]))]
        else:
            lost.append((block, f"{name}, {component}: {TURNED}"))


def _frame_of(whole: abaqus_scope.Scope, frame_of: Mapping[int, Frame], name: str) -> Frame | None:
    """Axes of all nodes of a set, () where they differ or are not understood, None without any."""
    try:
        used = {frame_of.get(n) for n in whole.members(whole.nsets, [name], "")}
    except SceneError:
        return None  # what is wrong with the set is said where it is used
    if used <= {None}:
        return None
    return used.pop() if len(used) == 1 else ()


def _frame(row: Sequence[str]) -> Frame:
    """Axes as rows of *TRANSFORM, TYPE=R: a point on the first one, a point in the plane of two."""
    a, b = np.array([float(word) for word in row]).reshape(2, 3)
    z = np.cross(a, b)
    axes = np.array([a, np.cross(z, a), z])
    length = np.linalg.norm(axes, axis=1)
    if not length.all():
        raise SceneError("two axes are parallel")
    return tuple(map(tuple, axes / length[:, None]))
