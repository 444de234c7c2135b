"""Interfaces whose faces stick: closed forms, ties of the same stiffness, states, whole runs."""

import csv
import json
import re

from mpi4py import MPI

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.braking import equilibrium
from brake_fenicsx.macro.solver import with_interface
from brake_fenicsx.macro.tie import tied_faces
from brake_fenicsx.micro import linear_law
from brake_fenicsx.pipeline import assemble, run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability.substructures.substructure import split_substructures
from places import BLOCK

FEW = ["mesh.cells=hexahedra", "parts.block.size='5 mm'", "parts.plate.size='10 mm'", "contact={}"]
RIGID = [
    f"materials.{name}={{ model='isotropic', E='1e7 GPa', nu=0, rho='2510 kg/m^3' }}"
    for name in ("iron", "lining")
]
AREA, MASS, LOAD = 800e-6, 2510 * 800e-6 * 20e-3, 5e5 * 800e-6
K_T, K_N = 1e10, 3e10


def grip(more="", faces='["block.bottom", "plate.top"]'):
    """An interface that sticks, by a linear law."""
    return (
        f"contact.grip={{ faces={faces}, slip='stuck', tangential_stiffness='{K_T:g} Pa/m',"
        f" law={{ linear='{K_N:g} Pa/m' }}{more} }}"
    )


def lowest(K, M, count):
    """Lowest eigenvalues [1/s^2]."""
    return np.sort(eigsh(K, count, M, sigma=0.0, return_eigenvectors=False))


@pytest.mark.parametrize(
    ("held", "stiffness"), [(["y", "z"], K_T), (["x", "z"], K_T), (["x", "y"], K_N)]
)
def test_frequencies_of_a_rigid_block(held, stiffness, comm):
    """Guided along one direction: omega^2 = k A / m, k_t along both faces' directions."""
    supports = f"supports={{ 'plate.bottom'='clamped', 'block.sides'={held} }}"
    brake = assemble(BLOCK, comm, [*FEW, *RIGID, grip(), supports])
    K = with_interface(brake.K, brake.N, brake.w * K_N, brake.N)
    assert lowest(K, brake.M, 1)[0] == pytest.approx(stiffness * AREA / MASS, rel=1e-4)


def test_a_tie_of_the_same_stiffness_has_the_same_modes(comm):
    """Of closed elements, k_t = k: jumps of linear elements that match at the Gauss points of the
    facets are those of the tie, so that the stiffness is the same matrix."""
    kappa, faces = 2e12, ("block.bottom", "plate.top")
    same = [
        *FEW, "parts.plate.length='40 mm'", "parts.plate.width='20 mm'", "parts.plate.size='5 mm'",
        "mesh.degree=1", grip(", discretisation='quadrature'"),
        f"contact.grip.tangential_stiffness='{kappa:g} Pa/m'",
    ]  # fmt: skip
    brake = assemble(BLOCK, comm, same)
    layer = tied_faces(brake.mesh, brake.elastic.free, faces, {}, kappa).K
    springs = brake.stuck["grip"].matrix()
    stuck = with_interface(springs, brake.N, brake.w * kappa, brake.N)
    # Common parts of distorted quadrilaterals are integrated to 1e-7.
    assert abs(stuck - layer).max() < 1e-7 * abs(layer).max()
    found, wanted = (lowest(brake.K - springs + A, brake.M, 8) for A in (stuck, layer))
    np.testing.assert_allclose(found, wanted, rtol=1e-7)


def sheared(comm, force, mu):
    """The rigid block pressed by LOAD and sheared by a force along x at half its height."""
    loads = f"loads.'block.sides'={{ force=['{force} N', 0, 0] }}"
    free = "supports={ 'plate.bottom'='clamped' }"
    brake = assemble(BLOCK, comm, [*FEW, *RIGID, grip(), loads, free])
    eq = equilibrium(brake, linear_law(K_N), 0.0, 0.0, comm=comm)
    return brake, eq, brake.stuck["grip"].state(eq.u, eq.p, mu)


def test_elements_beyond_the_limit_of_a_sheared_block(comm):
    """F / A along the faces everywhere, and p = P / A + M x / I."""
    force, mu = 100.0, 0.3
    brake, eq, state = sheared(comm, force, mu)
    x, y = brake.points[:, 0], brake.points[:, 1]
    # A plane through the gaps: force and both moments of the elements.
    basis = np.stack([np.ones_like(x), x, y])
    gram = (basis * brake.w) @ basis.T
    p = np.linalg.solve(gram, [LOAD, force * 10e-3, 0.0]) @ basis
    np.testing.assert_allclose(eq.p, p, rtol=1e-4)
    beyond = force / AREA > mu * p
    assert 0.2 < brake.w[beyond].sum() / AREA < 0.8
    np.testing.assert_array_equal(state.beyond, beyond)
    assert not state.is_open.any()
    assert state.share(state.beyond) == pytest.approx(brake.w[beyond].sum() / AREA, rel=1e-12)
    np.testing.assert_allclose(state.tangential, [-force, 0, 0], atol=1e-4 * force)
    np.testing.assert_allclose(state.normal, [0, 0, LOAD], atol=1e-4 * LOAD)


def test_open_elements_of_a_tilted_block(comm):
    """More shear lifts one end; what is open has no pressure, and is not beyond the limit too."""
    brake, eq, state = sheared(comm, 400.0, None)
    assert 0.05 < state.share(state.is_open) < 0.5
    assert np.all(eq.p[state.is_open] == 0) and np.all(brake.points[state.is_open, 0] < 0)
    assert not state.beyond.any()
    np.testing.assert_allclose(state.tangential, [-400.0, 0, 0], atol=0.04)


# A cap pressed on the block from above, stuck to it; below the plate slides.
CAP = [
    FEW[0], "parts.block.size='10 mm'", "parts.plate.size='15 mm'",
    "parts.cap={ builder='block', length='30 mm', width='24 mm', height='8 mm',"
    " z='20 mm', size='12 mm', material='iron' }",
    "supports={ 'plate.bottom'='clamped', 'cap.sides'=['x', 'y'] }",
    "loads={ 'cap.top'={ pressure='1 MPa' } }",
    "stability={ band=['0 Hz', '20 kHz'], drivers=true, method='reduced', verify=1,"
    " damping={ sliding=true } }",
    "contact.stay={ faces=['cap.bottom', 'block.top'], slip='stuck', friction=0.3,"
    " tangential_stiffness='1e12 Pa/m', law={ linear='1e12 Pa/m' } }",
    "stages=['equilibrium', 'stability', 'uncertainty']",
    "samples={ n=2, approaches=['joint'] }",
    "samples.random.'contact.block_plate.friction'={ law='uniform', min=0.4, max=0.6 }",
]  # fmt: skip


def test_bodies_that_stick_are_one_substructure(comm):
    """And nothing of their slip is left for friction to act on."""
    brake = assemble(BLOCK, comm, CAP)
    bodies = split_substructures(brake.K, brake.M, {"N": brake.N, "T": brake.T, "R": brake.R})
    assert len(bodies) == 2
    own = brake.contact.interface == 1
    assert brake.T[own].nnz == brake.R[own].nnz == 0 and not brake.contact.speed[own].any()
    assert brake.T[~own].nnz > 0
    assert [*brake.stuck] == ["stay"]


@pytest.mark.long
@pytest.mark.together
def test_a_run_with_sliding_and_stuck_faces(tmp_path, comm):
    """Equilibrium, reduced modes as at full order, drivers, states and forces."""
    folder = comm.bcast(tmp_path) / "out"
    run(BLOCK, comm, folder, CAP)
    summary = json.loads((folder / "summary.json").read_text())
    check = summary["verification"]
    assert check["samples_compared"] == 1 and check["eigenvalues"] >= 6
    assert check["largest_relative_error"] < 1e-5 and check["wrong_verdicts"] == 0
    state = summary["stuck_contact"]["stay"]["joint"]
    parts = [state[name]["elements"] for name in ("open", "stuck", "beyond_friction")]
    assert sum(parts) == state["elements"] and parts[2] > 0
    # The block is held by the cap alone: the friction passes through the faces that stick.
    assert [*summary["contact_forces"]["joint"]] == ["block_plate"]
    load = 1e6 * 30e-3 * 24e-3
    mu = float(next(csv.DictReader((folder / "samples.csv").open()))["mu"])
    assert 0.4 < mu < 0.6
    np.testing.assert_allclose(state["normal_force_N"], [0, 0, load], atol=1e-5 * load)
    np.testing.assert_allclose(state["tangential_force_N"], [mu * load, 0, 0], atol=1e-5 * load)
    (line,) = [w for w in summary["warnings"] if "contact.stay: stuck" in w]
    said = r"contact.stay: stuck, .* \(joint\) .* % of its area is open and .* % is beyond"
    assert re.match(said, line)
    assert summary["friction"] == {"joint": "random (block_plate), stuck (stay)"}
    drivers = list(csv.DictReader((folder / "drivers.csv").open()))
    assert {d["parameter"] for d in drivers if d["kind"] == "friction"} == {"block_plate"}


def test_stuck_faces_need_no_motion(tmp_path):
    """Their friction is a limit alone; without it nothing is said of a limit."""
    scene = tmp_path / "still.toml"
    scene.write_text(re.sub(r"\[motion\].*?\n\n", "", BLOCK.read_text(), flags=re.S))
    for more, limit in ((", friction=0.4", True), ("", False)):
        changes = [
            *FEW, grip(more), "stages=['equilibrium', 'stability']", "parts.block.size='10 mm'",
            "parts.plate.size='15 mm'", "stability.band=['0 Hz', '20 kHz']",
        ]  # fmt: skip
        run(scene, MPI.COMM_SELF, tmp_path / f"out{limit}", changes)
        summary = json.loads((tmp_path / f"out{limit}" / "summary.json").read_text())
        state = summary["stuck_contact"]["grip"]["multi-scale"]
        assert ("beyond_friction" in state) == limit
        assert state["open"]["elements"] == 0
        modes = list(csv.DictReader((tmp_path / f"out{limit}" / "modes.csv").open()))
        assert modes and all(m["verdict"] != "unstable" for m in modes)


RANDOM = "samples.random.'contact.grip.friction'={ law='uniform', min=0.3, max=0.5 }"
SWEPT = "sweep.parameters={ 'contact.grip.friction'={ start=0.1, stop=0.5, steps=3 } }"
MISTAKES = [
    ([grip().replace("tangential_stiffness='1e+10 Pa/m',", "")], "needs tangential_stiffness"),
    ([grip().replace("slip='stuck', ", "")],
     "contact.grip.tangential_stiffness = 1e+10 Pa/m: acts where faces stick"),
    ([grip(), "contact.grip.slip='sticky'"], "slip = 'sticky': use one of motion, stuck"),
    ([grip(), "contact.grip.tangential_stiffness=0"], "must be positive"),
    ([grip(), "contact.grip.tangential_stiffness='1 MPa'"], "wrong unit; a contact stiffness"),
    ([grip(", friction=0.4"), RANDOM], "contact.grip.friction\": the interface is stuck"),
    ([grip(", friction=0.4"), SWEPT], "contact.grip.friction\": the interface is stuck"),
    ([grip(", friction=0.4"), "countermeasures=[{ key='contact.grip.friction', to=0.1 }]"],
     "contact.grip.friction': the interface is stuck"),
    ([grip(", friction=0.4"), "stability.damping.sliding=true"], "there is no friction"),
    ([grip(), "ties.glue={ faces=['block.bottom', 'plate.top'] }"], "is in contact.grip as well"),
    ([grip(), "contact.rub={ faces=['block.top', 'plate.bottom'], law={ linear='1e12 Pa/m' } }",
      "motion={ axis='z', speed='3 rad/s' }", "stability.damping.gyroscopic=true"],
     "contact.grip: block does not turn, and the part that it is joined to does"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "said"), MISTAKES)
def test_mistakes(changes, said):
    with pytest.raises(SceneError, match=re.escape(said)) as error:
        read_scene(BLOCK, ["stages=['equilibrium', 'stability', 'uncertainty']", *FEW, *changes])
    assert str(BLOCK) in str(error.value)
