"""The reduced bodies in the brake: each one itself, or a mirror image of another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .component import Component
from .substructure import MirrorImage, Substructure, mirror_image, turned_across

Array = NDArray[np.float64]
Index = NDArray[np.intp]


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


def placed(
    components: list[Component], images: list[tuple[int, MirrorImage | None, Substructure]]
) -> list[Placed]:
    """The bodies of the brake, their kept modes one after the other.

    Args:
        components: the originals, reduced.
        images: what ``originals_and_images`` says of every body.
    """
    out, first = [], 0
    for i, image, body in images:
        modes = slice(first, first + components[i].W.shape[1])
        first = modes.stop
        signs = np.ones(body.dofs.size) if image is None else image.signs
        own = body if image is None else image.body
        out.append(Placed(components[i], own.elements, own.dofs, signs, modes))
    return out
