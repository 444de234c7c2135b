"""The offline stage of an ensemble's bodies: how each is seen, one of a kind solved for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from ..reduction import CUTOFF, ORDER
from .anchors import Anchors
from .at_anchors import Varied, solve_at_anchors
from .bodies import Body, looked_at
from .congruent import Image, image_of
from .fixed import damped_body, fixed_body
from .proportion import Box, Damping, Proportion, proportion
from .varied import VariedBody
from .view import Arrays, ImageBody, Seen

Array = NDArray[np.float64]

# Modes of bodies of variable stiffness are kept up to the first multiple of the band, since nothing
# of a sample is corrected later, and known up to the second.
VARIED_CUTOFF = (2.0, 2.2)

# sigma as a share of the highest kappa of the band: moments about -sigma lose the digits that the
# lowest modes, which have none of their own on free bodies, would cost them about zero.
SHIFT = 0.05


@dataclass(frozen=True, slots=True)
class Reach:
    """Up to where bodies are known, by the end of the band.

    Attributes:
        omega: end of the band [rad/s].
    """

    omega: float

    @property
    def sigma(self) -> float:
        """Shift [1/s^2]."""
        return SHIFT * self.omega**2

    @property
    def limit(self) -> float:
        """No mode of a body below it is missing [1/s^2]."""
        return CUTOFF**2 * self.omega**2


def see_bodies(
    bodies: Sequence[Body],
    damping: Damping | None,
    box: tuple[Anchors, Callable[[Array], Array], int],
    reach: Reach,
    comm: MPI.Comm,
    progress: Callable[[int], Callable[[int], None]],
    known: Sequence[Arrays] | None,
) -> tuple[list[Seen], list[Proportion]]:
    """See the bodies of a brake.

    Args:
        bodies: the bodies.
        damping: of the samples; None without.
        box: anchors, coefficients of all unit changes at a point, and the number of these.
        reach: up to where.
        comm: processes that share the work.
        progress: called with this process's number of anchors; what it returns is called with the
            number done.
        known: ``arrays`` of all bodies of the same problem, made earlier.

    Returns:
        The bodies, and the damping of each.

    Raises:
        InaccurateResult: as ``EnsembleBasis`` does.
    """
    names = "N" if damping is None else damping.names
    images = _images(bodies)
    hows: list[Proportion] = []
    for body, image in zip(bodies, images, strict=True):
        hows.append(proportion(body, damping, reach.omega) if image is None else hows[image[0]])
    boxes = {
        i: Box(box[:2], body, how, box[2], reach.omega**2)
        for i, (body, how, image) in enumerate(zip(bodies, hows, images, strict=True))
        if image is None
    }
    advance = progress(-(-sum(b.work for b in boxes.values()) // comm.size))
    seen: list[Seen] = []
    for i, image in enumerate(images):
        if image is not None:
            seen.append(ImageBody(image[1], seen[image[0]]))
            continue
        # What an earlier run saw as an image has no arrays of its own.
        made = (None if known is None else known[i]) or None
        anchors = boxes[i].anchors
        if anchors is None:
            seen.append(_fixed(boxes[i], reach, names, comm, made))
        else:
            seen.append(_varied(boxes[i], anchors, reach, names, comm, made, advance))
    return seen, hows


def _fixed(box: Box, reach: Reach, names: str, comm: MPI.Comm, made: Arrays | None) -> Seen:
    """A body that is the same in every sample."""
    body = fixed_body(box.body, reach.sigma, reach.limit, ORDER, comm, made, names)
    return damped_body(body, box.body, reach.sigma, names, comm, made) if box.series else body


def _varied(
    box: Box, anchors: Anchors, reach: Reach, names: str, comm: MPI.Comm, made: Arrays | None,
    advance: Callable[[int], None],
) -> Seen:  # fmt: skip
    """A body that is another one in every sample."""
    body, n = box.body, box.body.N.shape[0]
    kept, limit = (factor**2 * reach.omega**2 + reach.sigma for factor in VARIED_CUTOFF)
    seen, sigma = looked_at(body, names), reach.sigma
    varied = Varied(seen, box.coefficients, anchors, sigma, kept, limit, box.stretched)
    if made is None:
        made = solve_at_anchors(varied, body.T, ORDER, comm, advance)
    return VariedBody(varied, names, n, body.T.shape[0] - n, made)


def _images(bodies: Sequence[Body]) -> list[tuple[int, Image] | None]:
    """For each body an earlier one that it is the image of, if there is any."""
    out: list[tuple[int, Image] | None] = []
    for i, body in enumerate(bodies):
        originals = (j for j in range(i) if out[j] is None)
        found = ((j, image_of(bodies[j], body)) for j in originals)
        out.append(next(((j, image) for j, image in found if image is not None), None))
    return out
