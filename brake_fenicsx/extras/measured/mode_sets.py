"""Modes in datasets 55 of a universal file, read line by line.

pyuff 2.5.8 cannot read complex values of six components, and stumbles over one value at a node. A
mode may be divided into several datasets with nodes of their own, and a complex one may be followed
by its conjugate.

Reference: Structural Dynamics Research Laboratory, University of Cincinnati, Universal File Formats
for Modal Analysis Testing, dataset 55, https://www.ceas3.uc.edu/sdrluff/.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError

Complex = NDArray[np.complex128]
NORMAL, COMPLEX = 2, (3, 7)  # analysis types
COMPLEX_VALUES = 5  # data type
_REAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?")
# Two datasets are of one mode, or of a conjugate pair, if their eigenvalues differ by less.
SAME = 1e-6


@dataclass(frozen=True, slots=True)
class Mode:
    """A mode that vibrates.

    Attributes:
        s: eigenvalue alpha + i omega [1/s], omega > 0.
        number: its number in the file.
        shape: node -> displacements, shape (components,), as many as the file has.
    """

    s: complex
    number: int
    shape: dict[int, Complex]


def read_mode_sets(file: Path) -> list[Mode]:
    """Modes of a universal file, by frequency; datasets 55 of anything else are left out.

    Raises:
        SceneError: a dataset 55 that is cut short or damaged.
    """
    text = file.read_bytes().decode("latin1").replace("\r\n", "\n")
    found: list[Mode] = []
    for match in re.finditer(r"^    -1 *\n +55 *\n(.*?)^    -1 *$", text, re.M | re.S):
        line = 1 + text.count("\n", 0, match.start(1))
        try:
            mode = _mode(match[1].split("\n"))
        except (ValueError, IndexError) as error:
            said = " ".join(str(error).split())
            raise SceneError(f"{file}: line {line}: dataset 55 is damaged: {said}") from None
        if mode is not None and not _joined(found, mode):
            found.append(mode)
    kept = [mode for mode in found if mode.s.imag > 0]
    for mode in (mode for mode in found if mode.s.imag < 0):
        s = mode.s.conjugate()
        if not any(abs(other.s - s) < SAME * abs(s) for other in kept):
            shape = {node: values.conj() for node, values in mode.shape.items()}
            kept.append(Mode(s, mode.number, shape))
    return sorted(kept, key=lambda mode: mode.s.imag)


def _mode(lines: list[str]) -> Mode | None:
    """One dataset: five lines of text, codes, numbers of the mode, and values at the nodes."""
    codes = [int(word) for word in lines[5].split()]
    analysis, complex_values, count = codes[1], codes[4] == COMPLEX_VALUES, codes[5]
    s = _eigenvalue(analysis, _reals(lines[7]))
    if s is None:
        return None
    if count < 3:
        raise ValueError(f"{count} values at a node; export displacements along three axes")
    shape: dict[int, Complex] = {}
    numbers = count * (1 + complex_values)
    rows = iter(line for line in lines[8:] if line.strip())
    for line in rows:
        x: list[float] = []
        while len(x) < numbers:
            x += _reals(next(rows, "")) or _short(line, len(x), numbers)
        if len(x) > numbers:
            _short(line, len(x), numbers)
        shape[int(line)] = np.array(x[0::2]) + 1j * np.array(x[1::2]) if complex_values else (
            np.array(x, dtype=complex)
        )  # fmt: skip
    return Mode(s, int(lines[6].split()[3]), shape)


def _short(node: str, found: int, wanted: int) -> list[float]:
    raise ValueError(f"node {node.strip()} has {found} numbers, not {wanted}")


def _reals(line: str) -> list[float]:
    """Numbers of a line, which may touch each other and have a D for the E."""
    return [float(word.replace("D", "E").replace("d", "e")) for word in _REAL.findall(line)]


def _eigenvalue(analysis: int, reals: list[float]) -> complex | None:
    """Eigenvalue alpha + i omega [1/s] of a mode that vibrates; None of anything else.

    The damping ratio of a normal mode is the viscous one or half of the hysteretic one.
    """
    if analysis in COMPLEX:
        s = complex(*reals[:2])
        return s if s.imag else None
    if analysis != NORMAL or not reals[0] > 0:
        return None
    viscous, hysteretic = [*reals[2:4], 0.0, 0.0][:2]
    ratio = viscous or 0.5 * hysteretic
    omega = 2 * np.pi * reals[0]
    return complex(-ratio / np.sqrt(max(1 - ratio**2, 1e-6)) * omega, omega)


def _joined(found: list[Mode], mode: Mode) -> bool:
    """Take the nodes of a mode into the one that it is the rest of."""
    for other in found:
        same = other.number == mode.number and abs(other.s - mode.s) < SAME * abs(mode.s)
        if same and not other.shape.keys() & mode.shape.keys():
            other.shape.update(mode.shape)
            return True
    return False
