"""Classes that a scene names in [extensions]: what may run, and where they act."""

import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import Extensions
from brake_fenicsx.pipeline import run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import bodies_key, result_digest
from coarse_block import BLOCK
from processes import parallel
from run_tables import read_columns
from test_extensions import MassDamping, Quadratic, Stribeck, Triangular
from test_registry import installed

FRICTION = "contact.block_plate.friction"
COARSE = [
    "stages=['equilibrium','stability','uncertainty']", "parts.block.size='14 mm'",
    "parts.plate.size='20 mm'", "stability.band=['0 Hz','20 kHz']", "stability.method=reduced",
    "samples.n=3",
]  # fmt: skip
RANDOM = f"samples.random.'{FRICTION}'={{ law = 'uniform', spread = 0.1 }}"
ALLOW = "extensions.allow=true"
HERE = "test_extensions"  # the module whose classes an installed package names
OWN = {
    "contact.block_plate": f"{{ use = '{HERE}:Quadratic', c = 1e19 }}",
    "friction.block_plate": f"{{ use = '{HERE}:Stribeck', low = 0.6, high = 0.3, V_s = 0.5 }}",
    "damping.mass": f"{{ use = '{HERE}:MassDamping', a = 40.0 }}",
    f"random.'{FRICTION}'": f"{{ use = '{HERE}:Triangular', share = 0.2 }}",
}
ROD = """
from dataclasses import dataclass, field
from brake_fenicsx.geometry.part import PartEntities, faces_where, flat_at

@dataclass(frozen=True)
class Rod:
    length: float = field(metadata={"unit": "m"})
    radius: float = field(metadata={"unit": "m"})
    size: float = field(metadata={"unit": "m"})

def build(occ, rod):
    body = [occ.addCylinder(0, 0, 0, 0, 0, rod.length, rod.radius)]
    occ.synchronize()
    ends = {"low": faces_where(body, flat_at(0.0)), "high": faces_where(body, flat_at(rod.length))}
    return PartEntities(volumes={"body": body}, faces=ends, sizes={"body": rod.size})
"""
LAW = """
from dataclasses import dataclass
import numpy as np

@dataclass(frozen=True)
class Quadratic:
    c: float
    first_touch: float = 0.0

    def pressure(self, d):
        return self.c * np.minimum(d, 0.0) ** 2

    def stiffness(self, d):
        return -2 * self.c * np.minimum(d, 0.0)

    vibration = stiffness

def draw(run):
    from matplotlib.figure import Figure
    figure = Figure()
    figure.subplots().plot(run.contact["p"], run.contact["k"], ".")
    return figure
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """An installed package that names the classes of ``test_extensions``."""
    names = ("Quadratic", "Stribeck", "MassDamping", "Triangular")
    points = (f"{name} = {HERE}:{name}" for name in names)
    installed(tmp_path / "site", "brake_fenicsx.extensions", *points)
    monkeypatch.syspath_prepend(tmp_path / "site")


@pytest.fixture
def beside(tmp_path):
    """A scene with code beside it: a contact law and a figure."""
    scene = tmp_path / "scene.toml"
    shutil.copy(BLOCK, scene)
    (tmp_path / "mine.py").write_text(LAW)
    law = "contact.block_plate = { use = 'mine:Quadratic', c = 1e19 }"
    scene.write_text(f"{BLOCK.read_text()}\n[extensions]\n{law}\nfigures.law = 'mine:draw'\n")
    return scene


@pytest.mark.long
@pytest.mark.parametrize(
    ("named", "given"),
    [
        ("contact.block_plate", Extensions(contact={"block_plate": Quadratic(1e19)})),
        ("friction.block_plate", Extensions(friction={"block_plate": Stribeck(0.6, 0.3, 0.5)})),
        ("damping.mass", Extensions(damping=[MassDamping(40.0)])),
        (f"random.'{FRICTION}'", Extensions(random={FRICTION: Triangular(0.2)})),
    ],
    ids=lambda x: x.partition(".")[0] if isinstance(x, str) else "",
)
def test_a_scene_and_python_name_the_same_objects(named, given, package):
    """Samples of classes of an installed package, without asking, and of the objects themselves."""
    more = COARSE if named.startswith("friction") else [*COARSE, RANDOM]
    by_scene = prepare(BLOCK, [*more, f"extensions.{named}={OWN[named]}"])
    by_object, plain = prepare(BLOCK, more, extensions=given), prepare(BLOCK, more)
    for k in (0,) if more is COARSE else (0, 2):
        found, same, without = (m.modes(sample=k).s for m in (by_scene, by_object, plain))
        np.testing.assert_allclose(found, same, rtol=1e-10)
        assert found.size != without.size or not np.allclose(found, without, rtol=1e-6)


def test_the_contact_law_of_a_run_is_that_beside_the_scene(beside, tmp_path):
    """p = c d^2 has the stiffness 2 sqrt(c p); its figure is on the page."""
    given = ["stages=['equilibrium','report']", *COARSE[1:3], "samples.n=1", ALLOW]
    run(beside, MPI.COMM_SELF, tmp_path / "out", given)
    contact = read_columns(tmp_path / "out" / "contact.csv")
    assert contact["p"].max() > 0
    np.testing.assert_allclose(contact["k"], 2 * np.sqrt(1e19 * contact["p"]), rtol=1e-6)
    assert (tmp_path / "out" / "figures" / "own_law.png").is_file()
    assert "Own figures" in (tmp_path / "out" / "report.html").read_text()
    # Another law with the same keys is another scene.
    (tmp_path / "mine.py").write_text(LAW.replace("-2 *", "-2.0 *"))
    with pytest.raises(SceneError, match="another scene"):
        run(beside, MPI.COMM_SELF, tmp_path / "out", given)


@pytest.mark.long
def test_shares_processes_and_workers_take_the_class(beside, tmp_path):
    changes = [w for text in [*COARSE, RANDOM] for w in ("--set", text)]

    def words(command, folder, *more):
        given = [command, beside, *changes, "--allow-extensions", "-o", tmp_path / folder, *more]
        return [str(word) for word in given]

    assert main(words("run", "one")) == 0
    assert main(words("prepare", "shares")) == 0
    for share in ("1/2", "2/2"):
        assert main(words("run", "shares", "--share", share)) == 0
    assert main(words("run", "shares")) == 0
    folders = ["shares"]
    if (mpirun := shutil.which("mpirun")) is not None:
        two = [mpirun, "-n", "2", "--oversubscribe", sys.executable, "-m", "brake_fenicsx"]
        subprocess.run([*two, *words("run", "two")], check=True, **parallel())
        folders.append("two")
    whole = read_columns(tmp_path / "one" / "modes.csv")
    assert {*whole["sample"]} == {0, 1, 2}
    for folder in folders:
        found = read_columns(tmp_path / folder / "modes.csv")
        np.testing.assert_allclose(found["frequency_hz"], whole["frequency_hz"], rtol=1e-9)
    model = prepare(beside, [*COARSE, RANDOM, ALLOW], tmp_path / "workers")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as workers:
        for record in model.samples(executor=workers):
            own = whole["sample"] == record["sample"]
            np.testing.assert_allclose(record["frequency"], whole["frequency_hz"][own], rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "mine.py is code beside the scene; read it, and give --allow-extensions to run it"),
        (["extensions.contact.block_plate='os:system'", ALLOW], "no installed package has it"),
        (["extensions.contact.block_plate='../mine:Quadratic'", ALLOW], "no installed package"),
        (["extensions.contact.block_plate='mine:Cubic'", ALLOW], "no attribute 'Cubic'"),
        (["extensions.contact.block_plate='mine:Quadratic'", ALLOW], "missing 1 required .* 'c'"),
        (["extensions.contact.pad='mine:draw'", ALLOW], r"pad = 'mine:draw': .*'run'"),
        (["extensions.contact={}", "extensions.damping={ a='mine:Quadratic' }", ALLOW], "'c'"),
        (
            [
                "extensions.contact={}", ALLOW,
                "extensions.friction.block_plate={ use='mine:Quadratic', c=1 }",
            ],
            "has no method 'coefficient'",
        ),
        (["extensions.law.pad='mine:Quadratic'", ALLOW], r"extensions\.law = .*unknown key"),
    ],
)  # fmt: skip
def test_what_may_not_run_is_refused_in_one_line(given, said, beside):
    with pytest.raises(SceneError, match=said):
        read_scene(beside, given)


def test_no_scene_allows_its_own_code(beside, capsys):
    beside.write_text(beside.read_text() + "allow = true\n")
    with pytest.raises(SceneError, match=r"extensions\.allow: no scene allows its own code"):
        read_scene(beside)
    assert main(["check", str(beside)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_module_of_a_scene_runs_in_no_other_command(beside):
    """Reading the scene without leave leaves its code alone."""
    (beside.parent / "mine.py").write_text("raise SystemExit('was run')")
    with pytest.raises(SceneError, match="is code beside the scene"):
        read_scene(beside)
    with pytest.raises(SystemExit, match="was run"):
        read_scene(beside, [ALLOW])


def test_a_part_of_ones_own_in_a_scene(tmp_path):
    """The first mode of a rod that is clamped at one end, as Euler and Bernoulli have it."""
    (tmp_path / "rods.py").write_text(ROD)
    scene = tmp_path / "rod.toml"
    text = """
        stages = []
        extensions.builders.rod = "rods:Rod"
        parts.rod = { builder = "rod", length = "60 mm", radius = "8 mm", size = "4 mm", material = "steel" }
        materials.steel = { model = "isotropic", E = "207 GPa", nu = 0.28, rho = "7820 kg/m^3" }
        supports = { "rod.low" = "clamped" }
    """  # noqa: E501
    scene.write_text(text)
    from brake_fenicsx.extras.measured.part_modes import part_modes

    read = read_scene(scene, [ALLOW])
    first = part_modes(read, "rod", np.zeros((1, 3)), 10e3, True).frequency[0]
    beam = 1.8751**2 / (2 * np.pi) * np.sqrt(207e9 / 7820.0) * 8e-3 / 2 / 60e-3**2
    assert first == pytest.approx(beam, rel=0.06)
    other = replace(read, own=replace(read.own, marks={}))
    assert result_digest(read) != result_digest(other) and bodies_key(read) != bodies_key(other)
    with pytest.raises(SceneError, match=r"parts\.rod\.builder = 'rod': use one of disc"):
        read_scene(scene, ["extensions={}"])
