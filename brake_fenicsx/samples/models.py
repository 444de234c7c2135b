"""What the samples of a study share: brake, reduced models, compliance, coordinates of modes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array
from brake_fenicsx.build import damping_terms, parametric
from brake_fenicsx.errors import OfOneProcess
from brake_fenicsx.folder import files
from brake_fenicsx.folder.arrays import Arrays
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import in_turns, on_first, release_memory
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.equilibrium import Compliance, Condensed, Solves, UnitLoads, compliance
from brake_fenicsx.scene import Scene, Stability
from brake_fenicsx.scene.digest import bodies_key
from brake_fenicsx.stability.eigensolvers.symmetric import lowest_modes
from brake_fenicsx.stability.substructures import ReducedModel

from .numbering import FILE as DOFS
from .numbering import Numbering
from .reduced_models import ReducedModels

SHAPES, LAYERS = "cache/shapes.npz", "cache/layers.npz"
# Real modes up to this multiple of the band tell modes apart where there is no reduced model.
FAMILIES = 1.3
UNITS = {"_1_s": " 1/s", "_rad_s": " rad/s", "_m_s": " m/s", "_N_s_m": " N s/m", "_s": " s"}


class Models(OfOneProcess):
    """What the samples of a study share.

    Attributes:
        brake: the brake; ``brake.at(values)`` is that of a sample.
        reduction: its reduced models.
        loads: the scene's bodies seen from their contact elements, under its loads.
        coordinates: of modes; without modes none.
        numbering: tells the mesh and the bodies of the dofs; only with modes.
        stability: how modes are computed; None without modes.
        facts: for the summary.
    """

    brake: parametric.ParametricBrake
    loads: UnitLoads
    coordinates: "FamilyCoordinates"
    numbering: Numbering

    def __init__(
        self, scene: Scene, counts: Mapping[str, int], store: Store, comm: MPI.Comm,
        cache: files.SharedCache,
    ):  # fmt: skip
        """Ask what there could be.

        Args:
            scene: the scene.
            counts: number of samples of each approach.
            store: the results folder.
            comm: processes that share the work.
            cache: what the folder shares with others.
        """
        self._scene, self._counts = scene, counts
        self._store, self._comm, self._cache = store, comm, cache
        self.reduction = ReducedModels(scene, counts, store, cache, comm)
        self.stability: Stability | None = self.reduction.stability
        self.facts: dict[str, Any] = {}

    def prepare(self, k0: Array) -> None:
        """Make or load what the samples share, on springs k0 [Pa/m]; collective."""
        b, shapes = self.brake, None
        if self.stability is not None:
            with self._cache.shared(DOFS, lambda: bodies_key(self._scene), self._comm):
                self.numbering = Numbering(b, self._store, self._comm)
            self.reduction.prepare(b, self.numbering, k0)
            self.facts |= self.reduction.facts
            if acting := damping_terms.record(self._scene, b.contact):
                self.facts["damping"] = acting
            for term, numbers in acting.items():
                where = ", ".join(numbers["approaches"])
                said = [_said(n, x) for n, x in numbers.items() if n != "approaches"]
                logger.info("damping by '%s' (%s): %s", term, where, ", ".join(said))
        model = next(iter(self.reduction.models.values()), None)
        if model is not None:
            self.loads = _reduced_loads(model, b, k0)
            grams = layer_grams(model, b, self.numbering.mark, self._store, self._comm)
            self.coordinates = FamilyCoordinates(b, model, None, grams)
        else:
            whole = compliance(b.K, b.N, b.T, b.w, b.f, k0, self._comm)
            self.loads = UnitLoads(whole, b.N @ whole.solve(b.unit_loads))
            full = self.reduction.full
            many = any(self._counts[n] > 1 or self._scene.sweep for n in full)
            if self.stability is not None and many:
                depends = self.reduction.depends([float(k) for k in np.unique(k0)])
                with self._cache.shared(SHAPES, lambda: depends, self._comm):
                    given = b.M, self.stability.band[1], self._store, self._comm
                    shapes = reference_shapes(whole, *given)
            self.coordinates = FamilyCoordinates(b, None, shapes)
        release_memory()


def _reduced_loads(model: ReducedModel, brake: parametric.ParametricBrake, k0: Array) -> UnitLoads:
    """Compliance under unit loads as a reduced model knows it."""
    NN, NT, gaps = model.static(brake.at({}).point, k0)
    none, carried = 0 * brake.w, []
    for Nf in gaps.T:
        unit = Condensed(Compliance(None, k0, NN, NT, Nf, 0.0), brake.w, none, 0.0)
        carried.append(-float(np.sum(brake.w * k0 * unit.linear(1.0, none, k0))))
    return UnitLoads(Compliance(None, k0, NN, NT, gaps.sum(axis=1)), gaps, np.array(carried))


@dataclass(frozen=True, slots=True)
class FamilyCoordinates:
    """Coordinates that modes of any sample of a study are followed in.

    Those of the kept modes of a reduced model; of a study at full order those of real modes of the
    reference, if it has any.

    Attributes:
        brake: the brake.
        model: a reduced model of it.
        shapes: real modes, shape (dofs, modes).
        grams: mass of each layer between the kept modes of the reduced models, shape (kept modes,
            kept modes); none at full order.
    """

    brake: parametric.ParametricBrake
    model: ReducedModel | None
    shapes: Array | None
    grams: dict[str, Array] = field(default_factory=dict)

    def of(self, u: AnyArray) -> AnyArray | None:
        """Coordinates of displacements, shape (dofs, columns); None without any."""
        if self.model is not None:
            return self.model.coordinates(self.brake.central_mass, u)
        return None if self.shapes is None else self.shapes.T @ (self.brake.M @ u)

    def displacements(self, coordinates: AnyArray) -> AnyArray:
        """Displacements of modes by their coordinates alone.

        Args:
            coordinates: shape (coordinates, columns).

        Returns:
            Shape (dofs, columns).
        """
        if self.model is not None:
            return self.model.kept_displacements(coordinates)
        if self.shapes is None:
            raise ValueError("families have no coordinates")
        return np.asarray(self.shapes @ coordinates)


def layer_grams(
    model: ReducedModel, brake: parametric.ParametricBrake, mark: str, store: Store, comm: MPI.Comm
) -> dict[str, Array]:
    """Layers' masses of the kept modes, from the folder where they are there; collective.

    Args:
        model: the reduced model.
        brake: the brake, whose layers have masses.
        mark: tells the mesh.
        store: the results folder.
        comm: processes of the run.
    """

    def made() -> Arrays:
        each = in_turns(len(names), lambda i: model.coordinates(brake.layer_mass(names[i])), comm)
        return {f"of_{name}": gram for name, gram in zip(names, each, strict=True)}

    names = brake.layers
    kept = _kept(store, LAYERS, made, comm, f"{mark} {model.bodies[-1].modes.stop}")
    return {name.removeprefix("of_"): gram for name, gram in kept.items()}


def reference_shapes(
    factor: Solves, M: sp.csr_matrix, end: float, store: Store, comm: MPI.Comm
) -> Array:
    """Real modes of the reference that families are followed in, shape (dofs, modes); collective.

    They are kept: an eigensolver may return them with other signs.

    Args:
        factor: of the reference stiffness.
        M: mass [kg].
        end: of the band [Hz].
        store: the results folder.
        comm: processes of the run.
    """
    cutoff = (2 * np.pi * FAMILIES * end) ** 2

    def made() -> Arrays:
        return {"shapes": on_first(lambda: lowest_modes(factor, M, cutoff).Phi, comm)}

    return np.asarray(_kept(store, SHAPES, made, comm)["shapes"])


def _kept(
    store: Store, file: str, make: Callable[[], Arrays], comm: MPI.Comm, mark: str = ""
) -> Arrays:
    """Arrays of a file with this mark, made and kept where it is missing; collective like make."""

    def there() -> Arrays | None:
        arrays = store.load(file)
        return arrays if arrays and str(arrays.pop("mark", "")) == mark else None

    kept = on_first(there, comm)
    if kept is None:
        kept = make()
        on_first(lambda: store.save(file, mark=np.array(mark), **kept), comm)
    return kept


def _said(name: str, value: Any) -> str:
    """A number of a record for a reader: its unit stands behind it."""
    end = next((end for end in UNITS if name.endswith(end)), "")
    return f"{name.removesuffix(end)} = {value}{UNITS.get(end, '')}"
