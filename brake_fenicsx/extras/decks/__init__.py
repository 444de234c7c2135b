"""Decks of other programs: first scenes, readers of mesh files, bodies by matrices."""

from pathlib import Path
from typing import Any

from brake_fenicsx.commands import argument, command
from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.decks"
EXTRA = Extra(
    name="decks",
    commands=(f"{_HERE}:init",),
    readers={
        ".inp": (f"{_HERE}.abaqus:read_abaqus", "as an Abaqus deck"),
        ".cdb": (f"{_HERE}.ansys:read_ansys", "as an Ansys archive"),
        **dict.fromkeys(
            (".bdf", ".nas", ".fem"), (f"{_HERE}.nastran:read_nastran", "by pyNastran")
        ),
    },
    unread=f"{_HERE}.draft.deck:beside",
    bodies=f"{_HERE}.external_bodies:with_superelements",
    nodes=f"{_HERE}.superelement:set_names",
)


@command(
    argument("deck", metavar="MESH", help="mesh file: .inp, .cdb, .bdf, .msh, ..."),
    argument("-o", dest="scene", metavar="SCENE.toml", help="the scene, ./MESH.toml"),
    argument("--units", nargs=3, metavar=("mm", "t", "s"), help="consistent units of length, mass"
             " and time of the file; guessed if not given"),
    argument("--shells", choices=["solid"], help="make solids of the shells of a deck"),
)  # fmt: skip
def init(options: Any, comm: Any) -> str | None:
    """Write a first scene of a mesh file: parts, faces, materials, contact, supports, loads."""
    from .draft.text import write_scene  # starts PETSc on all processes

    if comm.rank > 0:
        return None
    deck, scene = Path(options.deck), Path(options.scene or f"{Path(options.deck).stem}.toml")
    written = write_scene(deck, scene, options.units, bool(options.shells))
    return f"{written}\nnext: brake-fenicsx check {scene}"
