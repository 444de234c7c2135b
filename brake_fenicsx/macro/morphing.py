"""Bodies whose nodes move with lengths: between two mesh files, or with planes across z.

A node lies at x(p) = x(p_0) + (p - p_0) v, with a sum over the lengths that move it. The
determinant of the Jacobian at any point of a cell is then of third degree in p, and so are mass and
gyroscopic term, to round-off. The stiffness has poles where a cell collapses, the nearest ones p_-
below and p_+ above the range, whatever the other lengths. In

    u = ln((p - p_-) / (p_+ - p))

all of these lie i pi away from the axis of u or farther, so that a Chebyshev series of few terms
reaches the round-off of factors (``matrix_series``).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.meshing.brake_mesh import Mesh, check_cells
from brake_fenicsx.meshing.gmsh_mesh import MeshSettings
from brake_fenicsx.meshing.rawmesh import RawMesh, body_of_points, determinants, facet_nodes

from .stretching import DEGREES, Assembly, Power, matrix_series, products

# Faces move evenly if their nodes do to this share of the largest movement.
EVEN = 1e-6
# Imaginary part of a triple root by round-off, relatively; where no cell folds, it is as if one did
# so many ranges away.
APART, FAR = 1e-3, 100.0
# Decimals by which planes of facets are told apart, relative to the size of the brake.
PLANE = 5
# A range is found to hold for a mesh to this share of it.
HALVINGS = 20


@dataclass(frozen=True, slots=True)
class Moving:
    """Lengths that move nodes of the same layers, over ranges.

    Attributes:
        layers: that they deform, "part.layer".
        usual: the lengths in the scene [m], shape (lengths,).
        ends: of their ranges [m], shape (lengths, 2).
        folds: of each, where the first cell collapses, whatever the others [m], or so far that it
            moves no series, likewise.
        v: movement of the nodes of the mesh per length, shape (lengths, nodes, 3).
        slides: of each length, the keys of faces in contact that it moves along each other.
    """

    layers: tuple[str, ...]
    usual: Array
    ends: Array
    folds: Array
    v: Array
    slides: tuple[frozenset[str], ...] = ()

    @contextmanager
    def applied(self, mesh: Mesh, lengths: Array) -> Iterator[None]:
        """The nodes where some lengths have them, and back again."""
        x = mesh.domain.geometry.x
        there = x.copy()
        x[:] = there + np.tensordot(lengths - self.usual, self.v, 1)
        try:
            yield
        finally:
            x[:] = there

    def factor(self, power: Power, lengths: Array, inertia: bool) -> float:
        """Product of Chebyshev polynomials, of p for mass and gyroscopic term, else of u."""
        low, high, at = self.ends[:, 0], self.ends[:, 1], lengths
        if not inertia:
            low, high, at = map(self._u, (low, high, at))
        x = (2 * at - low - high) / np.where(high > low, high - low, 1.0)
        return float(products(x[None], np.array([power]))[0, 0])

    def inertia(self, mesh: Mesh, assemble: Assembly) -> dict[Power, sp.csr_matrix]:
        """Matrices by which the polynomials of p come in a mass or a gyroscopic term."""
        low, high = self.ends.T
        return self._series(lambda x: low + (high - low) * x, mesh, assemble)

    def stiffness(self, mesh: Mesh, assemble: Assembly) -> dict[Power, sp.csr_matrix]:
        """Matrices by which the polynomials of u come in a stiffness.

        Raises:
            InaccurateResult: too many would be needed.
        """
        low, high = map(self._u, self.ends.T)
        below, above = self.folds.T

        def lengths(x: Array) -> Array:
            return np.asarray(below + (above - below) / (1 + np.exp(-low - (high - low) * x)))

        return self._series(lengths, mesh, assemble)

    def _series(
        self, lengths: Callable[[Array], Array], mesh: Mesh, assemble: Assembly
    ) -> dict[Power, sp.csr_matrix]:
        """The matrices, by the lengths at points between 0 and 1 of the variables."""

        def at(x: Array) -> sp.csr_matrix:
            with self.applied(mesh, lengths(0.5 * (1 + x))):
                return assemble()

        if (found := matrix_series(at, len(self.usual))) is None:
            ends = (f"between {a:.4g} and {b:.4g} mm" for a, b in 1e3 * self.ends)
            ranges = " and ".join(ends)
            raise InaccurateResult(f"""the stiffness of {", ".join(self.layers)} changes too much
                {ranges} for a series of degree {DEGREES[-1]}: narrow the range""")
        return found

    def _u(self, p: Array) -> Array:
        """The variables of the series."""
        return np.asarray(np.log((p - self.folds[:, 0]) / (self.folds[:, 1] - p)))


class Move(NamedTuple):
    """A length that moves nodes.

    Attributes:
        name: its dotted key.
        usual: the length in the scene [m].
        ends: of its range [m].
        v: movement of all nodes per length [m/m], shape (nodes, 3).
    """

    name: str
    usual: float
    ends: tuple[float, float]
    v: Array


def deformed_layers(mesh: Mesh, v: Array) -> tuple[str, ...]:
    """Layers that some movement of the nodes, shape (nodes, 3), does not only shift along z."""
    read = plain(mesh)
    step = v[read.cells]
    moves = np.ptp(step[..., 2], axis=1) > EVEN * np.abs(v).max()
    tags = np.unique(read.cell_tag[moves | np.any(step[..., :2] != 0, axis=(1, 2))])
    return tuple(layer for layer, tag in mesh.layers.items() if tag in tags)


def plain(mesh: Mesh) -> RawMesh:
    """The mesh as it was read or made."""
    if mesh.raw is None:
        raise ValueError("a mesh of another origin")
    return mesh.raw


def moving(
    mesh: Mesh, settings: MeshSettings, moves: Sequence[Move], faces: Mapping[str, str]
) -> Moving:
    """Lengths that move nodes of the same layers, over ranges that the cells stand.

    Args:
        mesh: the tagged mesh.
        settings: the quality asked for.
        moves: what each length does.
        faces: key of the scene that depends on the area or the shape of a face -> the face.

    Raises:
        SceneError: a cell collapses, or a face in use does not keep its shape.
    """
    read, names = plain(mesh), ", ".join(move.name for move in moves)
    v, usual = np.array([move.v for move in moves]), np.array([move.usual for move in moves])
    ends = np.array([move.ends for move in moves])
    slides = tuple(_sliding(read, one, faces) for one in v)
    folds = np.array([_folds(read, v, usual, ends, i) for i in range(len(moves))])

    def mistake(p: Array) -> str:
        if not np.all((folds[:, 0] < p) & (p < folds[:, 1])):
            return "mesh: a cell collapses"
        try:
            moved = read.points + np.tensordot(p - usual, v, 1)
            check_cells(replace(read, points=moved), settings)
        except SceneError as error:
            return str(error).partition(": change")[0]
        return ""

    def said(p: Array) -> str:
        return ", ".join(f"{1e3 * length:.4g} mm" for length in p)

    steps = 9 if len(moves) == 1 else 3
    for p in map(np.array, product(*np.linspace(ends[:, 0], ends[:, 1], steps).T)):
        if text := mistake(p):
            good, bad = usual, p
            for _ in range(HALVINGS):
                middle = 0.5 * (good + bad)
                good, bad = (good, middle) if mistake(middle) else (middle, bad)
            raise SceneError(f"""{names}: at {said(p)}: {text}; the mesh holds to {said(good)}:
                narrow the range, or take a mesh whose cells stand more""")
    layers = dict.fromkeys(layer for one in v for layer in deformed_layers(mesh, one))
    return Moving(
        tuple(layers), usual, ends, folds, v[:, mesh.domain.geometry.input_global_indices], slides
    )


def _folds(mesh: RawMesh, v: Array, usual: Array, ends: Array, i: int) -> tuple[float, float]:
    """Lengths below and above that of the scene at which a Jacobian vanishes first [m].

    Of length i, with the others as they are in the scene and at all ends.
    """
    own, here = float(usual[i]), ends.copy()
    step = float(np.abs(ends[i] - own).max()) or abs(own)
    at, below, above = np.array([-1.0, 0.0, 1.0, 2.0]), -np.inf, np.inf
    moves = np.any(v[:, mesh.cells] != 0, axis=(0, 2, 3))
    own_cells = replace(mesh, cells=mesh.cells[moves])
    here[i] = own
    for p in [usual, *map(np.array, product(*here))]:
        points = mesh.points + np.tensordot(p - usual, v, 1)
        D = [determinants(replace(own_cells, points=points + t * step * v[i])).ravel() for t in at]
        c = np.linalg.solve(np.vander(at, increasing=True), D)
        # Roots 1 / s of 1 + c1 t + c2 t^2 + c3 t^3.
        companion = np.zeros((c.shape[1], 3, 3))
        companion[:, 0] = -(c[1:] / c[0]).T
        companion[:, [1, 2], [0, 1]] = 1.0
        s = np.linalg.eigvals(companion).ravel()
        # Roots that come several times are found apart.
        s = s.real[np.abs(s.imag) <= APART * np.abs(s)]
        near = 1 / FAR
        below = max(below, own + step / s.min(initial=-near))
        above = min(above, own + step / s.max(initial=near))
    return below, above


def _sliding(mesh: RawMesh, v: Array, faces: Mapping[str, str]) -> frozenset[str]:
    """Keys of faces in contact that move over others; refused are other faces that do, or deform.

    What lies in one plane of one body must move together: a part may lie on both sides of a disc,
    and the two sides of a disc move apart.

    Raises:
        SceneError: the key of the scene, the face and the remedy.
    """
    every, tolerance = facet_nodes(mesh), EVEN * float(np.abs(v).max())
    found = set[str]()
    body = body_of_points(mesh.cells, len(v))
    for key, face in faces.items():
        own = every[mesh.facet_tag == mesh.faces[face]]
        step, x = v[own], mesh.points[own[:, :3]]
        n = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        n *= np.sign(np.take_along_axis(n, np.abs(n).argmax(axis=1)[:, None], axis=1))
        n /= np.linalg.norm(n, axis=1)[:, None]
        height = np.sum(n * x[:, 0], axis=1) / np.abs(mesh.points).max()
        planes = np.round(np.column_stack([body[own[:, 0]], n, height]), PLANE)
        _, plane = np.unique(planes, axis=0, return_inverse=True)
        across = np.sum(step * n[:, None], axis=2, keepdims=True)
        along = step - across * n[:, None]
        touches = key.startswith("contact.")
        step = across if touches else step
        low, high = np.full((2, plane.max() + 1, step.shape[2]), np.inf) * [[[1]], [[-1]]]
        np.minimum.at(low, plane.ravel(), step.min(axis=1))
        np.maximum.at(high, plane.ravel(), step.max(axis=1))
        if np.max(high - low) > tolerance:
            raise SceneError(f"""{key}: the length deforms or tilts the face {face}; a face that
                carries anything may move as a whole alone, and one in contact along its plane as
                well: leave its nodes in their places relative to each other, or run the scene once
                for each value""")
        moves = np.abs(along).max() > tolerance
        if touches and moves:
            found.add(key)
        if key.startswith("ties.") and moves:
            raise SceneError(f"""{key}: the length moves the face {face} sideways, over other
                facets; it may move along its normal alone: run the scene once for each value""")
    return frozenset(found)
