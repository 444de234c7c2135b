"""Bodies that are images of one another: found from their matrices, and nothing less is taken."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.macro.brake import assemble_brake
from brake_fenicsx.macro.solver import local_rows
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability.changing.bodies import split_bodies
from brake_fenicsx.stability.changing.congruent import image_of

DEMO = Path(__file__).parents[2] / "scripts" / "scenes" / "disc_brake_demo.toml"


@pytest.fixture
def pads(twins):
    """The bodies of variable stiffness of both brakes."""
    s = twins
    bodies = split_bodies(s.K, s.M, s.N, s.T, s.f[:, None], s.parts)
    return [body for body in bodies if body.parts]


def test_image_is_found(twins, pads):
    """Order and signs that were hidden in the matrices."""
    first, second = pads
    image = image_of(first, second)
    half = len(twins.signs)
    np.testing.assert_array_equal(image.body.dofs, twins.dofs[first.dofs])
    np.testing.assert_array_equal(image.signs, twins.signs[first.dofs])
    np.testing.assert_array_equal(image.body.elements, twins.elements[first.elements])
    u, v = np.random.default_rng(1).standard_normal(first.dofs.size), np.zeros(2 * half)
    v[image.body.dofs] = image.signs * u
    np.testing.assert_allclose((twins.N @ v)[image.body.elements], first.N @ u, atol=1e-12)
    np.testing.assert_allclose(v @ (twins.K @ v), u @ (first.K @ u), rtol=1e-12)


def changed(A, by):
    """A with its largest entry off the diagonal changed, and the one across."""
    A = A.copy()
    off = sp.triu(A, 1).tocoo()
    m = np.abs(off.data).argmax()
    i, j = off.row[m], off.col[m]
    A[i, j] *= 1 + by
    if A.shape[0] == A.shape[1]:
        A[j, i] = A[i, j]
    return A


@pytest.mark.parametrize("name", ["K", "M", "N", "T", "parts"])
def test_what_differs_by_little_is_no_image(pads, name):
    """One entry by 1e-8; by round-off alone it still is one."""
    first, second = pads

    def other(by):
        if name == "parts":
            (number, part), *more = second.parts
            return replace(second, parts=((number, changed(part, by)), *more))
        return replace(second, **{name: changed(getattr(second, name), by)})

    assert image_of(first, other(1e-8)) is None
    assert image_of(first, other(1e-15)) is not None


def test_other_materials_are_no_image(pads):
    """The same matrices, moved by other constants."""
    first, second = pads
    (number, part), *more = second.parts
    assert image_of(first, replace(second, parts=((number + 7, part), *more))) is None


def test_pads_on_both_sides_of_a_disc():
    """The meshes of the brake's pads are mirror images: one stands for both, the disc for none."""
    sizes = ["parts.disc.size='30 mm'", "parts.pad.size='16 mm'", "parts.pad.plate_size='20 mm'"]
    stages = "stages=['equilibrium']"
    law = "contact.pad_disc.law={ p0 = '2e5 Pa', u0 = '2e-6 m' }"
    scene = read_scene(DEMO, [stages, "contact.pad_disc.gap=none", law, *sizes])
    b = assemble_brake(scene, MPI.COMM_SELF)
    K, M = local_rows(b.K), local_rows(b.M)
    bodies = split_bodies(K, M, b.N, b.T, b.f[:, None], [])
    pairs = [(i, j) for i in range(3) for j in range(i) if image_of(bodies[j], bodies[i])]
    (pair,) = pairs
    first, second = (bodies[i].elements.size for i in pair)
    assert first == second < b.w.size
