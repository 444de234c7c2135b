"""Modes of a modal test from a universal file: datasets 15 or 2411, 18 or 2420, 164 and 55.

A direction of a point counts as measured where any mode has a displacement other than zero in it.
Directions are those of the point's displacement coordinate system, Cartesian or cylindrical.

Reference: Structural Dynamics Research Laboratory, University of Cincinnati, Universal File Formats
for Modal Analysis Testing, https://www.ceas3.uc.edu/sdrluff/.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError
from brake_fenicsx.report.universal import universal_files

Array = NDArray[np.float64]

NODES, SYSTEMS, UNITS, SHAPES, RESPONSES = (15, 2411), (18, 2420), 164, 55, 58
NORMAL, COMPLEX = 2, (3, 7)  # analysis types of dataset 55
CYLINDRICAL, SPHERICAL = 1, 2


@dataclass(frozen=True, slots=True)
class Measured:
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
    label: NDArray[np.intp]
    points: Array
    axes: Array
    seen: NDArray[np.bool_]
    frequency: Array
    damping: Array
    shapes: NDArray[np.complex128]


def read_modes(path: str | Path) -> Measured:
    """Read the modes of a test.

    Args:
        path: the universal file.

    Raises:
        SceneError: the file, what it lacks, and the remedy.
    """
    file = Path(path)
    if not file.is_file():
        raise SceneError(f"{file}: no such file; name the universal file of the test")
    sets = _read(file)
    kinds = [s["type"] for s in sets]
    modes = [s for s in sets if s["type"] == SHAPES and _eigenvalue(s) is not None]
    if not modes:
        if RESPONSES in kinds:
            raise SceneError(
                f"{file}: contains frequency responses (dataset 58) and no modes; identify the"
                " modes in the test software, or with sdypy-EMA, and export them as dataset 55"
            )
        raise SceneError(
            f"{file}: contains no modes (dataset 55 of normal or complex modes);"
            f" it contains {_listed(kinds)}: export modes and nodes"
        )
    if not set(NODES) & set(kinds):
        raise SceneError(
            f"{file}: contains no nodes (dataset 15 or 2411); export the geometry of the test too"
        )
    modes.sort(key=lambda s: abs(_eigenvalue(s).imag))  # type: ignore[union-attr]
    scale = next((1 / s["length"] for s in sets if s["type"] == UNITS), 1.0)
    systems = _systems(file, sets, scale)
    place, system = _nodes(file, sets, scale, systems)
    labels = reduce(np.intersect1d, [np.asarray(s["node_nums"], dtype=int) for s in modes])
    without = [n for n in labels if n not in place]
    if without or not labels.size:
        lost = f"node {without[0]} of the modes has no position" if without else "no node is common"
        raise SceneError(f"{file}: dataset 55: {lost}; export the geometry of all measured points")
    shapes = np.array([_shape(s, labels) for s in modes])
    if not np.isfinite(shapes).all() or not np.any(shapes, axis=(1, 2)).all():
        raise SceneError(f"{file}: dataset 55: a mode is zero or not finite; export it again")
    s = np.array([_eigenvalue(m) for m in modes])
    points = np.array([place[n] for n in labels])
    axes = np.array([_axes(systems[system[n]], place[n]) for n in labels])
    return Measured(
        file, labels, points, axes, np.any(shapes != 0, axis=0), np.abs(s.imag) / (2 * np.pi),
        -s.real / np.abs(s), shapes,
    )  # fmt: skip


def _read(file: Path) -> list[dict[str, Any]]:
    """Datasets of a file; those of no use here by their number alone."""
    pyuff = universal_files("correlate")
    used = {*NODES, *SYSTEMS, UNITS, SHAPES}
    try:
        read = pyuff.UFF(str(file))
        return [
            read.read_sets(i) if kind in used else {"type": int(kind)}
            for i, kind in enumerate(read.get_set_types())
        ]
    except Exception as error:  # pyuff raises nothing narrower
        raise SceneError(f"{file}: cannot be read as a universal file: {error}") from None


def _listed(kinds: list[int]) -> str:
    return ", ".join(f"{k}" for k in dict.fromkeys(kinds)) or "no dataset at all"


def _eigenvalue(mode: dict[str, Any]) -> complex | None:
    """Eigenvalue alpha + i omega [1/s] of a mode that vibrates; None of anything else.

    The damping ratio of a normal mode is the viscous one or half of the hysteretic one.
    """
    if mode["analysis_type"] in COMPLEX:
        s = complex(mode["eig"])
        return s if s.imag else None
    if mode["analysis_type"] != NORMAL or not mode["freq"] > 0:
        return None
    ratio = mode.get("modal_damp_vis") or 0.5 * mode.get("modal_damp_his", 0.0)
    omega = 2 * np.pi * mode["freq"]
    return complex(-ratio / np.sqrt(max(1 - ratio**2, 1e-6)) * omega, omega)


def _shape(mode: dict[str, Any], labels: NDArray[np.intp]) -> NDArray[np.complex128]:
    """Displacements at some nodes, shape (nodes, 3)."""
    number = {int(n): i for i, n in enumerate(mode["node_nums"])}
    rows = [number[int(n)] for n in labels]
    return np.column_stack([np.asarray(mode[r], complex)[rows] for r in ("r1", "r2", "r3")])


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
                    raise SceneError(
                        f"{file}: dataset 18: system {n:.0f} refers to another one; export"
                        " coordinate systems in global coordinates"
                    )
                x, inside = (s[k][i] - s["ref_o"][i] for k in ("x_point", "xz_point"))
                y = np.cross(inside, x)
                rows = np.array([x, y, np.cross(x, y)])
                length = np.linalg.norm(rows, axis=1, keepdims=True)
                found[int(n)] = (int(s["cs_type"][i]), rows / length, s["ref_o"][i] * scale)
    return found


def _nodes(
    file: Path, sets: list[dict[str, Any]], scale: float,
    systems: dict[int, tuple[int, Array, Array]],
) -> tuple[dict[int, Array], dict[int, int]]:  # fmt: skip
    """Position [m] and displacement system of every node.

    Dataset 15 has coordinates in the definition system, 2411 in global axes.
    """
    place, system = {}, {}
    for s in (s for s in sets if s["type"] in NODES):
        for i, label in enumerate(s["node_nums"]):
            n, x = int(label), np.array([s[c][i] for c in "xyz"])
            own = int(s["def_cs"][i]) if s["type"] == 15 else 0
            system[n] = int(s["disp_cs"][i])
            for used in {own, system[n]}:
                if systems.get(used, (SPHERICAL,))[0] >= SPHERICAL:
                    raise SceneError(
                        f"{file}: node {n}: coordinate system {used} is missing or neither"
                        " Cartesian nor cylindrical; export the nodes in global coordinates"
                    )
            kind, rows, origin = systems[own]
            if kind == CYLINDRICAL:
                angle = np.radians(x[1])
                x = np.array([x[0] * np.cos(angle), x[0] * np.sin(angle), x[2]])
            place[n] = origin + scale * x @ rows
    return place, system


def _axes(system: tuple[int, Array, Array], x: Array) -> Array:
    """Directions of a coordinate system at a point, as rows."""
    kind, rows, origin = system
    if kind != CYLINDRICAL:
        return rows
    radial, along = (rows[:2] @ (x - origin)), rows[2]
    c, s = radial / max(float(np.linalg.norm(radial)), 1e-300)
    return np.array([c * rows[0] + s * rows[1], -s * rows[0] + c * rows[1], along])
