"""What a user of Python meets: names and types of the package, and one line for each mistake."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import brake_fenicsx
from brake_fenicsx import prepare, sample, sweep
from brake_fenicsx.errors import BrakeError
from brake_fenicsx.extensions import Extensions
from brake_fenicsx.micro import LawSettings, contact_law, law_steps, make_library
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.surface import make_topography
from coarse_block import BLOCK, FRICTION, ROUGH

ROOT = Path(__file__).parents[1]
I = np.eye(3)


def test_names_of_the_package():
    """Completion of a shell lists the functions and nothing that helps to import them."""
    names = [name for name in dir(brake_fenicsx) if not name.startswith("_")]
    assert {*brake_fenicsx.__all__} <= {*names}
    assert not {"Any", "import_module", "TYPE_CHECKING"} & {*names}


def test_a_type_checker_sees_the_types_of_the_package(tmp_path):
    """In another folder, without MYPYPATH: what an editor sees too."""
    script = tmp_path / "script.py"
    script.write_text(
        "from brake_fenicsx import prepare\n"
        "model = prepare('scene.toml')\nreveal_type(model)\nreveal_type(model.sweep('a', [1.0]))\n"
        "prepare(3)\n"
    )
    # Of the package alone what the script names: the whole is checked beside the tests.
    (tmp_path / "mypy.ini").write_text(
        "[mypy]\nignore_missing_imports = true\nfollow_imports = skip\n"
        "[mypy-brake_fenicsx,brake_fenicsx.model]\nfollow_imports = silent\n"
    )
    command = [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"), str(script)]
    said = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path
    ).stdout  # fmt: skip
    assert 'note: Revealed type is "brake_fenicsx.model.Model"' in said, said
    assert 'note: Revealed type is "brake_fenicsx.model.Branches"' in said
    assert 'Argument 1 to "prepare" has incompatible type "int"' in said


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
        (lambda m: m.sweep(FRICTION, ["1 bar", "2 bar"]), "values = '1 bar'; give one finite"),
        (lambda m: m.sweep(FRICTION, [0.1, np.nan]), "values = nan; give one finite number"),
        (lambda m: m.modes([FRICTION, 0.3]), "values: an object of the type list; give a mapping"),
        (lambda m: m.modes({FRICTION: "0.3"}), f"{FRICTION} = '0.3'; give one finite number"),
        (lambda m: m.modes(sample=0.5), "sample 0.5 of"),
        (lambda m: sample(BLOCK, {}), "give what `prepare` returns"),
        (lambda m: sweep(BLOCK, FRICTION, []), "values = []; give a list of numbers"),
        (lambda m: prepare({"stages": []}), "scene: an object of the type dict; give the path"),
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
    with pytest.raises(BrakeError) as error:
        call(model)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_objects_print_as_one_line(model):
    """Not as the arrays in them."""
    surface = make_topography(np.random.default_rng(1).normal(0, 1e-6, (32, 32)), (1e-3, 1e-3))
    assert repr(surface) == "Topography(array: 32 x 32 points, 1 x 1 mm)"
    library = make_library([law_steps(surface, LawSettings(1e9, steps=5))])
    assert repr(library) == f"LawLibrary(1 laws up to {library.p.max():.4g} Pa)"
    assert re.fullmatch(r"Brake\(\d+ dofs, \d+ contact elements\)", repr(model.study.brake))


def test_arrays_serve_as_matrices():
    np.testing.assert_allclose(complex_modes(I, None, 4 * I, (0.0, 1.0)).s, [2j] * 3)


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
