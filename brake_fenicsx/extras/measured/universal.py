"""Mode shapes of a run as a universal file, for modal analysis and test software.

Datasets: 151 (header), 164 (units: SI), 2411 (nodes), 2412 (volume elements) and, for each stored
mode, 55 (complex eigenvalue alpha + i omega [1/s], largest displacement 1).

Reference: Structural Dynamics Research Laboratory, University of Cincinnati, Universal File Formats
for Modal Analysis Testing, https://www.ceas3.uc.edu/sdrluff/.
"""

from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.arguments import Array, Complex, Ints
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import Arrays, read_hdf5, reading
from brake_fenicsx.folder.files import whole_file
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
    sets += [_mode(run, i, key, shape[used]) for i, (key, shape) in enumerate(stored, start=1)]
    path = run.directory / FILE
    with whole_file(path) as part:
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


def _read(path: Path, *names: str) -> Arrays:
    """Data sets of a file of fields."""
    with reading(path, "as an HDF5 file", "`run` of the scene makes it again"):
        return read_hdf5(path, [f"VTKHDF/{name}" for name in names])


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


def _mode(run: RunData, number: int, key: ModeKey, shape: Complex) -> dict[str, Any]:
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
