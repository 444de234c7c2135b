"""drivers.csv and drivers_contact.csv: what drives the squeal modes, from stored samples.

Rows of the first sample of each approach, mode by mode, and medians over all squeal modes of a
family where the approach has several samples.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Index

from . import squeal, tables
from .stored import StoredSamples

MEDIAN = "median"


@dataclass(frozen=True, slots=True)
class Driver(tables.Row):
    """A row of drivers.csv: the derivative of a mode by a parameter."""

    approach: str
    sample: int | str
    family: int
    mode: int | None
    frequency_hz: float
    alpha: float
    damping: float
    condition: float
    parameter: str
    kind: str
    dalpha_dp_1_s: float
    df_dp_hz: float
    ddamping_dp: float
    trusted: str
    modes: int


@dataclass(frozen=True, slots=True)
class ContactDriver(tables.Row):
    """A row of drivers_contact.csv: the derivative of a mode by the stiffness of an element."""

    approach: str
    sample: int
    mode: int
    element: int
    dalpha_dlnk_1_s: float
    df_dlnk_hz: float
    friction_work: float


def driver_table(stored: StoredSamples, threshold: float) -> tables.RowTable:
    """RowTable of drivers.csv.

    Args:
        stored: stored samples.
        threshold: a mode squeals where its damping lies below minus this.
    """
    return tables.RowTable.of(Driver, _rows(stored, threshold))


def contact_driver_table(stored: StoredSamples, threshold: float) -> tables.RowTable:
    """RowTable of drivers_contact.csv; arguments as above."""
    return tables.RowTable.of(ContactDriver, _maps(stored, threshold))


def _squealing(data: dict[str, Any], threshold: float) -> Index:
    """Places of the squeal modes among those that derivatives were computed for."""
    if "driver_mode" not in data:
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero(squeal.squeals(data, threshold)[data["driver_mode"]])


def _numbers(data: dict[str, Any], place: int) -> AnyArray:
    """Numbers of a mode for each parameter, shape (parameters, 8).

    Frequency, alpha, damping and condition; derivatives of alpha, frequency and damping; 1 where
    they are trusted, else 0.
    """
    mode = int(data["driver_mode"][place])
    s, d = complex(data["s"][mode]), data["driver_value"][:, place]
    damping = -2 * d.real / s.imag + 2 * s.real * d.imag / s.imag**2
    mode_numbers = [s.imag / (2 * np.pi), s.real, float(data["damping"][mode])]
    columns = [*mode_numbers, float(data["condition"][mode]), d.real, d.imag / (2 * np.pi), damping]
    trusted = data["driver_trusted"][:, place].astype(float)
    return np.stack([*(np.broadcast_to(c, d.shape) for c in columns), trusted], axis=1)


def _row(place: list[Any], numbers: AnyArray, name: tuple[str, str], modes: int) -> Driver:
    """A row from its place: approach, sample, family and mode."""
    values = [float(x) for x in numbers]
    trusted = "yes" if values[7] >= 0.5 else "no"
    return Driver.of(*place, *values[:4], *name, *values[4:7], trusted, modes)


def _names(data: dict[str, Any]) -> list[tuple[str, str]]:
    pairs = zip(data["driver_parameter"], data["driver_kind"], strict=True)
    return [(str(parameter), str(kind)) for parameter, kind in pairs]


def _rows(stored: StoredSamples, threshold: float) -> Iterator[Driver]:
    every = list(stored.with_arrays("driver_"))
    for nominal, data in stored.first.items():
        samples = [(d, family) for task, d, family in every if task[0] == nominal[0]]
        family = next((f for task, _, f in every if task == nominal), np.zeros(0, np.int32))
        for place in _squealing(data, threshold):
            mode = int(data["driver_mode"][place])
            for name, numbers in zip(_names(data), _numbers(data, place), strict=True):
                yield _row([*nominal, int(family[mode]), mode], numbers, name, 1)
        good = zip(stored.rows["approach"], stored.rows["status"], strict=True)
        if sum(row == (nominal[0], "ok") for row in good) > 1:
            yield from _medians(nominal[0], samples, threshold)


def _medians(
    approach: str, samples: list[tuple[dict[str, Any], NDArray[np.int32]]], threshold: float
) -> Iterator[Driver]:
    """Of the modes of each family, parameters that all of them have."""
    members: dict[int, list[dict[tuple[str, str], AnyArray]]] = {}
    for data, family in samples:
        for place in _squealing(data, threshold):
            rows = dict(zip(_names(data), _numbers(data, place), strict=True))
            members.setdefault(int(family[int(data["driver_mode"][place])]), []).append(rows)
    members.pop(-1, None)
    for number, rows_of_modes in sorted(members.items()):
        for name in rows_of_modes[-1]:
            if all(name in rows for rows in rows_of_modes):
                each = np.array([rows[name] for rows in rows_of_modes])
                median = np.r_[np.median(each[:, :7], axis=0), each[:, 7].mean()]
                yield _row([approach, MEDIAN, number, None], median, name, len(rows_of_modes))


def _maps(stored: StoredSamples, threshold: float) -> Iterator[ContactDriver]:
    """Contact elements of the first samples."""
    for task, data in stored.first.items():
        if "driver_map" not in data:
            continue
        for place in _squealing(data, threshold):
            mode = int(data["driver_mode"][place])
            pairs = zip(data["driver_map"][:, place], data["driver_work"][:, place], strict=True)
            for element, (d, work) in enumerate(pairs):
                values = float(d.real), float(d.imag / (2 * np.pi)), float(work)
                yield ContactDriver.of(*task, mode, element, *values)
