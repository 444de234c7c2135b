"""What the interpolation over a box reaches: errors of modes, and degrees that lower them.

The offline stage knows the bodies at the anchors and at two points between them. With the contact
of a typical sample these give the estimated errors of modes as the samples will state them. Where
too many exceed the tolerance, the parameters whose highest degree changes the modes most get more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import log

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.log import logger

from ..modes import relative_errors
from .contact_rows import SIGMA, ContactLinearisation
from .error_estimates import SAFETY
from .parameters import BETWEEN
from .reduced_model import ReducedModel

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Share of the modes at the points asked whose errors may exceed the tolerance: of modes that nearly
# merge they do at any degree.
ALLOWED = 0.1

# What one degree more gains at least, most degrees more at a time, the highest degree, and points
# of a body that are not exceeded.
GAIN, MORE, HIGHEST, MOST = 5.0, 6, 14, 150

# The interpolation is not what makes errors of which it has less than this share.
ELSEWHERE = 0.01

# Modes below this share of the band, or of its square, count with it.
NEAR_ZERO = 1e-2

# What is left of a range that is said to hold, for the scatter of errors over it; parameters that
# make this share of the largest part of the errors are narrowed together.
MARGIN, ALIKE = 0.7, 0.1


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A tolerance that is not reached over a box.

    Attributes:
        missed: modes at the points asked whose estimated errors exceed it.
        modes: all of them.
        error: largest error of these over |lambda|.
        usual: error that ``ALLOWED`` of them exceed.
        each: what the highest degree in each parameter makes of them, shape (d,).
        wide: numbers of the parameters that make most of them.
        share: part of their ranges, about the centre, that should hold the tolerance.
    """

    missed: int
    modes: int
    error: float
    usual: float
    each: Array
    wide: Index
    share: float


def shortfall(
    model: ReducedModel, contact: ContactLinearisation, tolerance: float
) -> Shortfall | None:
    """What a model lacks; None where the tolerance holds at the points asked, or no range is why.

    Args:
        model: the model.
        contact: of a typical sample.
        tolerance: wanted relative error of lambda.
    """
    if not model.parameters.dimension:
        return None
    errors = _errors(model, contact)
    usual = float(np.quantile(errors, 1 - ALLOWED)) if errors.size else 0.0
    if usual <= tolerance:
        return None
    each, missed = _of_each_parameter(model, contact), int(np.sum(errors > tolerance))
    if not each.max() > ELSEWHERE * usual:
        return None
    wide = np.flatnonzero(each >= ALIKE * each.max())
    # An interpolation of degree n errs with the power n + 1 of a small width, less of a large one.
    share = MARGIN * (tolerance / usual) ** (1 / model.orders[wide].min())
    return Shortfall(missed, errors.size, float(errors.max()), usual, each, wide, share)


def higher(
    model: ReducedModel,
    contact: ContactLinearisation,
    tolerance: float,
    points: Callable[[Index], int],
) -> Index | None:
    """Degrees in each parameter with which the tolerance may hold.

    Args:
        model: the model.
        contact: of a typical sample.
        tolerance: wanted relative error of lambda.
        points: of the box where a body is computed with some degrees.

    Returns:
        Shape (d,); None where it holds already, or higher ones cost too much.
    """
    lacking, orders = shortfall(model, contact, tolerance), model.orders
    if lacking is None:
        return None
    # A parameter of a tenth of the error needs so many degrees less.
    share = lacking.usual / tolerance * lacking.each / lacking.each.max()
    wanted = np.ceil(np.log(np.maximum(share, 1.0)) / log(GAIN)).astype(int)
    most = max(MOST, points(orders))
    for less in range(wanted.max()):
        found = np.minimum(orders + np.clip(wanted - less, 0, MORE), np.maximum(HIGHEST, orders))
        if np.any(found > orders) and points(found) <= most:
            names = np.array(model.parameters.names or range(orders.size), dtype=str)
            logger.info(
                "reduced model: errors up to %.0e over the range of %s; made again, of degree %d",
                lacking.error, ", ".join(names[found > orders]), found.max(),
            )  # fmt: skip
            return np.asarray(found)
    return None


def _errors(model: ReducedModel, contact: ContactLinearisation) -> Array:
    """Estimated errors of modes over |lambda| at the centre, between anchors and at corners."""
    between = np.resize(BETWEEN, model.parameters.dimension)
    errors = []
    for x in (0 * between, between, -between, np.sign(between), -np.sign(between)):
        modes = model.modes(x, contact)
        errors.append(relative_errors(modes.s, modes.error))
    every = np.concatenate(errors)
    return np.asarray(every[~np.isnan(every)])


def _of_each_parameter(model: ReducedModel, contact: ContactLinearisation) -> Array:
    """What the highest degree in each parameter makes of the stated errors, shape (d,)."""
    dimension = model.parameters.dimension
    # z is lambda or its square, but for a shift.
    rates, out = model.rows.rates, np.zeros(dimension)
    zero, factor = (-model.rows.shift, SAFETY) if rates else (SIGMA, 0.5 * SAFETY)
    for j in range(dimension):
        largest = [0.0]
        for side in (BETWEEN[0], -BETWEEN[0]):
            x = side * np.eye(dimension)[j]
            # The first estimate is the step from one degree lower: here other parameters add none.
            views = [replace(view, errors=view.errors[:1]) for view in model.at(x)]
            found, _, errors = model.quotient(model.sample(x, contact, views))
            largest += list(factor * errors / np.maximum(np.abs(found.z - zero), NEAR_ZERO))
        out[j] = np.quantile(largest, 1 - ALLOWED)
    return out
