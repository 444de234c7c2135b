"""What a user of Python meets: names and types of the package, and one line for each mistake."""

import pickle
import re
import subprocess
import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import brake_fenicsx
from brake_fenicsx import prepare, sample, sweep
from brake_fenicsx.display import html_table, mesh_grid
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.extensions import Extensions
from brake_fenicsx.mac import mac
from brake_fenicsx.micro import LawSettings, contact_law, law_steps, make_library
from brake_fenicsx.results.run import read_run
from brake_fenicsx.results.tables import MODES
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.surface import make_topography
from coarse_block import BLOCK, FRICTION, ROUGH

MEANT = f"; did you mean '{FRICTION}'?"
PRESSURE = 'loads."block.top".pressure'
ROOT = Path(__file__).parents[1]
I = np.eye(3)


def test_names_of_the_package():
    """Completion of a shell lists the functions and nothing that helps to import them."""
    names = [name for name in dir(brake_fenicsx) if not name.startswith("_")]
    assert {*brake_fenicsx.__all__} <= {*names}
    assert not {"Any", "import_module", "TYPE_CHECKING"} & {*names}


@pytest.mark.long
def test_a_type_checker_sees_the_types_of_the_package(tmp_path):
    """In another folder, without MYPYPATH: what an editor sees too."""
    script = tmp_path / "script.py"
    script.write_text(
        "from brake_fenicsx import prepare\n"
        "model = prepare('scene.toml')\nreveal_type(model)\nreveal_type(model.sweep('a', [1.0]))\n"
        "prepare({'stages': []}, parameters={'a': ['1 bar', 2e5]})\nprepare(3)\n"
        "reveal_type(model.modes({'a': '1 bar'}))\n"
    )
    # Of the package alone what the script names: the whole is checked beside the tests.
    (tmp_path / "mypy.ini").write_text(
        "[mypy]\nignore_missing_imports = true\nfollow_imports = skip\n"
        "[mypy-brake_fenicsx,brake_fenicsx.arguments,brake_fenicsx.model,brake_fenicsx.sweeps.sweep_study,"
        "brake_fenicsx.stability.modes]\nfollow_imports = silent\n"
    )
    command = [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"), str(script)]
    said = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path
    ).stdout  # fmt: skip
    assert 'note: Revealed type is "brake_fenicsx.model.Model"' in said, said
    assert 'note: Revealed type is "brake_fenicsx.sweeps.sweep_study.Branches"' in said
    assert said.count("error:") == said.count('"prepare" has incompatible type "int"') == 1, said
    assert 'Revealed type is "brake_fenicsx.stability.modes.Modes"' in said, said


@pytest.fixture(scope="module")
def model():
    return prepare(BLOCK, ROUGH)


class Coefficient:
    """A friction law that gives back the same whatever the speed."""

    def __init__(self, given):
        self.given = given

    def coefficient(self, V):
        return self.given


def rubbed(given):
    law = Extensions(friction={"block_plate": Coefficient(given)})
    return prepare(BLOCK, ROUGH, extensions=law).modes()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m: m.sweep(FRICTION, []), "values = []; give a list of numbers"),
        (lambda m: m.sweep(FRICTION, 0.3), "values = 0.3; give a list of numbers"),
        (lambda m: m.sweep(FRICTION, np.eye(2)), "give a list of numbers"),
        (lambda m: m.sweep(FRICTION, ["1 bar", "2 bar"]), "values = '1 bar': write a plain number"),
        (lambda m: m.sweep(PRESSURE, ["1 bar", "2 mm"]), "values = '2 mm': wrong unit; a pressure"),
        (lambda m: m.sweep(FRICTION, [0.1, np.nan]), "values = nan; give one finite number"),
        (lambda m: m.modes([FRICTION, 0.3]), "values: an object of the type list; give a mapping"),
        (lambda m: m.modes({FRICTION: "0.3"}), f"{FRICTION} = '0.3': write a plain number"),
        (lambda m: m.modes(sample=0.5), "sample 0.5 of"),
        (lambda m: m.modes({"friction": 0.3}), f"no such number of the scene{MEANT}"),
        (lambda m: m.sweep("contact.block_plat.friction", [0.1]), MEANT),
        (lambda m: m.modes({"parts.block.axis": 0.1}), "run the scene once for each"),
        (lambda m: m.modes(approach="multi_scale"), "; did you mean 'multi-scale'?"),
        (lambda m: m.modes(friction=0.3), "'friction'; its arguments are values, approach, sample"),
        (lambda m: m.modes(value={}), "did you mean 'values'?"),
        (lambda m: m.sweep(FRICTION), "sweep: missing a required argument: 'values'"),
        (lambda m: prepare(BLOCK, override=[]), "did you mean 'overrides'?"),
        (lambda m: m.modes().to_pyvista(999), "to_pyvista: mode 999: there are 0 to"),
        (lambda m: complex_modes(I, None, I, (0.0, 1.0)).to_pyvista(0), "modes of matrices have"),
        (lambda m: sample(BLOCK, {}), "give what `prepare` returns"),
        (lambda m: sweep(BLOCK, FRICTION, []), "values = []; give a list of numbers"),
        (lambda m: prepare({"stages": []}), "scene (mapping): stages: 'equilibrium' is missing"),
        (lambda m: prepare({"stages": None}), "(mapping): stages: an object of the type NoneType"),
        (lambda m: prepare({"samples": {"n": I}}), "scene (mapping): samples.n"),
        (lambda m: prepare(3), "scene: an object of the type int; give the path of a scene, or"),
        (lambda m: m.modes({PRESSURE: "5 mm"}), f"{PRESSURE} = '5 mm': wrong unit; a pressure"),
        (lambda m: prepare(BLOCK, ROUGH, parameters={FRICTION: 0.3}), "give a list of numbers"),
        (lambda m: complex_modes(I, None, I, 18e3), "band = 18000.0; give a list of numbers"),
        (lambda m: complex_modes(I, None, I, (2.0, 1.0)), "band 2 to 1 Hz: from at least 0"),
        (lambda m: complex_modes("M", None, I, (0.0, 1.0)), "matrix: an object of the type str"),
        (lambda m: contact_law(np.zeros((8, 8)), 1e9), "surface: an object of the type ndarray"),
        (lambda m: rubbed(0.3), "Coefficient.coefficient returns 0.3; return mu and its slope"),
        (lambda m: rubbed((np.nan, 0.0)), "coefficient returns (nan, 0.0); return mu"),
        (
            lambda m: prepare(BLOCK, ROUGH, extensions=Extensions(damping=[I])),
            "extensions: an object of the type ndarray has no method 'matrix'",
        ),
    ],
)  # fmt: skip
def test_mistakes_are_one_line_that_names_argument_and_remedy(model, call, said):
    with pytest.raises(BrakeError, match=re.escape(said)):
        call(model)


def test_objects_print_as_one_line(model):
    """Not as the arrays in them."""
    surface = make_topography(np.random.default_rng(1).normal(0, 1e-6, (32, 32)), (1e-3, 1e-3))
    assert repr(surface) == "Topography(array: 32 x 32 points, 1 x 1 mm)"
    library = make_library([law_steps(surface, LawSettings(1e9, steps=5))])
    assert repr(library) == f"LawLibrary(1 laws up to {library.p.max():.4g} Pa)"
    assert f"{library.p.max() / 1e6:.5g}</td>" in library._repr_html_()
    assert "<td>S_q [um]</td><td>" in surface._repr_html_()
    assert re.fullmatch(r"Brake\(\d+ dofs, \d+ contact elements\)", repr(model.study.brake))


def test_a_prepared_scene_keeps_the_ranges_of_its_sweep():
    """Ranges given to ``prepare`` come beside those of the scene."""
    swept = f"sweep.parameters={{ '{FRICTION}' = {{ values = [0.1, 0.3] }} }}"
    changes = [*ROUGH, swept, "samples.n=1"]
    found = prepare(BLOCK, changes, parameters={PRESSURE: ["1 bar", "2 bar"]})
    assert {*found.scene.sweep.parameters} == {FRICTION, PRESSURE}
    assert len(found.modes({FRICTION: 0.2, PRESSURE: "1.5 bar"})) > 0


@pytest.mark.long
def test_modes_and_branches_in_a_notebook(model):
    """Tables of every object; data frames and figures of modes and of branches, in own axes."""
    modes = model.modes()
    table = modes.to_pandas()
    assert {*table} < {*MODES} and list(table.frequency_hz) == list(modes.frequency)
    assert modes._repr_html_().count("<tr>") == min(len(modes), 30) + 1
    assert "<td>threshold</td><td>0.001</td>" in model._repr_html_()
    found = model.sweep(FRICTION, [0.0, 0.4, 0.8])
    assert found._repr_html_().count("<tr>") == min(len(found.events), 30) + 1
    axes = found.plot()
    assert [len(a.get_lines()) for a in axes] == [len(found.frequency), len(found.frequency) + 1]
    assert axes[1].get_xlabel() == f"{FRICTION} [-]" and len(axes[1].get_legend().get_texts()) > 0
    assert found.plot(ax=axes) is axes
    with pytest.raises(BrakeError, match=r"ax has 1 axes, and 2 are drawn; give plt.subplots\(2\)"):
        found.plot(ax=axes[0])
    rows = found.to_pandas()
    assert len(rows) == np.isfinite(found.frequency).sum()
    one = rows[rows.branch == rows.branch[0]]
    row = found.frequency[rows.branch[0]]
    np.testing.assert_array_equal(one.frequency_hz, row[np.isfinite(row)])
    _, ax = plt.subplots()
    assert modes.plot(ax=ax) is ax and ax.get_xlabel() == "frequency [kHz]"
    drawn = sum(len(line.get_xdata()) for line in ax.get_lines()[:2])
    assert drawn == len(modes) and ax is not modes.plot()
    plt.close("all")


def test_the_shape_of_a_mode_on_the_mesh(model):
    """By the reduced model that of full order; components stay where they are."""
    whole = prepare(BLOCK, [*ROUGH, "stability.method=full"]).modes()
    modes = model.modes()
    for i in (0, 3):
        shapes = []
        for of, j in ((modes, i), (whole, int(np.argmin(np.abs(whole.s - modes.s[i]))))):
            grid = of.to_pyvista(j)
            shapes.append((grid["re"] + 1j * grid["im"]).reshape(-1, 1))
            assert np.linalg.norm(grid["re"] + 1j * grid["im"], axis=1).max() == pytest.approx(1)
        assert grid.n_points == whole.on_mesh(j)[1].size // 3 and grid.n_cells > 0
        assert mac(*shapes)[0, 0] > 1 - 1e-6
    sent = pickle.loads(pickle.dumps(modes))
    assert sent.on_mesh is None and sent.to_pandas().equals(modes.to_pandas())
    V = model.study.brake.elastic.free.V
    u = np.tile([0.0, 3e-6j, 4e-6], V.dofmap.index_map.size_local)
    grid = mesh_grid(V, u)
    for name, vector in (("re", [0, 0, 0.8]), ("im", [0, 0.6, 0])):
        np.testing.assert_allclose(grid[name], [vector] * grid.n_points, rtol=1e-12)


def test_tables_of_a_run_are_data_frames(tmp_path):
    from mpi4py import MPI

    brake_fenicsx.run(BLOCK, MPI.COMM_SELF, tmp_path / "out", [*ROUGH, "samples.n=2"])
    run = read_run(tmp_path / "out")
    table = run.to_pandas()
    assert {*table} >= {"approach", "frequency_hz"} and {*table["sample"]} == {0, 1}
    np.testing.assert_array_equal(table.frequency_hz, run.modes["frequency_hz"])
    assert len(run.to_pandas("samples")) == 2 and len(run.to_pandas("probabilities")) > 0
    with pytest.raises(BrakeError, match="no table 'mode'; did you mean 'modes'"):
        run.to_pandas("mode")


def test_a_text_of_a_table_is_escaped():
    assert html_table("<b>", ["a"], [["<i>"], [0.123456789]]) == (
        "<p>&lt;b&gt;</p><table><tr><th>a</th></tr><tr><td>&lt;i&gt;</td></tr>"
        "<tr><td>0.12346</td></tr></table>"
    )
    assert html_table("", [""], [[1]] * 33).endswith("</table><p>and 3 more</p>")


def test_values_with_their_units(model):
    here, si = (model.modes({PRESSURE: p}).s for p in ("5 bar", 5e5))
    np.testing.assert_array_equal(here, si)
    assert model.sweep(PRESSURE, ["2 bar", 5e5]).values.tolist() == [2e5, 5e5]
    table = tomllib.loads(BLOCK.read_text())
    for part in table["parts"].values():
        part["size"] = "20 mm"
    table["stability"]["band"] = ["0 Hz", "15 kHz"]
    found = sweep(table, PRESSURE, ["0.2 MPa", "5 bar"])
    assert found.values.tolist() == [2e5, 5e5]


def test_critical_gaps_of_a_sample_are_drawn_once_for_all_values_of_friction(model):
    draw = model.study.sample
    first, second = (draw(("multi-scale", 1), {FRICTION: mu}).laws for mu in (0.3, 0.4))
    assert second is first and np.ptp(first.g_cr) > 0
    draw(("multi-scale", 2))
    again = draw(("multi-scale", 1)).laws
    assert again is not first
    np.testing.assert_array_equal(again.g_cr, first.g_cr)


@pytest.mark.long
def test_a_scene_as_a_mapping_is_the_scene_of_its_file(model, tmp_path):
    """With arrays, tuples and paths as values; its folder holds a scene of the same text."""
    table = tomllib.loads(BLOCK.read_text())
    table["stability"]["band"] = tuple(table["stability"]["band"])
    table["samples"] = {**table.get("samples", {}), "n": np.int64(3)}
    own = prepare(table, ROUGH, tmp_path / "out")
    np.testing.assert_array_equal(own.modes().s, model.modes().s)
    again = prepare(tmp_path / "out" / "scene.toml", directory=tmp_path / "out")
    np.testing.assert_array_equal(again.modes().s, model.modes().s)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        (record,) = own.samples(1, executor=pool)
    np.testing.assert_array_equal(record["s"], model.modes().s)


def test_ctrl_c_while_the_command_is_imported_is_one_line():
    """Interrupted at its first import, the status is 130 as it is later."""
    script = (
        "import builtins\nold = builtins.__import__\n"
        "def stop(name, *rest):\n    if name == 'argparse': raise KeyboardInterrupt\n"
        "    return old(name, *rest)\n"
        "builtins.__import__ = stop\nimport brake_fenicsx.cli\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stderr == "brake-fenicsx: interrupted; the same command resumes the run\n"


def test_a_named_error_is_one_line():
    """Whatever its text: no other test looks for the end of a line in a message."""
    assert str(BrakeError("one\n    line")) == "one line"
