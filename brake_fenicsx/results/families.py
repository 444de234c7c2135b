"""Families: modes of different samples, runs or meshes that have the same shape, by their MAC.

Families of another run have coordinates in another basis, on another mesh perhaps. What both have
are places: the displacement of a family at nodes of the mesh, and the body that each belongs to.
"""

from collections.abc import Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index, Mask
from brake_fenicsx.mac import mac

SHAPES = "shapes.npz"
# Smallest MAC of one mode in two samples or runs.
LEAST = 0.5
# Nodes of stored shapes at most: 3 mm apart on average in the reference brake.
MOST_POINTS = 20_000
# Part of their planes that two pairs of merging modes share, where they are one pair.
ONE_PAIR = 0.9
# Modes of one shape have frequencies whose logarithms differ by less.
FARTHEST = 0.3
# Imaginary part of a vector over its real one below which it is round-off.
FLAT = 1e-3
# The same, below which a mode moves on a line rather than in a plane: others than its partner in
# flutter give it parts as small.
TURNS = 0.03
# Difference of two MAC that says nothing.
ALIKE = 0.1
# Least MAC of a mode at its onset with the family that it is named after: that of a mode that is
# made of two in equal parts, and of little else.
RESEMBLES = 0.4


def same_families(x: Complex, f: Array, y: Complex, g: Array) -> list[tuple[int, int, float]]:
    """Pairs of columns of x and y that are one mode: of largest MAC together.

    Args:
        x: vectors, shape (m, families).
        f: their frequencies [Hz].
        y: vectors in the same coordinates, shape (m, others).
        g: their frequencies [Hz].

    Returns:
        Columns of x and of y, and their MAC.
    """
    likeness = np.where(_near(f, g), mac(x, y), 0.0)
    pairs = zip(*linear_sum_assignment(-likeness), strict=True)
    return [(int(i), int(j), float(likeness[i, j])) for i, j in pairs if likeness[i, j] >= LEAST]


class Onsets:
    """Modes that begin to squeal, of any samples.

    Where two modes merge, the mode that begins to grow is their sum or their difference, by the
    sign of what couples them, and these two are orthogonal. So such modes are alike if they have
    one shape, or if their real and imaginary parts span one plane.

    Attributes:
        vectors: in M-orthonormal coordinates, shape (m, modes).
        planes: orthonormal bases of their real and imaginary parts, shape (modes, m, 2); the second
            vector is zero where a mode is real.
        sizes: dimensions of these, shape (modes,).
    """

    def __init__(self, vectors: Complex, flat: float = FLAT):
        """Find the planes.

        Args:
            vectors: in M-orthonormal coordinates, shape (m, modes).
            flat: imaginary part over the real one below which a mode is real.
        """
        parts = np.stack([vectors.T.real, vectors.T.imag], axis=2)
        self.planes, s, _ = np.linalg.svd(parts, full_matrices=False)
        real = s[:, 1] <= flat * s[:, 0]
        self.planes[real, :, 1] = 0.0
        self.vectors, self.sizes = vectors, 2 - real

    def like(self, own: list[int], others: "Onsets", inside: bool = False) -> Array:
        """Likeness of some of these modes with all others, shape (own, others).

        Args:
            own: some of these modes.
            others: the others.
            inside: whether real modes are like those whose planes they lie in.
        """
        size = np.minimum if inside else np.maximum
        P, Q = self.planes[own], others.planes
        plane = np.einsum("imp,jmq->ijpq", P, Q) ** 2
        share = plane.sum(axis=(2, 3)) / size.outer(self.sizes[own], others.sizes)
        shape = mac(self.vectors[:, own], others.vectors)
        return np.maximum(shape, np.where(share > ONE_PAIR, share, 0.0))

    def families(self, frequencies: Array) -> tuple[list[int], list[int]]:
        """Family of each mode, and the mode that founds each family.

        Args:
            frequencies: of the modes [Hz].
        """
        family, first = np.zeros(self.sizes.size, int), list[int]()
        f = np.maximum(frequencies, 1.0)
        # Real vectors, of the merging itself, lie in the planes of the others.
        alike: Array = np.zeros((0, family.size))
        for j in np.argsort(-self.sizes, kind="stable"):
            if not first or alike[:, j].max() < LEAST:
                alike = np.vstack([alike, self.like([int(j)], self, True) * _near(f[[j]], f)])
                first.append(int(j))
            family[j] = np.argmax(alike[:, j])
        return family.tolist(), first


def known_numbers(likeness: Array) -> list[int]:
    """Number of each family: of the known one it is likest to, each given once; else a new one.

    Args:
        likeness: of the known families with these, shape (known, families).
    """
    known, new = likeness.shape
    numbers = [known + n for n in range(new)]
    for i, j in zip(*linear_sum_assignment(-likeness), strict=True):
        if likeness[i, j] >= RESEMBLES:
            numbers[j] = int(i)
    return numbers


def _near(f: Array, g: Array) -> Mask:
    return np.abs(np.log(g[None, :] / f[:, None])) < FARTHEST


class ModeFamilies:
    """Families of modes over samples, by the MAC in a common basis.

    The modes of a sample are matched to the first members of the families, best match first; a mode
    that matches none founds a family. While the frequencies of two coupled modes pass one another,
    the growing one turns from their sum to their difference, which are orthogonal. So growing modes
    are matched first, to the families that have grown, by MAC or plane; and a mode that matches no
    first member belongs to one that lies in its plane, or in whose plane it lies.

    Attributes:
        vectors: the first member of each family, of length 1.
        frequencies: its frequency [Hz], at least 1.
        grown: the first growing member of the families that have one, by number.
    """

    def __init__(self, known: "ModeFamilies | None" = None):
        """Begin with the families that are known, or with none."""
        self.vectors: list[Complex] = [] if known is None else [*known.vectors]
        self.frequencies: list[float] = [] if known is None else [*known.frequencies]
        self.grown: dict[int, Complex] = {} if known is None else {**known.grown}

    def add(self, shapes: Complex, frequencies: Array, grows: Mask) -> Index:
        """Family of each mode of one more sample, shape (modes,).

        Args:
            shapes: the mode vectors in M-orthonormal coordinates, shape (m, modes).
            frequencies: their frequencies [Hz], shape (modes,).
            grows: which of them are unstable, shape (modes,).
        """
        X = shapes / np.linalg.norm(shapes, axis=0)
        f = np.maximum(frequencies, 1.0)
        family = np.full(X.shape[1], -1)
        every = dict(enumerate(self.vectors))
        if every:
            likeness: AnyArray = self._near(every, f) * mac(np.array(self.vectors).T, X)
            grown = self._in_planes(self.grown, X, f, np.flatnonzero(grows))
            # Two families that a growing mode resembles alike: the one that has grown.
            grown[grown < likeness.max(axis=0) - ALIKE] = 0.0
            _match(family, grown, [*self.grown], RESEMBLES)
            _match(family, likeness, [*every], LEAST)
            free = {n: every[n] for n in sorted(every.keys() - {*family.tolist()})}
            inside = self._in_planes(free, X, f, np.flatnonzero(family < 0), inside=True)
            _match(family, inside, [*free], LEAST)
        for j in np.flatnonzero(family < 0):
            family[j] = len(self.vectors)
            self.vectors.append(X[:, j].copy())
            self.frequencies.append(float(f[j]))
        for j in np.flatnonzero(grows):
            self.grown.setdefault(int(family[j]), X[:, j].copy())
        return family

    def _in_planes(
        self, known: dict[int, Complex], X: Complex, f: Array, some: Index, inside: bool = False
    ) -> Array:
        """Likeness of some families with some modes, planes included; 0 of all other modes."""
        like = np.zeros((len(known), f.size))
        if known and some.size:
            families = Onsets(np.array([*known.values()]).T, TURNS)
            modes = Onsets(X[:, some], TURNS)
            found = families.like([*range(len(known))], modes, inside)
            like[:, some] = self._near(known, f[some]) * found
        return like

    def _near(self, known: dict[int, Complex], f: Array) -> Mask:
        return _near(np.array([self.frequencies[n] for n in known]), f)


def _match(family: Index, likeness: Array, numbers: list[int], least: float) -> None:
    """Give modes without a family one that no mode has yet, the best match first."""
    taken, flat = {int(n) for n in family}, likeness.ravel()
    good = np.flatnonzero(flat >= least)
    for place in good[np.argsort(-flat[good], kind="stable")]:
        i, j = divmod(int(place), family.size)
        if family[j] < 0 and numbers[i] not in taken:
            family[j] = numbers[i]
            taken.add(numbers[i])


def family_shapes(places: Array, u: Complex, numbers: Index) -> dict[str, AnyArray]:
    """Displacements of families at nodes, as arrays to store.

    Args:
        places: coordinates [m], direction (0, 1, 2) and centre of the body [m] of every free dof,
            shape (dofs, 7).
        u: displacement of a mode of each family, shape (dofs, families).
        numbers: number of each family.

    Returns:
        "points" [m], shape (nodes, 3); "body", the centre of the body of each node [m], likewise;
        "shapes", shape (families, nodes, 3), of unit norm; "families".
    """
    moves = places[:, 3] < 3
    places, u = places[moves], u[moves]
    # Rounded, so that the components of one node have one place whatever the round-off.
    keys = np.round(np.delete(places, 3, axis=1), 9)
    _, first, node = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    vectors = np.zeros((u.shape[1], first.size, 3), complex)
    vectors[:, node.ravel(), places[:, 3].astype(int)] = u.T
    step = max(1, -(-first.size // MOST_POINTS))
    chosen, kept = vectors[:, ::step], keys[first[::step]]
    size = np.linalg.norm(chosen.reshape(len(chosen), -1), axis=1)
    shapes = (chosen / np.maximum(size, 1e-300)[:, None, None]).astype(np.complex64)
    bodies = places[first[::step], 4:]
    return {"points": kept[:, :3], "body": bodies, "shapes": shapes, "families": numbers}


def shapes_at_dofs(shapes: Mapping[str, AnyArray], places: Array) -> Complex:
    """Displacements of stored families at the free dofs of another mesh: of the nearest nodes.

    Args:
        shapes: what ``family_shapes`` gave.
        places: of every free dof, as above.

    Returns:
        Shape (dofs, families).
    """
    nodes = np.column_stack([shapes["points"], shapes["body"]])
    nearest = KDTree(nodes).query(np.delete(places, 3, axis=1))[1]
    moves = places[:, 3] < 3
    found = shapes["shapes"][:, nearest, np.where(moves, places[:, 3], 0).astype(int)] * moves
    return np.asarray(found.T, dtype=complex)
