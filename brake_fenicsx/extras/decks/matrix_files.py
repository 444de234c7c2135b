"""Sparse matrices of a body as other codes write them.

Read by their content: Matrix Market; text of three columns (row, column, entry: Abaqus
FORMAT=COORDINATE, CalculiX SOLVER=MATRIXSTORAGE) or of five (node, component, node, component,
entry: Abaqus FORMAT=MATRIX INPUT and LABELS); Nastran DMIG, by pyNastran; SciPy's npz.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array, Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import read_npz, reading

# Node and component (1, 2, 3: displacements, 4, 5, 6: rotations) of each row, shape (rows, 2).
Labels = Ints

# Entries below this share of the largest one tell no triangle from another.
ROUND_OFF = 1e-6
# Numbers as Fortran and tables write them.
_PLAIN = str.maketrans(",Dd", " EE")
# Rows that a matrix of any file may have.
ROWS = 10**6


@dataclass(frozen=True, slots=True)
class LabelledMatrix:
    """A square matrix as a file holds it.

    Attributes:
        A: its entries, in the units of the file.
        rows: node and component of each row; None where the file numbers the rows alone.
    """

    A: sp.csr_matrix
    rows: Labels | None


def read_matrix(path: Path) -> LabelledMatrix:
    """Read a symmetric matrix, all of it or one triangle.

    Args:
        path: the file.

    Raises:
        SceneError: the file cannot be read, is of no known format, or holds no symmetric matrix;
            the line and the remedy.
    """
    with reading(path, "as a matrix", at=""):
        if path.suffix == ".npz":
            matrix = LabelledMatrix(_npz(path), None)
        else:
            with path.open(encoding="utf-8", errors="replace") as file:
                head = file.read(10_000)
            if head.startswith("%%MatrixMarket"):
                matrix = LabelledMatrix(_matrix_market(path), None)
            elif re.search(r"^DMIG", head, re.MULTILINE):
                matrix = _dmig(path)
            else:
                matrix = _columns(path)
    A = matrix.A
    if A.shape[0] != A.shape[1] or not A.shape[0]:
        raise SceneError(f"{A.shape[0]} x {A.shape[1]} entries; a square matrix is needed")
    if np.iscomplexobj(A.data) or not np.isfinite(A.data).all():
        raise SceneError("an entry is complex or not finite; real matrices are needed")
    skew = abs(A - A.T).max() / abs(A).max() if A.nnz else 0.0
    if skew > ROUND_OFF:
        raise SceneError(f"""not symmetric: entries differ by {skew:.1e} of the largest; write the
            matrices of the body alone, without friction and gyroscopic terms""")
    return LabelledMatrix((0.5 * (A + A.T)).tocsr(), matrix.rows)


def read_row_labels(path: Path) -> Labels:
    """Read "node.component" (CalculiX's .dof) or "node, component", one for each row.

    Raises:
        SceneError: a line that is no label, or one that comes twice.
    """
    with reading(path, "as text", at=""):
        lines = [line.strip() for line in path.read_text("utf-8").splitlines() if line.strip()]
    for number, line in enumerate(lines, 1):
        if not re.fullmatch(r"\d+[.,;\s]+\d+", line):
            raise SceneError(f"line {number}: {line!r}; write a node and a component, 12.3")
    labels = np.array([re.split(r"[.,;\s]+", line) for line in lines], dtype=np.int64)
    if len(np.unique(labels, axis=0)) < len(lines):
        raise SceneError("a node and component twice; write one line for each row")
    return labels.reshape(-1, 2)


def _npz(path: Path) -> sp.csr_matrix:
    """A sparse matrix as ``scipy.sparse.save_npz`` writes it, whose indices are looked at."""
    held = read_npz(path)
    kind, shape = held["format"].item(), tuple(int(n) for n in held["shape"])
    _check_rows(shape, sum(a.nbytes for a in held.values()))
    name = kind.decode() if isinstance(kind, bytes) else str(kind)
    if name in ("csr", "csc", "bsr"):
        A = getattr(sp, f"{name}_matrix")((held["data"], held["indices"], held["indptr"]), shape)
        A.check_format(full_check=True)
    elif name == "coo":
        A = sp.coo_matrix((held["data"], (held["row"], held["col"])), shape)
    elif name == "dia":
        A = sp.dia_matrix((held["data"], held["offsets"]), shape)
    else:
        raise ValueError(f"format {name!r} is not known; write csr")
    return A.tocsr()


def _matrix_market(path: Path) -> sp.csr_matrix:
    """A matrix in Matrix Market format, after a look at the sizes that it declares."""
    from scipy.io import mminfo, mmread

    rows, columns, entries, layout, _, symmetry = mminfo(str(path))
    length = path.stat().st_size
    _check_rows((rows, columns), length)
    whole = layout == "coordinate" or symmetry == "general"
    # A number and its line feed take two bytes or more.
    if 2 * (entries if whole else entries // 2) > length:
        raise ValueError(f"it declares {entries} entries, more than its {length} bytes hold")
    return sp.csr_matrix(mmread(str(path)))


def _check_rows(shape: Sequence[int], there: int) -> None:
    """Refuse rows by far more than there are bytes: empty ones have entries among others."""
    if max(shape, default=0) > max(ROWS, there):
        raise ValueError(f"{' x '.join(map(str, shape))} rows and columns in {there} bytes")


def _columns(path: Path) -> LabelledMatrix:
    """Text of three or five columns; lines that begin with * or # are headings."""
    rows: list[list[float]] = []
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            words = line.translate(_PLAIN).split()
            if not words or words[0][0] in "*#%$":
                continue
            try:
                rows.append([float(word) for word in words])
            except ValueError:
                rows.append([])
            if len(rows[-1]) not in (3, 5) or len(rows[-1]) != len(rows[0]):
                raise SceneError(f"""line {number}: {line.strip()[:60]!r}; text of three columns
                    (row, column, entry) or five (node, component, node, component, entry) is read,
                    and Matrix Market, Nastran DMIG and npz: convert others, to Matrix Market for
                    example""")
    if not rows:
        raise SceneError("no entries")
    table: Array = np.array(rows)
    if table.shape[1] == 3:
        i, j = table[:, :2].astype(int).T - 1
        size = int(max(i.max(), j.max())) + 1
        _check_rows((size,), path.stat().st_size)
        return LabelledMatrix(_filled(i, j, table[:, 2], size), None)
    return _labelled(table[:, :4].astype(int), table[:, 4])


def _labelled(pairs: Ints, values: Array) -> LabelledMatrix:
    """A matrix from node, component, node and component of each entry."""
    labels, place = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    i, j = place.reshape(-1, 2).T
    return LabelledMatrix(_filled(i, j, values, len(labels)), labels)


def _filled(i: AnyArray, j: AnyArray, values: AnyArray, size: int) -> sp.csr_matrix:
    """A matrix from its entries; where each pair of rows is given once, it stands for both."""
    if i.min() < 0 or j.min() < 0:
        raise SceneError("a row or column below 1")
    twice = i.size - np.unique(i * size + j).size
    if twice:
        raise SceneError(f"{twice} entries are given twice")
    off = i != j
    pairs = np.minimum(i, j)[off] * size + np.maximum(i, j)[off]
    if np.unique(pairs).size == pairs.size:
        i, j, values = (np.concatenate([a, b[off]]) for a, b in ((i, j), (j, i), (values, values)))
    return sp.csr_matrix((values, (i, j)), shape=(size, size))


def _dmig(path: Path) -> LabelledMatrix:
    """The one matrix of a file of Nastran DMIG entries."""
    try:
        from pyNastran.bdf.bdf import BDF
    except ImportError:
        raise SceneError("Nastran DMIG is read by pyNastran: pip install pyNastran") from None
    deck = BDF(debug=None)
    with reading(path, "by pyNastran", at=""):
        # pyNastran leaves a file in the working directory where one to include is missing.
        if any(line.lstrip().upper().startswith("INCLUDE") for line in path.open("r", 1, "latin1")):
            raise SceneError("INCLUDE: write the DMIG entries into the file itself")
        deck.read_bdf(str(path), validate=False, xref=False, punch=True)
    if len(deck.dmig) != 1:
        raise SceneError(f"""DMIG matrices {", ".join(deck.dmig) or "none"}; write one matrix to
            each file""")
    # Its entries, not its get_matrix, which in some releases fails with NumPy 2.
    A = next(iter(deck.dmig.values()))
    if A.is_complex:
        raise SceneError("a complex DMIG matrix; real matrices are needed")
    # Scalar points have the component 0; they are no displacements.
    return _labelled(np.hstack([A.GCi, A.GCj]).astype(int), np.asarray(A.Real, dtype=float))
