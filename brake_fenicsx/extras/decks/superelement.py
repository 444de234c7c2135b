"""A body given by its matrices: a substructure of another code, beside the bodies of the mesh.

Its coordinates are the displacements of nodes and whatever else the matrices have (rotations, modal
coordinates of a Craig-Bampton reduction). Nodes belong to named sets, which supports, springs,
masses and ties name as they name faces.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Ints
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.macro.solver import Factor
from brake_fenicsx.scene import Scene, parts_section, units

from .matrix_files import Labels, read_matrix, read_row_labels

# A stiffness with eigenvalues further below zero than those of 100 Hz is not that of a body; what
# round-off of a text file makes of the rigid motions lies above.
BELOW = (2 * np.pi * 100.0) ** 2
# What round-off takes from a mass, over its diagonal.
ROUND_OFF = 1e-9
# Mass over the volume of the box around the nodes [kg/m^3]. Thin brackets fill some per cent of it;
# the box of a few nodes that were kept may be far smaller than the body. A wrong unit changes the
# number by 1e3 or 1e9.
LIKELY = (10.0, 1e6)
# |K r| over |K| |r|, the largest of all rows: below the first, round-off of a text file, a motion
# is free; above the second, rounded coordinates do not explain it.
FREE, STRAINED = 1e-4, 2e-2


@dataclass(frozen=True, slots=True)
class Superelement:
    """Matrices of a body and the places of its nodes, in SI units.

    Attributes:
        K: stiffness [N/m], shape (coordinates, coordinates).
        M: mass [kg].
        C: damping [N s/m], or None.
        points: places of the nodes [m], shape (nodes, 3).
        rows: coordinate that is the displacement of each node in x, y, z, -1 where there is none,
            shape (nodes, 3).
        sets: name of a set -> its nodes.
        unknown: number of nodes with a displacement in the matrices that are not in the table.
    """

    K: sp.csr_matrix
    M: sp.csr_matrix
    C: sp.csr_matrix | None
    points: Array
    rows: Ints
    sets: dict[str, Ints]
    unknown: int = 0


def set_names(scene: Scene) -> list[str]:
    """Sets of nodes of all bodies given by matrices, "part.set".

    Raises:
        SceneError: a table of nodes cannot be read.
    """
    names = []
    for name, part in scene.parts.items():
        if part.matrices is not None:
            file = scene.path(part.matrices.nodes)
            try:
                sets = _nodes(file)[2]
            except SceneError as error:
                where = f"parts.{name}.matrices.nodes = {part.matrices.nodes!r}"
                raise SceneError(f"{where}: {error}") from None
            names += [f"{name}.{one}" for one in sets]
    return names


def read_superelement(folder: Path, given: parts_section.Matrices) -> Superelement:
    """Read and check the matrices of a body.

    Args:
        folder: folder of the scene.
        given: the files and their units.

    Raises:
        SceneError: the key below ``matrices``, its value and the remedy.
    """
    length, mass, time = _units(given)

    def asked(name: str, read: Callable[[Path], Any]) -> Any:
        try:
            return read(folder / getattr(given, name))
        except SceneError as error:
            raise SceneError(f"{name} = {getattr(given, name)!r}: {error}") from None

    labels, points, sets = asked("nodes", _nodes)
    order = None if given.dofs is None else asked("dofs", read_row_labels)
    matrices: dict[str, sp.csr_matrix] = {}
    scales = {"stiffness": mass / time**2, "mass": mass, "damping": mass / time}
    for name in (name for name in scales if getattr(given, name) is not None):
        read = asked(name, read_matrix)
        own: Labels | None = order if read.rows is None else read.rows
        A, source = scales[name] * read.A, f"{name} = {getattr(given, name)!r}"
        if name == "stiffness":
            first, size = own, A.shape[0]
        if own is not None and len(own) != A.shape[0]:
            raise SceneError(f"{source}: {A.shape[0]} rows, but {len(own)} in dofs")
        if (own is None) != (first is None):
            raise SceneError(f"{source}: rows without nodes, those of the stiffness have nodes")
        if own is not None and first is not None and not np.array_equal(own, first):
            A = _as_rows(A, own, first, source)
        elif A.shape[0] != size:
            raise SceneError(f"{source}: {A.shape[0]} rows, but {size} of the stiffness")
        matrices[name] = A
    if first is not None and given.modal:
        raise SceneError(f"modal = {given.modal}: the files name the rows; leave it out")
    rows = _rows(labels, first, size, given.modal)
    named = [] if first is None else first[first[:, 1] <= 3, 0]
    K, M, C = (matrices.get(name) for name in scales)
    unknown = np.setdiff1d(named, labels).size
    body = Superelement(K, M, C, length * points, rows, sets, unknown)
    _check_definite(body, given)
    return body


def _units(given: parts_section.Matrices) -> list[float]:
    """Units of length [m], mass [kg] and time [s]."""
    if len(given.units) != 3:
        raise SceneError(f"""units = {list(given.units)!r}: write those of length, mass and time in
            which all files are consistent, ["mm", "t", "s"] for N, mm and tonnes""")
    pairs = zip(given.units, ("m", "kg", "s"), strict=True)
    return [units.factor_to_si(unit, wanted, f"units: {unit!r}") for unit, wanted in pairs]


def _as_rows(A: sp.csr_matrix, labels: Labels, wanted: Labels, source: str) -> sp.csr_matrix:
    """A matrix in the order of the rows of the stiffness, zero where it has none."""
    rows = pd.MultiIndex.from_arrays(wanted.T).get_indexer(pd.MultiIndex.from_arrays(labels.T))
    for node, component in labels[rows < 0][:1]:
        raise SceneError(f"{source}: node {node}, component {component} has no stiffness")
    A = A.tocoo()
    return sp.csr_matrix((A.data, (rows[A.row], rows[A.col])), shape=2 * (len(wanted),))


def _rows(labels: Ints, first: Labels | None, size: int, modal: int) -> Ints:
    """Row of each node's displacement in x, y, z, shape (nodes, 3)."""
    if first is None:
        if size != 3 * labels.size + modal:
            raise SceneError(f"""stiffness: {size} rows, but {labels.size} nodes in the table have
                {3 * labels.size} displacements, x, y, z each, and modal = {modal}; correct the
                table, write the number of modal coordinates, the last rows, or name the rows by
                dofs""")
        return np.arange(3 * labels.size).reshape(-1, 3)
    wanted = pd.MultiIndex.from_product([labels, (1, 2, 3)])
    rows = pd.MultiIndex.from_arrays(first.T).get_indexer(wanted)
    if np.all(rows < 0):
        raise SceneError("nodes: none of them is in the matrices; compare their numbers")
    return np.asarray(rows).reshape(-1, 3)


def _nodes(path: Path) -> tuple[Ints, Array, dict[str, Ints]]:
    """Numbers, places and sets of a table of nodes: node, x, y, z and the names of its sets."""
    with reading(path, "as text", at=""):
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    numbers: list[int] = []
    places: list[list[float]] = []
    sets: dict[str, list[int]] = {}
    for number, cells in enumerate(csv.reader(lines), 1):
        if not cells or cells[0].lstrip().startswith("#"):
            continue
        try:
            node, where = int(cells[0]), [float(cell) for cell in cells[1:4]]
        except ValueError:
            if not numbers:
                continue
            where = []
        if len(where) != 3 or not np.isfinite(where).all():
            raise SceneError(f"""line {number}: {",".join(cells)!r}; write node, x, y, z and the
                sets it is in""")
        for name in " ".join(cells[4:]).split():
            sets.setdefault(name, []).append(len(numbers))
        numbers.append(node)
        places.append(where)
    if len({*numbers}) < len(numbers) or not numbers:
        raise SceneError("no nodes, or a node twice")
    return np.array(numbers), np.array(places), {n: np.array(v) for n, v in sets.items()}


def _check_definite(body: Superelement, given: parts_section.Matrices) -> None:
    """Refuse a mass or a stiffness with eigenvalues below zero, and coordinates without mass."""
    empty = np.flatnonzero(body.M.diagonal() <= 0.0)
    if empty.size:
        raise SceneError(f"""mass = {given.mass!r}: {empty.size} coordinates have no mass, row
            {empty[0] + 1} the first; condense them in the other code""")
    # Four points a cell leave a mass of quadratic tetrahedra singular: that is no mistake.
    mass = (body.M + ROUND_OFF * sp.diags(body.M.diagonal())).tocsr()
    stiffness = (body.K + BELOW * mass).tocsr()
    wanted = "positive semi-definite"
    for key, file, A in (("mass", given.mass, mass), ("stiffness", given.stiffness, stiffness)):
        try:
            factor = Factor(A, "brake_superelement_")
        except InaccurateResult:
            raise SceneError(f"{key} = {file!r}: singular; {wanted} is needed") from None
        negative = factor.negative_pivots
        factor.destroy()
        if negative:
            raise SceneError(f"""{key} = {file!r}: {negative} negative eigenvalues; {wanted} is
                needed""")


def doubts(body: Superelement) -> list[str]:
    """Sentences on what is unlikely.

    A body that shifts freely turns freely too, if each row of its stiffness belongs to the node at
    whose place it is put.

    Args:
        body: its matrices in SI units, stiffness in full.
    """
    sentences = []
    lost = np.count_nonzero(np.all(body.rows < 0, axis=1))
    if lost and body.unknown:
        sentences.append(
            f"{lost} nodes of the table have no displacement in the matrices, and {body.unknown}"
            " nodes of the matrices are not in the table; compare their numbers"
        )
    shifts, turns = np.split(rigid_motions(body), 2, axis=1)
    mass = float(np.einsum("ic,ic->", shifts, body.M @ shifts)) / 3
    box = np.ptp(body.points, axis=0)
    volume = float(box.prod())
    if volume > 0 and not LIKELY[0] <= mass / volume <= LIKELY[1]:
        x, y, z = 1e3 * box
        sentences.append(
            f"a mass of {mass:.3g} kg in a box of {x:.3g} x {y:.3g} x {z:.3g} mm; correct units, or"
            " the unit of the table of nodes"
        )
    whole = np.count_nonzero(body.rows >= 0) == body.K.shape[0]
    if whole and _strain(body, shifts) < FREE and _strain(body, turns) > STRAINED:
        sentences.append(
            "it shifts freely, but turning strains it; correct the order of the table of nodes,"
            " which is that of the rows where the matrices name no nodes, or their coordinates"
        )
    return sentences


def rigid_motions(body: Superelement) -> Array:
    """Shifts by one along x, y and z, turns by one about the mean place, (coordinates, 6)."""
    x = body.points - body.points.mean(axis=0)
    turns = np.cross(np.eye(3), x[:, None])  # node, axis, component
    values = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=1)
    there, out = body.rows >= 0, np.zeros((body.K.shape[0], 6))
    out[body.rows[there]] = values.swapaxes(1, 2)[there]
    return out


def _strain(body: Superelement, motion: Array) -> float:
    """Largest force over the sum of its terms' sizes."""
    force, sizes = np.abs(body.K @ motion), np.abs(body.K) @ np.abs(motion)
    return float(np.divide(force, sizes, out=np.zeros_like(force), where=sizes > 0).max())
