"""The reduced bodies in the brake: each one itself, or a mirror image of another one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .component import Component
from .moments import Rows
from .parameters import Parameters
from .substructure import MirrorImage, Substructure, mirror_image, turned_across

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# What the names of a body's arrays begin with.
BODY = "body"


@dataclass(frozen=True, slots=True)
class Placed:
    """A reduced body in the brake: itself, or a mirror image of it.

    Attributes:
        component: the reduced body.
        elements: its contact elements among all.
        dofs: its free dofs among all.
        signs: displacement over that of the reduced body, shape (dofs,).
        modes: places of its kept modes among all.
    """

    component: Component
    elements: Index
    dofs: Index
    signs: Array
    modes: slice


def square_of(at: Index, down: int = 0, right: int = 0) -> tuple[Any, Any]:
    """Rows and columns of some elements; as slices where they can be, ten times as fast.

    Args:
        at: numbers of the elements.
        down: row of the first element of all.
        right: column of the first element of all.
    """
    if at.size and np.array_equal(at, np.arange(at[0], at[0] + at.size)):
        first, last = int(at[0]), int(at[0]) + at.size
        return slice(down + first, down + last), slice(right + first, right + last)
    rows, columns = np.ix_(at + down, at + right)
    return rows, columns


def originals_and_images(
    substructures: Sequence[Substructure],
) -> tuple[list[Substructure], list[tuple[int, MirrorImage | None, Substructure]]]:
    """Bodies that are reduced, and for each body its original and how it mirrors that.

    Args:
        substructures: the bodies of the brake.

    Returns:
        The originals; for each body the number of its original, how it mirrors that (None for the
        original itself), and the body.
    """
    originals: list[Substructure] = []
    out: list[tuple[int, MirrorImage | None, Substructure]] = []
    for body in substructures:
        for i, first in enumerate(originals):
            image = mirror_image(first, body)
            if image is not None:
                out.append((i, image, body))
                break
        else:
            out.append((len(originals), None, body))
            originals.append(body)
    other = [image.body.elements for _, image, _ in out if image is not None and image.across]
    if other:
        originals = [turned_across(body, np.concatenate(other)) for body in originals]
    return originals, out


def image_arrays(
    images: list[tuple[int, MirrorImage | None, Substructure]],
) -> dict[str, NDArray]:
    """Original, contact elements, dofs and signs of each body, for ``placed``.

    Args:
        images: what ``originals_and_images`` says of every body.
    """
    out: dict[str, NDArray] = {}
    for number, (i, image, body) in enumerate(images):
        own = body if image is None else image.body
        signs = np.ones(body.dofs.size) if image is None else image.signs
        given = {"original": np.array(i), "elements": own.elements, "dofs": own.dofs}
        out |= {f"{BODY}{number}.{n}": a for n, a in {**given, "signs": signs}.items()}
    return out


def placed(
    groups: Mapping[str, dict[str, NDArray]], rows: Rows, parameters: Parameters, omega: float
) -> list[Placed]:
    """The bodies of the brake, their kept modes one after the other.

    Args:
        groups: arrays of each original, by its number, and of ``image_arrays``.
        rows: blocks of contact rows.
        parameters: of all bodies.
        omega: end of the band [rad/s].
    """
    components: dict[str, Component] = {}
    out, first = [], 0
    for number in range(sum(name.startswith(BODY) for name in groups)):
        own = groups[f"{BODY}{number}"]
        i = str(int(own["original"]))
        if i not in components:
            components[i] = Component(groups[i], rows, parameters, omega)
        modes = slice(first, first + components[i].W.shape[1])
        first = modes.stop
        out.append(Placed(components[i], own["elements"], own["dofs"], own["signs"], modes))
    return out
