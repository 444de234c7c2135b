"""The reduced model of an undamped brake of constant materials, from its matrices alone."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.solver import whole

from .modes import Complex, Modes
from .substructures.contact_rows import ContactLinearisation
from .substructures.offline import reduce_bodies
from .substructures.reduced_model import ReducedModel
from .substructures.substructure import split_substructures


class Reduced:
    """Reduced model of an undamped brake of constant materials, from its matrices.

    Attributes:
        model: the model.
    """

    def __init__(
        self,
        K: Any,
        M: Any,
        N: sp.csr_matrix,
        T: sp.csr_matrix,
        w: ArrayLike,
        k0: ArrayLike,
        band: tuple[float, float],
        tolerance: float = 1e-5,
        comm: MPI.Comm = MPI.COMM_SELF,
    ):
        """Offline stage.

        Args:
            K: elastic stiffness without contact [N/m], SciPy sparse or PETSc, shape (dofs, dofs).
            M: mass [kg], likewise.
            N: gap operator, shape (elements, dofs).
            T: slip operator, likewise.
            w: areas of the contact elements [m^2], shape (elements,).
            k0: typical contact stiffness [Pa/m], positive; the model is as good for any other.
            band: lowest and highest frequency [Hz].
            tolerance: wanted relative error of lambda.
            comm: processes that share the work.

        Raises:
            SceneError: matrices of the wrong kind or shape, or an area that is not positive.
        """
        own, areas = whole(K), np.asarray(w, float)
        for name, A in (("N", N), ("T", T)):
            if not sp.issparse(A) or A.shape != (areas.size, own.shape[0]):
                raise SceneError(
                    f"{name}: a sparse matrix of shape ({areas.size}, {own.shape[0]}) is needed,"
                    " one row for each contact element and one column for each dof"
                )
        for name, value in (("k0", np.asarray(k0, float)), ("w", areas)):
            if value.shape not in ((), areas.shape):
                raise SceneError(f"{name}: shape {value.shape}; give one value, or one per element")
            if not (np.all(np.isfinite(value)) and np.all(value > 0)):
                raise SceneError(f"{name} = {np.min(value):.3g}: positive finite values are needed")
        bodies = split_substructures(own, whole(M), {"N": N.tocsr(), "T": T.tocsr()})
        self.model: ReducedModel = reduce_bodies(
            bodies, areas, band, tolerance=tolerance, comm=comm
        )

    def modes(self, k: ArrayLike, mu: ArrayLike) -> Modes:
        """Complex modes of one sample in the band, see ``ReducedModel.modes``.

        Args:
            k: contact stiffness of each element [Pa/m], shape (elements,).
            mu: friction coefficient, one or one per element.
        """
        return self.model.modes([], ContactLinearisation.of(k, mu))

    def expand(self, s: Complex, a: Complex, k: ArrayLike, mu: ArrayLike) -> Complex:
        """Displacements of some modes of a sample, shape (dofs, chosen).

        Args:
            s: eigenvalues lambda [1/s], shape (chosen,).
            a: their columns of ``right``.
            k: contact stiffness of the sample [Pa/m].
            mu: its friction coefficient.
        """
        return self.model.displacements([], ContactLinearisation.of(k, mu), s, a)[0]
