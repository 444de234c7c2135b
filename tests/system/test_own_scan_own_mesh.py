"""docs/own_scan_own_mesh.md as a reader follows it: its files are written, its commands run."""

import re
import subprocess
import sys

import h5py
import numpy as np
import pytest

from brake_fenicsx.results.run import read_run
from places import ROOT

# Four runs: minutes.
pytestmark = pytest.mark.slow

PAGE = ROOT / "docs" / "own_scan_own_mesh.md"
BLOCK = re.compile(r"^```(sh|toml|python)\n(.*?)^```$", re.M | re.S)


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """Folder in which the page was followed, and what each command printed.

    In a reader's shell: nothing is set but what a login sets. The checkout is one of links, so that
    the study does not lie in the real one.
    """
    checkout = tmp_path_factory.mktemp("checkout")
    for path in ROOT.iterdir():
        if path.name != ".venv":
            (checkout / path.name).symlink_to(path)
    (checkout / ".venv").symlink_to(sys.prefix)
    environment = {"HOME": str(checkout), "PATH": "/usr/local/bin:/usr/bin:/bin", "LANG": "C.UTF-8"}
    printed, state, study = {}, "", checkout / "my_study"
    for kind, text in BLOCK.findall(PAGE.read_text()):
        if kind != "sh":
            name = re.match(r"# (\S+)\n", text)[1]
            (study / name).write_text(text)
            continue
        for line in text.splitlines():
            done = subprocess.run(
                ["bash", "-c", state + line], cwd=checkout, env=environment, capture_output=True,
                text=True,
            )  # fmt: skip
            assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
            printed[line] = done.stdout + done.stderr
            if line.startswith((". ", "cd ")):
                state += line + "\n"
    return study, printed


def test_the_scan_is_read_as_the_page_says(followed):
    surface = read_run(followed[0] / "scan-results").surface
    assert surface["size"] == pytest.approx([1.8e-3, 1.4e-3])
    assert np.nanstd(surface["heights"]) == pytest.approx(33.1e-6, rel=0.05)


def test_the_commands_say_what_the_page_promises(followed):
    """A wrong unit and a wrong group are named; what is built; samples that were there."""
    folder, printed = followed
    for command, said in (("mesh.unit=m", "mesh.unit"), ("groups.ROTOR", "ROTOR")):
        assert said in printed[next(line for line in printed if command in line)]
    built = r"(\d+) cells, (\d+) free dofs, (\d+) contact"
    said = re.search(built, printed["brake-fenicsx check my_brake.toml"])
    facts = read_run(folder / "my_brake-results").summary
    wanted = [facts[name] for name in ("cells", "dofs", "contact_elements")]
    assert [int(n) for n in said.groups()] == wanted
    more = printed["brake-fenicsx run my_brake.toml --set samples.n=6"]
    assert "of 7 samples were there already" in more and "dofs" in printed["python my_brake.py"]


def test_the_brake_is_pressed_and_drawn(followed):
    run = read_run(followed[0] / "my_brake-results")
    assert np.sum(run.samples["approach"] == "multi-scale") == 6
    own = run.contact["approach"] == "classical"
    force = np.sum(run.contact["p"][own] * run.contact["area"][own])
    # 2 bar on both back plates of 80 x 45 mm.
    assert force == pytest.approx(2 * 2e5 * 80e-3 * 45e-3, rel=1e-6)
    assert (followed[0] / "my_brake-results" / "report.html").stat().st_size > 500_000


def test_every_element_lies_on_a_facet_of_its_own(followed):
    """Facets drawn and written for ParaView: each with the element whose area it covers."""
    folder, _ = followed
    run = read_run(folder / "my_brake-results")
    corners, facet = run.faces["corners"], run.faces["facet"]
    assert np.unique(facet).size == facet.size
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)[facet]
    own = run.contact["approach"] == "classical"
    # The rim cuts the pads' outer corners off; all other facets are covered whole.
    w = run.contact["area"][own]
    assert np.all(w <= area * (1 + 1e-9))
    assert np.median(w / area) == pytest.approx(1.0, rel=1e-9)
    with h5py.File(folder / "my_brake-results/fields/pressure_classical.vtkhdf") as fields:
        assert {"p", "g", "g_cr", "k", "active"} <= {*fields["VTKHDF/CellData"]}


def test_a_worn_lining_is_a_random_input(followed):
    run = read_run(followed[0] / "worn")
    rough = run.samples["approach"] == "multi-scale"
    lengths = np.array(run.samples["parts.pad.morph.wear.value"][rough], float)
    assert {*run.samples["status"]} == {"ok"}
    assert np.all((lengths > 6e-3) & (lengths < 10e-3)) and np.ptp(lengths) > 1e-4


def test_another_friction_is_another_folder(followed):
    """The classical approach has it too."""
    assert read_run(followed[0] / "trial").samples["mu"] == pytest.approx(0.3)
