"""Results do not depend on the account: option files, variables and locale of its user."""

import json
import os
import subprocess
import sys

import pytest

from brake_fenicsx.errors import BrakeError
from brake_fenicsx.extras.variants.comparison import comparison_text
from brake_fenicsx.libraries import beside_dolfinx, differences, kernels_in_use
from coarse_block import SCENES

COARSE = (
    "contact.block_plate.friction=0.55", "parts.block.size=14 mm", "parts.plate.size=20 mm",
    "stability.band=['0 Hz','16 kHz']",
)  # fmt: skip
PROGRAM = (sys.executable, "-m", "brake_fenicsx.cli")
# File in the home folder or the working directory -> what stands in it.
GMSH = "Mesh.MeshSizeFactor = 2; Mesh.RandomSeed = 9; Mesh.Algorithm = 1; General.NumThreads = 2;\n"
PETSC = "-hostile 1\n-brake_compliance_ksp_type none\n-eps_tol 1\n-st_pc_type none\n"
FFCX = json.dumps({"table_atol": 0.3, "table_rtol": 0.3, "epsilon": 0.3})
JIT = json.dumps({"cffi_extra_compile_args": ["-Ofast"], "timeout": 1})
FILES = {
    ".gmshrc": GMSH, ".gmsh-options": GMSH, ".petscrc": PETSC, "petscrc": PETSC,
    "matplotlibrc": "lines.linewidth: 9\nfigure.facecolor: red\nsavefig.dpi: 33\naxes.grid: True\n",
} | {
    f"{folder}{program}_{name}.json": text
    for name in ("options", "parameters")  # DOLFINx 0.6 and later, and 0.5
    for program, place, text in (("ffcx", "ffcx", FFCX), ("dolfinx_jit", "dolfinx", JIT))
    for folder in ("", f".config/{place}/")
}  # fmt: skip


@pytest.fixture(scope="module")
def accounts(tmp_path_factory):
    """Two accounts: home folder, which is the working directory, and environment of each.

    They share compiled forms: with other options for the compiler a form has another name.
    """
    found, cache = {}, os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    for name in ("plain", "hostile"):
        home = tmp_path_factory.mktemp(name)
        own = {"HOME": str(home), "XDG_CACHE_HOME": cache, "OPENBLAS_NUM_THREADS": "1"}
        found[name] = home, os.environ | own
    home, environment = found["hostile"]
    environment.pop("XDG_CONFIG_HOME", None)
    for name, text in FILES.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text)
    environment |= {
        "MATPLOTLIBRC": str(home), "SEED": "77", "LC_ALL": "C", "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "PYTHONHASHSEED": "5",
        "PETSC_OPTIONS": "-hostile 2 -brake_compliance_ksp_type none", "GMSH_HOME": str(home),
    }  # fmt: skip
    return found


def called(account, *words, **more):
    home, environment = account
    return subprocess.run(
        words, cwd=home, env=environment | more, capture_output=True, text=True, check=True
    )


@pytest.mark.hard
@pytest.mark.slow
def test_the_mesh_of_the_demo_is_the_same_in_every_account(accounts):
    """~/.gmshrc with a size factor of 2 and two threads: the same mesh, node by node."""
    words, found = ["check", str(SCENES / "disc_brake_demo.toml"), "--json", "-q"], set()
    for size in ("parts.disc.size=36 mm", "parts.pad.size=16 mm", "parts.pad.plate_size=24 mm"):
        words += ["--set", size]
    for name, threads in (("plain", "1"), ("hostile", "2")):
        done = called(accounts[name], *PROGRAM, *words, OMP_NUM_THREADS=threads)
        found.add(json.loads(done.stdout)["mesh_sha256"])
    assert len(found) == 1 and len(found.pop()) == 64


@pytest.mark.hard
@pytest.mark.slow
def test_a_run_is_the_same_in_every_account(accounts):
    """Options of gmsh, PETSc, DOLFINx, FFCx and matplotlib, seed and locale change no byte."""
    words = ["run", str(SCENES / "squealing_block.toml"), "-o", "out"]
    for text in ("samples.n=2", "countermeasures=[]", *COARSE):
        words += ["--set", text]
    for account in accounts.values():
        said = called(account, *PROGRAM, *words).stderr
        assert ("PETSC_OPTIONS" in said) == (account is accounts["hostile"])
    one, two = (home / "out" for home, _ in accounts.values())
    names = sorted(
        str(p.relative_to(one)) for kind in ("csv", "png", "svg") for p in one.rglob(f"*.{kind}")
    )
    assert len(names) > 20
    timed = {"tables/speed_and_error.csv", "tables/stages.csv"}
    differ = {n for n in names if (one / n).read_bytes() != (two / n).read_bytes()}
    assert differ <= timed, differ
    assert "differ" not in comparison_text(one, two)
    summary = json.loads((two / "summary.json").read_text())
    assert summary["versions"]["kernels"] and summary["mesh_sha256"]
    # Another kernel, as another machine takes: named by the comparison and by the next run.
    summary["versions"]["kernels"] = "OpenBLAS 0 Z80"
    (two / "summary.json").write_text(json.dumps(summary))
    text = f"kernels: {json.loads((one / 'summary.json').read_text())['versions']['kernels']} and"
    assert f"{text} OpenBLAS 0 Z80" in comparison_text(one, two)
    assert "kernels: OpenBLAS 0 Z80 and" in called(accounts["hostile"], *PROGRAM, *words).stderr


def test_options_of_petsc_are_those_of_the_command_line(accounts):
    """Neither ~/.petscrc, nor that of the working directory, nor PETSC_OPTIONS; the words given."""
    code = (
        "from brake_fenicsx.libraries import start_petsc\nstart_petsc(['-wanted', '3'])\n"
        "import brake_fenicsx.compat\nfrom petsc4py import PETSc\no = PETSc.Options()\n"
        "print(o.hasName('hostile'), o.getString('wanted'))"
    )
    assert called(accounts["hostile"], sys.executable, "-c", code).stdout == "False 3\n"
    lazy = "import brake_fenicsx.compat\n" + code.partition("\n")[2].partition("\n")[2]
    lazy = lazy.replace("o.getString('wanted')", "o.hasName('wanted')")
    assert called(accounts["hostile"], sys.executable, "-c", lazy).stdout == "False False\n"


def test_a_library_of_another_numpy_is_named():
    """petsc4py 3.18.5 of Debian 12 with the wheel of NumPy 2.4.6: "dtype size changed"."""
    said = r"petsc4py does not load with .*numpy.* \(size changed\)"
    with pytest.raises(BrakeError, match=said), beside_dolfinx("petsc4py"):
        raise ValueError("size changed")


def test_forms_are_compiled_as_the_program_says(accounts):
    """Option files of DOLFINx and FFCx: neither of the account nor of the working directory."""
    code = (
        "import json\nimport {0}dolfinx.jit as jit, ffcx\n"
        "get = lambda m: getattr(m, 'get_options', None) or m.get_parameters\n"
        "print(json.dumps([get(jit)(), get(ffcx)()], default=str))"
    )
    found = {}
    for name in ("", "brake_fenicsx.compat, "):
        done = called(accounts["hostile"], sys.executable, "-c", code.format(name))
        found[name] = json.loads(done.stdout)
    (read, table), (own, own_table) = found.values()
    assert read["cffi_extra_compile_args"] == ["-Ofast"] and table["table_atol"] == 0.3
    assert own["cffi_extra_compile_args"] != ["-Ofast"] and own["timeout"] == 120
    assert own_table["table_atol"] == 1e-9 and own_table["epsilon"] == 1e-14


def test_kernels_are_those_that_run():
    """The release and the kernels, as OpenBLAS names them; by another variable, others."""
    assert kernels_in_use().startswith("OpenBLAS 0.")
    code = "import numpy\nfrom brake_fenicsx.libraries import kernels_in_use as k\nprint(k())"
    environment = os.environ | {"OPENBLAS_CORETYPE": "Prescott"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.endswith("Prescott\n")


def test_differences_of_runs_are_named():
    """Versions of both, and meshes of one scene; what one run did not use is no difference."""
    one = {"versions": {"numpy": "1", "gmsh": "4"}, "mesh_sha256": "a", "settings": {"parts": 1}}
    two = {"versions": {"numpy": "2"}, "mesh_sha256": "b", "settings": {"parts": 1}}
    assert differences(one, two) == ["numpy: 1 and 2", "other meshes of the same parts"]
    assert differences(one, {**two, "settings": {"parts": 2}}) == ["numpy: 1 and 2"]
    assert not differences(one, one) and not differences({}, one)
