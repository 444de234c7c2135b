"""The offline stage: the bodies of a brake, each once, made into a reduced model."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from math import ceil, log10
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

from brake_fenicsx.arguments import frequency_band
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.processes import in_turns

from .component import image_arrays, originals_and_images
from .contact_rows import ContactLinearisation, Rows
from .parameters import CONSTANT, Parameters
from .reach import higher
from .reduced_model import ReducedModel
from .reduction import Reduction, kept_modes
from .substructure import Substructure

Index = NDArray[np.intp]

# Relative error that five points in kappa reach, with degree 4 over a box of materials, and how
# much one degree and one point more gain: measured on two blocks in perfect contact, moduli +-20 %.
REACHED, GAIN = 1e-5, 12.0


def reduce_bodies(
    substructures: Sequence[Substructure],
    w: ArrayLike,
    band: tuple[float, float],
    parameters: Parameters = CONSTANT,
    followed: str = "N",
    tolerance: float = 1e-5,
    cutoff: float | None = None,
    contact: ContactLinearisation | None = None,
    comm: MPI.Comm = MPI.COMM_SELF,
    progress: Callable[[int], Callable[[int], None]] = lambda total: lambda done: None,
    keep: Callable[[dict[str, NDArray[Any]]], Mapping[str, NDArray[Any]]] | None = None,
) -> ReducedModel:
    """Reduce the bodies of a brake; collective.

    Args:
        substructures: the bodies, see ``split_substructures``.
        w: areas of all contact elements [m^2], shape (elements,).
        band: lowest and highest frequency [Hz].
        parameters: box of the materials; constant ones by default.
        followed: motions whose rates or values contact forces follow: "N", with "T" (falling
            friction) and "R" (sliding damping) where they act.
        tolerance: wanted relative error of lambda; more points and higher degrees below 1e-5.
        cutoff: kept modes reach up to this frequency [Hz]; chosen from the softening of the box
            if None.
        contact: of a typical sample. Where estimated errors with it exceed the tolerance, the
            degree is raised and the work done again (``reach``); never if None.
        comm: processes that share the work.
        progress: called with the number of factors of this process; what it returns is called
            with the number of those that were done since.
        keep: called by all processes with what the first one made (nothing on others); what
            it returns is what each process works with. All get their own copy if None.

    Raises:
        SceneError: a band, cutoff or tolerance that is none.
        InaccurateResult: a body is not positive definite somewhere in the box, an inertia count
            finds a mode missing, a factor is wrong, or damping is too strong.
    """
    start, band = time.perf_counter(), frequency_band(band)
    if cutoff is not None and not cutoff > band[1]:
        raise SceneError(f"cutoff {cutoff:g} Hz must lie above the band's {band[1]:g} Hz")
    damped = any(body.C is not None or body.ratios for body in substructures)
    rows, omega = Rows(followed, damped), 2 * np.pi * band[1]
    degrees = _degrees(tolerance, rows)
    reach = None if cutoff is None else cutoff / band[1]
    bodies, images = originals_and_images(substructures, parameters)
    modes = [
        *in_turns(len(bodies), lambda i: kept_modes(bodies[i], parameters, omega, reach), comm)
    ]

    def planned(orders: Index) -> list[Reduction]:
        more = int(max(orders, default=degrees[0])) - degrees[0]
        levels = tuple(degree + more for degree in degrees)
        return [
            Reduction(body, kept, rows, parameters, levels, orders, omega, comm)
            for body, kept in zip(bodies, modes, strict=True)
        ]

    def computed(orders: Index) -> dict[str, NDArray[Any]]:
        reductions = planned(orders)
        arrays: dict[str, NDArray[Any]] = {}
        advance = progress(sum(reduction.factors for reduction in reductions))
        # The largest body takes most memory: it comes before the values of others are there.
        for i in sorted(range(len(bodies)), key=lambda i: -bodies[i].dofs.size):
            arrays |= {f"{i}.{name}": a for name, a in reductions[i].arrays(advance).items()}
        if comm.rank > 0:
            return {}
        arrays |= {**image_arrays(images), "orders": orders, "followed": np.array(followed)}
        seconds = time.perf_counter() - start
        return {**arrays, "damped": np.array(damped), "seconds": np.array(seconds)}

    def made(orders: Index) -> ReducedModel:
        arrays = computed(orders)
        held = _on_all(arrays, comm) if keep is None else keep(arrays)
        return ReducedModel(held, w, band, parameters)

    def points(orders: Index) -> int:
        return max(reduction.points for reduction in planned(orders))

    model = made(np.full(parameters.dimension, degrees[0]))
    while contact is not None:
        orders = comm.bcast(higher(model, contact, tolerance, points))
        if orders is None:
            break
        model = made(orders)
    return model


def _degrees(tolerance: float, rows: Rows) -> tuple[int, ...]:
    """Degree of the interpolation of each coefficient in w; two of lambda for each of kappa."""
    if not 0 < tolerance < 1:
        raise SceneError(f"tolerance = {tolerance:g}: a relative error between 0 and 1 is needed")
    top = int(np.clip(4 + ceil(log10(REACHED / tolerance) / log10(GAIN) - 1e-9), 2, 8))
    # Measured: with one degree less for every two coefficients, these err about alike.
    if rows.damped:
        return tuple(max(1, top - (n + 3) // 4) for n in range(2 * top + 3))
    # Modes that grow as fast as they turn lie off the real axis of kappa.
    return tuple(max(1, top - (n + 1) // 2) for n in range(top + 1 + rows.rates))


def _on_all(arrays: dict[str, NDArray[Any]], comm: MPI.Comm) -> dict[str, NDArray[Any]]:
    """Arrays of the first process on all of them; collective."""
    return {name: comm.bcast(arrays.get(name)) for name in comm.bcast(list(arrays))}
