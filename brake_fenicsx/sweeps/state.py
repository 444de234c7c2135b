"""The modes at one value of a parameter, and how alike two groups of modes are.

Left and right vectors give the spectral projector of a group of modes,
P = Phi (Psi^H Phi)^-1 Psi^H. The trace of the product of two such projectors, over their rank, is
the modal assurance criterion of modes that are not orthogonal: 1 for the same group, 0 for another
one (M. I. Friswell, "On the design of modal actuators and sensors", and for two-sided vectors R. J.
Allemang, Sound and Vibration 37(8), 2003). Where two modes merge, their own projectors grow without
bound, and that of the pair stays analytic (T. Kato, Perturbation Theory for Linear Operators, 1980,
chapter II).
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.mac import mac
from brake_fenicsx.samples.study import Study
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stability.substructures.parameter_line import Basis

# Equilibria that are kept as starts.
KEPT = 8

# Relative error of lambda at most that a value found on the vectors of others may add.
FINEST = 1e-5


@dataclass(frozen=True, slots=True)
class State:
    """Oscillating modes at one value of the parameter, sorted by frequency.

    Attributes:
        x: value of the parameter.
        s: eigenvalues lambda [1/s] with omega > 0, shape (modes,).
        right: right vectors in coordinates in which the mass is the identity, shape (m, modes).
        left: left vectors, likewise.
        error: estimated errors of lambda [1/s].
        condition: condition numbers of lambda [-].
        verdict: "stable", "unstable" or "neutral".
        open: which contact elements are open, packed.
    """

    x: float
    s: Complex
    right: Complex
    left: Complex
    error: Array
    condition: Array
    verdict: NDArray[np.str_]
    open: bytes = b""

    @classmethod
    def of(cls, x: float, modes: Modes, k: Array | None = None) -> "State":
        """The oscillating ones of some modes; rigid modes and divergence belong to no branch.

        Args:
            x: value of the parameter.
            modes: all modes there.
            k: stiffness of the contact elements [Pa/m], shape (elements,).
        """
        kept = np.flatnonzero(modes.s.imag > 0)
        kept = kept[np.lexsort((modes.s.real[kept], modes.s.imag[kept]))]
        right, left = (X[:, kept].astype(complex) for X in (modes.right, modes.left))
        return cls(
            float(x), modes.s[kept], right / np.linalg.norm(right, axis=0),
            left / np.linalg.norm(left, axis=0), modes.error[kept],
            modes.condition[kept], np.array(modes.verdict, dtype=str)[kept],
            b"" if k is None else np.packbits(k == 0).tobytes(),
        )  # fmt: skip

    @property
    def frequency(self) -> Array:
        """|omega| / 2 pi [Hz]."""
        return np.asarray(self.s.imag / (2 * np.pi))

    @property
    def damping(self) -> Array:
        """-2 alpha / |omega| [-]."""
        return np.asarray(-2 * self.s.real / self.s.imag)

    @property
    def undamped(self) -> bool:
        """Whether every mode has its mirror image -conj(lambda), as without damping."""
        apart = np.abs(self.s[:, None] + self.s[None, :].conj()).min(axis=1, initial=np.inf)
        return bool(np.all(apart <= 1e-9 * np.abs(self.s)))

    def turned(self, group: Sequence[int], other: "State", theirs: Sequence[int]) -> "State":
        """This state with the vectors of equal eigenvalues turned to those of another state.

        Args:
            group: modes of one eigenvalue, whose vectors are any basis of their space.
            other: the other state.
            theirs: its modes that continue them.
        """
        own, mate = list(group), list(theirs)
        R, L = self.right[:, own], self.left[:, own]
        right = R @ np.linalg.solve(L.conj().T @ R, L.conj().T @ other.right[:, mate])
        left = L @ np.linalg.solve(R.conj().T @ L, R.conj().T @ other.left[:, mate])
        new_right, new_left = self.right.copy(), self.left.copy()
        new_right[:, own] = right / np.linalg.norm(right, axis=0)
        new_left[:, own] = left / np.linalg.norm(left, axis=0)
        return replace(self, right=new_right, left=new_left)


def likeness(a: State, b: State) -> Complex:
    """Two-sided modal assurance criterion of every mode of a with every mode of b.

    Returns:
        Traces of the products of their projectors, shape (modes of a, modes of b); they are not
        bounded where a mode is nearly defective.
    """
    return mac(a.right, b.right, a.left, b.left)


def group_likeness(a: State, group: Sequence[int], b: State, theirs: Sequence[int]) -> float:
    """The same of two groups of modes, real part over their number; 0 for a defective group."""
    R, L = a.right[:, list(group)], a.left[:, list(group)]
    S, N = b.right[:, list(theirs)], b.left[:, list(theirs)]
    try:
        first = np.linalg.solve(L.conj().T @ R, L.conj().T @ S)
        second = np.linalg.solve(N.conj().T @ S, N.conj().T @ R)
    except np.linalg.LinAlgError:
        return 0.0
    return float(np.trace(first @ second).real / len(group))


class Points:
    """Modes of a sample over one scalar of the scene; see ``branches.Solve``."""

    def __init__(
        self,
        study: Study,
        task: tuple[str, int],
        key: str,
        fixed: Mapping[str, float] | None = None,
        ends: Sequence[float] = (),
    ):
        """Choose the sample.

        Args:
            study: the samples of the scene, prepared.
            task: approach and number of the sample.
            key: dotted key of the scalar.
            fixed: values of further scalars, SI.
            ends: first and last value of a line, which are computed first: those between are found
                on their vectors, where these suffice.
        """
        self._study, self._task, self._key = study, task, key
        self._fixed, self._ends = dict(fixed or {}), [*ends]
        self._gaps: dict[float, Array] = {}
        self._ready: dict[float, State] = {}
        stability = study.scene.stability
        self.line = Basis(min(stability.tolerance if stability else FINEST, FINEST))

    def __call__(self, x: float) -> State:
        """The modes at a value of the scalar, SI."""
        while self._ends:
            with suppress(NotConverged):
                end = self._ends.pop(0)
                self._ready[end] = self._computed(end)
        return self._ready.pop(x) if x in self._ready else self._computed(x)

    def _computed(self, x: float) -> State:
        values = {**self._fixed, self._key: x}
        eq, modes = self._study.solved(self._task, values, self._near(x), self.line)
        self._gaps[x] = eq.g
        if len(self._gaps) > KEPT:
            self._gaps.pop(next(iter(self._gaps)))
        return State.of(x, modes, eq.k_vibration)

    def _near(self, x: float) -> Array | None:
        """Gaps to start from: of the nearest value, or on the line through the two nearest."""
        near = sorted(self._gaps, key=lambda known: abs(known - x))[:2]
        if len(near) < 2:
            return self._gaps[near[0]] if near else None
        a, b = near
        return self._gaps[a] + (x - a) / (b - a) * (self._gaps[b] - self._gaps[a])
