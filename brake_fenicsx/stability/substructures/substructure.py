"""Substructures of a brake: bodies that nothing but contact couples.

Without contact the stiffness, mass and damping of a brake are block diagonal. Each block is a
substructure with a free interface (Craig and Chang 1976, Rubin 1975), whose stiffness and damping
are affine in some coefficients,

    K = K_0 + sum a_j A_j,     C = C_0 + sum c_j A_j,     M = M_0 + sum m_j A_j,

over one set of matrices: changes of the stiffness and of the mass, of which the damping takes a
share (Rayleigh damping, loss factors), and what the damping alone is made of. A pad on the
other side of the disc is often the mirror image of the first one; then one of the two is reduced.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from brake_fenicsx.arguments import AnyArray, Array, Index

# Coordinates, relative to the size of a body, and matrix entries, relative to the largest, of two
# mirror images differ by round-off.
SAME_PLACE, SAME_ENTRY = 1e-6, 1e-9

# What a sparse matrix is made of.
CSR = ("data", "indices", "indptr")


@dataclass(frozen=True, slots=True)
class ModalRatio:
    """Damping ratio of the modes of a part, or of the part of a substructure.

    Attributes:
        mass: of the part [kg], on the dofs of the substructure, shape (n, n).
        frequency: rising [Hz], shape (m,); empty for one ratio.
        ratio: zeta at them, linear between, constant outside, shape (m,) or (1,).
    """

    mass: sp.csr_matrix
    frequency: Array
    ratio: Array

    def at(self, f: Array) -> Array:
        """The ratio at some frequencies [Hz]."""
        if not self.frequency.size:
            return np.full(f.shape, self.ratio[0])
        return np.interp(f, self.frequency, self.ratio)


@dataclass(frozen=True, slots=True)
class Substructure:
    """One body of a brake, without contact.

    Attributes:
        dofs: its places among all free dofs, shape (n,).
        elements: its contact elements among all, shape (m,).
        K: elastic stiffness [N/m], shape (n, n).
        M: mass [kg].
        C: damping [N s/m]; None where it has none.
        interface: the rows "N" (gap), "T" (slip along the sliding direction) and "R" (slip across
            it) of its contact elements, each of shape (m, n).
        loads: unit loads [N], shape (n, loads).
        changes: matrices A_j that act on it: number among all -> matrix.
        points: coordinates [m] and direction (0, 1, 2) of its dofs, and, where tied bodies may have
            nodes in one place, the centre of the body of each [m], shape (n, 4) or (n, 7); None if
            unknown.
        ratios: damping ratios of its parts; an offline stage alone needs them.
    """

    dofs: Index
    elements: Index
    K: sp.csr_matrix
    M: sp.csr_matrix
    C: sp.csr_matrix | None
    interface: dict[str, sp.csr_matrix]
    loads: Array
    changes: dict[int, sp.csr_matrix] = field(default_factory=dict)
    points: Array | None = None
    ratios: tuple[ModalRatio, ...] = ()

    def stiffness(self, c: Array) -> sp.csr_matrix:
        """K [N/m] under coefficients of all changes, shape (3, changes)."""
        return self._changed(self.K, c[0])

    def mass(self, c: Array) -> sp.csr_matrix:
        """M [kg] under these coefficients."""
        return self._changed(self.M, c[2])

    @property
    def matrices(self) -> list[sp.csr_matrix]:
        """K_0, M_0, C_0 (empty where it has none) and the changes."""
        C = sp.csr_matrix(self.K.shape) if self.C is None else self.C
        return [self.K, self.M, C, *self.changes.values()]

    def added(self, factors: Array) -> sp.csr_matrix:
        """The sum of ``matrices`` times some factors, shape (3 + changes,)."""
        parts = zip(factors, self.matrices, strict=True)
        return sum((f * A for f, A in parts if f), sp.csr_matrix(self.K.shape)).tocsr()

    def _changed(self, A: sp.csr_matrix, c: Array) -> sp.csr_matrix:
        return sum((c[j] * change for j, change in self.changes.items() if c[j]), A).tocsr()

    def modal_damping(self, W: Array, kappa: Array) -> Array:
        """Damping 2 zeta omega of its modes by the ratios of its parts [1/s], shape (modes,).

        A mode has the mean of its parts' ratios, weighted by the kinetic energy of each in it
        (Hasselman, AIAA Journal 14, 1409, 1976: "composite" modal damping).

        Args:
            W: M-orthonormal modes, shape (n, modes).
            kappa: their eigenvalues [1/s^2].
        """
        omega = np.sqrt(np.maximum(kappa, 0.0))
        weights = [np.sum(W * (part.mass @ W), axis=0) for part in self.ratios]
        zeta = [part.at(omega / (2 * np.pi)) for part in self.ratios]
        return np.asarray(2 * np.average(zeta, axis=0, weights=weights) * omega)

    def damping_beyond(self, omega: float) -> Array:
        """Damping of the modes beyond a frequency by the ratios there: shares of M and K.

        2 zeta omega of a mode at omega > omega_c is about 2 zeta omega_c + zeta omega^2 / (4
        omega_c). This follows the square root of omega_c / omega, by which a mode weighs in the
        flexibility, to 1/8.

        Args:
            omega: the frequency omega_c [rad/s].

        Returns:
            [1/s] and [s].
        """
        if not self.ratios:
            return np.zeros(2)
        zeta = [part.at(np.array(omega / (2 * np.pi))) for part in self.ratios]
        mean = np.average(zeta, weights=[part.mass.sum() for part in self.ratios])
        return float(mean) * np.array([2 * omega, 1 / (4 * omega)])

    def arrays(self) -> dict[str, AnyArray]:
        """What ``from_arrays`` makes the body of again; coordinates are left out."""
        matrices = {"K": self.K, "M": self.M, **self.interface}
        matrices |= {f"change{j}": A for j, A in self.changes.items()}
        if self.C is not None:
            matrices["C"] = self.C
        out = {"dofs": self.dofs, "elements": self.elements, "loads": self.loads}
        for name, A in matrices.items():
            A.sort_indices()
            out |= {f"{name}.{part}": getattr(A, part) for part in CSR}
        return out

    @classmethod
    def from_arrays(cls, arrays: dict[str, AnyArray]) -> "Substructure":
        """The body, on the same memory: the arrays may be mapped from a file."""
        columns = arrays["dofs"].size

        def matrix(name: str) -> sp.csr_matrix:
            parts = tuple(arrays[f"{name}.{part}"] for part in CSR)
            return sp.csr_matrix(parts, shape=(parts[2].size - 1, columns))

        numbers = [
            int(name[6:-5])
            for name in arrays
            if name.startswith("change") and name.endswith(".data")
        ]
        rows = {name: matrix(name) for name in "NTR" if f"{name}.data" in arrays}
        matrices = matrix("K"), matrix("M"), matrix("C") if "C.data" in arrays else None
        changes = {j: matrix(f"change{j}") for j in numbers}
        return cls(arrays["dofs"], arrays["elements"], *matrices, rows, arrays["loads"], changes)


class MatrixSums:
    """Sums of some matrices on one pattern, whatever their factors are.

    SciPy's sum leaves out entries that happen to be zero, such as all those of a matrix whose
    factor is zero. Each such sum would have a pattern of its own, and a factorisation would analyse
    it anew. Here the pattern has the places of all entries of all matrices.

    Example:
        >>> A, B = sp.csr_matrix([[1.0, 0.0], [0.0, 2.0]]), sp.csr_matrix([[0.0, 3.0], [0.0, 0.0]])
        >>> MatrixSums([A, B])(np.array([1.0, 0.0])).nnz
        3
    """

    def __init__(self, matrices: Sequence[sp.csr_matrix]):
        """Find the places of all entries.

        Args:
            matrices: of one shape.
        """
        self._matrices = [_canonical(A) for A in matrices]
        first = self._matrices[0]
        self._places: list[slice | AnyArray] = [slice(None)] * len(matrices)
        whole = first
        if not all(_alike(A, first) for A in self._matrices):
            whole = sum(map(_ones, self._matrices), sp.csr_matrix(first.shape)).tocsr()
            whole.sort_indices()
            self._places = self._found(whole)
        self._pattern, self._shape = (whole.indices, whole.indptr), first.shape

    def __call__(self, factors: AnyArray) -> sp.csr_matrix:
        """The sum of the matrices times some factors, real or complex, shape (matrices,)."""
        data: AnyArray = np.zeros(self._pattern[0].size, np.result_type(float, factors))
        for factor, A, places in zip(factors, self._matrices, self._places, strict=True):
            if factor:
                data[places] += factor * A.data
        return sp.csr_matrix((data, *self._pattern), self._shape)

    def _found(self, whole: sp.csr_matrix) -> list[slice | AnyArray]:
        """Places of the entries of each matrix among all; one array for matrices alike."""
        whole.data = np.arange(1.0, whole.nnz + 1)
        found: list[slice | AnyArray] = []
        for i, A in enumerate(self._matrices):
            same = next((j for j in range(i) if _alike(self._matrices[j], A)), None)
            if same is None:
                own = _ones(A).multiply(whole).tocsr()
                own.sort_indices()
                found.append(own.data.astype(np.int32) - 1)
            else:
                found.append(found[same])
        return found


def _canonical(A: sp.csr_matrix) -> sp.csr_matrix:
    """The matrix with sorted indices, each place once."""
    if not A.has_canonical_format:
        A = A.copy()
        A.sum_duplicates()
    return A


def _alike(A: sp.csr_matrix, B: sp.csr_matrix) -> bool:
    """Whether two matrices have entries in the same places."""
    pairs = (A.indptr, B.indptr), (A.indices, B.indices)
    return all(a is b or np.array_equal(a, b) for a, b in pairs)


def _ones(A: sp.csr_matrix) -> sp.csr_matrix:
    """One in each place of an entry."""
    return sp.csr_matrix((np.ones(A.nnz), A.indices, A.indptr), A.shape)


def split_substructures(
    K: sp.csr_matrix,
    M: sp.csr_matrix,
    interface: dict[str, sp.csr_matrix],
    loads: Array | None = None,
    changes: Sequence[sp.csr_matrix] = (),
    C: sp.csr_matrix | None = None,
    points: Array | None = None,
) -> list[Substructure]:
    """Take a brake apart into the bodies that only contact couples.

    Args:
        K: elastic stiffness without contact [N/m], shape (dofs, dofs).
        M: mass [kg].
        interface: gap operator "N", slip operators "T" and "R", shape (elements, dofs).
        loads: unit loads [N], shape (dofs, loads); none if None.
        changes: matrices A_j that stiffness and damping are affine over.
        C: damping of the bodies [N s/m]; None where they have none.
        points: coordinates [m] and direction of every dof, perhaps the centre of its body, shape
            (dofs, 4) or (dofs, 7); mirror images are found by them.

    Returns:
        The bodies, in the order of their first dofs.
    """
    square = [K, M, *changes, *([] if C is None else [C])]
    count, label = connected_components(sum(map(abs, square)), directed=False)
    loads = np.zeros((K.shape[0], 0)) if loads is None else loads
    columns = {name: A.tocsc() for name, A in interface.items()}

    def block(A: sp.csr_matrix, dofs: Index) -> sp.csr_matrix:
        own = A[dofs][:, dofs].tocsr()
        # The three components of a displacement share no mass, and most C_ij join but two of them:
        # up to two thirds of the pattern are zeros.
        own.eliminate_zeros()
        return own

    found = []
    for i in range(count):
        dofs = np.flatnonzero(label == i)
        rows = {name: A[:, dofs].tocsr() for name, A in columns.items()}
        touched = np.sum([np.diff(A.indptr) for A in rows.values()], axis=0)
        elements = np.flatnonzero(touched)
        own = {j: block(A.tocsr(), dofs) for j, A in enumerate(changes)}
        own = {j: A for j, A in own.items() if A.nnz}
        damping = None if C is None else block(C.tocsr(), dofs)
        if damping is not None:
            # What changes may become damped.
            damping = damping if damping.nnz or own else None
        seen = {name: A[elements] for name, A in rows.items()}
        rest = seen, loads[dofs], own, None if points is None else points[dofs]
        found.append(Substructure(dofs, elements, block(K, dofs), block(M, dofs), damping, *rest))
    return found


@dataclass(frozen=True, slots=True)
class MirrorImage:
    """A body whose displacements are those of another one, reordered and with other signs.

    Attributes:
        body: the image; its dofs, elements and rows in the order of the original.
        signs: displacement of the image over that of the original, 1 or -1, shape (n,).
        across: whether the slips across the sliding direction ("R") have the other sign too.
    """

    body: Substructure
    signs: Array
    across: bool


def mirror_image(original: Substructure, other: Substructure) -> MirrorImage | None:
    """A second body as the mirror image of a first one; None where it is none.

    Reflections of the coordinate axes, and products of them, are tried about the centres of the
    two bodies; only a body all of whose matrices agree to round-off is an image.

    Args:
        original: the first body.
        other: the second one.
    """
    sizes = [
        (b.K.shape, b.elements.size, b.loads.shape, sorted(b.changes)) for b in (original, other)
    ]
    first, second = original.points, other.points
    if sizes[0] != sizes[1] or first is None or second is None:
        return None
    # One triple of coordinates, or two: that of the body where several are tied together.
    triples = first.shape[1] // 3
    places = [
        np.delete(x, 3, axis=1) - np.tile(x[:, :3].mean(axis=0), triples) for x in (first, second)
    ]
    size = float(np.ptp(places[0], axis=0).max()) or 1.0
    direction = first[:, 3].astype(int)
    tree = KDTree(np.column_stack([places[1], size * second[:, 3]]))
    for turn in product((1.0, -1.0), repeat=3):
        wanted = np.column_stack([places[0] * np.tile(turn, triples), size * direction])
        distance, dofs = tree.query(wanted)
        if distance.max() > SAME_PLACE * size or np.unique(dofs).size < dofs.size:
            continue
        image = _reordered(original, other, dofs, np.array([*turn, 1.0])[direction])
        if image is not None:
            return image
    return None


def turned_across(body: Substructure, elements: Index) -> Substructure:
    """A body with the other direction across the sliding one in some contact elements.

    A force across follows a slip across, so that the direction may be either of the two, as long as
    both bodies of an element have the same.
    """
    if "R" not in body.interface:
        return body
    signs = np.where(np.isin(body.elements, elements), -1.0, 1.0)
    rows = {**body.interface, "R": (sp.diags(signs) @ body.interface["R"]).tocsr()}
    return replace(body, interface=rows)


def _reordered(
    original: Substructure, other: Substructure, dofs: Index, signs: Array
) -> MirrorImage | None:
    """The other body in the order of the original, if its matrices are the same ones."""
    turn = sp.diags(signs)

    def same(A: sp.spmatrix, B: sp.spmatrix) -> bool:
        return _largest(A - B) <= SAME_ENTRY * max(_largest(A), _largest(B))

    def square(A: sp.csr_matrix) -> sp.csr_matrix:
        return (turn @ A[dofs][:, dofs] @ turn).tocsr()

    if (original.C is None) != (other.C is None):
        return None
    if not _same_ratios(original.ratios, other.ratios):
        return None
    pairs = [(original.K, other.K), (original.M, other.M)]
    pairs += [(a.mass, b.mass) for a, b in zip(original.ratios, other.ratios, strict=True)]
    pairs += [(A, other.changes[j]) for j, A in original.changes.items()]
    if original.C is not None and other.C is not None:
        pairs.append((original.C, other.C))
    if not all(same(A, square(B)) for A, B in pairs):
        return None
    rows = {name: (A[:, dofs] @ turn).tocsr() for name, A in other.interface.items()}
    elements = _matching_rows(original.interface, rows)
    loads = other.loads[dofs] * signs[:, None]
    if elements is None or not same(sp.csr_matrix(loads), sp.csr_matrix(original.loads)):
        return None
    rows = {name: A[elements] for name, A in rows.items()}
    across = "R" in rows and not same(original.interface["R"], rows["R"])
    if across:
        rows["R"] = -rows["R"]
    if not all(same(A, rows[name]) for name, A in original.interface.items()):
        return None
    dofs, elements = other.dofs[dofs], other.elements[elements]
    moved = replace(original, dofs=dofs, elements=elements, loads=loads, points=None)
    return MirrorImage(moved, signs, across)


def _same_ratios(first: tuple[ModalRatio, ...], second: tuple[ModalRatio, ...]) -> bool:
    """Whether the parts of two bodies have the same damping ratios, in this order."""
    return len(first) == len(second) and all(
        np.array_equal(a.frequency, b.frequency) and np.array_equal(a.ratio, b.ratio)
        for a, b in zip(first, second, strict=True)
    )


def _matching_rows(
    first: dict[str, sp.csr_matrix], second: dict[str, sp.csr_matrix]
) -> Index | None:
    """For each contact element of the first body the one of the second with the same rows."""
    weights = np.random.default_rng(0).random((first["N"].shape[1], 2))
    marks = [rows["N"] @ weights[:, 0] + rows["T"] @ weights[:, 1] for rows in (first, second)]
    order = [np.argsort(mark, kind="stable") for mark in marks]
    if not np.allclose(marks[0][order[0]], marks[1][order[1]], rtol=1e-6, atol=1e-12):
        return None
    found = np.empty_like(order[0])
    found[order[0]] = order[1]
    return found


def _largest(A: sp.spmatrix) -> float:
    """Largest modulus of an entry."""
    return float(np.abs(A.tocsr().data).max(initial=0.0))
