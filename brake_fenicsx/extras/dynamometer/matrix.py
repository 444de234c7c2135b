"""The states of a scene and what each changes in it; CSV files with units in their headings."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import reading
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.keys import KeyMistake
from brake_fenicsx.scene.samples_section import split_key, unit_of
from brake_fenicsx.scene.scalars import SPEED, check_scalar
from brake_fenicsx.scene.units import factor_to_si

Array = NDArray[np.float64]
Frame = Any  # pandas.DataFrame
AXES = ("pressure", "speed", "temperature")
CELSIUS = {"degC": 0.0, "K": -273.15}  # unit of a temperature -> what to add
MOST = 100_000  # states


def read_columns(path: Path, units: Mapping[str, str], table: Frame = None) -> Frame:
    """A table in SI units, of a CSV file whose heading names them, "pressure [bar]".

    Args:
        path: the file.
        units: known names -> SI unit, "degC" of a temperature, "" of a number, or "text"; a dotted
            key of the scene has its own.
        table: what stands in its place, as text.

    Raises:
        SceneError: file, line, value and remedy.
    """
    import pandas as pd

    if table is None:
        with reading(path, "as a CSV file", "write one heading, and as many cells in every line"):
            table = pd.read_csv(path, dtype=str, keep_default_na=False)
    found: dict[str, Any] = {}
    for head in map(str, table):
        name, _, unit = (part.strip(" ]") for part in head.partition("["))
        try:
            si = units[name] if name in units else unit_of(name)
        except KeyMistake:
            raise SceneError(f"{path}: heading {head!r}: known are {', '.join(units)}") from None
        if si == "degC" and unit not in CELSIUS:
            raise SceneError(f"{path}: heading {head!r}: write {name} [degC] or [K]")
        found[name] = cells = table[head].astype(str).str.strip()
        if si == "text":
            continue
        plain = si in ("", "degC")
        factor = 1.0 if plain else factor_to_si(unit, si, f"{path}: heading {head!r}")
        numbers = pd.to_numeric(cells, errors="coerce").to_numpy(float)
        for i in np.flatnonzero(~np.isfinite(numbers)):
            raise SceneError(f"{path}: line {i + 2}: {name} = {cells[i]!r}: write a number")
        found[name] = factor * numbers + (CELSIUS[unit] if si == "degC" else 0.0)
    if table.empty:
        raise SceneError(f"{path}: contains no line of values below its heading")
    return pd.DataFrame(found)


def axis_units(scene: Scene) -> dict[str, str]:
    """SI units of the numbers of a state."""
    turns = scene.motion is None or scene.motion.direction is None
    return {"pressure": "Pa", "speed": "rad/s" if turns else "m/s", "temperature": "degC"}


def read_matrix(scene: Scene) -> Frame:
    """The states of a scene, of its file or its grid, numbered from 0.

    Returns:
        Columns pressure [Pa], speed [rad/s or m/s] and temperature [degC], those that are given;
        direction, section and stops.

    Raises:
        SceneError: file or key, value and remedy.
    """
    import pandas as pd

    table = scene.section("states")
    rest = {"direction": "forward", "section": "", "stops": 1}
    units = axis_units(scene) | dict.fromkeys(rest, "text") | {"stops": ""}
    grid, path = None, scene.path(table.matrix or "states.grid")
    if table.matrix is None:
        grid = pd.DataFrame([*product(*table.grid.values())], columns=list(table.grid))
    given = read_columns(path, units, grid)
    states = given.assign(**{k: v for k, v in rest.items() if k not in given})
    positive = states[[n for n in AXES[:2] if n in states]]
    wrong = {
        f"only {', '.join(units)} are read": bool({*states} - {*units}),
        f"{len(states)} states; write {MOST} at most": len(states) > MOST,
        "direction: write forward or reverse": bool({*states.direction} - {"forward", "reverse"}),
        "stops: write whole numbers from 1 on": ((states.stops < 1) | (states.stops % 1 > 0)).any(),
        "pressure and speed must be positive": (positive <= 0).any(axis=None),
    }
    for text in (text for text, is_so in wrong.items() if is_so):
        raise SceneError(f"{path}: {text}")
    return states


def state_values(scene: Scene, states: Frame) -> dict[str, Array]:
    """Scalars of the scene that differ from state to state, by dotted key, SI.

    Raises:
        SceneError: a load or a key is none, or a table does not reach a state.
    """
    table, found = scene.section("states"), dict[str, Array]()
    pressed = [name for name, load in scene.loads.items() if load.pressure is not None]
    for name in table.loads or pressed:
        if name not in pressed:
            raise SceneError(f"states.loads: {name}: is none of {', '.join(pressed) or 'no load'}")
        if "pressure" in states:
            found[f"loads.{name}.pressure"] = states.pressure.to_numpy()
    if "speed" in states and scene.motion is not None:
        with suppress(SceneError):  # else nothing but the tables depends on it
            check_scalar(scene, "states", SPEED)
            found[SPEED] = np.copysign(states.speed.to_numpy(), scene.motion.rate)
    for name in table.tables:
        found |= _interpolated(scene.path(name), scene, states, table.outside == "hold")
    written = {split_key(name): name for name in scene.varied}
    return {written.get(split_key(name), name): values for name, values in found.items()}


def _interpolated(path: Path, scene: Scene, states: Frame, hold: bool) -> dict[str, Array]:
    """Scalars of a table in all states: linear between its nodes, which are a grid."""
    from scipy.interpolate import RegularGridInterpolator

    table = read_columns(path, axis_units(scene))
    over, keys = ([n for n in table if (n in AXES) is is_axis] for is_axis in (True, False))
    for name in keys:
        check_scalar(scene, str(path), name)
    table = table.sort_values(over) if over else table
    nodes = [np.unique(table[name]) for name in over]
    if not keys or not over or min(map(len, nodes)) < 2 or {*over} - {*states}:
        raise SceneError(
            f"{path}: write columns of keys of the scene, and two values or more of those of"
            f" {', '.join(AXES)} that the states have"
        )
    grid, points = np.array([*product(*nodes)]), states[over].to_numpy()
    if not np.array_equal(table[over], grid):
        raise SceneError(f"{path}: write one line for each combination of {', '.join(over)}")
    held = np.clip(points, grid[0], grid[-1])
    beyond = np.abs(points - held) > 1e-9 * (
        grid[-1] - grid[0]
    )  # units are converted with round-off
    for i, j in np.argwhere(beyond & (not hold)):
        raise SceneError(
            f"{path}: {over[j]} = {points[i, j]:g} of state {i + 1} lies outside {grid[0, j]:g} to"
            f' {grid[-1, j]:g}; add lines, or write states.outside = "hold"'
        )
    shape = [*map(len, nodes)]
    return {
        n: RegularGridInterpolator(nodes, table[n].to_numpy().reshape(shape))(held) for n in keys
    }
