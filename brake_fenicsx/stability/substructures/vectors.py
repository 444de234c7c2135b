"""Right and left vectors of single modes of a sample, and their motions at the contact elements.

The zeros of the expanded T(z) come with its own vectors, which derivatives would feel to first
order. With all of D (``sample_problem``) T(z) a = own a + forced u, T(z)' b = own' b + source' eta;
the corrections come from the expanded T, bordered so that it is regular (Guettel and Tisseur, Acta
Numerica 26, 2017, doi:10.1017/S0962492917000034, section 4). The motions of the left vector along
the rows that forces act along are lead' b - D' eta.

Displacements of modes of the reduced model, with all that the kept modes leave out: the left vector
is the mode of the transposed problem, bodies transposed, and forces along the rows whose motions
are followed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.folder.processes import in_turns, release_memory
from brake_fenicsx.iteration import Steps, sizes

from ..eigensolvers.eigenpairs import on_parts, times
from .component import Complement, Component, Placed
from .contact_rows import Rows
from .polynomials import applied
from .sample import Chosen, Sample, assembled
from .sample_problem import rest_terms

# Steps at most for motions and for vectors, and the relative error at which they end.
STEPS, SETTLED = 200, 1e-8


@dataclass(frozen=True, slots=True)
class ContactMotions:
    """Motions of modes at the contact elements.

    Attributes:
        s: eigenvalues lambda [1/s], shape (modes,).
        slope: psi^H P'(lambda) phi, shape (modes,).
        right: rows "N", "T", "R" -> N phi, T phi, R phi of each element, shape (elements, modes).
        left: rows -> psi^H N', psi^H T', psi^H R', likewise.
        error: estimated relative error of the vectors and motions, shape (modes,).
    """

    s: Complex
    slope: Complex
    right: dict[str, Complex]
    left: dict[str, Complex]
    error: Array


@dataclass(frozen=True, slots=True)
class Vectors:
    """Kept coordinates of some modes, and their motions.

    Attributes:
        a: right coordinates, shape (kept modes, modes).
        b: left ones, not conjugated.
        y: motions that contact forces follow, shape (followed rows of closed elements, modes).
        eta: those that the left vector sees, likewise.
    """

    a: Complex
    b: Complex
    y: Complex
    eta: Complex


def sharpened(sample: Sample, z: Complex, a: Complex, b: Complex) -> tuple[Vectors, Array]:
    """Vectors with all of D from those of the expanded T(z).

    Args:
        sample: the reduced problem of the sample.
        z: eigenvalues, in units of the model, shape (modes,).
        a: coordinates of the kept modes, shape (kept modes, modes).
        b: the left ones, not conjugated.

    Returns:
        The vectors, and their estimated relative errors, shape (modes,): large next to a merging
        point, where they stay as sharp as they got.
    """
    a, b = a / la.norm(a, axis=0), b / la.norm(b, axis=0)
    factors = [_bordered(sample, *mode) for mode in zip(z, a.T, b.T, strict=True)]

    def step(rest: Complex, trans: int) -> Complex:
        columns = zip(factors, rest.T, strict=True)
        found = [
            la.lu_solve(lu, np.r_[-r, 0], trans=trans, check_finite=False) for lu, r in columns
        ]
        return np.asarray(np.array(found).T[:-1])

    steps = Steps(z.size, SETTLED, STEPS)
    y: Complex | None = None
    eta: Complex | None = None
    w = sample.rows.variable(z)
    while True:
        y, right_error = right_motions(sample, z, a, y)
        eta, left_error = left_motions(sample, z, b, eta)
        if not steps.moving.any():
            error = np.maximum(steps.left, np.maximum(right_error, left_error))
            return Vectors(a, b, y, eta), error
        u = sample.gaps_and_rates(z, y)
        right = applied(sample.own, w, a) + applied(sample.forced, w, u)
        left = applied(sample.own, w, b, transpose=True)
        left = left + applied(sample.source, w, eta, transpose=True)
        da, db = step(right, 0), step(left, 1)
        # Both are unit vectors.
        added = steps.take(np.maximum(la.norm(da, axis=0), la.norm(db, axis=0)))
        a, b = np.where(added, a + da, a), np.where(added, b + db, b)


def _bordered(sample: Sample, z: complex, a: Complex, b: Complex) -> tuple[Complex, AnyArray]:
    """Factor of the expanded T(z) with a border that makes it regular."""
    T = np.tensordot(z ** np.arange(len(sample.T)), sample.T, 1)
    T = np.block([[T, b.conj()[:, None]], [a.conj()[None], np.zeros((1, 1))]])
    return la.lu_factor(T, check_finite=False)


def right_motions(
    sample: Sample, z: Complex, a: Complex, start: Complex | None = None
) -> tuple[Complex, Array]:
    """Motions y that contact forces follow, from others nearby, and their errors."""
    w = sample.rows.variable(z)
    source = applied(sample.source, w, a)

    def step(y: Complex) -> Complex:
        u = sample.gaps_and_rates(z, y)
        return sample.solve(source + u - y - applied(sample.E, w, u, kind=float))

    return _iterated(applied(sample.y, z, a) if start is None else start, step)


def left_motions(
    sample: Sample, z: Complex, b: Complex, start: Complex | None = None
) -> tuple[Complex, Array]:
    """Motions eta that the left vector sees, of the transposed problem; as ``right_motions``."""
    forced = applied(sample.forced, sample.rows.variable(z), b, transpose=True)

    def step(eta: Complex) -> Complex:
        seen = forced + sample.left_response(z, eta, kind=float)
        return sample.solve(sample.gaps_and_rates(z, seen) - eta, 1)

    return _iterated(
        sample.solve(sample.gaps_and_rates(z, forced), 1) if start is None else start, step
    )


def _iterated(y: Complex, step: Callable[[Complex], Complex]) -> tuple[Complex, Array]:
    """Columns y after their steps, and the relative errors that are left, shape (columns,).

    The solves are of single precision; the products that give the residuals are of double
    precision, or their noise would be what is left.
    """
    steps = Steps(y.shape[1], SETTLED, STEPS)
    while steps.moving.any():
        change = step(y)
        y = np.where(steps.take(*sizes(change, y)), y + change, y)
    return y, steps.left


def slopes(sample: Sample, z: Complex, v: Vectors) -> Complex:
    """Slope b' T'(z) a of each mode."""
    w, u = sample.rows.variable(z), sample.gaps_and_rates(z, v.y)
    moved = [-times(A, u, float) for A in sample.E]
    for n, A in enumerate(sample.source):
        moved[n] = moved[n] + times(A, v.a)
    seen = applied(sample.forced, w, v.b, transpose=True)
    seen = seen + sample.left_response(z, v.eta, kind=float)
    rest = rest_terms(sample.own, sample.forced, v.a, u)
    return sample.slope(z, v.y, (v.b, v.eta, seen), moved, rest)


def motions_of_elements(
    sample: Sample, rows: Rows, elements: int, z: Complex, v: Vectors
) -> tuple[dict[str, Complex], dict[str, Complex]]:
    """Motions of all contact elements, open ones too, under right and left vectors.

    Args:
        sample: the reduced problem of the sample.
        rows: blocks of contact rows.
        elements: number of all contact elements.
        z: eigenvalues, in units of the model.
        v: their vectors.

    Returns:
        Followed rows under the right vectors, acting rows under the left ones: block -> motions,
        shape (elements, modes).
    """
    w, every = rows.variable(z), Chosen.of(sample.bodies, np.arange(elements), elements)
    given = sample.bodies, sample.views, rows
    force = sample.contact.forces(sample.gaps_and_rates(z, v.y), rows)
    b = assembled(*given, every, sample.closed)
    right = applied(b.source, w, v.a) - applied(b.D, w, force, kind=float)
    b = assembled(*given, sample.closed, every)
    left = applied(b.lead, w, v.b, True) - applied(b.D, w, v.eta, True, float)
    both = (rows.followed, right), (rows.acting, left)
    seen, met = (
        dict(zip(names, x.reshape(len(names), elements, z.size), strict=True)) for names, x in both
    )
    return seen, met


def mode_displacements(
    modes: Sequence[tuple[Sample, Complex, Complex]],
    rows: Rows,
    left: bool,
    comm: MPI.Comm,
    aside: int = 0,
    rest: tuple[Sequence[Placed], Complex, Array, Array] | None = None,
) -> list[tuple[Complex, Array]]:
    """Displacements W a + v of the bodies, v from their matrices at full order; collective.

    The processes take the matrices in turns: each has one factor, for the modes of all samples that
    share it, of the body and of its mirror images.

    Args:
        modes: of some samples the reduced problem, eigenvalues in units of the model, shape
            (modes,), and coordinates of the kept modes, shape (kept modes, modes).
        rows: blocks of contact rows.
        left: whether these are left vectors, not conjugated.
        comm: processes that share the work.
        aside: of these, the first so many do other work.
        rest: bodies of constant materials, the eigenvalue z at rest, loads in units of the band's
            end, shape (dofs, columns), and their kept modes, shape (kept modes, columns).

    Returns:
        Of each sample the displacements, shape (dofs, its modes), and their estimated relative
        errors, shape (its modes,): of the motions at the contact, or of v in the worst body. Those
        at rest, if there are any, come last.
    """
    matrices = _sharing([sample for sample, *_ in modes], rest[0] if rest else ())
    sources = [partial(_driven, *mode, rows, left) for mode in modes]
    out: list[tuple[Complex, Array]] = [
        (np.zeros((sum(b.dofs.size for b in sample.bodies), z.size), complex), np.zeros(z.size))
        for sample, z, _ in modes
    ]
    if rest is not None:
        sources.append(partial(_loaded, *rest, rows))
        out.append((np.zeros(rest[2].shape, complex), np.zeros(rest[1].size)))
    keys = list(matrices)

    def work(j: int) -> list[tuple[int, Index, Complex, Array]]:
        component, users = keys[j][0], matrices[keys[j]]
        release_memory()
        P = component.polynomial(modes[users[0]][0].x if users[0] < len(modes) else np.zeros(0))
        P = [A.T.tocsr() for A in P] if left else P
        # All modes together: solves with few columns take as long as with one.
        every = [(i, *b) for i in users for b in sources[i](component)]
        numbers, bodies, w, kept, load, errors = zip(*every, strict=True)
        complement = Complement(P[0], component.mass, component.W, component.coupled)
        try:
            v, settled = _left_out(complement, P, np.hstack(w), np.hstack(kept), np.hstack(load))
        finally:
            complement.factor.destroy()
        ends = np.cumsum([a.shape[1] for a in kept])[:-1]
        parts = np.split(np.hstack(kept) + v, ends, axis=1)
        worst = np.split(np.maximum(np.hstack(errors), settled), ends)
        found = zip(numbers, bodies, parts, worst, strict=True)
        return [(i, body.dofs, body.signs[:, None] * u, error) for i, body, u, error in found]

    for found in in_turns(len(keys), work, comm, aside):
        for i, dofs, u, error in found:
            out[i][0][dofs] = u
            np.maximum(out[i][1], error, out=out[i][1])
    return out


def _sharing(
    samples: Sequence[Sample], resting: Sequence[Placed]
) -> dict[tuple[Component, bytes], list[int]]:
    """Bodies at points of the box that need a factor, and the numbers of the samples it serves."""
    found: dict[tuple[Component, bytes], list[int]] = {}
    for i, sample in enumerate(samples):
        for component in dict.fromkeys(body.component for body in sample.bodies):
            point = sample.x.tobytes() if component.body.changes else b""
            found.setdefault((component, point), []).append(i)
    for component in dict.fromkeys(body.component for body in resting):
        found.setdefault((component, b""), []).append(len(samples))
    return found


def _driven(
    sample: Sample, z: Complex, a: Complex, rows: Rows, left: bool, component: Component
) -> Iterator[tuple[Placed, Complex, Complex, Complex, Array]]:
    """A body and its mirror images under the modes of a sample.

    The variable w, what is kept, contact loads, and relative errors of the motions at the contact.
    """
    if left:
        (force, error), along = left_motions(sample, z, a), rows.followed
    else:
        y, error = right_motions(sample, z, a)
        force, along = sample.contact.forces(sample.gaps_and_rates(z, y), rows), rows.acting
    interface = component.interface(sample.x)
    I = sp.vstack([interface[name] for name in along]).tocsr()
    for number, body in enumerate(sample.bodies):
        if body.component is component:
            acting, there = sample.closed.rows(number, len(along), body.elements.size)
            kept = times(component.W, a[body.modes])
            push = times(I[acting].T.tocsr(), force[there])
            yield body, rows.variable(z), kept, push, error


def _loaded(
    bodies: Sequence[Placed], z: Complex, loads: Array, a: Array, rows: Rows, component: Component
) -> Iterator[tuple[Placed, Complex, Complex, Complex, Array]]:
    """The same of a body and its mirror images under loads at rest."""
    for body in bodies:
        if body.component is component:
            push = np.asarray(-body.signs[:, None] * loads[body.dofs], complex)
            kept, error = np.asarray(component.W @ a[body.modes], complex), np.zeros(z.shape)
            yield body, rows.variable(z), kept, push, error


def _left_out(
    complement: Complement, P: list[sp.csr_matrix], w: Complex, kept: Complex, load: Complex
) -> tuple[Complex, Array]:
    """V of S(w)^-1 v = -load - P(w) kept, by the inverse at the shift, and relative errors."""
    v = np.zeros_like(kept)
    known = -load - np.sum([w**n * times(A, kept) for n, A in enumerate(P)], axis=0)
    steps = Steps(w.size, SETTLED, STEPS)
    # A solve takes as long as its columns are many: those that have settled leave it.
    while (some := np.flatnonzero(steps.moving)).size:
        x, at, size = v[:, some], w[some], np.zeros((2, w.size))
        rhs = known[:, some] - np.sum([at**n * times(A, x) for n, A in enumerate(P) if n], axis=0)
        new = on_parts(complement.solve, rhs)
        size[:, some] = sizes(new - x, kept[:, some] + x)
        v[:, some] = np.where(steps.take(*size)[some], new, x)
    return v, steps.left
