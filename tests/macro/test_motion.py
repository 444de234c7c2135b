"""Rotation about any axis: a brake that is turned in space has the same modes, forces and slips."""

from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.build import brake as brake_module
from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.brake_doubts import placement_doubts
from brake_fenicsx.build.damping_terms import damping_terms
from brake_fenicsx.build.interfaces import scene_motion
from brake_fenicsx.build.scene_mesh import scene_mesh
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.contact_elements import pad_forces
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import complex_modes
from coarse_block import SCENES

BRAKE = [
    "stages=['equilibrium','stability']", "surface={}", "micro={}", "samples={}",
    "parts.disc={ builder='disc', radius='60 mm', bore='25 mm', thickness='10 mm', size='60 mm',"
    " material='iron' }",
    "parts.pad={ builder='pad', side='both', z='5 mm', r_inner='30 mm', r_outer='55 mm',"
    " angle='60 deg', lining='8 mm', plate='6 mm', ear_length='0 mm', piston_diameter='18 mm',"
    " size='40 mm', plate_size='40 mm', material='iron' }",
    "contact.pad_disc={ faces=['pad.friction','disc.friction'], law={ linear='1e12 Pa/m' },"
    " friction=0.5 }",
    "supports={ 'disc.bore'='clamped' }", "stability={ band=['0 Hz','9 kHz'],"
    " damping={ gyroscopic=true } }",
]  # fmt: skip
SHIFT, SPEED = np.array([0.2, -0.1, 0.4]), 300.0


def turn(axis):
    """A rotation that takes z to an axis."""
    z = np.array(axis) / np.linalg.norm(axis)
    return np.column_stack([*la.null_space(z[None]).T, z])


def assembled(monkeypatch, motion, turned=None):
    """A brake, its mesh turned and moved, and its scene."""
    scene = read_scene(SCENES / "disc_brake.toml", [*BRAKE, motion])

    def moved(scene, comm):
        mesh = scene_mesh(scene, comm)
        if turned is not None:
            mesh.domain.geometry.x[:] = mesh.domain.geometry.x @ turned.T + SHIFT
        return mesh

    monkeypatch.setattr(brake_module, "scene_mesh", moved)
    return scene, assemble_brake(scene, MPI.COMM_SELF)


def spectrum(scene, brake):
    """Eigenvalues under friction of one contact stiffness, the disc turning."""
    w = sp.diags(1e12 * brake.w)
    K = (brake.K + (brake.N + 0.5 * brake.T).T @ w @ brake.N).tocsr()
    s = complex_modes(brake.M, damping_terms(scene, brake).bulk, K, (0.0, 9e3)).s
    return s[np.lexsort((s.real.round(3), s.imag.round(3)))]


@cache
def unturned():
    """The brake about z, and its spectrum."""
    scene = read_scene(
        SCENES / "disc_brake.toml", [*BRAKE, f"motion={{ axis='z', speed='{SPEED} rad/s' }}"]
    )
    brake = assemble_brake(scene, MPI.COMM_SELF)
    return (scene, brake), spectrum(scene, brake)


@pytest.mark.parametrize("axis", [pytest.param("'y'", marks=pytest.mark.slow), "[1, -2, 0.5]"])
def test_turned_brake_is_the_same_brake(monkeypatch, axis):
    """Modes, sliding speeds and forces on the pads, with a gyroscopic term that matters."""
    plain, first = unturned()
    vector = {"'y'": [0, 1.0, 0]}.get(axis, [1, -2, 0.5])
    point = ", ".join(f"'{1e3 * x} mm'" for x in SHIFT + 0.03 * np.array(vector))
    about = f"motion={{ axis={axis}, point=[{point}], speed='{SPEED} rad/s' }}"
    other = assembled(monkeypatch, about, turn(vector))
    np.testing.assert_allclose(other[1].contact.speed, plain[1].contact.speed, rtol=1e-9)
    second = spectrum(*other)
    assert first.size == second.size > 5
    np.testing.assert_allclose(second, first, rtol=1e-7)
    p = 1e5 * (1 + np.arange(plain[1].w.size))
    pads = [
        pad_forces(b.contact, ["pad"], scene_motion(s), p, 0.5 + 0 * p) for s, b in (plain, other)
    ]
    for one, two in zip(*pads, strict=True):
        assert two.torque == pytest.approx(one.torque, rel=1e-9)
        assert two.effective_radius == pytest.approx(one.effective_radius, rel=1e-9)
        assert two.leading_share == pytest.approx(one.leading_share, rel=1e-9)
        assert two.towards_leading == pytest.approx(one.towards_leading, rel=1e-9)


def test_axis_z_is_that_of_the_coordinates():
    np.testing.assert_array_equal(Rotation(1.0).frame, np.eye(3))


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        ("{ axis='z', direction=[1, 0, 0] }", "motion.axis = 'z': .* direction; leave motion.axis"),
        ("{ point=[0, 0, 0], direction=[1, 0, 0] }", "motion.point = .* leave motion.point"),
        ("{ axis=[0, 0, 0] }", r"motion.axis = \[0.0, 0.0, 0.0\]: write three numbers, not all"),
        ("{ axis=[0, 1] }", "motion.axis = .*: write three numbers"),
        ("{ axis='z', point=['1 mm', '2 mm'] }", "motion.point = .*: write three numbers"),
        ("{ axis='w' }", "motion.axis"),
    ],
)
def test_mistakes_are_one_line(motion, said):
    with pytest.raises(SceneError, match=said):
        read_scene(SCENES / "block_on_plate.toml", [f"motion={motion}"])


def test_axis_through_the_contact_face_is_named():
    def doubts(motion):
        scene = read_scene(SCENES / "block_on_plate.toml", [f"motion={{ {motion} }}"])
        found = placement_doubts(scene, assemble_brake(scene, MPI.COMM_SELF))
        return [line for line in found if "axis of the motion" in line]

    assert len(doubts("axis='z'")) == 1
    assert not doubts("axis='z', point=['80 mm', '0 mm', '0 mm']")
    assert not doubts("direction=[1, 0, 0]")
