"""States, tables over their numbers, and imposed gaps, as files and scenes write them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.dynamometer.states import imposed_gap, read_matrix, state_values
from brake_fenicsx.macro.contact_forces import EnrichedGap
from brake_fenicsx.micro import OneLaw, exponential_law
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK, FRICTION, ROUGH

MU = f"pressure [bar],temperature [degC],{FRICTION}\n2,20,0.3\n2,120,0.2\n8,20,0.5\n8,120,0.6\n"
STATES = (
    "pressure [MPa],temperature [degC],direction,section,stops\n"
    "0.2,20,forward,a,3\n0.8,120,reverse,b,2\n0.5,70,forward,b,1\n"
)


@pytest.fixture
def scene(tmp_path):
    """A scene by its files and its [states], as a mapping."""

    def read(states=STATES, table=MU, **keys):
        (tmp_path / "matrix.csv").write_text(states)
        (tmp_path / "mu.csv").write_text(table)
        (tmp_path / "block.toml").write_text(BLOCK.read_text())
        own = {} if "grid" in keys else {"matrix": '"matrix.csv"'}
        given = ", ".join(f"{n} = {x}" for n, x in ({"tables": '["mu.csv"]'} | own | keys).items())
        return read_scene(tmp_path / "block.toml", [*ROUGH, f"states={{ {given} }}"])

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
    numbers = '{ "pressure [bar]" = ["2", "8"], "temperature [degC]" = ["20", "70", "120"] }'
    found = scene(grid=numbers)
    states = read_matrix(found)
    assert len(states) == 6 and {*states.section} == {""}
    values = state_values(found, states)
    np.testing.assert_allclose(values[FRICTION], [0.3, 0.25, 0.2, 0.5, 0.55, 0.6])


@pytest.mark.hard
@pytest.mark.parametrize(
    ("states", "keys", "said"),
    [
        (STATES.replace("[MPa]", ""), {}, "heading 'pressure': .*write known names with their"),
        (STATES.replace("degC", "F"), {}, r"write .*temperature \[degC\]"),
        (STATES.replace("section", "remark"), {}, "heading 'remark': .*write known names"),
        (STATES.replace("20", "warm"), {}, "line 2: temperature .degC. = 'warm': write a number"),
        (STATES.replace("reverse", "back"), {}, "line 3: .*back.*forward or reverse"),
        (STATES.replace(",3\n", ",2.5\n"), {}, "line 2: .*2.5: positive numbers, whole stops"),
        (STATES.replace("0.8", "0.9"), {}, r"mu.csv: pressure = 900000 of state 2 lies outside"),
        (STATES.replace("0.2", "-0.2"), {"outside": '"hold"'}, "positive numbers"),
        (STATES.split("\n")[0] + "\n", {}, "no line of values"),
        (STATES, {"rows": "1"}, "unknown key"),
        (STATES, {"grid": '{ "pressure [bar]" = ["2"] }', "matrix": '"matrix.csv"'}, "one of the"),
        (STATES, {"bands": '["3 kHz", "1 kHz"]'}, "states.bands .*rising"),
        (STATES, {"gap": "{ other = '1 um' }"}, "states.gap.other: contact has only block_plate"),
        (STATES, {"events": "'none.csv'"}, "none.csv: no such file"),
    ],
)
def test_what_is_no_state_is_named(states, keys, said, scene):
    """Units, words, numbers and ranges of a matrix of states: file, line, value and remedy."""
    with pytest.raises(SceneError, match=said) as error:
        scene(states, **keys)
    assert "\n" not in str(error.value)


def test_beyond_a_table_its_last_value_is_held_where_the_scene_says_so(scene):
    found = scene(STATES.replace("0.8", "0.9"), outside='"hold"')
    np.testing.assert_allclose(state_values(found, read_matrix(found))[FRICTION].iloc[1], 0.6)


def test_only_what_states_use_of_a_table_widens_the_reduced_model(scene):
    """A line far beyond the states, whose modulus no reduced model holds, changes nothing."""
    lining = "temperature [degC],materials.lining.C33 [GPa]\n20,2.27\n120,2.0\n{}"
    one, two = (scene(table=lining.format(more)) for more in ("", "900,0.01\n"))
    assert one.spanned == two.spanned
    assert np.ptp(one.spanned["materials.lining.C33"]) == pytest.approx(0.27e9)


@pytest.mark.hard
@pytest.mark.parametrize(
    ("table", "said"),
    [
        (MU.replace("8,120,0.6\n", ""), "a line for each combination of"),
        (MU.replace(FRICTION, "contact.other.friction"), "contact.other"),
        (f"speed [m/s],{FRICTION}\n1,0.2\n2,0.3\n", "numbers that states have"),
        (f"{FRICTION}\n0.2\n", "a line for each combination of"),
    ],
)
def test_what_is_no_table_is_named(table, said, scene):
    """A table of scalars over the numbers of the states is a grid of keys that the scene has."""
    with pytest.raises(SceneError, match=said):
        scene(table=table)


def gap(text, x, y=0.0, folder=Path(), **state):
    """A gap on elements of the plane z = 0; a pad alone."""
    points = np.stack(np.broadcast_arrays(x, y, 0.0), axis=1)
    contact = SimpleNamespace(interface=np.zeros(len(points), int), points=points)
    table = SimpleNamespace(gap={"pad": text})
    scene = SimpleNamespace(
        contact={"pad": None}, motion=None, section=lambda name: table, path=folder.joinpath
    )
    return imposed_gap(scene, contact, state)


def test_formulas_are_lengths_of_the_place_and_the_state():
    found = gap("-2 um * ((r - 3 mm) / mm) ** 2 + 1 um * temperature / (50 K)",
                np.array([3e-3, 4e-3]), temperature=100.0)  # fmt: skip
    np.testing.assert_allclose(found, [2e-6, 0.0], atol=1e-18)


def test_a_gap_of_a_file_is_exact_at_its_points(tmp_path):
    x = np.array([[-1e-3, 0.0], [2e-3, 1e-3], [0.0, -1e-3], [1e-3, 2e-3]])
    rows = "\n".join(f"{1e3 * a},{1e3 * b},{i}" for i, (a, b) in enumerate(x))
    (tmp_path / "wear.csv").write_text(f"x [mm],y [mm],gap [um]\n{rows}\n")
    found = gap("wear.csv", *x.T, tmp_path)
    np.testing.assert_allclose(found, 1e-6 * np.arange(4), atol=1e-15)


@pytest.mark.hard
@pytest.mark.parametrize(
    "text",
    ["__import__('os')", "x.shape", "x[0]", "open(x)", "q", "1 um / 0", "x +", "'a'", "2", "x * x",
     "none/there.csv"],
)  # fmt: skip
def test_what_is_no_gap_is_named(text):
    """A gap is a formula that gives a length, never code, or a file that is there."""
    said = r"states.gap.pad = .*; write a length with units|none/there.csv: no such file"
    with pytest.raises(SceneError, match=said):
        gap(text, np.ones(2))


def test_a_coned_gap_over_a_rigid_annulus_has_its_closed_form():
    """p0 exp(-g/u0) on r1 < r < r2 with the gap c (r - r1): F = 2 pi p0 e^(-g/u0) I, with

    I = int exp(-c (r - r1) / u0) r dr in closed form. A positive gap opens the patch.
    """
    r1, r2, c, p0, u0, F = 0.096, 0.140, 1e-5 / 0.044, 10e6, 2e-6, 5e3
    edges = np.linspace(r1, r2, 2001)
    r = 0.5 * (edges[1:] + edges[:-1])
    coned = gap("10 um * (r - 96 mm) / (44 mm)", r)
    laws = EnrichedGap(OneLaw(exponential_law(p0, u0)), np.zeros(r.size, np.intp), -coned)
    a = c / u0
    closed = (r1 / a + 1 / a**2) - np.exp(-a * (r2 - r1)) * (r2 / a + 1 / a**2)
    g = u0 * np.log(2 * np.pi * p0 * closed / F)
    w = np.pi * (edges[1:] ** 2 - edges[:-1] ** 2)
    assert w @ laws.pressure(np.full(r.size, g)) == pytest.approx(F, rel=1e-6)
