"""Decks of other programs: first scenes, readers of mesh files, bodies by matrices."""

from brake_fenicsx.extensions import Extra

_HERE = "brake_fenicsx.extras.decks"
EXTRA = Extra(
    name="decks",
    commands=(f"{_HERE}.commands:init",),
    readers={
        ".inp": (f"{_HERE}.abaqus:read_abaqus", "as an Abaqus deck"),
        ".cdb": (f"{_HERE}.ansys:read_ansys", "as an Ansys archive"),
        **dict.fromkeys(
            (".bdf", ".nas", ".fem"), (f"{_HERE}.nastran:read_nastran", "by pyNastran")
        ),
    },
    unread=f"{_HERE}.draft.beside:beside",
    bodies=f"{_HERE}.external_bodies:with_superelements",
    nodes=f"{_HERE}.superelement:set_names",
)
