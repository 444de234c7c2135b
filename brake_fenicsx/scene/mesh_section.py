"""[mesh] of a scene: kind of cells, and the user's own mesh file in place of builders."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, StrictStr, WithJsonSchema

from brake_fenicsx.scene.keys import key, rising_pair


def _dotted(name: str) -> str:
    """A name "part.name"."""
    if name.count(".") != 1 or not all(name.split(".")):
        raise ValueError('write "part.name"')
    return name


def _names_type() -> Any:
    """Type of a table of names to names."""
    return dict[str, Annotated[StrictStr, AfterValidator(_dotted)]]


def _named(value: Any) -> Any:
    """A name "part.name", or several."""
    for name in value if isinstance(value, list) and value else [value]:
        if not isinstance(name, str):
            raise ValueError('write "part.name"')
        _dotted(name)
    return value


def _groups_type() -> Any:
    """Type of a table of names to names, or to lists of them."""
    one = {"type": "string"}
    schema = WithJsonSchema({"anyOf": [one, {"type": "array", "items": one, "minItems": 1}]})
    return dict[str, Annotated[Any, BeforeValidator(_named), schema]]


@dataclass(frozen=True, slots=True)
class MeshTable:
    """[mesh]: how parts are meshed, or the file that contains the mesh.

    Attributes:
        cells: kind of the builders' cells; hexahedra only for swept parts. The hexahedra of the
            reference disc take about half the unknowns of tetrahedra at equal error, and keep the
            frequencies of double modes equal to 1e-13 (tetrahedra of 12 mm: 4e-4 apart).
        order: order of the geometry. 1 (straight edges) is enough for flat contact; 2 puts mid-side
            nodes on curved faces, which curved contact (Hertz) needs.
        degree: polynomial degree of the displacements. 1 is for comparison with decks of linear
            elements: these elements are fully integrated, too stiff in bending and lock near nu =
            0.5.
        mass: consistent, or lumped (the sum of each row on the diagonal; linear elements only).
        growth: growth rate of the cell size away from finer cells, size per distance.
        quality: lowest accepted cell quality: 3 r / R of tetrahedra, scaled Jacobian of hexahedra.
        file: mesh file, relative to the scene's folder.
        unit: unit of the file's coordinates.
        groups: group of the file -> "part.layer" for cells, "part.face" for surfaces or nodes; a
            list of faces where it lies on several parts.
        split: face whose nodes are duplicated -> face of the other body with the original nodes.
        extent: smallest and largest accepted extent [m] of the mesh; other meshes are rejected as a
            mistake in the unit.
    """

    cells: str = key(default="tetrahedra", choices=("tetrahedra", "hexahedra"))
    order: int = key(default=1, choices=(1, 2))
    degree: int = key(default=2, choices=(1, 2))
    mass: str = key(default="consistent", choices=("consistent", "lumped"))
    growth: float = key(default=0.5)
    quality: float = key(default=0.01)
    file: str | None = key(default=None)
    unit: str | None = key(default=None)
    groups: dict[str, str | list[str]] = field(
        default_factory=dict, metadata={"type": _groups_type}
    )
    split: dict[str, str] = field(default_factory=dict, metadata={"type": _names_type})
    extent: tuple[float, ...] = key(
        "m", default=(5e-3, 3.0), rule=(rising_pair, "write [smallest, largest]")
    )

    def contradictions(self) -> Iterator[str]:
        """Orders that go together; what is said of a mesh file needs one."""
        if self.degree == 1 and self.order == 2:
            yield ".order = 2: needs mesh.degree = 2, displacements of second order"
        if self.degree == 2 and self.mass == "lumped":
            yield """.mass = "lumped": corners of quadratic elements would have no or negative mass;
                write mesh.degree = 1 as well"""
        for name in ("unit", "groups", "split") if self.file is None else ():
            if getattr(self, name):
                yield f".{name}: needs mesh.file, the file that it is about"
