"""Stiffness and mass of a layer over its thickness, and their series over several variables.

Stretched by s along z, a body has derivatives along z that are 1/s of what they were, and s times
its volume. Strains are linear in derivatives, so that with any quadrature, to round-off,

    K(s) = s A + B + D / s,      M(s) = s M(1).

What lies on a stretched layer is shifted along z, which changes neither.

The series is one of Chebyshev polynomials over variables in [-1, 1]. Each variable alone tells the
degree that it needs; of several the series is one of products up to a
total share of these degrees, through points that elimination with pivoting chooses (Sommariva and
Vianello, Comput. Math. Appl. 57, 1324, 2009: approximate Fekete points). The error of an entry is
measured between the points, and products that matter for no entry are left out: variables that meet
in no entry cost no more than each by itself.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray
from scipy import special

from brake_fenicsx import compat
from brake_fenicsx.arguments import Array, Index
from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.meshing.rawmesh import body_of_points

from .elasticity import face_tag, measured_area

# Number of a function of some variables, one of each.
Power = tuple[int, ...]

# Error of an entry over the largest ones of its row and column that is accepted, degrees that are
# tried for each variable, and halves of these for several together.
ERROR, DEGREES, TOGETHER = 1e-10, (2, 4, 8, 16), (2, 3, 4)
# Share of the error below which a term is left out.
DROPPED = 0.1
# Least entries of a row that count, over those of all rows.
SMALL = 1e-4


def matrix_series(
    at: Callable[[Array], sp.csr_matrix], variables: int
) -> dict[Power, sp.csr_matrix] | None:
    """Matrices by which products of Chebyshev polynomials come in a matrix; None of too many.

    Args:
        at: the matrix at a point of [-1, 1]^variables, of one pattern always.
        variables: their number.
    """
    known: dict[tuple[float, ...], sp.csr_matrix] = {}

    def value(x: Array) -> Array:
        place = tuple(float(v) for v in np.round(x, 12))
        if place not in known:
            known[place] = at(np.array(place))
        return np.asarray(known[place].data)

    def series(degrees: Index) -> tuple[Index, Array, Callable[[Array], float]]:
        indices = _indices(degrees)
        points = _spread(indices, [_line(degree) for degree in degrees])
        A: Array = np.linalg.inv(products(points, indices)) @ [value(x) for x in points]
        return indices, A, _shares(next(iter(known.values())), A)

    def holds(degrees: Index) -> bool:
        indices, A, share = series(degrees)
        wrong = (value(x) - (products(x[None], indices) @ A)[0] for x in _between(degrees))
        return all(share(data) <= ERROR for data in wrong)

    # Points of one degree are among those of twice the degree.
    axes = np.eye(variables, dtype=np.intp)
    alone = [next((d for d in DEGREES if holds(d * axis)), None) for axis in axes]
    if None in alone:
        return None
    trials = [np.array(alone) * n // 2 for n in (TOGETHER if variables > 1 else (2,))]
    degrees = next((d for d in trials if variables == 1 or holds(d)), None)
    if degrees is None:
        return None
    (indices, A, share), pattern = series(degrees), next(iter(known.values()))
    return {
        tuple(map(int, index)): sp.csr_matrix(
            (data, pattern.indices, pattern.indptr), pattern.shape
        )
        for index, data in zip(indices, A, strict=True)
        if not index.any() or share(data) > DROPPED * ERROR
    }


def products(x: Array, indices: Index) -> Array:
    """Products of Chebyshev polynomials at some points, shape (points, products).

    Args:
        x: shape (points, variables).
        indices: degrees of the factors, shape (products, variables).
    """
    return np.asarray(special.eval_chebyt(indices, x[:, None]).prod(axis=2))


def _indices(degrees: Index) -> Index:
    """Degrees of the factors of products up to a total share of some degrees."""
    every = np.array([*np.ndindex(*(degrees + 1))])
    return every[np.sum(every / np.maximum(degrees, 1), axis=1) <= 1 + 1e-9]


def _line(degree: int) -> Array:
    """Extreme points of a Chebyshev polynomial; the centre for a constant."""
    return np.cos(np.pi * np.arange(degree + 1) / degree) if degree else np.zeros(1)


def _spread(indices: Index, lines: list[Array]) -> Array:
    """As many points of a grid as there are products."""
    grid = np.array([*product(*lines)])
    _, order = la.qr(products(grid, indices).T, mode="r", pivoting=True)
    return np.asarray(grid[order[: len(indices)]])


def _between(degrees: Index) -> Array:
    """Points between those of some degrees, near the ends and in the middle."""
    at = (np.array([0 * degrees, degrees // 2]) + 0.5) / np.maximum(degrees, 1)
    end, middle = np.cos(np.pi * at) * (degrees > 0)
    if np.count_nonzero(degrees) == 1:
        return np.array([end, middle])
    other = (-1.0) ** np.arange(len(degrees))
    mixed = np.where(other > 0, end, middle)
    return np.array([end, middle, other * end, mixed, other * mixed])


def _shares(pattern: sp.csr_matrix, A: Array) -> Callable[[Array], float]:
    """Largest entry of data on a pattern over the largest ones of its row and column in some."""
    size = np.abs(A).max(axis=0)
    rows = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    most = np.zeros(pattern.shape[0])
    np.maximum.at(most, rows, size)
    # Where the entries of a row cancel there is round-off alone.
    most = np.maximum(most, SMALL * most.max())
    scale = np.sqrt(most[rows] * most[pattern.indices])
    return lambda data: float((np.abs(data) / scale).max())


# Makes a matrix of the mesh as it is then, with one pattern always.
Assembly = Callable[[], sp.csr_matrix]

# A power of the stretch whose matrix is less than this share of the others is round-off.
ROUND_OFF = 1e-12

# Heights of a mesh file are the same up to this share of the thickness.
SAME = 1e-3


@contextmanager
def stretched(mesh: Mesh, factor: float) -> Iterator[None]:
    """The whole mesh stretched along z, and back again."""
    x = mesh.domain.geometry.x
    z = x[:, 2].copy()
    x[:, 2] = factor * z
    try:
        yield
    finally:
        x[:, 2] = z


@dataclass(frozen=True, slots=True)
class Stretch:
    """The thickness of layers.

    Attributes:
        layers: "part.layer".
        usual: the thickness in the scene [m], shape (1,).
    """

    layers: tuple[str, ...]
    usual: Array

    def applied(self, mesh: Mesh, lengths: Array) -> AbstractContextManager[None]:
        """The mesh scaled along z so that these layers have this thickness."""
        return stretched(mesh, float(lengths[0] / self.usual[0]))

    def factor(self, power: Power, lengths: Array, inertia: bool) -> float:
        """Power of the stretch, of either."""
        return float((lengths[0] / self.usual[0]) ** power[0])

    def inertia(self, mesh: Mesh, assemble: Assembly) -> dict[Power, sp.csr_matrix]:
        """Power of the stretch -> mass or gyroscopic term."""
        return {(1,): assemble()}

    def stiffness(self, mesh: Mesh, assemble: Assembly) -> dict[Power, sp.csr_matrix]:
        """The matrices A, B and D of the stiffness.

        Args:
            mesh: the tagged mesh.
            assemble: assembles the stiffness on the mesh as it is then, with one pattern always.

        Returns:
            Power of the stretch (1, 0, -1) -> matrix [N/m]; those that are zero are left out.
        """
        K = []
        for factor in (1.0, 2.0, 0.5):
            with stretched(mesh, factor):
                K.append(assemble())
        longer, shorter = K[1] - K[0], K[2] - K[0]
        D = (4 / 3) * (0.5 * longer + shorter)
        A = longer + 0.5 * D
        found = {(1,): A, (0,): K[0] - A - D, (-1,): D}
        size = max(abs(matrix).max() for matrix in found.values())
        return {
            power: matrix.tocsr()
            for power, matrix in found.items()
            if abs(matrix).max() > ROUND_OFF * size
        }


def check_layer(mesh: Mesh, layer: str, thickness: float | None, faces: Mapping[str, str]) -> None:
    """Refuse a layer that cannot be stretched by itself, or changes faces in use.

    Args:
        mesh: the tagged mesh.
        layer: "part.layer".
        thickness: of a layer of a mesh file, as the scene writes it [m]; None of a builder's.
        faces: key of the scene that depends on the area or the shape of a face -> the face.

    Raises:
        SceneError: what is wrong, and the remedy.
    """
    if layer not in mesh.layers:
        raise SceneError(f"{layer}: the mesh has no such layer; there are {', '.join(mesh.layers)}")
    cells = mesh.cell_tags.find(mesh.layers[layer])
    if thickness is not None:
        _check_flat(mesh, layer, cells, thickness)
    domain = mesh.domain
    domain.topology.create_connectivity(3, 2)
    facets_of = domain.topology.connectivity(3, 2)
    around = np.unique(np.concatenate([facets_of.links(cell) for cell in cells]))
    for key, face in faces.items():
        own = np.intersect1d(mesh.facet_tags.find(face_tag(mesh, face, key)), around)
        tags = compat.meshtags(domain, 2, own.astype(np.int32), 1)
        ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)(1)
        area = measured_area(mesh, ds)
        with stretched(mesh, 2.0):
            grown = measured_area(mesh, ds) - area
        if grown > ROUND_OFF * area:
            raise SceneError(f"""{key}: the face {face} lies on the sides of the layer {layer},
                whose thickness is random or swept; only flat faces across z may carry anything
                then: run the scene once for each thickness""")


def _check_flat(mesh: Mesh, layer: str, cells: NDArray[np.int32], thickness: float) -> None:
    """Ends across z, where a layer of a mesh file meets others, and the thickness that is written.

    Raises:
        SceneError: the layer is no such one.
    """
    z, nodes = mesh.domain.geometry.x[:, 2], compat.geometry_dofs(mesh.domain)
    key = f"parts.{layer.replace('.', '.layers.')}"
    shared = np.zeros(z.size, dtype=bool)
    shared[nodes[np.setdiff1d(np.arange(len(nodes)), cells)]] = True
    # Each body by itself: a layer may lie on both sides of a disc.
    body = body_of_points(nodes[cells], z.size)
    for number in np.unique(body[nodes[cells]]):
        own = np.flatnonzero(body == number)
        low, high = z[own].min(), z[own].max()
        if abs(high - low - thickness) > SAME * thickness:
            raise SceneError(f"""{key} = {1e3 * thickness:.6g} mm: the layer of the mesh is
                {1e3 * (high - low):.6g} mm thick along z; write that""")
        ends = np.minimum(z[own] - low, high - z[own])[shared[own]]
        if np.any(ends > SAME * thickness):
            raise SceneError(f"""{key}: the layer meets others elsewhere than at its two ends across
                z; run the scene once for each thickness""")
