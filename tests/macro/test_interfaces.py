"""Several interfaces in one scene: laws, friction and gaps of each."""

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.parametric import parametric_brake
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.braking import with_compliance
from brake_fenicsx.macro.equilibrium import equilibrium
from brake_fenicsx.micro import OneLaw, exponential_law, linear_law
from brake_fenicsx.micro.combined import join_laws
from brake_fenicsx.pipeline import assemble, run
from brake_fenicsx.samples.sampling import draw_sample
from brake_fenicsx.scene import Friction, read_scene

# A plate that slides between two blocks, pressed from above.
SANDWICH = """
stages = ["equilibrium", "stability"]
[parts.upper]
builder = "block"
length = "12 mm"
width = "8 mm"
height = "6 mm"
size = "4 mm"
material = "lining"
[parts.plate]
builder = "block"
length = "16 mm"
width = "10 mm"
height = "4 mm"
z = "-4 mm"
size = "5 mm"
material = "iron"
[parts.lower]
builder = "block"
length = "12 mm"
width = "8 mm"
height = "6 mm"
z = "-10 mm"
size = "3.3 mm"
material = "lining"
[materials.iron]
model = "isotropic"
E = "125 GPa"
nu = 0.24
rho = "7200 kg/m^3"
[materials.lining]
model = "isotropic"
E = "3 GPa"
nu = 0.3
rho = "2500 kg/m^3"
[contact.above]
faces = ["upper.bottom", "plate.top"]
law = { p0 = "4 MPa", u0 = "3 um" }
friction = { static = 0.6, kinetic = 0.3, decay = "2 m/s" }
[contact.below]
faces = ["lower.top", "plate.bottom"]
law = { linear = "1e12 Pa/m" }
discretisation = "quadrature"
friction = 0.2
[supports]
"lower.bottom" = "clamped"
"upper.top" = ["x", "y"]
"plate.sides" = ["x", "y"]
[loads]
"upper.top" = { pressure = "2 MPa" }
[motion]
direction = [1, 0, 0]
speed = "4 m/s"
[stability]
band = ["0 Hz", "60 kHz"]
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "sandwich.toml"
    path.write_text(SANDWICH)
    return path


def test_each_interface_follows_its_own_law_and_friction(scene, comm):
    """Series of two contacts: each carries the whole load, by its own law; friction by its own
    coefficient. Catches laws or coefficients numbered by the wrong interface."""
    brake = assemble(scene, comm)
    c = brake.contact
    parsed = read_scene(scene)
    sample = draw_sample(parsed, "multi-scale", 0, parametric_brake(parsed, brake).at)
    mu = 0.3 + 0.3 * np.exp(-2.0)
    np.testing.assert_allclose(sample.friction.mu[c.interface == 0], mu, rtol=1e-12)
    np.testing.assert_allclose(sample.friction.mu[c.interface == 1], 0.2)
    eq = equilibrium(with_compliance(brake, sample.laws, comm), sample.laws, sample.friction.mu)
    load = 2e6 * 12e-3 * 8e-3
    for i in (0, 1):
        own = c.interface == i
        assert c.w[own] @ eq.p[own] == pytest.approx(load, rel=1e-9)
    above, below = (c.interface == i for i in (0, 1))
    np.testing.assert_allclose(eq.p[above], 4e6 * np.exp(-eq.g[above] / 3e-6), rtol=1e-12)
    np.testing.assert_allclose(eq.p[below], np.maximum(-1e12 * eq.g[below], 0), atol=1e-3)
    # The pad below lies under the plate: n points down, s along the plate's motion all the same.
    np.testing.assert_allclose(c.normal[below], np.tile([0, 0, -1.0], (below.sum(), 1)), atol=1e-12)
    np.testing.assert_allclose(c.s, np.tile([1.0, 0, 0], (c.w.size, 1)), atol=1e-12)


def test_a_run_of_two_interfaces(scene, tmp_path):
    """The whole chain, at full order with a friction that differs from element to element."""
    run(scene, MPI.COMM_SELF, tmp_path / "out")
    assert (tmp_path / "out" / "modes.csv").read_text().count("\n") > 2


def test_friction_table_is_refused_where_it_makes_no_sense(scene):
    random = "samples.random.\"contact.above.friction\"={ law = 'uniform', min = 0.3, max = 0.5 }"
    with pytest.raises(SceneError, match=r"contact.above.friction is a table; write one number"):
        read_scene(scene, [random])
    with pytest.raises(SceneError, match=r"friction.decay = '2 s'"):
        read_scene(scene, ["contact.above.friction={ static = 0.5, kinetic = 0.4, decay = '2 s' }"])
    with pytest.raises(SceneError, match=r"friction.kinetic: missing"):
        read_scene(scene, ["contact.above.friction={ static = 0.5, decay = '2 m/s' }"])


def test_friction_falls_from_static_to_kinetic():
    law, V = Friction(0.6, 0.4, 0.5), np.array([0.0, 0.5, 50.0])
    mu, slope = law.coefficient(V)
    np.testing.assert_allclose(mu, [0.6, 0.4 + 0.2 / np.e, 0.4], atol=1e-12)
    h = 1e-6
    up, down = (law.coefficient(V + e)[0] for e in (h, -h))
    np.testing.assert_allclose(slope, (up - down) / (2 * h), atol=1e-9)


def test_joined_laws_are_their_parts():
    """Numbers run on from library to library; catches an index kept from the part before."""
    one, two = OneLaw(linear_law(1e9)), OneLaw(exponential_law(1e6, 2e-6))
    assert join_laws([one]) is one
    both = join_laws([one, two, one])
    assert len(both) == 3
    index, d = np.array([0, 1, 2, 1]), np.array([-1e-6, 1e-6, -3e-6, 0.0])
    for name in ("loading", "vibration"):
        alone = [
            getattr((one, two, one)[i], name)(np.array(0), np.array(x))
            for i, x in zip(index, d, strict=True)
        ]
        np.testing.assert_array_equal(getattr(both, name)(index, d), np.transpose(alone))
    np.testing.assert_allclose(both.first_touch(index)[[0, 2]], 0.0)
    np.testing.assert_array_equal(both.highest(index), np.inf)
