"""Which displacements are drawn as the modes of a sample, and the nodal diameters of rings."""

from dataclasses import replace
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.folder.store import Store
from brake_fenicsx.report import mode_fields
from brake_fenicsx.report.mode_fields import _severe, nodal_pattern, prepare_shapes
from brake_fenicsx.results.tables import MODES, SAMPLES, write_rows
from brake_fenicsx.samples.sampling import Roughness
from brake_fenicsx.samples.solve import by_bodies, displacements
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.modes import Modes
from places import BLOCK, DEMO
from run_tables import mode, read_run

COMM = MPI.COMM_SELF
COARSE = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'", "stability.band=['0 Hz','20 kHz']",
    "samples.n=2", "contact.block_plate.friction=0.3",
]  # fmt: skip
OWN = "samples.random.\"materials.lining.C44\"={ law='uniform', spread=0.2 }"


@pytest.mark.parametrize(
    ("changes", "stored"),
    [
        (["stability.method=full"], "vectors"),
        (["stability.method=reduced"], ""),
        (["stability.method=reduced", OWN], ""),
    ],
)
def test_displacements_are_those_of_the_modes(changes, stored, tmp_path, monkeypatch):
    """x' K x / x' M x, with the stiffness of the sample, gives the frequencies."""
    scene = read_scene(BLOCK, [*COARSE, *changes])
    (tmp_path / "cache").mkdir()
    brake = assemble_brake(scene, COMM)
    hdf = read_surface(scene).hdf
    study = Study(scene, brake, Roughness(hdf=hdf), Store(tmp_path), COMM)
    study.prepare()
    # All modes of the small scene are stable: every second one is taken for unstable.
    grows = property(lambda self: ["unstable" if i % 2 else "stable" for i in range(len(self))])
    monkeypatch.setattr(Modes, "verdict", grows)
    task = ("multi-scale", 1)
    data = study.work(task)
    assert {"vectors"} & {*data} == {stored} - {""}
    chosen = np.flatnonzero(data["verdict"] == "unstable")[:4]
    sample = study.sample(task)
    ((X, _),) = displacements(study.models, [(sample, data, chosen)], COMM)
    assert chosen.size == X.shape[1] == 4
    K = sample.brake.K
    K_t = tangent(K, brake.N, brake.T, brake.w, data["k"], data["mu"])
    M = study.brake.M
    for i, x in zip(chosen, X.T, strict=True):
        omega = np.sqrt((x.conj() @ (K_t @ x)).real / (x.conj() @ (M @ x)).real)
        assert omega == pytest.approx(abs(data["s"][i].imag), rel=1e-5)


@pytest.mark.parametrize(("threshold", "drawn"), [(0, [(1, 3), (0, 0)]), (0.01, [(1, 3)])])
def test_the_most_severe_families_are_drawn_whatever_their_sample(
    threshold, drawn, tmp_path, monkeypatch
):
    """The first sample that has an unstable mode has only the one that hardly grows."""
    modes = [
        mode("multi-scale", 0, 0, 14e3, -8e-6, 1), mode("multi-scale", 1, 2, 14e3, -8e-6, 1),
        mode("multi-scale", 1, 3, 1500.0, -0.075, 2),
    ]  # fmt: skip
    write_rows(tmp_path / "modes.csv", MODES, modes)
    write_rows(tmp_path / "samples.csv", SAMPLES, [["multi-scale", k, "ok", k] for k in (0, 1)])
    monkeypatch.setattr(
        mode_fields, "read_run", lambda folder, told: replace(read_run(folder), summary=told)
    )
    scene = read_scene(BLOCK, [f"stability.threshold={threshold}"])
    run, ((*chosen,),) = _severe(SimpleNamespace(store=Store(tmp_path), scene=scene), COMM)
    assert run.threshold == threshold
    # The one of median damping: of two equal ones any.
    found = [(m.sample, m.mode) for m in chosen]
    assert found[0] == drawn[0] and len(found) == len(drawn)


@pytest.fixture(scope="module")
def ring():
    """Nodes of a disc of 75 to 144 mm radius, 20 mm thick, at random angles."""
    rng = np.random.default_rng(3)
    angle = 2 * np.pi * (np.arange(400) + 0.6 * rng.random(400)) / 400
    radius, z = rng.uniform(0.075, 0.144, 400), rng.uniform(-0.01, 0.01, 400)
    rim = slice(0, None, 4)
    radius[rim] = 0.144
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


@pytest.mark.parametrize("n", [0, 1, 4, 9])
@pytest.mark.parametrize("travelling", [False, True])
def test_a_wave_around_the_disc_has_its_order(ring, n, travelling):
    """Standing or travelling, whatever its phase."""
    angle = np.arctan2(ring[:, 1], ring[:, 0])
    u = np.zeros(ring.shape, dtype=complex)
    u[:, 2] = np.exp(1j * (n * angle + 0.3)) if travelling else np.cos(n * angle - 0.4)
    found = nodal_pattern(ring, u * np.exp(0.7j))
    assert (found.diameters, found.direction) == (n, "out of plane")
    assert found.share == pytest.approx(1.0)


def test_the_strongest_direction_and_its_share_are_named(ring):
    """Radial with three waves, and a quarter of that square out of plane with five."""
    angle = np.arctan2(ring[:, 1], ring[:, 0])
    radial = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    u = radial * np.cos(3 * angle)[:, None]
    u[:, 2] = 0.5 * np.cos(5 * angle)
    found = nodal_pattern(ring, u)
    assert (found.diameters, found.direction) == (3, "in plane, radial")
    assert found.share == pytest.approx(0.8, abs=0.02)
    across = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros(len(angle))])
    assert nodal_pattern(ring, across).direction == "in plane, tangential"
    assert nodal_pattern(ring, across).diameters == 0


def test_what_is_no_ring_or_does_not_move_has_no_pattern(ring):
    angle = np.arctan2(ring[:, 1], ring[:, 0])
    half = ring[angle > 0]
    assert nodal_pattern(half, np.ones(half.shape)) is None
    assert nodal_pattern(ring, np.zeros(ring.shape)) is None
    assert nodal_pattern(np.zeros((0, 3)), np.zeros((0, 3))) is None


DAMPED = ["stability.damping={ loss=true, omega_ref='8 kHz' }", "materials.lining.loss=0.002"]
TWO_PADS = [
    COARSE[0], "samples.approaches=['multi-scale']", "contact.pad_disc.gap=hdf",
    "surface={ statistics={ S_q = '3 um' } }",
    "contact.pad_disc.law={ p0 = '10 MPa', u0 = '10 um' }",
    "samples.random.\"contact.pad_disc.friction\"={ law='uniform', min=0.3, max=0.7 }",
    "parts.disc.size='30 mm'", "parts.pad.size='20 mm'", "parts.pad.plate_size='20 mm'",
    "stability.band=['0 Hz','4 kHz']", "samples.n=2",
]  # fmt: skip


@pytest.mark.together
@pytest.mark.parametrize(
    ("scene", "changes", "free"),
    [(BLOCK, COARSE, 3), (BLOCK, [*COARSE, *DAMPED], 3), (DEMO, TWO_PADS, 2)],
)
def test_equilibria_by_bodies_are_those_of_the_whole_stiffness(scene, changes, free, tmp_path):
    """Of bodies that nothing but contact holds, and mirror images; the processes share them.

    The gaps of the displacement are those of the equilibrium.
    """
    scene = read_scene(scene, [*changes, "stability.method=reduced"])
    (tmp_path / "cache").mkdir()
    brake = assemble_brake(scene, COMM)
    study = Study(scene, brake, Roughness(hdf=read_surface(scene).hdf), Store(tmp_path), COMM)
    study.prepare()
    first = {task: study.work(task) for task in study.tasks[:2]}
    (model,) = study.models.reduction.models.values()
    assert np.sum(model.flexibilities == 0) == free
    given = [(study.sample(task), data) for task, data in first.items()]
    assert all(by_bodies(study.models, sample) for sample, _ in given)
    found = displacements(study.models, [], MPI.COMM_WORLD, equilibria=given)
    for (u, error), (task, whole) in zip(found, study.displacements(first).items(), strict=True):
        assert np.linalg.norm(u[:, 0] - whole) < 1e-8 * np.linalg.norm(whole)
        assert error.shape == (1,) and error[0] < 1e-8
        gaps = first[task]["g"] - brake.g0
        assert np.abs(brake.N @ u[:, 0] - gaps).max() < 1e-8 * np.abs(gaps).max()


def test_equilibria_of_changing_bodies_take_the_whole_stiffness(tmp_path):
    """Kept modes of the centre of the box are none of theirs."""
    scene = read_scene(BLOCK, [*COARSE, "stability.method=reduced", OWN])
    (tmp_path / "cache").mkdir()
    brake = assemble_brake(scene, COMM)
    study = Study(scene, brake, Roughness(hdf=read_surface(scene).hdf), Store(tmp_path), COMM)
    study.prepare()
    assert not by_bodies(study.models, study.sample(("multi-scale", 0)))


@pytest.mark.together
def test_folders_that_cannot_be_made_are_told_to_all(processes):
    """Others of its team waited for the first process for ever."""
    team, folder = processes
    if team.rank == 0:
        (folder / "figures").write_text("no folder")
    study = SimpleNamespace(store=Store(folder), scene=None)
    with pytest.raises(FileExistsError):
        prepare_shapes(study, {}, {}, False, team)
