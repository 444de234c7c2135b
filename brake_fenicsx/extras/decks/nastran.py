"""Bulk data of Nastran and OptiStruct, read by pyNastran: points, solids, shells, other cards.

pyNastran divides the lines into cards, included files in their place, and reads the fields of each.
It gives a point without a coordinate system the basic one although a GRDSET names another
(1.4.1); here the blank field decides.
"""

from __future__ import annotations

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh, corners_of, numbered, same_length

# Shells may mark faces, or become solids.
SHELL_NODES = {"CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 6, "CQUAD4": 4, "CQUADR": 4, "CQUAD8": 8}
_SOLIDS = {
    ("CTETRA", 4): "tetra", ("CTETRA", 10): "tetra10", ("CHEXA", 8): "hexahedron",
    ("CHEXA", 20): "hexahedron20", ("CPENTA", 6): "wedge", ("CPENTA", 15): "wedge15",
    ("CPYRAM", 5): "pyramid", ("CPYRAM", 13): "pyramid13",
}  # fmt: skip
_ELEMENTS = {card for card, _ in _SOLIDS}
# Places of the nodes of a CHEXA of 20 in the order of VTK: upper edges before the upright ones.
_VTK = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)
_POINTS = ("GRID", "GRDSET", "CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")
# Cards of which nothing is lost: methods and output of the analysis.
HARMLESS = frozenset({"ENDDATA", "EIGRL", "EIGR", "EIGC", "EIGP", "TABDMP1", "FREQ", "FREQ1"})
_PARAMETERS = ("POST", "AUTOSPC", "PRTMAXIM", "GRDPNT", "MAXRATIO", "COUPMASS", "BAILOUT")


def read_nastran(path: Path) -> FileMesh:
    """Read a deck.

    Args:
        path: bulk data, with or without executive and case control before them.

    Returns:
        Cells in basic coordinates; groups are the numbers of the properties of solids and shells.

    Raises:
        SceneError: pyNastran is not installed, or the deck cannot be read.
    """
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # what is wrong is raised too
        model, cards = _cards(path)
    solids: dict[int, tuple[str, list[int]]] = {}
    skins: dict[str, list[list[int]]] = {}
    cells, shells = dict[str, list[int]](), dict[str, list[list[int]]]()
    for number, own in model.elements.items():
        nodes = [int(n) for n in own.nodes if n]
        if own.type in SHELL_NODES:
            if len(nodes) != SHELL_NODES[own.type]:
                raise SceneError(f"{own.type} {number} lacks middle nodes; write all of them")
            skins.setdefault(own.type, []).append(nodes)
            shells.setdefault(str(own.pid), []).append(nodes)
            continue
        kind = _SOLIDS.get((own.type, len(nodes)))
        if kind is None:
            raise SceneError(
                f"{own.type} {number} has {len(nodes)} nodes; write all middle nodes, or none"
            )
        solids[number] = kind, [nodes[i] for i in _VTK] if kind == "hexahedron20" else nodes
        cells.setdefault(str(own.pid), []).append(number)
    points = {n: own.get_position().tolist() for n, own in model.nodes.items()}
    counts = [SHELL_NODES[kind] for kind in skins]
    mesh, _, node, _ = numbered(points, solids, cells, {}, counts)
    for kind, rows in skins.items():
        mesh.shells[kind] = np.array([[node[n] for n in row] for row in rows])
    for name, rows in shells.items():
        corners = (corners_of(np.array([[node[n] for n in row]]))[0] for row in rows)
        mesh.facet_groups[name] = same_length([*map(list, corners)])
        mesh.shell_sets[name] = True
    if "WTMASS" in model.params:
        mesh.mass_factor = float(model.params["WTMASS"].values[0])
    mesh.blocks = [c for c in cards if c.keyword not in (*_ELEMENTS, *_POINTS)]
    held = [n for n, own in model.nodes.items() if {*"123"} & {*str(own.ps)}]
    if held:
        block = next(c for c in cards if c.keyword in ("GRDSET", "GRID"))
        why = f"{len(held)} points are held by their GRID or GRDSET: write [supports]"
        mesh.lost = [(block, why)]
    return mesh


def card_of(block: DeckKeyword) -> Any:
    """A model of pyNastran with one card."""
    from pyNastran.bdf.bdf import BDF

    model = BDF(debug=None)
    with redirect_stdout(StringIO()):  # what is wrong is raised too
        model.add_card_lines([line for (line,) in block.rows], block.keyword)
    return model


def _cards(path: Path) -> tuple[Any, list[DeckKeyword]]:
    """A model with points and elements, and every card; a row is a line as it stands."""
    try:
        from pyNastran.bdf.bdf import BDF
        from pyNastran.bdf.bdf_interface.pybdf import BDFInputPy
        from pyNastran.bdf.bdf_interface.utils import to_fields
    except ImportError:
        raise SceneError(
            f"{path.suffix} needs pyNastran: pip install pyNastran, or convert the mesh to .msh"
        ) from None
    model = BDF(debug=None)
    source: Any = BDFInputPy(True, False, "latin1", log=model.log)
    # It would write pyNastran_crash.bdf into the working directory.
    source._dump_file = lambda *_: None
    try:
        lines, places = source.lines_to_deck_lines(source.get_main_lines(str(path)))
    except (OSError, RuntimeError) as error:
        text = " ".join(str(error).split())[:120]
        raise SceneError(f"an included file cannot be read: {text}") from None
    begins = [i + 1 for i, line in enumerate(lines) if line.split()[:1] in (["BEGIN"], ["begin"])]
    if len(begins) > 1:
        raise SceneError("superelements are not read; write one deck without BEGIN SUPER")
    start = begins[0] if begins else 0
    lines, places = lines[start:], places[start:]
    cards, points = list[DeckKeyword](), dict[int, list[str]]()
    listed, by_name, _ = model.get_bdf_cards(lines, places)
    rest = [(name, *card) for name, own in by_name.items() for card in own]
    for name, _, own, (file, line) in [*listed, *rest]:
        if "=" in name:
            raise SceneError(f"card {name!r}: replicated cards are not read; write them out")
        at = f"{Path(source.active_filenames[file]).name}:{line + 1}"
        cards.append(DeckKeyword(name, {}, [[row] for row in own], own[0].strip(), at))
        try:
            fields = [word.strip() for word in to_fields(own, name)]
            wanted = name in (*_POINTS, *_ELEMENTS, *SHELL_NODES)
            if wanted or (name == "PARAM" and fields[1].upper() == "WTMASS"):
                model.add_card_lines(own, name)
        except Exception as error:  # pyNastran raises nothing narrower
            text = " ".join(str(error).split())[:120]
            raise SceneError(f"{at}: {own[0].strip()}: {text}") from None
        if name == "GRID":
            points[int(fields[1])] = fields
        if name in SHELL_NODES:
            shell = model.elements[int(fields[1])]
            cards[-1].options = {"PID": str(shell.pid), "ZOFFS": str(shell.zoffset or 0.0)}
        if name == "PARAM" and fields[1].upper() in ("WTMASS", *_PARAMETERS):
            cards.pop()
    if model.grdset is not None:
        for number, fields in points.items():
            own = model.nodes[number]
            own.cp, own.ps = (
                given if fields[place] else default
                for place, given, default in (
                    (2, own.cp, model.grdset.cp), (7, own.ps, model.grdset.ps),
                )
            )  # fmt: skip
    only = dict.fromkeys(
        ("elements", "nodes_with_elements", "properties", "masses", "materials", "loads",
         "constraints", "aero", "sets", "optimization"), False,
    )  # fmt: skip
    model.cross_reference(**{f"xref_{name}": value for name, value in only.items()})
    return model, cards
