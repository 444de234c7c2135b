"""Constants of a material from resonances: their table, Gauss-Newton, Laplace's approximation.

Logarithms of the constants are normal around the scene's, those of the measured frequencies normal
around the computed ones. Peaks are assigned to modes by the least sum of squares; a peak that is
farther from every mode than a gate is left out, at the cost of the gate; a mode that nobody heard
costs what one of ten does. Gauss-Newton starts at several constants drawn from the prior, each with
two gates, which narrow; the best end counts. The covariance is the inverse of the Gauss-Newton
matrix there.

The stiffness is linear in the C_ij of the material. Modes at some constants span a basis on which
those at other constants are computed (Rayleigh-Ritz); the basis takes in further modes until
frequencies at the wanted constants agree with those at full order.

Reference: A. Tarantola, Inverse Problem Theory (2005), doi:10.1137/1.9780898717921, section 3.4.
"""

from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np
import scipy.linalg as la
from scipy.optimize import linear_sum_assignment

from brake_fenicsx.arguments import Array, Complex, Index
from brake_fenicsx.build import changes, material_table
from brake_fenicsx.errors import InaccurateResult, NotConverged, SceneError
from brake_fenicsx.folder.arrays import TextTable
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.scene import Scene
from brake_fenicsx.stability.eigensolvers.symmetric import count_below

from .part_modes import elastic_modes, part_body
from .universal import modes_of, read_sets

# Directions of the basis smaller than this share of the largest are left out.
SMALL = 1e-6
# Step of the difference of C_ij by the logarithm of a constant; exact where they are linear.
STEP = 1e-4
# Gates of the first step, the narrowest one in standard errors, and the factor between two steps.
WIDE, NARROW, NARROWING = (0.3, 0.06), 5.0, 0.5
STEPS, SETTLED, STARTS = 40, 1e-5, 12
# A step is at most so many standard deviations of the prior.
STRIDE = 1.0
# The basis is enough if frequencies agree with those at full order within this share of the error.
AGREES = 0.05
ROUNDS = 6
# Cost of a mode below the highest peak that nobody heard: one of ten is not. Without it the many
# modes of a soft body would explain any peaks.
UNHEARD = 2 * np.log(9.0)

UNITS = {"frequency_hz": 1.0, "frequency_khz": 1e3}
# Two peaks closer than this may be one that was written twice.
TWICE = 2e-4
SUFFIXES = (".unv", ".uff", ".uf")
# Modes; functions of several types, of which one is the frequency response.
SHAPES, RESPONSES, RESPONSE = 55, 58, 4
# A pole counts as a mode if, of so many model orders, this share has one this near, over |s|.
ORDERS, ORDER, SHARE, STABLE = 60, 20, 0.8, 1e-3


@dataclass(frozen=True, slots=True)
class Peaks:
    """Resonances of one specimen.

    Attributes:
        specimen: its name.
        frequency: ascending, shape (peaks,) [Hz].
        q: quality factor 1 / (2 zeta) of each, nan where not given.
    """

    specimen: str
    frequency: Array
    q: Array


def read_peaks(path: str | Path) -> list[Peaks]:
    """Read the peaks of all specimens of a file.

    Args:
        path: a table with a column frequency_hz or frequency_khz, and q and specimen if there are
            any; or a universal file of identified modes (dataset 55), or of frequency responses
            (dataset 58), in which sdypy-EMA then finds the modes.

    Raises:
        SceneError: file, line, value and remedy.
    """
    file = Path(path)
    if file.suffix.lower() not in SUFFIXES:
        return _table(file)
    sets = read_sets(file, ())
    kinds = {d["type"] for d in sets}
    measured = RESPONSES in kinds and SHAPES not in kinds
    s = _poles(file) if measured else np.array([mode.s for mode in modes_of(file, sets)])
    ratio = np.where(s.real < 0, -s.real / np.abs(s), np.nan)
    return [_checked(file, file.stem, np.column_stack([s.imag / (2 * np.pi), 0.5 / ratio]))]


def _table(file: Path) -> list[Peaks]:
    """Peaks of a table."""
    table = TextTable.read(file)
    unit, *more = [name for name in table.heading if name in UNITS] or [""]
    if not unit or more or {*table.heading} - {*UNITS, "q", "specimen"}:
        raise SceneError(f"""{file}: the heading is {",".join(table.heading)}; write one of
            {", ".join(UNITS)}, and q and specimen if there are any""")
    f = UNITS[unit] * table.numbers(unit, positive=True)
    q = table.numbers("q", optional=True, positive=True)
    specimens: dict[str, list[tuple[float, float]]] = {}
    for name, *peak in zip(table.texts("specimen"), f, q, strict=True):
        specimens.setdefault(name or "1", []).append((peak[0], peak[1]))
    return [_checked(file, name, np.array(sorted(own))) for name, own in specimens.items()]


def _poles(file: Path) -> Complex:
    """Eigenvalues [1/s] of frequency responses that are stable over the order of the model.

    Least-squares complex frequency-domain method (B. Peeters et al., Shock Vib. 11, 2004,
    doi:10.1155/2004/523692).

    Raises:
        SceneError: the library is not installed, the responses are none or do not fit together,
            or no pole is stable.
    """
    try:
        ema = import_module("sdypy.EMA")
    except ImportError:
        raise SceneError(f"""{file}: contains frequency responses (dataset 58) and no modes; pip
            install sdypy-EMA, which finds modes in them, or export modes as dataset
            55""") from None
    sets = (d for d in read_sets(file, (RESPONSES,)) if d["type"] == RESPONSES)
    x = [np.asarray(d["x"]) for d in sets if d["func_type"] == RESPONSE]
    if not x or any(f.shape != x[0].shape or not np.allclose(f, x[0]) for f in x):
        raise SceneError(f"""{file}: dataset 58: {len(x)} frequency responses (function type 4), or
            not all at the same frequencies; export frequency responses of one frequency axis""")
    model = ema.Model(lower=x[0][1], upper=x[0][-1], pol_order_high=ORDERS)
    try:
        model.read_uff(str(file))
        model.get_poles(show_progress=False)
    except Exception as error:  # sdypy-EMA raises nothing narrower
        raise SceneError(f"""{file}: dataset 58: sdypy-EMA fails ({type(error).__name__}: {error});
            export modes as dataset 55""") from None
    orders, found = [np.asarray(poles) for poles in model.all_poles[-ORDER:]], []
    for s in (s for s in orders[-1] if s.imag > 0 > s.real):
        nearest = np.array([poles[np.argmin(np.abs(poles - s))] for poles in orders])
        same = nearest[np.abs(nearest - s) < STABLE * abs(s)]
        if same.size >= SHARE * ORDER:
            found.append(complex(np.median(same.real), np.median(same.imag)))
    if not found:
        raise SceneError(f"{file}: dataset 58: no resonance is found; export modes as dataset 55")
    return np.array(sorted(found, key=lambda s: s.imag))


def _checked(file: Path, name: str, rows: Array) -> Peaks:
    f = rows[:, 0]
    for i in np.flatnonzero(np.diff(f) < TWICE * f[1:]):
        logger.warning(
            "%s: specimen %s: peaks %.6g and %.6g Hz are taken as two modes; if they are one,"
            " remove one", file, name, f[i], f[i + 1],
        )  # fmt: skip
    return Peaks(name, f, rows[:, 1])


@dataclass(frozen=True, slots=True)
class BodyModes:
    """Modes at some constants.

    Attributes:
        frequency: ascending, shape (modes,) [Hz].
        slope: of its logarithm by that of each constant, shape (modes, constants).
        share: part of the strain energy of each that is in the material, shape (modes,).
    """

    frequency: Array
    slope: Array
    share: Array


class VariedBody:
    """A body and the logarithms of the constants of one of its materials.

    Attributes:
        names: of the constants.
        nominal: logarithms of the scene's values.
        highest: end of the frequencies [Hz].
    """

    def __init__(self, scene: Scene, part: str, material: str, highest: float, supported: bool):
        """Assemble the body; see ``part_modes``."""
        self._table, self.highest = scene.materials[material], highest
        self._where = f"{scene.file}: materials.{material}"
        usual, given = material_table.constants(self._table), self._table.C11 is not None
        known = [name for name in usual if (name[0] == "C") == given]
        # Of what is zero there is no logarithm: it stays.
        self.names = [name for name in known if usual[name] > 0]
        if held := [name for name in known if name not in self.names]:
            logger.warning("%s: %s stay as they are: not above zero", self._where, ", ".join(held))
        self.nominal = np.log([usual[name] for name in self.names])
        mesh, elastic, _ = part_body(scene, part, np.zeros((1, 3)), supported)
        self._K, self._M = elastic.K, elastic.M
        entries = changes.moved_entries(scene, material, self.names)
        self._index = tuple(np.array([changes.VOIGT[entry] for entry in entries]).T)
        directions = [changes.unit_change(scene, mesh, material, entry) for entry in entries]
        if not all(directions):
            raise SceneError(f"{self._where}: of no layer of parts.{part}; name another --material")
        self._A = affine_parts(mesh, elastic.free, directions)
        self._C = material_table.stiffness(self._table)[self._index]
        self._count, self._W = 0, np.zeros((elastic.M.shape[0], 0))

    def count(self) -> int:
        """Modes below the highest frequency at the scene's constants, rigid-body modes included."""
        return count_below(self._K, self._M, (2 * np.pi * self.highest) ** 2)[0]

    def _entries(self, theta: Array) -> Array:
        """The C_ij that change, at logarithms of the constants."""
        values = dict(zip(self.names, np.exp(theta), strict=True))
        try:
            C = material_table.varied_stiffness(self._table, values)
        except SceneError as error:  # as of nu beyond 0.5
            raise InaccurateResult(f"{self._where}: {error}") from None
        if not la.eigvalsh(C)[0] > 0:
            raise InaccurateResult(f"{self._where}: constants are not positive definite")
        return np.asarray(C[self._index])

    def take_in(self, theta: Array) -> Array:
        """Take the modes at some constants into the basis.

        Returns:
            Their frequencies at full order [Hz].
        """
        change = self._entries(theta) - self._C
        K = self._K + sum(c * A for c, A in zip(change, self._A, strict=True))
        frequency, shapes, _ = elastic_modes(self._where, K.tocsr(), self._M, self.highest)
        if not frequency.size:
            return frequency
        self._count = max(self._count, frequency.size)
        S = np.column_stack([self._W, shapes])
        values, turn = la.eigh(S.T @ (self._M @ S))
        kept = values > SMALL**2 * values[-1]
        self._W = S @ (turn[:, kept] / np.sqrt(values[kept]))
        self._modal_K = self._W.T @ (self._K @ self._W)
        self._modal_A = np.array([self._W.T @ (A @ self._W) for A in self._A])
        return frequency

    def modes(self, theta: Array) -> BodyModes:
        """As many modes as were ever taken in, at some constants, on the basis.

        Raises:
            InaccurateResult: no material has these constants.
        """
        C = self._entries(theta)
        K = self._modal_K + np.tensordot(C - self._C, self._modal_A, 1)
        kappa, phi = la.eigh(K, subset_by_index=(0, self._count - 1))
        energy = np.einsum("im,jik,km->mj", phi, self._modal_A, phi, optimize=True)
        energy = energy / kappa[:, None]
        step = STEP * np.eye(theta.size)
        slope = [(self._entries(theta + s) - self._entries(theta - s)) / (2 * STEP) for s in step]
        return BodyModes(np.sqrt(kappa) / (2 * np.pi), 0.5 * energy @ np.array(slope).T, energy @ C)


@dataclass(frozen=True, slots=True)
class Posterior:
    """Constants of one specimen.

    Attributes:
        theta: logarithms of the constants at the maximum, shape (constants,).
        covariance: of these, shape (constants, constants).
        mode: number of the mode of each peak, -1 where it is left out.
        modes: modes at the maximum.
        misfit: sum of squares over the variance, prior and gates included.
        steps: Gauss-Newton steps of the best start.
        basis_error: largest relative error of a frequency by the basis.
    """

    theta: Array
    covariance: Array
    mode: Index
    modes: BodyModes
    misfit: float
    steps: int
    basis_error: float = np.nan


def assigned(peaks: Array, modes: Array, gate: float) -> Index:
    """Mode of each peak, -1 for none, by the least sum of squares up to a gate.

    Args:
        peaks: logarithms of measured frequencies, shape (peaks,).
        modes: of computed ones, shape (modes,).
        gate: largest distance.
    """
    cost = np.minimum((peaks[:, None] - modes) ** 2, gate**2)
    # A column for each peak that may be left out.
    cost = np.column_stack([cost, np.full((peaks.size, peaks.size), gate**2)])
    mode = linear_sum_assignment(cost)[1]
    near = mode < modes.size
    near[near] &= np.abs(peaks[near] - modes[mode[near]]) < gate
    return np.where(near, mode, -1)


def identified(body: VariedBody, peaks: Array, prior: float, error: float) -> Posterior:
    """Constants from the peaks of one specimen.

    Args:
        body: the body, its basis filled by ``fill_basis``.
        peaks: measured frequencies, shape (peaks,) [Hz].
        prior: standard deviation of the logarithm of each constant.
        error: of the logarithm of a frequency.

    Raises:
        NotConverged: no start settles, or the basis does not.
    """
    rng = np.random.default_rng(0)
    draws = prior * rng.standard_normal((STARTS - 1, body.nominal.size))
    starts = body.nominal + np.vstack([np.zeros(body.nominal.size), draws])
    ends = [_descended(body, peaks, prior, error, s, gate) for s in starts for gate in WIDE]
    settled = [end for end in ends if end is not None]
    if not settled:
        raise NotConverged("Gauss-Newton does not settle from any start; check the peaks")
    best = min(settled, key=lambda end: end.misfit)
    for _ in range(ROUNDS):
        full, computed = body.take_in(best.theta), best.modes.frequency
        used = best.mode[best.mode >= 0]
        if used.max(initial=-1) < full.size:
            off = float(np.abs(computed[used] / full[used] - 1).max(initial=0.0))
            if off <= AGREES * error:
                return replace(best, basis_error=off)
        again = _descended(body, peaks, prior, error, best.theta, 2 * NARROW * error)
        if again is None:
            break
        best = again
    raise NotConverged("modes at the identified constants do not agree with those at full order")


def fill_basis(body: VariedBody, prior: float) -> float:
    """Take in the modes at the scene's constants, and where each of them is larger.

    Returns:
        The first frequency at the scene's constants [Hz]; infinite if it lies beyond the highest.
    """
    frequency = body.take_in(body.nominal)
    if not frequency.size:
        return np.inf
    for axis in np.eye(body.nominal.size):
        try:
            body.take_in(body.nominal + prior * axis)
        except InaccurateResult:
            continue  # no material has these
    return float(frequency[0])


def misfit(peaks: Array, modes: Array, mode: Index, error: float, gate: float) -> float:
    """Squares of the peaks over the variance, and what modes that nobody heard cost.

    Args:
        peaks: logarithms of measured frequencies.
        modes: of computed ones.
        mode: number of the mode of each peak, -1 for none.
        error: standard deviation of a peak.
        gate: distance that a peak without a mode counts for.
    """
    used = mode >= 0
    rest = np.where(used, peaks - modes[mode], gate)
    below = np.flatnonzero(modes < peaks.max(initial=-np.inf))
    unheard = np.setdiff1d(below, mode).size
    return float(np.sum((rest / error) ** 2)) + UNHEARD * unheard


def _descended(
    body: VariedBody, peaks: Array, prior: float, error: float, theta: Array, gate: float
) -> Posterior | None:
    """Gauss-Newton from one start; None where it does not settle or leaves what is a material."""
    last: object = None
    narrow = NARROW * error
    for step in range(STEPS):
        try:
            modes = body.modes(theta)
        except InaccurateResult:
            return None
        log_f = np.log(modes.frequency)
        mode = assigned(np.log(peaks), log_f, gate)
        used = mode >= 0
        J = modes.slope[mode[used]]
        H = J.T @ J / error**2 + np.eye(theta.size) / prior**2
        away = (theta - body.nominal) / prior**2
        move = np.linalg.solve(H, J.T @ (np.log(peaks)[used] - log_f[mode[used]]) / error**2 - away)
        size = float(np.linalg.norm(move)) / prior
        if size < SETTLED and gate == narrow and mode.tolist() == last:
            total = float(np.sum(((theta - body.nominal) / prior) ** 2))
            total += misfit(np.log(peaks), log_f, mode, error, gate)
            spread = np.asarray(np.linalg.inv(H), float)
            return Posterior(theta, spread, mode, modes, total, step)
        theta = theta + move * min(1.0, STRIDE / max(size, 1e-300))
        gate, last = max(narrow, NARROWING * gate), mode.tolist()
    return None
