"""States, tables over their numbers, and imposed gaps, as files and scenes write them."""

from types import SimpleNamespace

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.dynamometer.gaps import formula, imposed_gap
from brake_fenicsx.extras.dynamometer.matrix import read_matrix, state_values
from brake_fenicsx.macro.gap import EnrichedGap
from brake_fenicsx.micro import OneLaw, exponential_law
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK, FRICTION, ROUGH

MU = f"pressure [bar],temperature [K],{FRICTION}\n2,300,0.3\n2,400,0.2\n8,300,0.5\n8,400,0.6\n"
STATES = (
    "pressure [MPa],temperature [degC],direction,section,stops\n"
    "0.2,26.85,forward,a,3\n0.8,126.85,reverse,b,2\n0.5,76.85,forward,b,1\n"
)


@pytest.fixture
def scene(tmp_path):
    """A scene by its files and its [states], as a mapping."""

    def read(states=STATES, tables=(("mu.csv", MU),), **keys):
        (tmp_path / "matrix.csv").write_text(states)
        for name, text in tables:
            (tmp_path / name).write_text(text)
        (tmp_path / "block.toml").write_text(BLOCK.read_text())
        names = ", ".join(f'"{name}"' for name, _ in tables)
        more = "".join(f", {name} = {value}" for name, value in keys.items())
        own = "" if "grid" in keys else 'matrix = "matrix.csv", '
        given = f"states={{ {own}tables = [{names}]{more} }}"
        return read_scene(tmp_path / "block.toml", [*ROUGH, given])

    return read


def test_tables_are_exact_at_their_nodes_and_linear_between(scene):
    found = scene()
    states = read_matrix(found)
    np.testing.assert_allclose(states.pressure, [2e5, 8e5, 5e5])
    assert [*states.direction] == ["forward", "reverse", "forward"] and states.stops.sum() == 6
    values = state_values(found, states)
    np.testing.assert_allclose(values[FRICTION], [0.3, 0.6, 0.4], rtol=1e-12)
    np.testing.assert_allclose(values["loads.block.top.pressure"], [2e5, 8e5, 5e5])


def test_a_grid_has_every_combination(scene):
    found = scene(
        grid='{ "pressure [bar]" = ["2", "8"], "temperature [K]" = ["300", "350", "400"] }'
    )
    states = read_matrix(found)
    assert len(states) == 6 and {*states.section} == {""}
    np.testing.assert_allclose(
        state_values(found, states)[FRICTION], [0.3, 0.25, 0.2, 0.5, 0.55, 0.6]
    )


@pytest.mark.hard
@pytest.mark.parametrize(
    ("states", "keys", "said"),
    [
        (STATES.replace("[MPa]", ""), {}, "heading 'pressure ': no unit"),
        (STATES.replace("degC", "F"), {}, r"write temperature \[degC\] or \[K\]"),
        (STATES.replace("section", "remark"), {}, "heading 'remark': "),
        (STATES.replace("26.85", "warm"), {}, "line 2: temperature = 'warm': write a number"),
        (STATES.replace("reverse", "back"), {}, "direction: write forward or reverse"),
        (STATES.replace(",3\n", ",2.5\n"), {}, "stops: write whole numbers"),
        (STATES.replace("0.8", "0.9"), {}, r"mu.csv: pressure = 900000 of state 2 lies outside"),
        (STATES.replace("0.2", "-0.2"), {"outside": '"hold"'}, "must be positive"),
        (STATES.split("\n")[0] + "\n", {}, "no line of values"),
        (STATES, {"tables_": ""}, "unknown key"),
        (
            STATES,
            {"grid": '{ "pressure [bar]" = ["2"] }', "matrix": '"matrix.csv"'},
            "one of the two",
        ),
        (STATES, {"loads": '["plate.top"]'}, "states.loads: plate.top: is none of block.top"),
    ],
)
def test_what_is_no_state_is_named(states, keys, said, scene):
    """Units, words, numbers and ranges of a matrix of states: file, line, value and remedy."""
    with pytest.raises(SceneError, match=said) as error:
        scene(states, **({"tables_": "1"} if "tables_" in keys else keys))
    assert "\n" not in str(error.value)


def test_beyond_a_table_its_last_value_is_held_where_the_scene_says_so(scene):
    found = scene(STATES.replace("0.8", "0.9"), outside='"hold"')
    np.testing.assert_allclose(state_values(found, read_matrix(found))[FRICTION][1], 0.6)


@pytest.mark.hard
@pytest.mark.parametrize(
    ("table", "said"),
    [
        (MU.replace("8,400,0.6\n", ""), "one line for each combination"),
        (MU.replace(FRICTION, "contact.other.friction"), "contact.other"),
        (f"speed [m/s],{FRICTION}\n1,0.2\n2,0.3\n", "that the states have"),
        (f"pressure [bar],{FRICTION}\n1,0.2\n", "two values or more"),
    ],
)
def test_what_is_no_table_is_named(table, said, scene):
    """A table of scalars over the numbers of the states is a grid of keys that the scene has."""
    with pytest.raises(SceneError, match=said):
        scene(tables=(("mu.csv", table),))


def test_formulas_are_numbers_and_never_code():
    known = {"x": np.array([1.0, 2.0]), "r": np.array([3.0, 4.0]), "temperature": 100.0}
    found = formula("-2e-6 * (r - 3) ** 2 + sqrt(x) / temperature", known, "gap")
    np.testing.assert_allclose(found, -2e-6 * np.array([0, 1.0]) + np.sqrt([1.0, 2.0]) / 100)


@pytest.mark.hard
@pytest.mark.parametrize(
    "text",
    ["__import__('os')", "x.shape", "x[0]", "open(x)", "y", "1 / 0", "x +", "'a'", "True"],
)
def test_what_is_no_formula_is_named(text):
    """A formula of a gap is numbers, names and functions; whatever else stands in it is refused."""
    with pytest.raises(SceneError, match=r"states.gap.pad = .*; write a formula in metres"):
        formula(text, {"x": np.ones(2)}, "states.gap.pad")


def test_a_coned_gap_over_a_rigid_annulus_has_its_closed_form():
    """p0 exp(-g/u0) on r1 < r < r2 with the gap c (r - r1): F = 2 pi p0 e^(-g/u0) I, with

    I = int exp(-c (r - r1) / u0) r dr in closed form. A positive gap opens the patch.
    """
    r1, r2, c, p0, u0, F = 0.096, 0.140, 1e-5 / 0.044, 10e6, 2e-6, 5e3
    edges = np.linspace(r1, r2, 2001)
    r = 0.5 * (edges[1:] + edges[:-1])
    contact = SimpleNamespace(interface=np.zeros(r.size, int), points=np.array([r, 0 * r, 0 * r]).T)
    scene = SimpleNamespace(
        contact={"pad": None}, motion=None,
        section=lambda name: SimpleNamespace(gap={"pad": f"{c} * (r - {r1})"}),
    )  # fmt: skip
    gap = imposed_gap(scene, contact, {})
    laws = EnrichedGap(OneLaw(exponential_law(p0, u0)), np.zeros(r.size, np.intp), -gap)
    a = c / u0
    closed = (r1 / a + 1 / a**2) - np.exp(-a * (r2 - r1)) * (r2 / a + 1 / a**2)
    g = u0 * np.log(2 * np.pi * p0 * closed / F)
    w = np.pi * (edges[1:] ** 2 - edges[:-1] ** 2)
    assert w @ laws.pressure(np.full(r.size, g)) == pytest.approx(F, rel=1e-6)
