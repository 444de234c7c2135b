"""The examples of docs/developer_guide.md: parts of a user's own in place of the program's."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import assemble, prepare, sample
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extensions import Extensions
from brake_fenicsx.macro import equilibrium
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import Reduced
from places import SQUEALING

FRICTION, ROUGH = "contact.block_plate.friction", "joint"


@pytest.fixture(scope="module")
def brake():
    return assemble(SQUEALING, MPI.COMM_SELF)


@dataclass(frozen=True)
class Quadratic:
    """A contact law: p = c d^2 below d = 0, the protocol ``brake_fenicsx.micro.Law``."""

    c: float  # [Pa/m^2]
    first_touch: float = 0.0

    def pressure(self, d):
        return self.c * np.minimum(d, 0.0) ** 2

    def stiffness(self, d):
        return -2 * self.c * np.minimum(d, 0.0)

    vibration = stiffness  # elastic: unloading follows loading


def test_a_contact_law_of_ones_own(brake):
    state = equilibrium(brake, Quadratic(1e19), g_cr=0.0, mu=0.0)
    assert brake.w @ state.p == pytest.approx(5e5 * brake.w.sum(), rel=1e-6)
    np.testing.assert_allclose(state.k, 2 * np.sqrt(1e19 * state.p), rtol=1e-6)


def test_friction_that_depends_on_the_pressure(brake):
    """One coefficient for each contact element, from any function of the state."""
    law = Quadratic(1e19)
    state = equilibrium(brake, law, g_cr=0.0, mu=0.0)
    model = Reduced(brake.K, brake.M, brake.N, brake.T, brake.w, 1e11, (0.0, 18e3))
    mu = 0.3 + 0.2 * state.p / state.p.max()
    low, own, high = (model.modes(state.k, m).s for m in (0.3, mu, 0.5))
    assert not np.allclose(own, low) and not np.allclose(own, high)
    np.testing.assert_allclose(model.modes(state.k, 0 * mu + 0.3).s, low, rtol=1e-9)


@dataclass(frozen=True)
class Stribeck:
    """mu = high + (low - high) / (1 + V / V_s): the protocol ``extensions.FrictionLaw``."""

    low: float
    high: float
    V_s: float  # [m/s]

    def coefficient(self, V):
        fall = 1 / (1 + V / self.V_s)
        return (
            self.high + (self.low - self.high) * fall,
            -(self.low - self.high) / self.V_s * fall**2,
        )


def test_a_friction_law_of_ones_own():
    """The modes of the table of the scene that has the same coefficient and slope at the speed."""
    own, slope = Stribeck(0.6, 0.3, 0.5), "stability.damping={ slope = true }"
    speed = read_scene(SQUEALING).motion.rate
    (mu,), (fall,) = own.coefficient(np.array([speed]))
    # kinetic + a exp(-V / decay) with the decay of the speed.
    a = -fall * speed * np.e
    table = f"{{ static = {mu - a / np.e + a}, kinetic = {mu - a / np.e}, decay = '{speed} m/s' }}"
    # The term needs a friction that depends on the speed in the scene; the own law replaces it.
    other = f"{FRICTION}={{ static = 0.3, kinetic = 0.2, decay = '1 m/s' }}"
    model = prepare(
        SQUEALING,
        ["countermeasures=[]", other, slope],
        extensions=Extensions(friction={"block_plate": own}),
    )
    given = prepare(SQUEALING, ["countermeasures=[]", f"{FRICTION}={table}", slope])
    np.testing.assert_allclose(sample(model).s, sample(given).s, rtol=1e-8)
    undamped = prepare(SQUEALING, [f"{FRICTION}={mu}"])
    assert not np.allclose(sample(model).s, sample(undamped).s, rtol=1e-6)


@dataclass(frozen=True)
class MassDamping:
    """C = 2 a M, which moves every eigenvalue by -a: protocol ``DampingTerm``."""

    a: float  # [1/s]

    def matrix(self, brake):
        return (2 * self.a * brake.M).tocsr()


@pytest.mark.parametrize("method", ["full", "reduced"])
def test_a_damping_term_of_ones_own_in_a_scene(method):
    changes = [f"stability.method={method}", "samples.n=2"]
    damped = sample(prepare(SQUEALING, changes, extensions=Extensions(damping=[MassDamping(40.0)])))
    plain = sample(prepare(SQUEALING, changes))
    shifted = -40.0 + 1j * np.sqrt(-(plain.s**2) - 40.0**2)
    distance = abs(np.subtract.outer(shifted, damped.s)).min(axis=1)
    assert plain.s.size == damped.s.size and np.all(distance < 1e-5 * abs(shifted))


@dataclass(frozen=True)
class Triangular:
    """Symmetric triangle around the value in the scene: protocol ``InputLaw``."""

    share: float

    def quantile(self, u, nominal):
        u = np.asarray(u)
        right = 1 - np.sqrt(2 * (1 - np.maximum(u, 0.5)))
        return nominal * (1 + self.share * np.where(u < 0.5, np.sqrt(2 * u) - 1, right))


def test_a_law_of_a_random_input_of_ones_own():
    """The modes of a sample are those of the value that it drew."""
    own = Extensions(random={FRICTION: Triangular(0.2)})
    given = f"samples.random.'{FRICTION}'={{ law = 'uniform', spread = 0.5 }}"
    changes = ["countermeasures=[]", given, "samples.joint.n=40", "samples.approaches=['joint']"]
    model = prepare(SQUEALING, changes, extensions=own)
    nominal = read_scene(SQUEALING).contact["block_plate"].friction
    drawn = np.array([model.study.sample((ROUGH, k)).values[FRICTION] for k in range(40)])
    assert np.all(abs(drawn / nominal - 1) <= 0.2) and np.ptp(drawn) > 0.1 * nominal
    np.testing.assert_allclose(
        model.modes(approach=ROUGH, sample=3).s,
        model.modes({FRICTION: drawn[3]}, ROUGH, 3).s,
        rtol=1e-12,
    )


@pytest.mark.parametrize(
    ("own", "more", "said"),
    [
        (Extensions(friction={"pad": Stribeck(1, 1, 1)}), {}, "no interface 'pad'; .*block_plate"),
        (Extensions(random={"contact.pad.friction": Triangular(0.1)}), {}, "no .contact.pad"),
        (Extensions(damping=[MassDamping(1.0)]), {"cache": "cache"}, "leave out .*cache"),
    ],
)  # fmt: skip
def test_extensions_that_fit_no_scene(own, more, said):
    with pytest.raises(SceneError, match=said):
        prepare(SQUEALING, extensions=own, **more)
