"""The reduced model that the samples share: made once, kept in the results folder."""

from __future__ import annotations

import time
from dataclasses import fields
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.log import Progress, logger
from brake_fenicsx.macro.brake import Brake
from brake_fenicsx.macro.condensation import Compliance
from brake_fenicsx.macro.contact import Contact
from brake_fenicsx.macro.solver import Factor, local_rows
from brake_fenicsx.scene import Stability
from brake_fenicsx.stability.damped_reduction import DampedReduced
from brake_fenicsx.stability.full.lanczos import lowest_modes
from brake_fenicsx.stability.reduced.basis import Basis
from brake_fenicsx.stability.reduced.damped_basis import DAMPED_ORDER
from brake_fenicsx.stability.reduction import ORDER, Reduced
from brake_fenicsx.stability.terms import Terms
from brake_fenicsx.store import Store

from .numbering import Numbering

Array = NDArray[np.float64]

FILE, SHAPES, DAMPED_FILE = "cache/basis.npz", "cache/shapes.npz", "cache/damped.npz"

# Real modes up to this multiple of the band tell modes apart where there is no reduced model.
FAMILIES = 1.3


def reduced_model(
    stability: Stability,
    brake: Brake,
    K: PETSc.Mat,
    M: PETSc.Mat,
    k0: Array,
    store: Store,
    comm: MPI.Comm,
    numbering: Numbering,
    order: int = ORDER,
) -> tuple[Reduced, dict[str, Any]]:
    """Make the reduced model, or load it; collective.

    Args:
        stability: band and cutoff.
        brake: operators of the scene.
        K: its stiffness [N/m], whole on this process.
        M: its mass [kg], likewise.
        k0: reference stiffness [Pa/m], shape (elements,).
        store: the results folder.
        comm: processes that share the work.
        numbering: order of the dofs in the folder.
        order: largest order of its moments; 0 where all its samples are damped.

    Returns:
        The model, and its figures for the summary.
    """
    known = _cached(store, numbering, order, k0)
    progress = Progress("interface columns", -(-len(brake.w) // comm.size))
    band = (stability.band[0], stability.band[1])
    start = time.perf_counter()
    reduced = Reduced(
        K, M, brake.N, brake.T, brake.w, k0, band, stability.cutoff, comm, progress.advance, known,
        order,
    )  # fmt: skip
    basis = reduced.basis
    if known is None and comm.rank == 0:
        arrays = {f.name: np.asarray(getattr(basis, f.name)) for f in fields(basis)}
        store.save(FILE, shapes=numbering.kept(reduced.Phi), **arrays)
    return reduced, {
        "real_modes": len(basis.Lambda),
        "complete_up_to_hz": float(np.sqrt(basis.limit) / 2 / np.pi),
        "seconds": time.perf_counter() - start,
        **{f"seconds_{name}": value for name, value in reduced.seconds.items()},
    }


def compliance_of(reduced: Reduced, f: Array) -> Compliance:
    """The bodies seen from their contact elements, under loads f [N]: part of the basis."""
    basis, factor = reduced.basis, reduced.factor
    return Compliance(
        factor, basis.k0, basis.compliance[0], basis.compliance[1], reduced.N @ factor.solve(f)
    )


def family_shapes(
    factor: Factor,
    M: PETSc.Mat,
    highest: float,
    store: Store,
    comm: MPI.Comm,
    numbering: Numbering,
) -> Array:
    """Real modes of the reference that families are followed in, shape (dofs, modes); collective.

    They are kept: an eigensolver may return them with other signs.

    Args:
        factor: factor of the reference, on every process.
        M: mass [kg], whole on this process.
        highest: upper end of the band [Hz].
        store: the results folder.
        comm: processes that want them.
        numbering: order of the dofs in the folder.
    """
    limit = (2 * np.pi * FAMILIES * highest) ** 2
    shapes: Array | None = None
    if comm.rank == 0:
        stored = store.load(SHAPES)
        if stored is None:
            shapes = lowest_modes(factor, local_rows(M), limit).Phi
            store.save(SHAPES, shapes=numbering.kept(shapes))
        else:
            shapes = numbering.present(stored["shapes"])
    return np.asarray(comm.bcast(shapes, root=0))


def damped_model(
    reduced: Reduced, terms: Terms, contact: Contact, store: Store, comm: MPI.Comm
) -> DampedReduced:
    """Add the damping of a scene to its reduced model, or load it; collective.

    Args:
        reduced: the model without.
        terms: damping terms of the scene.
        contact: its contact elements.
        store: the results folder.
        comm: processes that share the work.

    Raises:
        InaccurateResult: the bodies are damped too strongly.
    """
    stored = store.load(DAMPED_FILE)
    known = None
    k0 = reduced.basis.k0
    # Moments of another order or reference are of no use.
    same = stored is not None and len(stored["G"]) == DAMPED_ORDER + 1
    if stored is not None and same and np.array_equal(stored.get("k0", 0.0), k0):
        logger.info("reduced damping: from the cache")
        known = list(stored["G"])
    elements, modes = reduced.basis.Phi_N.shape
    columns = elements * (1 + terms.slope + terms.sliding) + modes * (terms.bulk is not None)
    progress = Progress("damped columns", -(-columns // comm.size))
    model = DampedReduced(
        reduced, terms.bulk, contact.R, terms.slope, terms.sliding, comm, progress.advance, known
    )
    if known is None and comm.rank == 0:
        store.save(DAMPED_FILE, G=np.array(model.basis.G), k0=k0)
    return model


def _cached(
    store: Store, numbering: Numbering, order: int, k0: Array
) -> tuple[Basis, Array] | None:
    """Basis and mode shapes that an earlier run left; None if there are none of this kind."""
    stored = store.load(FILE)
    # Older programs kept the shapes in an order of their own, and had another reference.
    if stored is None or len(stored["NN"]) != order + 1 or "shapes" not in stored:
        return None
    if not np.array_equal(stored["k0"], k0):
        return None
    logger.info("reduced basis: from the cache")
    values: dict[str, Any] = {f.name: stored[f.name] for f in fields(Basis)}
    for name in ("NN", "NT", "compliance"):
        values[name] = tuple(values[name])
    values["limit"] = float(values["limit"])
    return Basis(**values), numbering.present(stored["shapes"])
