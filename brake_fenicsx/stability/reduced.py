"""The reduced model of an undamped brake of constant materials, from its matrices alone."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.solver import whole

from .modes import Complex, Modes
from .substructures.contact_linearisation import ContactLinearisation
from .substructures.reduced_model import ReducedModel
from .substructures.substructure import split_substructures

Array = NDArray[np.float64]


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
        comm: MPI.Comm | None = None,
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
            comm: processes that share the work; this process alone if None.

        Raises:
            SceneError: matrices of the wrong kind or shape, or a stiffness that is not positive.
        """
        own, mass = whole(K), whole(M)
        _checked(own.shape[0], N, T, np.asarray(w, float), np.asarray(k0, float))
        bodies = split_substructures(own, mass, {"N": N.tocsr(), "T": T.tocsr()})
        self.model: ReducedModel = ReducedModel.offline(
            bodies, w, band, tolerance=tolerance, comm=comm
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


def _checked(dofs: int, N: Any, T: Any, w: Array, k0: Array) -> None:
    """Refuse what does not fit.

    Raises:
        SceneError: what it is, in one line.
    """
    for name, A in (("N", N), ("T", T)):
        if not sp.issparse(A) or A.shape != (w.size, dofs):
            raise SceneError(
                f"{name}: a sparse matrix of shape ({w.size}, {dofs}) is needed, one row for each"
                " contact element and one column for each dof"
            )
    if k0.shape not in ((), w.shape):
        raise SceneError(f"k0: shape {k0.shape}; give one value, or one for each contact element")
    for name, value in (("k0", k0), ("w", w)):
        if not (np.all(np.isfinite(value)) and np.all(value > 0)):
            raise SceneError(f"{name} = {np.min(value):.3g}: positive finite values are needed")
