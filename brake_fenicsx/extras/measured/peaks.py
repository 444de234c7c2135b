"""Frequencies of resonances, and Q factors where they are given, of one or more specimens."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

from brake_fenicsx.arguments import Array, Complex
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import TextTable
from brake_fenicsx.folder.log import logger

from .measured import modes_of, read_sets

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
        raise SceneError(
            f"{file}: the heading is {','.join(table.heading)}; write one of {', '.join(UNITS)},"
            " and q and specimen if there are any"
        )
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
