"""Modes of states: those of the scene that has their values, mirrored, stored in a run."""

import re
import signal
import subprocess
import time

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare, run
from brake_fenicsx.cli import main
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import result_digest
from coarse_block import BLOCK, FRICTION, ROUGH
from processes import command
from run_tables import read_rows

pytestmark = pytest.mark.long

E3 = "materials.lining.C33"
MATRIX = """\
pressure [bar],temperature [degC],direction,section,stops
5,20,forward,bedding,4
8,20,forward,main,10
8,120,forward,main,10
8,120,reverse,main,10
"""
MU = f"pressure [bar],temperature [degC],{FRICTION}\n5,20,0.6\n5,120,0.4\n8,20,0.7\n8,120,0.65\n"
LINING = f"temperature [degC],{E3} [GPa]\n20,2.27\n120,2.0\n"
EVENTS = "state,stop,frequency [kHz],level\n" + "".join(
    f"{state},{stop},{f},{level}\n"
    for state, stop, f, level in [
        (2, 1, 14.7, 80),
        (2, 2, 14.7, 85),
        (2, 2, 9.0, 70),
        (3, 1, 14.6, 75),
    ]
)
LOAD = 'loads."block.top".pressure'


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("states")
    files = {"matrix": MATRIX, "mu": MU, "lining": LINING, "events": EVENTS}
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text)
    text = re.sub(r"^(band = .*)", r"\1\nthreshold = 0", BLOCK.read_text(), flags=re.M)
    (folder / "block.toml").write_text(text)
    return folder / "block.toml"


GIVEN = [
    *ROUGH,
    "states={ matrix='matrix.csv', tables=['mu.csv', 'lining.csv'],"
    " gap={ block_plate='0.01 um * x / (20 mm)' }, events='events.csv', tolerance='400 Hz' }",
]


@pytest.fixture(scope="module")
def model(scene):
    return prepare(scene, GIVEN)


def in_state(model, i, k=0, gap=True):
    work = model.study.beside["states of the brake"]
    kept, work._gaps = work._gaps, work._gaps if gap else [0.0] * 4
    found = work.modes(model.study.sample(("multi-scale", k)), i)
    work._gaps = kept
    return found


def grown(modes):
    return modes.s[np.array(modes.verdict, str) == "unstable"]


THIRD = {LOAD: 8e5, FRICTION: 0.65, E3: 2.0e9}  # what the third state changes


def test_a_state_is_the_scene_that_has_its_values(model):
    _, modes = in_state(model, 2, k=1, gap=False)
    same = grown(model.modes(THIRD, sample=1))
    assert same.size
    np.testing.assert_allclose(grown(modes), same, rtol=1e-9, atol=1e-9 * abs(same).max())


def test_reverse_is_the_scene_that_slides_the_other_way(model):
    """With the same roughness."""
    other = prepare(model.scene.file, [*GIVEN, "motion.direction=[-1, 0, 0]"])
    same, forward = grown(other.modes(THIRD, sample=1)), in_state(model, 2, k=1, gap=False)[1]
    reverse = grown(in_state(model, 3, k=1, gap=False)[1])
    size = abs(same).max()
    np.testing.assert_allclose(reverse, same, rtol=1e-9, atol=1e-9 * size)
    assert reverse.size != grown(forward).size or abs(reverse - grown(forward)).max() > 1e-6 * size


def test_reverse_mirrors_a_brake_that_is_its_own_mirror_image(scene):
    """Cells are symmetric about the plane across sliding, and no element has a gap of its own."""
    even = [*ROUGH[:2], *ROUGH[3:], "mesh.cells=hexahedra", f"{FRICTION}=0.6"]
    even += ["states={ grid={ direction=['forward','reverse'] } }"]
    model = prepare(scene, even)
    (eq, forward), (back, reverse) = (in_state(model, i, gap=False) for i in range(2))
    assert grown(forward).size
    np.testing.assert_allclose(grown(reverse), grown(forward), rtol=1e-8)
    # The mirrored pressures are others, those of the same elements are not.
    x = model.study.brake.contact.points
    mirror = abs(x[:, None] * [-1, 1, 1] - x).sum(axis=2).argmin(axis=1)
    np.testing.assert_allclose(back.p[mirror], eq.p, rtol=1e-6)
    assert abs(back.p - eq.p).max() > 0.01 * eq.p.max()
    # Mirrored modes are of the same families.
    found = model.study.work(("multi-scale", 0))
    one, two = (np.sort(found["state_mode"][found["state_of"] == i]) for i in (1, 2))
    assert one.tolist() == two.tolist() and one[0] >= 0


def test_a_block_turns_by_the_taper_of_its_gap(model):
    """Force and moments fix the pressures of a block that can turn: only its gaps change."""
    tapered, plain = (in_state(model, 1, gap=gap)[0] for gap in (True, False))
    taper = 1e-8 * model.study.brake.contact.points[:, 0] / 0.02
    np.testing.assert_allclose(tapered.p, plain.p, rtol=1e-6)
    np.testing.assert_allclose(tapered.g - plain.g, -taper, atol=1e-6 * abs(taper).max())


STAGES = "stages=['surface','equilibrium','stability','uncertainty'{}]"
REPORT = STAGES.format(",'report'")
FIGURES = ("states", "states_roc")


@pytest.fixture(scope="module")
def folder(scene, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "out"
    run(scene, MPI.COMM_SELF, out, [*GIVEN, REPORT])
    return out


def test_tables_of_a_run_agree_with_one_another(folder, model):
    rows = read_rows(folder / "states.csv")
    states = [row for row in rows if row["family"] == "all"]
    assert [(row["samples"], row["failed"]) for row in states] == [(3, 0)] * 4
    for i, row in enumerate(states):
        grown = [
            (modes.damping < -1e-3) & (np.array(modes.verdict, str) == "unstable")
            for modes in (in_state(model, i, k)[1] for k in range(3))
        ]
        assert row["squeal_samples"] == sum(map(np.any, grown))
        own = [r for r in rows if r["state"] == row["state"] and r is not row]
        assert row["squeal_samples"] <= sum(r["squeal_samples"] for r in own)
        assert row["measured_stops"] <= sum(r["measured_stops"] for r in own)
    assert sum(row["squeal_samples"] for row in states) > 0
    whole = read_rows(folder / "states_occurrence.csv")[0]
    share = np.array([row["share"] for row in states]) @ [4, 10, 10, 10] / 34
    assert whole["predicted_percent"] == pytest.approx(100 * share)
    assert whole["measured_percent"] == pytest.approx(100 * 3 / 34)  # two events are of one stop
    every = read_rows(folder / "states_scores.csv")[0]
    assert every["events"] == 3 and every["hits"] + every["misses"] == 3
    page = (folder / "report.html").read_text()
    assert "Squeal is likeliest at" in page and "stops measured" in page
    assert all((folder / "figures" / f"{n}.png").stat().st_size > 2000 for n in FIGURES)


def test_the_best_threshold_is_written_back_and_needs_no_new_samples(folder, scene, capsys):
    text = scene.read_text()
    assert main(["threshold", str(folder), "--write", str(scene)]) == 0
    value = float(capsys.readouterr().out.split()[1])
    assert read_scene(scene).stability.threshold == pytest.approx(value, rel=1e-3)
    scene.write_text(text)
    one, two = (read_scene(scene, [*GIVEN, f"stability.threshold={x}"]) for x in (0, value))
    assert result_digest(one) == result_digest(two)


def same_tables(one, two):
    for name in ("states", "states_occurrence", "states_events", "states_scores"):
        rows = zip(read_rows(one / f"{name}.csv"), read_rows(two / f"{name}.csv"), strict=True)
        for a, b in rows:
            assert a == pytest.approx(b, rel=1e-8), name


def test_a_killed_run_goes_on_by_shares_to_the_same_tables(scene, folder, tmp_path):
    out, given = tmp_path / "out", [*GIVEN, STAGES.format("")]
    words = command(scene, out, given)
    going = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    while going.poll() is None and not [*out.glob("samples/multi-scale*")]:
        time.sleep(0.05)
    going.send_signal(signal.SIGKILL)
    going.wait()
    assert not (out / "states.csv").exists()
    for more in (["--share", "2/2"], []):
        subprocess.run([*words, *more], check=True, capture_output=True)
    same_tables(out, folder)


@pytest.mark.together
def test_two_processes_give_the_tables_of_one(scene, processes, tmp_path):
    comm, shared = processes
    scene, given = comm.bcast(scene), [*GIVEN, STAGES.format("")]
    run(scene, MPI.COMM_SELF, tmp_path / "one", given)
    run(scene, comm, shared / "two", given)
    comm.Barrier()
    same_tables(tmp_path / "one", shared / "two")


def test_other_events_and_thresholds_need_no_new_samples_and_other_states_do(folder, scene, capsys):
    """Both are read after the samples; a changed matrix is another scene."""
    changed = *GIVEN[:-1], GIVEN[-1].replace("400 Hz", "50 Hz"), "stability.threshold=0.5", REPORT
    words = ["run", str(scene), "-o", str(folder), "-q", "--no-pictures"]
    words += [word for text in changed for word in ("--set", text)]
    assert main(words) == 0
    assert {row["share"] for row in read_rows(folder / "states.csv")} == {0.0}
    matrix = scene.parent / "matrix.csv"
    matrix.write_text(MATRIX.replace("8,20", "7,20"))
    assert main(words) == 2
    assert "another scene" in capsys.readouterr().err
    matrix.write_text(MATRIX)


@pytest.mark.hard
def test_a_state_without_equilibrium_costs_itself(scene):
    """Far beyond tipping there is none: the state is named, the others have their modes."""
    (scene.parent / "mu.csv").write_text(MU.replace("8,120,0.65", "8,120,40"))
    found = prepare(scene, GIVEN).study.work(("multi-scale", 0))
    (scene.parent / "mu.csv").write_text(MU)
    lost = [bool(text) for text in found["state_outcome"]]
    assert lost[:3] == [False, False, True] and not np.isin(found["state_of"], [3]).any()
    assert "s" in found and not found.get("lost")
