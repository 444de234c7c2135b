"""A pressure-gap law that a user measured or computed elsewhere: a table of two columns."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.sections import Contact, Law
from brake_fenicsx.scene.units import to_si

# Pressures at fewer separations tell no stiffness between them.
LEAST = 4


def with_table(contact: Contact, name: str, folder: Path) -> Contact:
    """An interface whose law has the steps of its table, where it names one.

    Args:
        contact: the interface as the scene writes it.
        name: its name.
        folder: the scene's folder, where tables are looked for.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    law, where = contact.law, f"contact.{name}.law"
    if not isinstance(law, Law) or law.table is None:
        return contact
    if law.linear is not None or law.p0 is not None or law.u0 is not None:
        raise SceneError(f"{where}: table replaces linear, p0 and u0; leave these out")
    if len(law.units) != 2:
        raise SceneError(
            f'{where}.units = {list(law.units)!r}: write those of both columns, ["um", "MPa"]'
        )
    factors = []
    for unit, wanted in zip(law.units, ("m", "Pa"), strict=True):
        try:
            factors.append(to_si(f"1 {unit}", wanted))
        except ValueError as error:
            raise SceneError(f"{where}.units: {error}") from None
    said = f"{where}.table = {law.table!r}"
    d, p = _columns(folder / law.table, said) * np.array(factors)[:, None]
    order = np.argsort(-d, kind="stable")
    d, p = d[order], p[order]
    if d.size < LEAST:
        raise SceneError(f"{said}: {d.size} rows; a law needs {LEAST} or more")
    if p[0] <= 0.0:
        raise SceneError(
            f"{said}: {p[0]:g} Pa at the gap {d[0]:g} m; leave out rows without pressure: the law"
            " falls to zero beyond the widest gap by itself"
        )
    wrong = np.flatnonzero((np.diff(d) >= 0.0) | (np.diff(p) <= 0.0))
    if wrong.size:
        i = int(wrong[0])
        raise SceneError(
            f"{said}: {p[i + 1]:g} Pa at the gap {d[i + 1]:g} m and {p[i]:g} Pa at {d[i]:g} m; the"
            " pressure must rise as the gap falls: smooth the measured values"
        )
    return replace(contact, law=replace(law, steps=(tuple(d.tolist()), tuple(p.tolist()))))


def _columns(path: Path, said: str) -> np.ndarray:
    """Two columns of numbers, shape (2, rows); one heading and lines that begin with # are not."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SceneError(f"{said}: no such file; paths start at the scene's folder") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{said}: cannot be read as text: {error}") from None
    rows: list[list[float]] = []
    heading = False
    for number, line in enumerate(text.splitlines(), 1):
        cells = next(csv.reader([line]), []) if "," in line else line.split()
        if not cells or cells[0].lstrip().startswith("#"):
            continue
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            if not rows and not heading:
                heading = True
                continue
            raise SceneError(
                f"{said}: line {number}: {line.strip()!r} does not contain two numbers; write a"
                " gap and a pressure with decimal points, separated by a blank or a comma"
            ) from None
        if len(values) != 2 or not np.isfinite(values).all():
            raise SceneError(
                f"{said}: line {number}: {line.strip()!r}; write a gap and a pressure on each line"
            )
        rows.append(values)
    return np.array(rows, float).reshape(-1, 2).T
