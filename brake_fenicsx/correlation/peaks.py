"""Frequencies of resonances, and Q factors where they are given, of one or more specimens."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.log import logger

from .measured import read_modes

Array = NDArray[np.float64]
UNITS = {"frequency_hz": 1.0, "frequency_khz": 1e3}
# Two peaks closer than this may be one that was written twice.
TWICE = 2e-4
SUFFIXES = (".unv", ".uff", ".uf")


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
            any; or a universal file of identified modes (dataset 55).

    Raises:
        SceneError: file, line, value and remedy.
    """
    file = Path(path)
    if file.suffix.lower() in SUFFIXES:
        modes = read_modes(file)
        ratio = np.where(modes.damping > 0, modes.damping, np.nan)
        return [Peaks(file.stem, modes.frequency, 0.5 / ratio)]
    try:
        with file.open(newline="", encoding="utf-8-sig") as text:
            rows = csv.DictReader(line for line in text if line.strip() and line[0] != "#")
            table = [{str(k).strip(): v for k, v in row.items()} for row in rows]
            heading = [name.strip() for name in rows.fieldnames or ()]
    except FileNotFoundError:
        raise SceneError(f"{file}: no such file; name the table of peaks") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SceneError(f"{file}: cannot be read as a table: {error}") from None
    unit = [name for name in heading if name in UNITS]
    unknown = {*heading} - {*UNITS, "q", "specimen"}
    if len(unit) != 1 or unknown:
        raise SceneError(
            f"{file}: the heading is {','.join(heading)}; write one of {', '.join(UNITS)}, and q"
            " and specimen if there are any"
        )
    specimens: dict[str, list[tuple[float, float]]] = {}
    for number, row in enumerate(table, start=1):
        peak = UNITS[unit[0]] * _number(file, number, unit[0], row[unit[0]])
        q = _number(file, number, "q", row["q"]) if (row.get("q") or "").strip() else np.nan
        specimens.setdefault((row.get("specimen") or "1").strip(), []).append((peak, q))
    if not specimens:
        raise SceneError(f"{file}: contains no peak; write one frequency in each line")
    return [_checked(file, name, np.array(sorted(rows))) for name, rows in specimens.items()]


def _number(file: Path, number: int, name: str, cell: str | None) -> float:
    try:
        value = float(cell or "")
    except ValueError:
        value = np.nan
    if not (np.isfinite(value) and value > 0):
        raise SceneError(f"{file}: peak {number}: {name} = {cell!r}: write a positive number")
    return value


def _checked(file: Path, name: str, rows: Array) -> Peaks:
    f = rows[:, 0]
    for i in np.flatnonzero(np.diff(f) < TWICE * f[1:]):
        logger.warning(
            "%s: specimen %s: peaks %.6g and %.6g Hz are taken as two modes; if they are one,"
            " remove one", file, name, f[i], f[i + 1],
        )  # fmt: skip
    return Peaks(name, f, rows[:, 1])
