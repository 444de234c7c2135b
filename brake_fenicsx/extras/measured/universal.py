"""Universal files of modal analysis: tests that are read, mode shapes of a run that are written.

Read are nodes (datasets 15, 2411), axes (18, 2420), units (164) and modes (55). A direction of a
point counts as measured where any mode has a displacement other than zero in it. Directions are
those of the point's displacement coordinate system, Cartesian or cylindrical. Modes are read line
by line: pyuff 2.5.8 cannot read complex values of six components, and stumbles over one value at a
node. A mode may be divided into several datasets with nodes of their own, and a complex one may be
followed by its conjugate.

Written are datasets 151 (header), 164 (units: SI), 2411 (nodes), 2412 (volume elements) and, for
each stored mode, 55 (complex eigenvalue alpha + i omega [1/s], largest displacement 1).

Reference: Structural Dynamics Research Laboratory, University of Cincinnati, Universal File Formats
for Modal Analysis Testing, https://www.ceas3.uc.edu/sdrluff/.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Array, Complex, Index, Ints, Mask
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder import arrays, files
from brake_fenicsx.report.mode_fields import MOST
from brake_fenicsx.results.run import RunData, read_run
from brake_fenicsx.results.squeal import ModeKey

FILE = "modes.unv"
SI = {"units_code": 1, "units_description": "SI: metre, newton", "temp_mode": 1,
      "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15}  # fmt: skip
# Nodes of a cell -> corners and descriptor of the linear element: a line of dataset 2412 holds 8
# nodes, and pyuff writes one line.
ELEMENTS = {4: (4, 111), 10: (4, 111), 8: (8, 115), 27: (8, 115)}
# Codes of dataset 55.
COMPLEX_EIGENVALUE, TRANSLATIONS, DISPLACEMENT = 3, 2, 8

NODES, SYSTEMS, UNITS = (15, 2411), (18, 2420), 164
CYLINDRICAL, SPHERICAL = 1, 2
NORMAL, COMPLEX = 2, (3, 7)  # analysis types
COMPLEX_VALUES = 5  # data type
_REAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?")
# Two datasets are of one mode, or of a conjugate pair, if their eigenvalues differ by less.
SAME = 1e-6


def export_modes(directory: str | Path | RunData) -> Path:
    """Write the mode shapes that a run stored for ParaView as modes.unv into its folder.

    Args:
        directory: results folder of a finished run, or its results already read.

    Returns:
        The file.

    Raises:
        SceneError: the folder holds no mode shapes, or pyuff is missing.
    """
    pyuff = universal_files("export")
    run = read_run(directory)
    complete = run.modes is not None and run.samples is not None
    there = [name for name in run.approaches if complete and _file(run, name).is_file()]
    stored = [(key, shape) for name in there for key, shape in _shapes(run, name)]
    if not stored:
        raise SceneError(f"""{run.directory}/fields: contains no mode shapes; a run stores those of
            its most severe squeal modes: run the scene with stages = [..., "stability", "report"]
            and, if no mode squeals, a lower stability.threshold or more friction""")
    points, cells, used = _mesh(_file(run, stored[0][0].approach))
    sets = [_header(run), {"type": 164, **SI}, *_model(points, cells)]
    sets += [_shape(run, i, key, shape[used]) for i, (key, shape) in enumerate(stored, start=1)]
    path = run.directory / FILE
    with files.whole_file(path) as part:
        pyuff.UFF(str(part)).write_sets(sets, mode="overwrite")
    return path


def universal_files(command: str) -> Any:
    """The library of universal files, imported by the commands that need it."""
    try:
        import pyuff
    except ImportError:
        raise SceneError(f"{command} needs pyuff: pip install pyuff") from None
    return pyuff


def _file(run: RunData, approach: str) -> Path:
    return run.directory / "fields" / f"modes_{approach}.vtkhdf"


def _read(path: Path, *names: str) -> arrays.Arrays:
    """Data sets of a file of fields."""
    with arrays.reading(path, "as an HDF5 file", "`run` of the scene makes it again"):
        return arrays.read_hdf5(path, [f"VTKHDF/{name}" for name in names])


def _shapes(run: RunData, approach: str) -> list[tuple[ModeKey, Complex]]:
    """Stored modes of an approach, shapes at the points of the file, (points, 3)."""
    keys = run.squeal.representatives(approach, MOST)
    pairs = [[f"PointData/mode_{key.name}_{part}" for part in ("re", "im")] for key in keys]
    held = _read(_file(run, approach), *(name for pair in pairs for name in pair))
    found = [
        (key, [held.get(f"VTKHDF/{n}") for n in pair])
        for key, pair in zip(keys, pairs, strict=True)
    ]
    return [(key, re + 1j * im) for key, (re, im) in found if re is not None and im is not None]


def _mesh(path: Path) -> tuple[Array, Ints, Ints]:
    """Corners of the cells [m], cells over them, and the point of the file of each corner."""
    points, cells, types = _read(path, "Points", "Connectivity", "Types").values()
    cells = cells.reshape(len(types), -1)
    used, numbers = np.unique(cells[:, : ELEMENTS[cells.shape[1]][0]], return_inverse=True)
    return points[used], numbers.reshape(len(cells), -1), used


def _header(run: RunData) -> dict[str, Any]:
    name = str(run.summary.get("name", run.directory.name))[:80]
    by = dict.fromkeys(("db_app", "program"), "brake_fenicsx")
    return {"type": 151, "model_name": name, "description": "complex modes, SI units", **by}


def _model(points: Array, cells: Ints) -> list[dict[str, Any]]:
    """Nodes, numbered from 1, and volume elements."""
    zero = np.zeros(len(points), dtype=int)
    nodes: dict[Any, Any] = {
        "type": 2411, "node_nums": np.arange(1, len(points) + 1), "def_cs": zero, "disp_cs": zero,
        "color": zero, "x": points[:, 0], "y": points[:, 1], "z": points[:, 2],
    }  # fmt: skip
    corners, descriptor = ELEMENTS[cells.shape[1]]
    elements: list[dict[str, Any]] = [
        {"element_nums": i, "fe_descriptor": descriptor, "phys_table": 1, "mat_table": 1,
         "color": 0, "num_nodes": corners, "nodes_nums": cell.tolist()}
        for i, cell in enumerate(cells + 1, start=1)
    ]  # fmt: skip
    return [nodes, {"type": 2412, descriptor: elements}]


def _shape(run: RunData, number: int, key: ModeKey, shape: Complex) -> dict[str, Any]:
    """A complex mode."""
    modes = run.modes or {}
    row = np.flatnonzero(
        (modes["approach"] == key.approach)
        & (modes["sample"] == key.sample)
        & (modes["mode"] == key.mode)
    )[0]
    s = complex(modes["real_1_s"][row], 2 * np.pi * key.frequency)
    return {
        "type": 55, "analysis_type": COMPLEX_EIGENVALUE, "model_type": 1,
        "data_ch": TRANSLATIONS, "spec_data_type": DISPLACEMENT,
        "id1": f"{key.approach}, sample {key.sample}, mode {key.mode}",
        "id2": f"{key.frequency:.10g} Hz, damping -2 alpha/|omega| = {key.damping:.10g}",
        "id3": f"alpha = {s.real:.10g} 1/s, negative damping: unstable",
        "load_case": key.sample, "mode_n": number, "eig": s,
        "node_nums": np.arange(1, len(shape) + 1),
        "r1": shape[:, 0], "r2": shape[:, 1], "r3": shape[:, 2],
    }  # fmt: skip


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


@dataclass(frozen=True, slots=True)
class ModalTest:
    """Modes of a test, by frequency.

    Attributes:
        file: the universal file.
        label: number of each point, shape (points,).
        points: positions [m], shape (points, 3).
        axes: the three directions of each point as rows, shape (points, 3, 3).
        seen: which directions were measured, shape (points, 3).
        frequency: shape (modes,) [Hz].
        damping: modal damping ratio of each [-].
        shapes: displacements along the axes, shape (modes, points, 3).
    """

    file: Path
    label: Index
    points: Array
    axes: Array
    seen: Mask
    frequency: Array
    damping: Array
    shapes: Complex


def read_modes(path: str | Path) -> ModalTest:
    """Read the modes of a test with their shapes.

    Args:
        path: the universal file.

    Raises:
        SceneError: the file, what it lacks, and the remedy.
    """
    file = Path(path)
    sets = read_sets(file, (*NODES, *SYSTEMS, UNITS))
    modes = modes_of(file, sets)
    if not set(NODES) & {d["type"] for d in sets}:
        raise SceneError(f"""{file}: contains no nodes (dataset 15 or 2411); export the geometry of
            the test too""")
    place = nodes_of(file, sets)
    labels = sorted(set[int].intersection(*({*mode.shape} for mode in modes)))
    without = [n for n in labels if n not in place]
    if without or not labels:
        lost = f"node {without[0]} of the modes has no position" if without else "no node is common"
        raise SceneError(f"{file}: dataset 55: {lost}; export the geometry of all measured points")
    shapes = np.array([[mode.shape[n][:3] for n in labels] for mode in modes])
    if not np.isfinite(shapes).all() or not np.any(shapes, axis=(1, 2)).all():
        raise SceneError(f"{file}: dataset 55: a mode is zero or not finite; export it again")
    points, axes = (np.array(of) for of in zip(*(place[n] for n in labels), strict=True))
    s = np.array([mode.s for mode in modes])
    measured, frequency = np.asarray(shapes.any(axis=0)), s.imag / (2 * np.pi)
    given = np.array(labels), points, axes, measured, frequency
    return ModalTest(file, *given, -s.real / np.abs(s), shapes)


def read_sets(file: Path, kinds: Collection[int]) -> list[dict[str, Any]]:
    """Datasets of a universal file; those of other kinds by their number alone.

    Raises:
        SceneError: the file is missing or no universal file.
    """
    pyuff = universal_files("a test in a universal file")
    with arrays.reading(file, "as a universal file by pyuff"):
        read = pyuff.UFF(str(file))
        return [
            read.read_sets(i) if kind in kinds else {"type": int(kind)}
            for i, kind in enumerate(read.get_set_types())
        ]


def modes_of(file: Path, sets: list[dict[str, Any]]) -> list[Mode]:
    """Modes of a universal file, by frequency.

    Args:
        file: the file.
        sets: its datasets, to say what it holds instead.

    Raises:
        SceneError: there is none.
    """
    modes = read_mode_sets(file)
    if not modes:
        kinds = dict.fromkeys(str(d["type"]) for d in sets)
        raise SceneError(f"""{file}: contains no modes (dataset 55, normal or complex) but
            {", ".join(kinds) or "no dataset at all"}; export nodes and modes; of frequency
            responses (58) identify the modes first, in the test software or with sdypy-EMA""")
    return modes


def _systems(
    file: Path, sets: list[dict[str, Any]], scale: float
) -> dict[int, tuple[int, Array, Array]]:
    """Kind, axes as rows and origin [m] of every coordinate system; 0 is the global one.

    So is 1 where the file defines none: gmsh, Salome and others write it so.
    """
    world = (0, np.eye(3), np.zeros(3))
    found: dict[int, tuple[int, Array, Array]] = {0: world}
    if not any(s["type"] in (18, 2420) for s in sets):
        found[1] = world
    for s in sets:
        if s["type"] == 2420:
            for n, kind, T in zip(s["CS_sys_labels"], s["CS_types"], s["CS_matrices"], strict=True):
                found[n] = (kind, T[:3], T[3] * scale)
        elif s["type"] == 18:
            for i, n in enumerate(s["cs_num"]):
                if s["ref_cs_num"][i]:
                    raise SceneError(f"""{file}: dataset 18: system {n:.0f} refers to another one;
                        export coordinate systems in global coordinates""")
                x, inside = (s[k][i] - s["ref_o"][i] for k in ("x_point", "xz_point"))
                y = np.cross(inside, x)
                rows = np.array([x, y, np.cross(x, y)])
                length = np.linalg.norm(rows, axis=1, keepdims=True)
                found[int(n)] = (int(s["cs_type"][i]), rows / length, s["ref_o"][i] * scale)
    return found


def nodes_of(file: Path, sets: list[dict[str, Any]]) -> dict[int, tuple[Array, Array]]:
    """Position [m] and displacement axes, as rows, of every node.

    Dataset 15 has coordinates in the definition system, 2411 in global axes.
    """
    scale = next((1 / s["length"] for s in sets if s["type"] == UNITS), 1.0)
    systems = _systems(file, sets, scale)
    place = {}
    for s in (s for s in sets if s["type"] in NODES):
        for i, label in enumerate(s["node_nums"]):
            n, x = int(label), np.array([s[c][i] for c in "xyz"])
            own, shown = int(s["def_cs"][i]) if s["type"] == 15 else 0, int(s["disp_cs"][i])
            for used in {own, shown}:
                if systems.get(used, (SPHERICAL,))[0] >= SPHERICAL:
                    raise SceneError(f"""{file}: node {n}: coordinate system {used} is missing or
                        neither Cartesian nor cylindrical; export the nodes in global
                        coordinates""")
            kind, rows, origin = systems[own]
            if kind == CYLINDRICAL:
                angle = np.radians(x[1])
                x = np.array([x[0] * np.cos(angle), x[0] * np.sin(angle), x[2]])
            x = origin + scale * x @ rows
            place[n] = x, _axes(systems[shown], x)
    return place


def _axes(system: tuple[int, Array, Array], x: Array) -> Array:
    """Directions of a coordinate system at a point, as rows."""
    kind, rows, origin = system
    if kind != CYLINDRICAL:
        return rows
    radial = rows[:2] @ (x - origin)
    c, s = radial / max(float(np.linalg.norm(radial)), 1e-300)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ rows


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
        values = np.array(x, complex)
        shape[int(line)] = values[::2] + 1j * values[1::2] if complex_values else values
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
