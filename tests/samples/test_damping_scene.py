"""Damping named in a scene, against perturbation theory with matrices made another way."""

import json

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.damping_terms import damping_terms
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.pipeline import run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.scene import active_terms
from brake_fenicsx.stability import complex_modes
from brake_fenicsx.stability.damping_matrices import gyroscopic
from brake_fenicsx.stability.eigen import tangent
from coarse_block import BLOCK, SCENES
from full_order import stored_eigenvalues, text_rows

SELF = MPI.COMM_SELF
COARSE = [
    "stages=['equilibrium','stability']", "parts.block.size='20 mm'", "parts.plate.size='30 mm'",
    "stability.band=['0 Hz','20 kHz']", "stability.zeta_max=0.3",
]  # fmt: skip
FALLING = "contact.block_plate.friction={ static=0.6, kinetic=0.4, decay='2 m/s' }"
LOSS = "stability.damping={ loss=true, omega_ref='8 kHz' }"
FACTOR = "materials.lining.loss=0.002"


def damped(folder, *changes):
    """Modes of a scene, its stored sample and its summary."""
    run(BLOCK, SELF, folder, [*COARSE, *changes])
    data = np.load(folder / "samples" / "multi-scale-00000.npz")
    return stored_eigenvalues(folder)[0], data, json.loads((folder / "summary.json").read_text())


def brake_of(*changes):
    return assemble_brake(read_scene(BLOCK, [*COARSE, *changes]), SELF)


def elementwise(operator, values):
    """sum of values_i o_i o_i' over the rows of an operator."""
    return sum(v * (o.T @ o) for v, o in zip(values, operator, strict=True))


def lining(brake):
    """Stiffness of the lining alone: K is linear in its constants."""
    names = {"C11": 5.94, "C12": 0.76, "C13": 0.98, "C33": 2.27, "C44": 1.18}
    half = brake_of(*(f"materials.lining.{n}='{v / 2} GPa'" for n, v in names.items()))
    return 2 * (brake.K - half.K)


def alone_alpha(brake, data):
    return 3.0 * brake.M


def alone_beta(brake, data):
    return 1e-9 * brake.K


def alone_loss(brake, data):
    return 0.002 / (2 * np.pi * 8e3) * lining(brake)


def alone_sliding(brake, data):
    b = brake
    return elementwise(b.R, b.w * data["mu"] * data["p"] / b.contact.speed)


def alone_slope(brake, data):
    slope = -0.2 / 2.0 * np.exp(-1.0 / 2.0)
    return elementwise(brake.T, brake.w * data["p"] * slope)


TERMS = {
    "alpha": (["stability.damping.rayleigh=['3 1/s', 0]"], alone_alpha),
    "beta": (["stability.damping.rayleigh=[0, '1 ns']"], alone_beta),
    "loss": ([LOSS, FACTOR], alone_loss),
    # Light pressure: the term is proportional to it, and perturbation theory holds.
    "sliding": (["stability.damping.sliding=true", "motion.speed='40 m/s'"], alone_sliding),
    "slope": (["stability.damping.slope=true", FALLING], alone_slope),
}


@pytest.mark.long
@pytest.mark.parametrize("term", TERMS)
def test_each_term_moves_the_eigenvalues_as_perturbation_theory_says(term, tmp_path):
    """d lambda = - psi^H lambda C phi / psi^H 2 lambda M phi, C by another way; sign and size.

    Catches a wrong sign, a frequency in Hz for one in rad/s, a lost area, the wrong layer's loss.
    """
    changes, alone = TERMS[term]
    light = "loads.\"block.top\".pressure='0.2 bar'" if term in ("sliding", "slope") else ""
    changes = [c for c in (*changes, light) if c]
    s, data, summary = damped(tmp_path, *changes)
    brake = brake_of(*(c for c in changes if "damping" not in c and c != FACTOR))
    K = tangent(brake.K, brake.N, brake.T, brake.w, data["k"], data["mu"])
    m = complex_modes(brake.M, None, K, (0.0, 22e3), zeta_max=0.3)
    left, M, C = m.left.conj(), brake.M, alone(brake, data)
    overlap = np.einsum("im,im->m", left, M @ m.right)
    move = -np.einsum("im,im->m", left, C @ m.right) / (2 * overlap)
    moved = s - m.s[: s.size]
    assert s.size >= 5 and np.abs(move).max() > 0.3
    # What is left is of second order.
    assert np.all(np.abs(moved - move[: s.size]) < 4e-3 * np.abs(move).max())
    assert np.all(moved.real > 0) if term == "slope" else np.all(moved.real < 1e-6)
    name = "rayleigh" if term in ("alpha", "beta") else term
    assert list(summary["damping"]) == [name]
    assert summary["damping"][name]["approaches"] == ["multi-scale"]
    assert name in (tmp_path / "log.txt").read_text()
    if term == "loss":
        assert summary["damping"]["loss"]["omega_ref_rad_s"] == pytest.approx(2 * np.pi * 8e3)
        assert summary["damping"]["loss"]["factors"] == {"lining": 0.002}


def test_rayleigh_damping_without_friction_is_exact(tmp_path):
    """alpha alone: lambda = -alpha / 2 + i sqrt(omega^2 - alpha^2 / 4), whatever the contact."""
    frictionless = "contact.block_plate.friction=0.0"
    s, *_ = damped(tmp_path / "a", frictionless)
    t, *_ = damped(tmp_path / "b", frictionless, "stability.damping.rayleigh=['800 1/s', '0 s']")
    assert s.size == t.size > 5
    np.testing.assert_allclose(t, -400 + 1j * np.sqrt(s.imag**2 - 400.0**2), rtol=1e-8)


def test_reference_frequency_in_hertz_and_in_radians():
    """Libraries of units take 1 Hz for 1 rad/s."""
    made = [
        read_scene(BLOCK, [FACTOR, f"stability.damping={{ loss=true, omega_ref='{text}' }}"])
        for text in ("2 kHz", "12566.370614359172 rad/s")
    ]
    values = [scene.stability.damping.reference for scene in made]
    assert values == pytest.approx([2 * np.pi * 2e3] * 2, rel=1e-12)


def invariants(C):
    """Numbers that no renumbering of dofs changes."""
    odd = C - C.T
    return [C.diagonal().sum(), sp.linalg.norm(C), sp.linalg.norm(odd), sp.linalg.norm(C @ C)]


DISC = [
    "stages=['equilibrium','stability']", "contact.pad_disc.law={ linear='1e10 Pa/m' }",
    "samples.n=1", "contact.pad_disc.gap=none", "parts.disc.size='24 mm'", "parts.pad.size='18 mm'",
    "parts.pad.plate_size='18 mm'", "parts.pad.shim=false", "mesh.quality=0.02",
]  # fmt: skip


@pytest.mark.together
def test_terms_of_the_bodies_do_not_depend_on_the_number_of_processes(comm):
    """Rayleigh, two loss factors and the turning disc, assembled by all processes or by one."""
    damping = (
        "stability.damping={ rayleigh=['20 1/s','1e-8 s'], loss=true, omega_ref='2 kHz',"
        " gyroscopic=true }"
    )
    changes = [*DISC, damping, "materials.lining.loss=0.05", "materials.steel.loss=0.002"]
    scene = read_scene(SCENES / "disc_brake_demo.toml", changes)
    brakes = [assemble_brake(scene, c) for c in (comm, SELF)]
    together, alone = (damping_terms(scene, b).bulk for b in brakes)
    np.testing.assert_allclose(invariants(together), invariants(alone), rtol=1e-10)
    # Of it the skew part is the disc's alone, for the speed and the sense of the scene.
    b = brakes[1]
    G = gyroscopic(b.mesh, b.elastic.free, {"disc.body": 7200.0}, Rotation(5.0))
    skew = 0.5 * (alone - alone.T)
    assert abs(skew - G).max() < 1e-12 * abs(G).max()
    sets = [*changes, "motion.speed='-5 rad/s'"]
    back = damping_terms(read_scene(SCENES / "disc_brake_demo.toml", sets), b).bulk
    assert abs(0.5 * (back - back.T) + G).max() < 1e-12 * abs(G).max()


@pytest.mark.together
def test_a_damped_scene_on_all_processes(comm, tmp_path):
    """The samples shared by the processes, each with the whole of C."""
    folder = comm.bcast(tmp_path if comm.rank == 0 else None, root=0)
    mu = "samples.random.\"contact.block_plate.friction\"={ law='uniform', min=0.3, max=0.7 }"
    changes = [
        *COARSE, "stages=['equilibrium','stability','uncertainty']", mu, "samples.n=2", FACTOR,
        "stability.damping={ rayleigh=['20 1/s','1e-8 s'], sliding=true, loss=true,"
        " omega_ref='8 kHz' }", "stability.method=reduced",
    ]  # fmt: skip
    run(BLOCK, comm, folder / "out", changes)
    alone = read_scene(BLOCK, changes)
    assert active_terms(alone, "multi-scale") == ("rayleigh", "loss", "sliding")
    table = text_rows(folder / "out" / "modes.csv")
    assert {r["sample"] for r in table} == {"0", "1"}
    assert min(int(r["family"]) for r in table) >= 0
    run(BLOCK, SELF, tmp_path / "alone", changes)
    for k in (0, 1):
        s, t = (stored_eigenvalues(f, sample=k)[0] for f in (folder / "out", tmp_path / "alone"))
        np.testing.assert_allclose(s, t, rtol=1e-8)


MANY = [
    *COARSE, FALLING, "samples.n=2",
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
]  # fmt: skip


@pytest.mark.slow
def test_damping_too_strong_for_the_reduced_model_goes_to_full_order_if_asked(tmp_path):
    """Its own decay lies within the band: refused with the remedy, never solved in silence."""
    strong = ["stability.damping={ loss=true, omega_ref='8 kHz' }", "materials.lining.loss=0.8"]
    with pytest.raises(SceneError, match=r"damping too large .*on_tolerance = .full order"):
        run(BLOCK, SELF, tmp_path / "no", [*MANY, *strong, "stability.method=reduced"])
    strong.append("stability.on_tolerance='full order'")
    run(BLOCK, SELF, tmp_path, [*MANY, *strong, "stability.method=reduced", "samples.n=2"])
    log = (tmp_path / "log.txt").read_text()
    assert "no reduced model: damping too large for the frequency expansion" in log
    assert {r["sample"] for r in text_rows(tmp_path / "modes.csv")} == {"0", "1"}


def test_terms_act_only_where_they_mean_something():
    """One friction coefficient has no slope; without friction nothing turns with the sliding."""
    both = "stability.damping={ slope=true, sliding=true }"
    stages = "stages=['equilibrium','stability','uncertainty']"
    scene = read_scene(
        BLOCK, [both, FALLING, stages, "samples.approaches=['multi-scale','classical']",
                "samples.classical={ penalty='2e13 Pa/m', friction=0.0 }"]
    )  # fmt: skip
    assert active_terms(scene, "multi-scale") == ("sliding", "slope")
    assert active_terms(scene, "classical") == ()
    assert active_terms(read_scene(BLOCK), "multi-scale") == ()
