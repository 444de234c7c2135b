"""Designs: which points of the unit cube [0, 1]^d the samples of a study stand on.

    random           independent points
    latin-hypercube  one point in each of n slices of every axis
    sobol            the scrambled Sobol sequence
    rbd-fast         a Latin hypercube; any design but the next two can be analysed by RBD-FAST
    fast             search curves of the extended FAST, one for each input
    saltelli         Saltelli's crossing of two Sobol blocks, for first-order and total indices

Where samples draw their roughness, Saltelli's design takes it for one more input: the rows A and A
with an input of B have the roughness of the row A, one more row A and the row B that of B. A search
curve of FAST cannot hold it.

The last two give n' <= n points, the largest number their structure allows.
"""

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from scipy import special

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import InputLaw
from brake_fenicsx.scene import Distribution
from brake_fenicsx.scene.samples_section import Plan

# Harmonics M that FAST sums for each input.
HARMONICS = 4
# Points of a search curve: 4 M^2 for each other input, so that none shares a frequency, and 200:
# with 111 an index of Ishigami's function is off by 0.22, with 200 by 0.003.
SHORTEST = 200
# Designs whose points mean something only all together: no point may be drawn again.
RIGID = ("fast", "saltelli")


def design_size(plan: Plan, inputs: int) -> int:
    """Number of points of a design.

    Args:
        plan: samples asked for, design and curves.
        inputs: number of random inputs d.

    Raises:
        SceneError: the samples asked for are too few for the design.
    """
    if plan.design == "fast":
        length = plan.n // (inputs * plan.curves)
        shortest = max(SHORTEST, 4 * HARMONICS**2 * (inputs - 1) + 1)
        if length < shortest:
            raise SceneError(f"""samples: n = {plan.n} is too few for FAST with {inputs} inputs and
                {plan.curves} curves; take {shortest * inputs * plan.curves} or more, or design =
                'rbd-fast'""")
        return length * inputs * plan.curves
    if plan.design == "saltelli":
        width = inputs + plan.rough + 2
        rows = plan.n // width
        if rows < 8:
            raise SceneError(f"""samples: n = {plan.n} is too few for Saltelli's design with
                {inputs} inputs{" and the roughness" if plan.rough else ""}; take {8 * width} or
                more""")
        return int(2 ** math.floor(math.log2(rows))) * width
    return plan.n


def design_points(plan: Plan, inputs: int, seed: np.random.SeedSequence) -> Array | None:
    """Points of a design.

    Args:
        plan: samples asked for, design and curves.
        inputs: number of random inputs d.
        seed: seed of the whole design.

    Returns:
        Shape (design_size, d); None for independent points, which each sample draws by itself.
    """
    size = design_size(plan, inputs)
    if plan.design == "random":
        return None
    # A sequence of its own: newer SciPy spawns from it, and a second call would find it changed.
    fresh = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
    rng = np.random.default_rng(fresh)
    if plan.design in ("latin-hypercube", "rbd-fast"):
        from scipy.stats import qmc

        return np.asarray(qmc.LatinHypercube(inputs, seed=rng).random(size))
    if plan.design == "sobol":
        from scipy.stats import qmc

        with warnings.catch_warnings():
            # The sequence is balanced at powers of 2 only; any number of samples may be wanted.
            warnings.simplefilter("ignore", UserWarning)
            return _inside(qmc.Sobol(inputs, seed=rng).random(size))
    if plan.design == "saltelli":
        from SALib.sample import sobol

        every = inputs + plan.rough
        rows, problem = size // (every + 2), unit_problem(every)
        points = sobol.sample(problem, rows, calc_second_order=False, seed=rng)
        return _inside(points[:, :inputs])
    return _curves(plan.curves, size // plan.curves // inputs, inputs, rng)


def roughness_of(plan: Plan, inputs: int, k: int) -> int:
    """Number of the sample whose roughness sample k has: its own but for Saltelli's design."""
    if not (plan.rough and plan.design == "saltelli"):
        return k
    block, row = divmod(k, inputs + 3)
    return block * (inputs + 3) + (0 if row <= inputs else inputs + 2)


def _curves(curves: int, length: int, inputs: int, rng: np.random.Generator) -> Array:
    """Search curves of FAST with random phases, one set of d curves after the other."""
    from SALib.sample import fast_sampler

    sets = []
    for _ in range(curves):
        phase = int(rng.integers(2**32))
        with library_seed(phase):
            found = fast_sampler.sample(unit_problem(inputs), length, M=HARMONICS, seed=phase)
        sets.append(found)
    return _inside(np.concatenate(sets))


def correlation_root(random: Mapping[str, Distribution | InputLaw], design: str) -> Array | None:
    """Cholesky factor of the correlation of inputs, in the order of their keys.

    Args:
        random: dotted key -> law.
        design: design of the samples.

    Returns:
        Shape (d, d), lower triangle; None where all inputs are independent.

    Raises:
        SceneError: a key or a value is wrong, or no inputs can be correlated so.
    """
    names, R = sorted(random), np.eye(len(random))
    for name in names:
        for other, value in getattr(random[name], "correlation", {}).items():
            where = f'samples.random."{name}".correlation."{other}"'
            others = ", ".join(n for n in names if n != name) or "there is none"
            if other == name:
                raise SceneError(f"{where}: of an input with itself; leave it out")
            if other not in random:
                raise SceneError(f"{where}: is no random input; others are {others}")
            i, j = names.index(name), names.index(other)
            if not -1 < value < 1 or R[i, j] not in (0.0, value):
                raise SceneError(f"""{where} = {value:g}: must lie between -1 and 1, and be given
                    once for a pair""")
            R[i, j] = R[j, i] = value
    if not np.any(R - np.eye(len(names))):
        return None
    if design in RIGID:
        raise SceneError(f"""samples: design = {design!r} needs independent inputs; take another
            design, or remove samples.random.NAME.correlation""")
    smallest = float(np.linalg.eigvalsh(R)[0])
    if not smallest > 0:
        raise SceneError(f"""samples.random: the correlations are not those of any inputs: their
            matrix is not positive definite (smallest eigenvalue {smallest:.3g}); give all pairs, or
            weaker""")
    return np.asarray(np.linalg.cholesky(R))


def correlated(u: Array, root: Array | None) -> Array:
    """Independent points of the unit cube to those of correlated inputs (Gaussian copula).

    Args:
        u: shape (d,).
        root: see ``correlation_root``.
    """
    return u if root is None else np.asarray(special.ndtr(root @ special.ndtri(u)))


def unit_problem(inputs: int) -> dict[str, object]:
    """The unit cube as SALib describes it."""
    names = np.array([f"x{i}" for i in range(inputs)], dtype=object)
    return {"num_vars": inputs, "names": names, "bounds": [[0.0, 1.0]] * inputs}


def _inside(x: Array) -> Array:
    """Points off the faces of the cube, where an unbounded law has no value."""
    return np.clip(x, 1e-12, 1 - 1e-12)


@contextmanager
def library_seed(seed: int) -> Iterator[None]:
    """Seed NumPy's global generator, which older SALib draws from, and put it back after.

    Newer SALib takes the seed itself: its numbers are others, but as reproducible.
    """
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
