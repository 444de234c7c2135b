"""Modes of states: those of the scene that has their values, mirrored, stored in a run."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import prepare, run
from brake_fenicsx.cli import main
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK, FRICTION, ROUGH
from run_tables import read_rows

E3 = "materials.lining.C33"
MATRIX = """\
pressure [bar],temperature [degC],direction,section,stops
5,20,forward,bedding,4
8,20,forward,main,10
8,120,forward,main,10
8,120,reverse,main,10
"""
MU = f"pressure [bar],temperature [degC],{FRICTION}\n5,20,0.6\n5,120,0.4\n8,20,0.7\n8,120,0.5\n"
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
    text = BLOCK.read_text().replace("[stability]", "[stability]\nthreshold = 0")
    (folder / "block.toml").write_text(text)
    return folder / "block.toml"


GIVEN = [
    *ROUGH,
    "states={ matrix='matrix.csv', tables=['mu.csv', 'lining.csv'],"
    " gap={ block_plate='1e-8 * (x / 0.02)' }, events='events.csv', tolerance='400 Hz' }",
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


@pytest.mark.parametrize(("i", "values"), [
    (0, {LOAD: 5e5, FRICTION: 0.6}), (2, {LOAD: 8e5, FRICTION: 0.5, E3: 2.0e9}),
])  # fmt: skip
def test_a_state_is_the_scene_that_has_its_values(i, values, model):
    _, modes = in_state(model, i, k=1, gap=False)
    same = model.modes(values, sample=1)
    np.testing.assert_allclose(modes.s, same.s, rtol=1e-9, atol=1e-9 * abs(same.s).max())


def test_reverse_is_the_scene_that_slides_the_other_way(model):
    """With the same roughness, exactly; no mesh is so symmetric that it could stand for this."""
    other = prepare(model.scene.file, [*GIVEN, "motion.direction=[-1, 0, 0]"])
    values = {LOAD: 8e5, FRICTION: 0.5, E3: 2.0e9}
    same, forward = other.modes(values, sample=1), in_state(model, 2, k=1, gap=False)[1]
    _, reverse = in_state(model, 3, k=1, gap=False)
    size = abs(same.s).max()
    np.testing.assert_allclose(reverse.s, same.s, rtol=1e-9, atol=1e-9 * size)
    assert abs(np.sort_complex(reverse.s) - np.sort_complex(forward.s)).max() > 1e-6 * size


def test_a_block_turns_by_the_taper_of_its_gap(model):
    """Force and moments fix the pressures of a block that can turn: only its gaps change."""
    tapered, plain = (in_state(model, 1, gap=gap)[0] for gap in (True, False))
    taper = 1e-8 * model.study.brake.contact.points[:, 0] / 0.02
    np.testing.assert_allclose(tapered.p, plain.p, rtol=1e-6)
    np.testing.assert_allclose(tapered.g - plain.g, -taper, atol=1e-6 * abs(taper).max())


@pytest.fixture(scope="module")
def folder(scene, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "out"
    run(
        scene,
        MPI.COMM_SELF,
        out,
        [*GIVEN, "stages=['surface','equilibrium','stability','uncertainty','report']"],
    )
    return out


def test_tables_of_a_run_agree_with_one_another(folder, model):
    states, families = (read_rows(folder / f"{n}.csv") for n in ("states", "states_families"))
    assert [row["samples"] for row in states] == [3] * 4 and not any(
        row["failed"] for row in states
    )
    for i, row in enumerate(states):
        grown = [
            (modes.damping < -1e-3) & (np.array(modes.verdict) == "unstable")
            for modes in (in_state(model, i, k)[1] for k in range(3))
        ]
        assert row["squeal_samples"] == sum(map(np.any, grown))
        assert row["squeal_samples"] <= sum(
            f["squeal_samples"] for f in families if f["state"] == row["state"]
        )
    assert sum(row["squeal_samples"] for row in states) > 0
    whole = read_rows(folder / "states_occurrence.csv")[0]
    share = np.array([row["share"] for row in states]) @ [4, 10, 10, 10] / 34
    assert whole["predicted_percent"] == pytest.approx(100 * share)
    assert whole["measured_percent"] == pytest.approx(100 * 3 / 34)  # two events are of one stop
    every = read_rows(folder / "states_scores.csv")[0]
    assert every["events"] == 3 and every["hits"] + every["misses"] == 3
    page = (folder / "report.html").read_text()
    assert "Squeal is likeliest at" in page and "<title>states" not in page.lower()
    assert (folder / "figures" / "states.png").stat().st_size > 2000


def test_the_best_threshold_is_written_back(folder, scene, capsys):
    text = scene.read_text()
    status = main(["threshold", str(folder), "--write", str(scene)])
    said = capsys.readouterr()
    if status:
        assert "tells no threshold" in said.err and scene.read_text() == text
    else:
        value = float(said.out.split()[1])
        assert read_scene(scene).stability.threshold == pytest.approx(value, rel=1e-3)
    scene.write_text(text)


def test_other_events_need_no_new_samples_and_other_states_do(folder, scene, capsys):
    """Events, bands and tolerance are read after the samples; a changed matrix is another scene."""
    more = [
        word
        for text in (*GIVEN[:-1], GIVEN[-1].replace("400 Hz", "50 Hz"))
        for word in ("--set", text)
    ]
    kept = ["--set", "stages=['surface','equilibrium','stability','uncertainty','report']"]
    assert main(["run", str(scene), "-o", str(folder), "-q", "--no-pictures", *more, *kept]) == 0
    matrix = scene.parent / "matrix.csv"
    matrix.write_text(MATRIX.replace("8,20", "7,20"))
    assert main(["run", str(scene), "-o", str(folder), "-q", "--no-pictures", *more, *kept]) == 2
    assert "another scene" in capsys.readouterr().err
    matrix.write_text(MATRIX)


@pytest.mark.hard
def test_a_state_without_equilibrium_costs_itself(scene):
    """Far beyond tipping there is none: the state is named, the others have their modes."""
    (scene.parent / "mu.csv").write_text(MU.replace("8,120,0.5", "8,120,40"))
    found = prepare(scene, GIVEN).study.work(("multi-scale", 0))
    (scene.parent / "mu.csv").write_text(MU)
    lost = [bool(text) for text in found["state_outcome"]]
    assert lost[:3] == [False, False, True] and not np.isin(found["state_of"], [2]).any()
    assert "s" in found and not found.get("lost")
