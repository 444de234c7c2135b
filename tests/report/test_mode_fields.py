"""Which displacements are drawn as the modes of a sample."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.measured_surface import read_surface
from brake_fenicsx.folder.store import Store
from brake_fenicsx.report import mode_fields
from brake_fenicsx.report.mode_fields import _severe
from brake_fenicsx.results.tables import MODES, SAMPLES, write_rows
from brake_fenicsx.samples.solve import displacements
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability.eigen import tangent
from brake_fenicsx.stability.modes import Modes
from run_tables import read_run

COMM = MPI.COMM_SELF
BLOCK = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"
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
    study = Study(scene, brake, None, hdf, Store(tmp_path), COMM)
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
    real, rest = -1.0, (1e-12, 1e-6, 2.0, "unstable")
    modes = [
        ["multi-scale", 0, 0, 14e3, real, -8e-6, *rest, 1],
        ["multi-scale", 1, 2, 14e3, real, -8e-6, *rest, 1],
        ["multi-scale", 1, 3, 1500.0, real, -0.075, *rest, 2],
    ]
    write_rows(tmp_path / "modes.csv", MODES, modes)
    write_rows(tmp_path / "samples.csv", SAMPLES, [["multi-scale", k, "ok", k] for k in (0, 1)])
    monkeypatch.setattr(
        mode_fields, "read_run", lambda folder, told: replace(read_run(folder), summary=told)
    )
    scene = read_scene(BLOCK, [f"stability.threshold={threshold}"])
    run, ((*chosen,),) = _severe(SimpleNamespace(comm=COMM, store=Store(tmp_path), scene=scene))
    assert run.threshold == threshold
    # The one of median damping: of two equal ones any.
    found = [(m.sample, m.mode) for m in chosen]
    assert found[0] == drawn[0] and len(found) == len(drawn)
