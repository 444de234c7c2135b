"""A law of contact from a table of measured gaps and pressures."""

import json
import re

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.errors import SceneError
from brake_fenicsx.pipeline import run
from brake_fenicsx.samples.sampling import one_law
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import result_digest
from places import BLOCK
from run_tables import read_columns

P0, U0 = 10.0, 10.0  # MPa and um


def written(folder, lines, units='["um", "MPa"]'):
    """The block scene with a table as its law."""
    (folder / "law.csv").write_text("\n".join(lines) + "\n")
    scene = folder / "scene.toml"
    table = f'law = {{ table = "law.csv", units = {units} }}'
    text = BLOCK.read_text()
    scene.write_text(text.replace('law = { p0 = "10 MPa", u0 = "10 um" }', table))
    return scene


def exponential(rows=80):
    """Lines of p0 exp(-g / u0) from 0.01 to 20 MPa, widest gap last."""
    g = np.linspace(-7.0, 70.0, rows)
    return ["gap,pressure", *(f"{x:.9g},{P0 * np.exp(-x / U0):.12g}" for x in g)]


def test_table_of_an_exponential_law(tmp_path):
    """Pressure and stiffness are those of the closed form."""
    law = one_law(read_scene(written(tmp_path, exponential())).contact["block_plate"].law).law
    g = np.linspace(-6.5e-6, 60e-6, 333)
    exact = 1e7 * np.exp(-g / 1e-5)
    np.testing.assert_allclose(law.pressure(g), exact, rtol=1e-6)
    np.testing.assert_allclose(law.stiffness(g), exact / 1e-5, rtol=1e-5)
    np.testing.assert_allclose(law.vibration(g), law.stiffness(g))


def test_modes_under_a_table(tmp_path):
    """Equilibrium and modes are those under the law itself; a changed table is another result."""
    own = ['stages=["equilibrium","stability"]', "stability.band=['0 Hz','20 kHz']"]
    own += ["parts.block.size='14 mm'", "parts.plate.size='20 mm'"]
    scene = written(tmp_path, exponential())
    found, wanted = (prepare(s, own).modes().s for s in (scene, BLOCK))
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    before = result_digest(read_scene(scene))
    written(tmp_path, exponential(81))
    assert result_digest(read_scene(scene)) != before


def test_pressures_above_a_table_are_warned_of(tmp_path):
    """The share of the force on elements above the last row is that of contact.csv."""
    own = ['stages=["equilibrium","stability"]', "stability.band=['0 Hz','20 kHz']"]
    own += ["parts.block.size='14 mm'", "parts.plate.size='20 mm'"]
    rows = exponential()
    for name, top in (("whole", 20.0), ("short", 0.5)):
        kept = [rows[0], *(r for r in rows[1:] if float(r.partition(",")[2]) <= top)]
        run(written(tmp_path, kept), MPI.COMM_SELF, tmp_path / name, own)
        found = read_columns(tmp_path / name / "contact.csv")
        highest = 1e6 * max(float(r.partition(",")[2]) for r in kept[1:])
        force, above = found["p"] * found["area"], found["p"] > highest
        share = force[above].sum() / force.sum()
        facts = json.loads((tmp_path / name / "summary.json").read_text())
        said = [w for w in facts["warnings"] if "highest pressure of their laws" in w]
        if name == "whole":
            assert share == 0 and not said
        else:
            stated = facts["samples"]["multi-scale"]["force_share_beyond_laws"]
            assert 0.1 < share < 1 and stated == pytest.approx(share, rel=1e-9)
            assert f"{100 * share:.2g} % of the normal force" in said[0]


@pytest.mark.parametrize(
    ("lines", "units", "said"),
    [
        (["0,1", "1,0.5", "2,0.6", "3,0.1"], '["um", "MPa"]', "must rise as the gap falls"),
        (["0,1", "1,0.5", "1,0.4", "3,0.1"], '["um", "MPa"]', "must rise as the gap falls"),
        (["0,1", "1,0.5", "2,0.2", "3,0"], '["um", "MPa"]', "leave out rows without pressure"),
        (["0,1", "1,0.5", "2,0.2"], '["um", "MPa"]', "3 rows; a law needs 4"),
        (["0,1", "1,0.5", "a,b", "3,0"], '["um", "MPa"]', "line 3: 'a,b' does not contain two"),
        (["0;1", "1;0,5", "2;0,2", "3;0,1"], '["um", "MPa"]', "line 2: .* decimal points"),
        (["0,1,2", "1,0.5,2"], '["um", "MPa"]', "write a gap and a pressure"),
        (["0,1", "1,nan"], '["um", "MPa"]', "write a gap and a pressure"),
        (exponential(), '["um"]', "those of both columns"),
        (exponential(), '["um", "mm"]', "law.units"),
    ],
)
def test_wrong_tables(tmp_path, lines, units, said):
    """One line names the table and what is wrong with it."""
    with pytest.raises(SceneError, match=said) as error:
        read_scene(written(tmp_path, lines, units))
    assert "contact.block_plate.law" in str(error.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["contact.block_plate.law.table=none.csv"], "law.table = 'none.csv': no such file"),
        (['contact.block_plate.law.linear="1e13 Pa/m"'], "law: table replaces linear"),
        (["contact.block_plate.law={ linear='1e13 Pa/m', u0='1 um' }"], "law: write linear, or p0"),
        (["contact.block_plate.law={ p0='1 MPa' }"], 'law: write "library", { linear = '),
    ],
)
def test_missing_table_and_two_laws(tmp_path, changes, words):
    """A table that is not there, or beside another law, is refused."""
    with pytest.raises(SceneError, match=re.escape(f"contact.block_plate.{words}")):
        read_scene(written(tmp_path, exponential()), changes)
