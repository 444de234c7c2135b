"""[mesh] of a scene: kind of cells, and the user's own mesh file in place of builders."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.tables import key, read_table


@dataclass(frozen=True, slots=True)
class MeshTable:
    """[mesh]: how parts are meshed, or which file holds them.

    Attributes:
        cells: kind of the builders' cells; hexahedra only for swept parts. The hexahedra of the
            reference disc take about half the unknowns of tetrahedra at equal error, and leave its
            double modes double to 1e-13 (tetrahedra of 12 mm: 4e-4 apart).
        order: order of the geometry; 2 puts middle nodes on curved faces, as a Hertz contact needs.
            Displacements are of second order in any case. Straight sides are the default: flat
            contact faces gain nothing, and for the reference disc (below 6 kHz, worst frequency)
            they are no less exact: tetrahedra of 12 mm 1.2 % against 1.4 % with middle nodes, 7 mm
            0.25 % against 0.31 %, for 16 % less time of assembly. Hexahedra gain: 11 mm 0.48 %
            against 0.33 %.
        growth: how fast cells grow away from finer ones, size per distance.
        quality: a mesh with a worse cell is refused: 3 r / R of tetrahedra, scaled Jacobian of
            hexahedra.
        file: mesh file, relative to the scene's folder.
        unit: unit of the file's coordinates.
        groups: group of the file -> "part.layer" for cells, "part.face" for surfaces or nodes.
        split: face whose nodes are doubled -> the face left on the other body.
        extent: smallest and largest extent [m] that is taken for a brake's.
    """

    cells: str = key(default="tetrahedra", choices=("tetrahedra", "hexahedra"))
    order: int = key(default=1, choices=(1, 2))
    growth: float = key(default=0.5)
    quality: float = key(default=0.01)
    file: str | None = key(default=None)
    unit: str | None = key(default=None)
    groups: dict[str, str] = field(default_factory=dict)
    split: dict[str, str] = field(default_factory=dict)
    extent: tuple[float, ...] = key("m", default=(5e-3, 3.0))


def read_mesh(table: dict[str, Any]) -> MeshTable:
    """Read the section [mesh].

    Raises:
        SceneError: the key, its value and the remedy.
    """
    names = {k: _names(table.get(k, {}), f"mesh.{k}") for k in ("groups", "split")}
    rest = {k: v for k, v in table.items() if k not in names}
    mesh = replace(read_table(MeshTable, rest, "mesh"), **names)
    if mesh.file is None:
        for name in ("unit", "groups", "split"):
            if getattr(mesh, name):
                raise SceneError(f"mesh.{name}: needs mesh.file, the file that it is about")
    if len(mesh.extent) != 2 or not mesh.extent[0] < mesh.extent[1]:
        raise SceneError(f"mesh.extent = {list(mesh.extent)!r} m: write [smallest, largest]")
    return mesh


def _names(table: Any, where: str) -> dict[str, str]:
    """A table of names to names."""
    if not isinstance(table, dict):
        raise SceneError(f"{where} = {table!r}: write a table")
    for name, value in table.items():
        if not isinstance(value, str) or value.count(".") != 1 or not all(value.split(".")):
            raise SceneError(f'{where}."{name}" = {value!r}: write "part.name"')
    return dict(table)
