"""Bodies whose nodes move with a length: between two mesh files, or with planes across z.

A node lies at x(p) = x(p_0) + (p - p_0) v. The determinant of the Jacobian at any point of a cell
is then of third degree in p, and so are mass and gyroscopic term, to round-off. The stiffness has
poles where a cell collapses, the nearest ones p_- below and p_+ above the range. In

    u = ln((p - p_-) / (p_+ - p))

all of these lie i pi away from the axis of u or farther, so that a Chebyshev series of few terms
reaches the round-off of factors; its error is measured between its points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy import special
from scipy.sparse.csgraph import connected_components

from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.parts import length_key, moved_planes

from .mesh import Mesh, check_cells
from .meshing.groups import mesh_of_file
from .meshing.quality import determinants
from .meshing.rawmesh import RawMesh, facet_nodes

Array = NDArray[np.float64]

# Error of an entry of the stiffness over the largest ones of its row and column that is accepted,
# and degrees of the series that are tried.
ERROR, DEGREES = 1e-10, (4, 8, 16)
# Least entries of a row that count, over those of all rows.
SMALL = 1e-4
# Faces move evenly if their nodes do to this share of the largest movement.
EVEN = 1e-6
# Imaginary part of a triple root by round-off, relatively; where no cell folds, it is as if one did
# so many ranges away.
APART, FAR = 1e-3, 100.0
# Decimals by which planes of facets are told apart, relative to the size of the brake.
PLANE = 5
# A range is found to hold for a mesh to this share of it.
HALVINGS = 20


def velocity(scene: Scene, read: RawMesh, parts: list[str], key: str) -> Array:
    """Movement of the nodes of a mesh file per length [m/m], shape (nodes, 3).

    Args:
        scene: the scene.
        read: the mesh of ``mesh.file``.
        parts: names of the parts that are in it.
        key: "parts.PART.morph.NAME".

    Raises:
        SceneError: the displaced mesh is another one, the same, or moves other parts.
    """
    _, part, _, name = key.split(".", 3)
    morph, where = scene.parts[part].morph[name], f"{key}.displaced"
    moved = mesh_of_file(scene.file.parent, scene.mesh, parts, (morph.displaced, where))
    step = moved.points - read.points
    others = np.ones(len(step), dtype=bool)
    others[read.cells[read.part(part)]] = False
    size = float(np.abs(step).max())
    if not size > 0:
        raise SceneError(f"{where} = {morph.displaced!r}: no node is at another place")
    if np.abs(step[others]).max(initial=0.0) > EVEN * size:
        raise SceneError(
            f"{where} = {morph.displaced!r}: nodes of other parts than {part} are moved; leave"
            " them where they are in mesh.file"
        )
    return np.asarray(step / (morph.ends[1] - morph.ends[0]))


def file_mesh(scene: Scene, parts: list[str]) -> tuple[RawMesh, dict[str, Array]]:
    """Mesh of the mesh file, its nodes where the lengths of the scene have them.

    Args:
        scene: the scene.
        parts: names of the parts that are in it.

    Returns:
        The mesh, and the movement of its nodes under each length, "parts.PART.morph.NAME".
    """
    read = mesh_of_file(scene.file.parent, scene.mesh, parts)
    points, moves = read.points.copy(), {}
    for part in parts:
        for name, morph in scene.parts[part].morph.items():
            key = f"parts.{part}.morph.{name}"
            moves[key] = velocity(scene, read, parts, key)
            points += (morph.length - morph.ends[0]) * moves[key]
    return replace(read, points=points), moves


@dataclass(frozen=True, slots=True)
class Moving:
    """A length that moves nodes, over a range.

    Attributes:
        layers: whose nodes move, "part.layer".
        usual: the length in the scene [m].
        ends: of the range [m].
        folds: lengths at which the first cell collapses [m], or so far that it moves no series.
        v: movement of the nodes of the mesh per length, shape (nodes, 3).
    """

    layers: tuple[str, ...]
    usual: float
    ends: tuple[float, float]
    folds: tuple[float, float]
    v: Array

    @contextmanager
    def applied(self, mesh: Mesh, length: float) -> Iterator[None]:
        """The nodes where a length has them, and back again."""
        x = mesh.domain.geometry.x
        there = x.copy()
        x[:] = there + (length - self.usual) * self.v
        try:
            yield
        finally:
            x[:] = there

    def factor(self, power: int, length: float, inertia: bool) -> float:
        """Chebyshev polynomial of a length, of p for mass and gyroscopic term, else of u."""
        low, high, at = (x if inertia else self._u(x) for x in (*self.ends, length))
        x = (2 * at - low - high) / (high - low or 1.0)
        return float(special.eval_chebyt(power, x))

    def inertia(
        self, mesh: Mesh, assemble: Callable[[], sp.csr_matrix]
    ) -> dict[int, sp.csr_matrix]:
        """Matrices by which the Chebyshev polynomials of p come in a mass or a gyroscopic term."""
        low, high = self.ends
        x = np.cos(np.pi * (np.arange(4) + 0.5) / 4)
        M = [self._at(mesh, assemble, low + 0.5 * (high - low) * (1 + t)) for t in x]
        series = np.linalg.inv(_polynomials(x, 3))
        return {j: sum(c * A for c, A in zip(series[j], M, strict=True)) for j in range(4)}

    def stiffness(
        self, mesh: Mesh, assemble: Callable[[], sp.csr_matrix]
    ) -> dict[int, sp.csr_matrix]:
        """Matrices by which the Chebyshev polynomials of u come in a stiffness.

        Raises:
            InaccurateResult: too many would be needed.
        """
        low, high = map(self._u, self.ends)
        known: dict[float, sp.csr_matrix] = {}

        def at(x: float) -> Array:
            if x not in known:
                u = low + 0.5 * (high - low) * (1 + x)
                known[x] = self._at(mesh, assemble, self._length(u))
            return np.asarray(known[x].data)

        for degree in DEGREES:
            # Points of one degree are among those of twice the degree.
            points = [round(float(x), 12) for x in np.cos(np.pi * np.arange(degree + 1) / degree)]
            A: Array = np.linalg.inv(_polynomials(points, degree)) @ [at(x) for x in points]
            pattern = known[points[0]]
            between = np.cos(np.pi * (np.array([0, degree // 2]) + 0.5) / degree)
            wrong = [at(float(x)) - _polynomials(x, degree) @ A for x in between]
            share = _shares(pattern, A)
            if max(map(share, wrong)) <= ERROR:
                break
        else:
            raise InaccurateResult(
                f"the stiffness of {', '.join(self.layers)} changes too much between"
                f" {self.ends[0]:g} m and {self.ends[1]:g} m for a series of degree {degree}:"
                " narrow the range"
            )
        while degree > 1 and share(A[degree]) <= 0.1 * ERROR:
            degree -= 1
        return {
            j: sp.csr_matrix((A[j], pattern.indices, pattern.indptr), pattern.shape)
            for j in range(degree + 1)
        }

    def _at(
        self, mesh: Mesh, assemble: Callable[[], sp.csr_matrix], length: float
    ) -> sp.csr_matrix:
        with self.applied(mesh, length):
            return assemble()

    def _u(self, p: float) -> float:
        """The variable of the series."""
        return float(np.log((p - self.folds[0]) / (self.folds[1] - p)))

    def _length(self, u: float) -> float:
        """The length of a value of u."""
        below, above = self.folds
        return float(below + (above - below) / (1 + np.exp(-u)))


def _polynomials(x: Any, degree: int) -> Array:
    """Chebyshev polynomials up to a degree at some points, shape (..., degree + 1)."""
    return np.asarray(special.eval_chebyt(np.arange(degree + 1), np.asarray(x)[..., None]))


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


def movement(scene: Scene, raw: RawMesh, files: list[str], name: str) -> Array:
    """Movement of all nodes per length [m/m], shape (nodes, 3).

    Args:
        scene: the scene.
        raw: its plain mesh.
        files: names of the parts that are in the mesh file.
        name: the length, by its dotted key.
    """
    part, key = length_key(name)
    v = np.zeros_like(raw.points)
    if (planes := moved_planes(scene.parts[part], key)) is not None:
        own = np.unique(raw.cells[raw.part(part)])
        v[own, 2] = np.interp(raw.points[own, 2], *planes)
        return v
    step = file_mesh(scene, files)[1][name.removesuffix(".value")]
    # The nodes of the file come behind those of the builders.
    v[len(v) - len(step) :] = step
    return v


def moving(
    scene: Scene,
    mesh: Mesh,
    files: list[str],
    name: str,
    usual: float,
    ends: tuple[float, float],
    faces: Mapping[str, str],
) -> Moving:
    """A length that moves nodes, over a range that its cells stand.

    Args:
        scene: the scene.
        mesh: its tagged mesh.
        files: names of the parts that are in the mesh file.
        name: the length, by its dotted key.
        usual: the length in the scene [m].
        ends: of the range [m].
        faces: key of the scene that depends on the area or the shape of a face -> the face.

    Raises:
        SceneError: a cell collapses, or a face in use does not keep its shape.
    """
    read = mesh.raw
    if read is None:
        raise ValueError("a mesh of another origin")
    v = movement(scene, read, files, name)
    _check_faces(read, v, faces)
    folds = _folds(read, v, usual, ends)

    def mistake(p: float) -> str:
        if not folds[0] < p < folds[1]:
            return "mesh: a cell collapses"
        try:
            check_cells(replace(read, points=read.points + (p - usual) * v), scene.mesh)
        except SceneError as error:
            return str(error).partition(": change")[0]
        return ""

    for p in np.linspace(*ends, 9):
        if text := mistake(p):
            good, bad = usual, p
            for _ in range(HALVINGS):
                middle = 0.5 * (good + bad)
                good, bad = (good, middle) if mistake(middle) else (middle, bad)
            raise SceneError(
                f"{name}: at {p:.4g} m: {text}; the mesh holds to {good:.4g} m: narrow the range,"
                " or take a mesh whose cells stand more"
            )
    moved = np.unique(read.cell_tag[np.any(v[read.cells] != 0, axis=(1, 2))])
    layers = tuple(layer for layer, tag in mesh.layers.items() if tag in moved)
    return Moving(layers, usual, ends, folds, v[mesh.domain.geometry.input_global_indices])


def _folds(mesh: RawMesh, v: Array, usual: float, ends: tuple[float, float]) -> tuple[float, float]:
    """Lengths below and above that of the scene at which a Jacobian vanishes first [m]."""
    step = float(np.abs(np.array(ends) - usual).max()) or abs(usual)
    at = np.array([-1.0, 0.0, 1.0, 2.0])
    moves = np.any(v[mesh.cells] != 0, axis=(1, 2))
    own = replace(mesh, cells=mesh.cells[moves])
    D = [determinants(replace(own, points=mesh.points + t * step * v)).ravel() for t in at]
    c = np.linalg.solve(np.vander(at, increasing=True), D)
    # Roots 1 / s of 1 + c1 t + c2 t^2 + c3 t^3.
    companion = np.zeros((c.shape[1], 3, 3))
    companion[:, 0] = -(c[1:] / c[0]).T
    companion[:, [1, 2], [0, 1]] = 1.0
    s = np.linalg.eigvals(companion).ravel()
    # Roots that come several times are found apart.
    s = s.real[np.abs(s.imag) <= APART * np.abs(s)]
    near = 1 / FAR
    return usual + step / s.min(initial=-near), usual + step / s.max(initial=near)


def _check_faces(mesh: RawMesh, v: Array, faces: Mapping[str, str]) -> None:
    """Refuse faces in use that are deformed, and faces that touch others and move sideways.

    What lies in one plane of one body must move together: a part may lie on both sides of a disc,
    and the two sides of a disc move apart.

    Raises:
        SceneError: the key of the scene, the face and the remedy.
    """
    every, tolerance = facet_nodes(mesh), EVEN * float(np.abs(v).max())
    first = np.repeat(mesh.cells[:, 0], mesh.cells.shape[1])
    links = sp.coo_matrix((np.ones(first.size), (first, mesh.cells.ravel())), (len(v), len(v)))
    _, body = connected_components(links, directed=False)
    for key, face in faces.items():
        own = every[mesh.facet_tag == mesh.faces[face]]
        step, x = v[own], mesh.points[own[:, :3]]
        n = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        n *= np.sign(np.take_along_axis(n, np.abs(n).argmax(axis=1)[:, None], axis=1))
        n /= np.linalg.norm(n, axis=1)[:, None]
        height = np.sum(n * x[:, 0], axis=1) / np.abs(mesh.points).max()
        planes = np.round(np.column_stack([body[own[:, 0]], n, height]), PLANE)
        _, plane = np.unique(planes, axis=0, return_inverse=True)
        low, high = np.full((2, plane.max() + 1, 3), np.inf) * [[[1]], [[-1]]]
        np.minimum.at(low, plane.ravel(), step.min(axis=1))
        np.maximum.at(high, plane.ravel(), step.max(axis=1))
        if np.max(high - low) > tolerance:
            raise SceneError(
                f"{key}: the length deforms or tilts the face {face}; a face that carries anything"
                " may move as a whole alone: leave its nodes in their places relative to each"
                " other, or run the scene once for each value"
            )
        along = step[:, 0] - np.sum(step[:, 0] * n, axis=1)[:, None] * n
        if key.startswith(("contact.", "ties.")) and np.abs(along).max() > tolerance:
            raise SceneError(
                f"{key}: the length moves the face {face} sideways, over other facets; it may"
                " move along its normal alone: run the scene once for each value"
            )
