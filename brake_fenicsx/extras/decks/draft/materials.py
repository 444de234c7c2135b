"""Materials of a deck and the sets of cells that have them: Abaqus, Ansys, Nastran.

Each reader gives the reason why something of its keyword is not taken over, or None.
"""

from collections.abc import Callable
from typing import Any

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.decks.abaqus_scope import find
from brake_fenicsx.extras.decks.keywords import TABLES
from brake_fenicsx.extras.decks.nastran import SHELL_NODES, card_of
from brake_fenicsx.meshing.filemesh import DeckKeyword, FileMesh

from .shell_surface import ShellSection
from .statements import Deck, Quantity, numbers

Reader = Callable[[Deck, DeckKeyword], str | None]

_NAMES = TABLES["constants"]


def _elastic(deck: Deck, block: DeckKeyword) -> str | None:
    kind, given = block.options.get("TYPE", "ISOTROPIC").upper()[:3], numbers(block)
    # One temperature may follow the constants.
    count = 21 if kind == "ANI" else len(_NAMES[kind])
    if len(given) not in (count, count + 1) or (kind == "ISO" and len(block.rows) > 1):
        return f"{len(given)} numbers: constants of several temperatures, or of none"
    if kind == "ANI":
        rest = [v for i, v in enumerate(given[:21]) if i not in _NAMES["orthotropic"]]
        if max(map(abs, rest)) > 1e-9 * max(given):
            return "anisotropic; no model of a scene has these constants"
        kind, given = "ORT", [given[i] for i in _NAMES["orthotropic"]]
    pairs = zip(_NAMES[kind], given, strict=False)
    c: dict[str, Any] = {n: Quantity(v, "" if n[0] == "n" else "Pa") for n, v in pairs}
    if kind == "ENG":
        c = _engineering(c)
    model = "isotropic" if kind == "ISO" else "orthotropic"
    deck.add("materials", deck.about, model=model, **c)
    return None


def _engineering(c: dict[str, Any]) -> dict[str, Any]:
    """Constants in the order of a scene."""
    axes = {"E": "E1 E2 E3", "nu": "nu12 nu13 nu23", "G": "G23 G13 G12"}
    return {key: [c[name] for name in names.split()] for key, names in axes.items()}


def _density(deck: Deck, block: DeckKeyword) -> None:
    deck.add("materials", deck.about, rho=Quantity(numbers(block)[0], "kg/m^3"))


def _damping(deck: Deck, block: DeckKeyword) -> None:
    if given := block.options.get("STRUCTURAL"):
        deck.add("materials", deck.about, loss=Quantity(float(given), ""))


def _section(deck: Deck, block: DeckKeyword) -> str | None:
    """A set of a part is one of each of its instances."""
    for group in deck.mesh.owned(block.options["ELSET"], block.scope):
        found = find(deck.mesh.cell_groups, group)
        if found is None:
            return "no solid is in this set"
        deck.sections[found] = block.options["MATERIAL"]
    return None


def of_solids(mesh: FileMesh, block: DeckKeyword) -> bool:
    """Whether a section is of continuum shells, which have the nodes of solids."""
    sets = mesh.owned(block.options.get("ELSET", ""), block.scope)
    return all(find(mesh.cell_groups, n) and not find(mesh.facet_groups, n) for n in sets)


def _shells(deck: Deck, block: DeckKeyword) -> str | None:
    """*SHELL SECTION: thickness, or for each layer thickness, points and material."""
    if of_solids(deck.mesh, block):
        return _section(deck, block)
    options, said = block.options, f"{block.at}: {block.said}"
    rows, turned = [] if "NODALTHICKNESS" in options else block.rows, list[str]()
    if "COMPOSITE" in options:
        layers = [(float(t), material) for t, _, material, *_ in rows]
        # An angle in Abaqus, a name of axes there and in CalculiX.
        turned = [word for row in rows for word in row[3:4] if word.strip("0.+-Ee")]
    else:
        layers = [(float(row[0] or 0), options["MATERIAL"]) for row in rows[:1]]
    words = {"SPOS": 0.5, "SNEG": -0.5}
    share = options.get("OFFSET", "0").upper()
    offset = (words[share] if share in words else float(share)) * sum(t for t, _ in layers)
    for group in deck.mesh.owned(options["ELSET"], block.scope):
        deck.add_shells(ShellSection(group, layers, offset, said))
    return f"layers turned by {', '.join(turned)}: make each a part" if turned else None


def _constants(deck: Deck, block: DeckKeyword) -> str | None:
    """MP, label, material, value; MPDATA, format, -, label, material, -, value.

    A material with EY or EZ is orthotropic, its PRXY, PRYZ and PRXZ nu12, nu23 and nu13.
    """
    words = block.rows[0]
    label, number = words[1:3] if block.keyword == "MP" else words[3:5]
    value, *more = words[3:] if block.keyword == "MP" else words[6:]
    name, own = f"MAT{number}", deck.constants[f"MAT{number}"]
    deck.sections[name] = name
    if (key := _NAMES["ansys"].get(label)) is None:
        return "no elastic constant or density"
    deck.tables["materials"].pop(name, None)
    if any(more) or label in own:
        own[""] = Quantity(0.0, "")  # the material is not as it stands
        return "several values of one constant"
    unit = {"E": "Pa", "G": "Pa", "r": "kg/m^3"}.get(key[0], "")
    own[label] = Quantity(float(value), unit)
    given = {_NAMES["ansys"][one]: q for one, q in own.items() if one}
    rho = {"rho": given.pop("rho")} if "rho" in given else {}
    if "" in own or not given:
        return None
    if given.keys() <= {"E1", "nu", "nu12"}:
        nu = {"nu": given.get("nu", given.get("nu12"))} if len(given) > 1 else {}
        if "E1" in given:
            deck.add("materials", name, model="isotropic", E=given["E1"], **nu, **rho)
    elif given.keys() == {*_NAMES["ENG"]}:
        deck.add("materials", name, model="orthotropic", **_engineering(given), **rho)
    return None


def _material(deck: Deck, block: DeckKeyword) -> str | None:
    """MAT1, read by pyNastran; the density times that of PARAM, WTMASS."""
    ((number, own),) = card_of(block).materials.items()
    rho = Quantity(own.rho * deck.mesh.mass_factor, "kg/m^3")
    keys = {"E": Quantity(own.e, "Pa"), "nu": Quantity(own.nu, ""), "rho": rho}
    loss = {"loss": Quantity(own.ge, "")} if own.ge else {}
    deck.add("materials", f"MAT{number}", model="isotropic", **keys, **loss)
    return None


def _property(deck: Deck, block: DeckKeyword) -> str | None:
    """PSOLID, PSHELL and PCOMP, read by pyNastran."""
    ((number, own),) = card_of(block).properties.items()
    if block.keyword == "PSOLID":
        if own.fctn not in (None, "SMECH"):
            return "no solid"
        deck.sections[str(number)] = f"MAT{own.mid}"
        return None
    plain = block.keyword == "PSHELL"
    # Of a symmetric laminate these are the plies of both halves.
    plies = [] if plain else zip(own.get_thicknesses(), own.get_material_ids(), strict=True)
    pairs = [(own.t, own.mid1)] if plain else plies
    layers = [(float(t or 0), f"MAT{mid}") for t, mid in pairs]
    said, total = f"{block.at}: {block.said}", sum(t for t, _ in layers)
    offset = 0.0 if plain or own.z0 is None else -own.z0 - 0.5 * total
    zoffs = [*deck.zoffs[str(number)], 0.0]
    if len(zoffs) > 2:
        raise SceneError(f"{said}: shells with several ZOFFS; give each a property of its own")
    deck.add_shells(ShellSection(str(number), layers, offset - zoffs[0], said))
    turned = [] if plain else [f"{angle:g}" for angle in own.get_thetas() if angle]
    lost = [f"layers turned by {', '.join(turned)}: make each a part"] * bool(turned)
    lost += [f"a mass of {own.nsm:g} per area: write [masses]"] * bool(own.nsm)
    bends = (own.mid2 and own.twelveIt3 == 1.0) if plain else own.lam in (None, "SYM")
    lost += [] if bends else ["its own bending stiffness"]
    return "; ".join(lost) or None


def _shell_of_nastran(deck: Deck, block: DeckKeyword) -> str | None:
    """How far the middle of a shell is from its grid points, and whether its axes are turned."""
    deck.zoffs[block.options["PID"]].add(float(block.options["ZOFFS"]))
    said = f"THETA or MCID {block.options.get('THETA')}: write the axis of the part"
    return said if "THETA" in block.options else None


def taken(deck: Deck, block: DeckKeyword) -> None:
    """Nothing of it is lost."""


ABAQUS: dict[str, Reader] = {
    "ELASTIC": _elastic, "DENSITY": _density, "DAMPING": _damping, "SOLID SECTION": _section,
    "SHELL SECTION": _shells, "SHELL GENERAL SECTION": _shells,
}  # fmt: skip
ANSYS: dict[str, Reader] = {"MP": _constants, "MPDATA": _constants}
NASTRAN: dict[str, Reader] = {
    **dict.fromkeys(SHELL_NODES, _shell_of_nastran),
    **dict.fromkeys(("PSOLID", "PSHELL", "PCOMP"), _property),
    "MAT1": _material,
}
# Keywords that give shells a thickness.
SHELLS = ("SHELL SECTION", "SHELL GENERAL SECTION", "PSHELL", "PCOMP")
