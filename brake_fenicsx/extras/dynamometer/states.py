"""States of a dynamometer test: [states] of a scene, and what each state changes in the brake."""

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import TextTable, reading
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.keys import key
from brake_fenicsx.scene.samples_section import split_key, unit_of
from brake_fenicsx.scene.scalars import SPEED, changes_bodies, check_scalar, si_unit
from brake_fenicsx.scene.units import to_si

Frame = Any  # pandas.DataFrame
AXES = ("pressure", "speed", "temperature")
RISING = (lambda f: len(f) > 1 and [*f] == sorted({*f}), "write two or more rising frequencies")
WAYS = ("forward", "reverse")
UNSAID = {"direction": WAYS[0], "section": "", "stops": 1.0}  # where a matrix does not say it
GAP = 'write a length with units, as "1 um * (r - 118 mm) / (22 mm)", or a CSV file of x, y, gap'
REMEDY = "write known names with their unit, pressure [bar], speed [rad/s], temperature [degC]"


@dataclass(frozen=True, slots=True)
class States:
    """[states]: stops of a dynamometer test, each a state of the brake ([page](dynamometer.md)).

    Attributes:
        matrix: CSV file with a state in each line; its heading names pressure, speed, temperature
            (each with its unit in brackets), direction, section, stops. All loads with a pressure
            have that of the state.
        grid: values of the same headings, of which every combination is a state.
        tables: CSV files of scalars over pressure, speed or temperature: headings are these, and
            dotted keys of the scene.
        outside: what happens to a state beyond the values of a table: "refuse", or "hold" its
            last value.
        gap: interface -> gap that is imposed on its elements: a formula with units, of x, y, z, the
            distance r from the axis, and the numbers of the state, or a CSV file with the columns
            x, y and gap.
        bands: ends of the bands of frequency in which stops with squeal are counted.
        events: CSV file of the stops that squealed: state or its numbers, frequency, stop, level.
        tolerance: distance at most between the frequencies of an event and of a family.
    """

    matrix: str | None = key(default=None, file=True)
    grid: dict[str, tuple[str, ...]] = key(default=dict)
    tables: tuple[str, ...] = key(default=(), file=True)
    outside: str = key(default="refuse", choices=("refuse", "hold"))
    gap: dict[str, str] = key(default=dict, file=True)
    bands: tuple[float, ...] = key("Hz", default=(1e3, 3e3, 8e3, 16e3), aside=True, rule=RISING)
    events: str | None = key(default=None, aside=True)
    tolerance: float = key("Hz", default=150.0, aside=True)


def check(scene: Scene, _: Callable[[str], Scene]) -> Scene:
    """States are of the reduced model, and its box holds what they change in the bodies.

    Raises:
        SceneError: the scene has no modes, or a file and its line say what is no state.
    """
    from .outcomes import read_events

    table = scene.section("states")
    if bool(table.matrix) == bool(table.grid):
        raise SceneError("states: write matrix, a file, or grid, a table of values; one of the two")
    if scene.stability is None or scene.stability.method != "reduced":
        raise SceneError('states: needs [stability] with method = "reduced"')
    states = read_matrix(scene)
    if WAYS[1] in {*states.direction} and scene.damping and scene.damping.gyroscopic:
        raise SceneError("states: reverse turns the gyroscopic term; leave it out of the damping")
    for name in {*table.gap} - {*scene.contact}:
        raise SceneError(f"states.gap.{name}: contact has only {', '.join(scene.contact)}")
    read_events(scene, states)
    values = state_values(scene, states).items()
    ranges = {name: tuple(x.tolist()) for name, x in values if changes_bodies(scene, name)}
    return replace(scene, spanned={**scene.spanned, **ranges})


def in_si(table: TextTable, units: Callable[[str], str | None]) -> Frame:
    """A table in SI units, whose heading names those of the file, "pressure [bar]".

    Args:
        table: the table.
        units: SI unit of a column by its name, degC of a temperature; None of texts.

    Raises:
        SceneError: file, heading, line, value and remedy.
    """
    import pandas as pd

    found = dict[str, Any]()
    for head in table.heading:
        at = f"{table.source}: heading {head!r}: "
        with reading(None, "as values with a unit", REMEDY, at=at):
            name, _, unit = (part.strip(" ]") for part in head.partition("["))
            if name in found:
                raise ValueError(f"{name} is there twice")
            si = units(name)
            factor = 1.0 if si is None or si == unit else to_si(f"1 {unit}", si)
        found[name] = table.texts(head) if si is None else factor * table.numbers(head)
    return pd.DataFrame(found)


def units_of_state(scene: Scene, **more: str | None) -> dict[str, str | None]:
    """SI units of the numbers of a state, and others."""
    numbers = {"pressure": "Pa", "speed": si_unit(scene, SPEED), "temperature": "degC"}
    return {**numbers, "direction": None, **more}


def read_matrix(scene: Scene) -> Frame:
    """The states of a scene, of its file or its grid, numbered from 1.

    Returns:
        Columns pressure [Pa], speed [rad/s or m/s] and temperature [degC], nan where they are not
        given; direction, section and stops.

    Raises:
        SceneError: file or key, value and remedy.
    """
    table = scene.section("states")
    path = scene.path(table.matrix or "states.grid")
    if table.grid:
        rows = [*product(*table.grid.values())]
        read = TextTable(path, [*table.grid], rows, range(2, 2 + len(rows)))
    else:
        read = TextTable.read(path)
    given = in_si(read, units_of_state(scene, section=None, stops="").__getitem__)
    states = given.reindex(columns=[*AXES, *UNSAID]).fillna(UNSAID)
    wrong = (states[["pressure", "speed", "stops"]] <= 0).any(axis=1) | (states.stops % 1 != 0)
    for i in states.index[wrong | ~states.direction.isin(WAYS)]:
        line = f"{path}: line {read.lines[i]}: {', '.join(read.rows[i])}"
        raise SceneError(f"{line}: positive numbers, whole stops, {' or '.join(WAYS)} are needed")
    return states.astype({"stops": int}).set_index(states.index + 1)


def state_values(scene: Scene, states: Frame) -> Frame:
    """Scalars of the scene that differ from state to state, by dotted key, SI.

    Raises:
        SceneError: a key is none, or a table does not reach a state.
    """
    pressed = (name for name, load in scene.loads.items() if load.pressure is not None)
    found = {f"loads.{name}.pressure": states.pressure for name in pressed}
    if scene.motion is not None:
        with suppress(SceneError):  # else nothing but the tables depends on it
            check_scalar(scene, "states", SPEED)
            found[SPEED] = np.copysign(states.speed, scene.motion.rate)
    for name in scene.section("states").tables:
        found |= _interpolated(scene.path(name), scene, states)
    written = {split_key(name): name for name in scene.varied}
    values = {written.get(split_key(name), name): x for name, x in found.items()}
    return states[[]].assign(**values).dropna(axis=1)


def _interpolated(path: Path, scene: Scene, states: Frame) -> dict[str, Any]:
    """Scalars of a table in all states: linear between its nodes, which are a grid."""
    from scipy.interpolate import RegularGridInterpolator

    units = units_of_state(scene)
    table = in_si(TextTable.read(path), lambda n: units[n] if n in AXES else unit_of(n))
    over, keys = ([n for n in table if (n in AXES) is axis] for axis in (True, False))
    for name in keys:
        check_scalar(scene, str(path), name)
    table, nodes = table.sort_values(over), [np.unique(table[name]) for name in over]
    whole = over and keys and np.array_equal(table[over], [*product(*nodes)])
    if not whole or states[over].isna().any(axis=None):
        raise SceneError(f"{path}: write a line for each combination of numbers that states have")
    low, high = table[over].min(), table[over].max()
    held = states[over].clip(low, high, axis=1)
    beyond = (states[over] - held).abs() > 1e-9 * high.abs()  # units have round-off
    if beyond.any(axis=None) and scene.section("states").outside != "hold":
        i, name = beyond.stack().idxmax()
        value = f"{name} = {states[name][i]:g} of state {i} lies outside"
        ends = f"{low[name]:g} to {high[name]:g}; add lines, or write"
        raise SceneError(f'{path}: {value} {ends} states.outside = "hold"')
    values = table[keys].to_numpy().reshape(*map(len, nodes), len(keys))
    return dict(zip(keys, RegularGridInterpolator(nodes, values)(held).T, strict=True))


def imposed_gap(scene: Scene, contact: Any, state: Mapping[str, float]) -> np.ndarray:
    """Gap that a state adds to each contact element [m], shape (elements,).

    Args:
        scene: its section ``states.gap`` has a formula or a file for an interface. A formula has
            units, "1 um * (r - 118 mm) / (22 mm)"; its names are x, y, z, r, the distance from the
            axis, and the numbers of the state. Pint evaluates it; it is never run as code.
        contact: the elements.
        state: pressure [Pa], speed [rad/s or m/s] and temperature [K above 0 degC].

    Raises:
        SceneError: the formula or the file is none.
    """
    import pint
    from scipy.interpolate import RBFInterpolator

    from brake_fenicsx.build.interfaces import scene_motion
    from brake_fenicsx.macro.contact_forces import Rotation

    x, motion, out = contact.points, scene_motion(scene), np.zeros(contact.interface.size)
    flat = motion.local(x) if isinstance(motion, Rotation) else x
    units = units_of_state(scene, temperature="delta_degC", **dict.fromkeys([*"xyzr", "gap"], "m"))
    registry: Any = pint.get_application_registry()  # type: ignore[no-untyped-call, unused-ignore]
    numbers = {**state, **dict(zip("xyzr", [*x.T, np.hypot(*flat.T[:2])], strict=True))}
    known = {name: registry.Quantity(value, units[name]) for name, value in numbers.items()}
    for name, given in scene.section("states").gap.items():
        with reading(None, "as a gap", GAP, at=f"states.gap.{name} = {given[:80]!r}: "):
            if given.endswith(".csv"):
                table = in_si(TextTable.read(scene.path(given)), units.__getitem__)
                found = RBFInterpolator(table[["x", "y"]], table.gap, kernel="linear")(x[:, :2])
            else:
                found = registry.parse_expression(given, **known).to("m").magnitude
            out = np.where(contact.interface == [*scene.contact].index(name), found, out)
            if not np.isfinite(out).all() or re.search(r"[^\w\s.+*/()-]", given):
                raise ValueError("it is no number on some contact element")
    return out
