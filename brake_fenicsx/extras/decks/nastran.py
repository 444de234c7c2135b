"""Bulk data of Nastran and OptiStruct, read by pyNastran: points, solids, shells, other cards.

pyNastran divides the lines into cards, included files in their place, and reads the fields of each.
It gives a point without a coordinate system the basic one although a GRDSET names another
(1.4.1); here the blank field decides.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh, numbered

from . import abaqus_scope, keywords

# Shells may mark faces, or become solids.
SHELL_NODES = {"CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 6, "CQUAD4": 4, "CQUADR": 4, "CQUAD8": 8}
_SOLIDS = {"CTETRA": (4, 10), "CHEXA": (8, 20), "CPENTA": (6, 15), "CPYRAM": (5, 13)}
_POINTS = ("GRID", "GRDSET", "CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")
_PARAMETERS = ("WTMASS", *keywords.TABLES["idle"]["nastran"])


def read_nastran(path: Path) -> FileMesh:
    """Read a deck.

    Args:
        path: bulk data, with or without executive and case control before them.

    Returns:
        Cells in basic coordinates; groups are the numbers of the properties of solids and shells.

    Raises:
        SceneError: pyNastran is not installed, or the deck cannot be read.
    """
    try:
        import pyNastran.bdf.bdf  # noqa: F401
    except ImportError:
        raise SceneError(f"""{path.suffix} needs pyNastran: pip install pyNastran, or convert the
            mesh to .msh""") from None
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # what is wrong is raised too
        model, blocks, first = _model(path)
    solids, skins = dict[int, tuple[str, list[int]]](), dict[int, tuple[str, list[int]]]()
    groups = defaultdict[str, list[int]](list)
    for number, own in model.elements.items():
        nodes = [int(n) for n in own.nodes if n]
        if SHELL_NODES.get(own.type) == len(nodes):
            skins[number] = own.type, nodes
        elif len(nodes) in _SOLIDS.get(own.type, ()):
            solids[number] = abaqus_scope.KINDS[len(nodes)], nodes
        else:
            raise SceneError(f"""{own.type} {number} has {len(nodes)} nodes; write all middle nodes,
                or none""")
        groups[str(own.pid)].append(number)
    points = {n: own.get_position().tolist() for n, own in model.nodes.items()}
    mesh = numbered(points, solids, skins, groups, {})
    if "WTMASS" in model.params:
        mesh.mass_factor = float(model.params["WTMASS"].values[0])
    mesh.blocks = blocks
    held = [n for n, own in model.nodes.items() if {*"123"} & {*str(own.ps)}]
    if held and first is not None:
        why = f"{len(held)} points are held by their GRID or GRDSET: write [supports]"
        mesh.lost = [(first, why)]
    return mesh


def card_of(block: DeckKeyword) -> Any:
    """A model of pyNastran with one card."""
    from pyNastran.bdf.bdf import BDF

    model = BDF(debug=None)
    with redirect_stdout(StringIO()):  # what is wrong is raised too
        model.add_card_lines([line for (line,) in block.rows], block.keyword)
    return model


def _model(path: Path) -> tuple[Any, list[DeckKeyword], DeckKeyword | None]:
    """A model with points and elements, every other card, and the first one of points."""
    from pyNastran.bdf.bdf import BDF
    from pyNastran.bdf.bdf_interface.utils import to_fields

    model = BDF(debug=None)
    blocks, points, first = list[DeckKeyword](), dict[int, list[str]](), None
    for name, lines, at in _cards(model, path):
        block = DeckKeyword(name, {}, [[line] for line in lines], lines[0].strip(), at)
        try:
            fields = [word.strip() for word in to_fields(lines, name)]
            parameter = fields[1].upper() if name == "PARAM" else ""
            if name in (*_POINTS, *_SOLIDS, *SHELL_NODES) or parameter == "WTMASS":
                model.add_card_lines(lines, name)
        except Exception as error:  # pyNastran raises nothing narrower
            raise SceneError(f"{at}: {block.said}: {_short(error)}") from None
        first = block if first is None and name in ("GRID", "GRDSET") else first
        if name == "GRID":
            points[int(fields[1])] = fields
        elif name in SHELL_NODES:
            shell = model.elements[int(fields[1])]
            block.options = {"PID": str(shell.pid), "ZOFFS": str(shell.zoffset or 0.0)}
            if isinstance(shell.theta_mcid, int) or shell.theta_mcid:
                block.options["THETA"] = str(shell.theta_mcid)
        if name not in (*_POINTS, *_SOLIDS) and parameter not in _PARAMETERS:
            blocks.append(block)
    _refer(model, points)
    return model, blocks, first


def _refer(model: Any, points: Mapping[int, list[str]]) -> None:
    """Give points their coordinate systems; number -> fields of GRID, of which some are blank."""
    for number, fields in points.items() if model.grdset is not None else ():
        own = model.nodes[number]
        own.cp = own.cp if fields[2] else model.grdset.cp
        own.ps = own.ps if fields[7] else model.grdset.ps
    only = (
        "elements nodes_with_elements properties masses materials loads constraints aero sets"
        " optimization"
    )
    model.cross_reference(**{f"xref_{name}": False for name in only.split()})


def _cards(model: Any, path: Path) -> Iterator[tuple[str, list[str], str]]:
    """Name, lines and place of each card, those of included files in their place."""
    from pyNastran.bdf.bdf_interface.pybdf import BDFInputPy

    source: Any = BDFInputPy(True, False, "latin1", log=model.log)
    # It would write pyNastran_crash.bdf into the working directory.
    source._dump_file = lambda *_: None
    try:
        lines, places = source.lines_to_deck_lines(source.get_main_lines(str(path)))
    except (OSError, RuntimeError) as error:
        raise SceneError(f"an included file cannot be read: {_short(error)}") from None
    begins = [i + 1 for i, line in enumerate(lines) if line.split()[:1] in (["BEGIN"], ["begin"])]
    if len(begins) > 1:
        raise SceneError("superelements are not read; write one deck without BEGIN SUPER")
    start = begins[0] if begins else 0
    listed, by_name, _ = model.get_bdf_cards(lines[start:], places[start:])
    rest = [(name, *card) for name, own in by_name.items() for card in own]
    for name, _, own, (file, line) in [*listed, *rest]:
        if "=" in name:
            raise SceneError(f"card {name!r}: replicated cards are not read; write them out")
        yield name, own, f"{Path(source.active_filenames[file]).name}:{line + 1}"


def _short(error: Exception) -> str:
    """The start of what pyNastran says, in one line."""
    return " ".join(str(error).split())[:120]
