"""Drivers of a scene's unstable modes against samples beside it, and against laws of scaling."""

from dataclasses import replace
from functools import cache

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.folder.store import Store
from brake_fenicsx.results.driver_tables import contact_driver_table, driver_table
from brake_fenicsx.results.stored import StoredSamples
from brake_fenicsx.samples.drivers import driver_arrays
from brake_fenicsx.samples.sampling import SMOOTH
from brake_fenicsx.samples.solve import modes_of_sample, reduced_modes
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene import read_scene
from coarse_block import BLOCK

MULTI = "multi-scale"
COARSE = [
    "parts.block.size='10 mm'", "parts.plate.size='14 mm'", "stability.band=['0 Hz','26 kHz']",
    "contact.block_plate.law={ p0='1 MPa', u0='0.3 um' }", "contact.block_plate.friction=0.8",
    "stability.drivers=true",
]  # fmt: skip
MANY = [
    "stages=['equilibrium','stability','uncertainty']", "stability.method=reduced", "samples.n=3",
    "samples.random.\"contact.block_plate.friction\"={ law='uniform', min=0.78, max=0.82 }",
    "stability.tolerance=1e-7",
]  # fmt: skip
CASES = {
    "full": [
        "stability.damping={ loss=true, omega_ref='15 kHz', rayleigh=['90 1/s','2 ns'] }",
        "materials.lining.loss=0.004", "stability.band=['0 Hz','16 kHz']",
    ],
    "random": [*MANY, "samples.random.\"materials.lining.C33\"={ law='uniform', spread=0.1 }"],
    "damped": [
        *MANY, "samples.random.\"parts.block.height\"={ law='uniform', spread=0.01 }",
        "stability.damping={ loss=true, omega_ref='15 kHz', rayleigh=['90 1/s','2 ns'],"
        " sliding=true }",
        "materials.lining.loss=0.004", "motion.speed='40 m/s'",
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """``studied(case)``: the study of a scene and what is stored of its first sample."""

    @cache
    def make(case):
        folder = tmp_path_factory.mktemp("run")
        scene = read_scene(BLOCK, [*COARSE, *CASES[case]])
        store = Store(folder / "out")
        store.check("")
        store.open("")
        study = Study(scene, assemble_brake(scene, MPI.COMM_SELF), SMOOTH, store, MPI.COMM_SELF)
        study.prepare()
        return study, study.work((MULTI, 0))

    return make


def growing(data):
    """Eigenvalues of the unstable modes [1/s]."""
    return data["s"][data["driver_mode"]]


def row(data, kind, parameter=None):
    """Derivatives to one parameter."""
    own = data["driver_kind"] == kind
    if parameter is not None:
        own &= data["driver_parameter"] == parameter
    assert own.sum() == 1
    return data["driver_value"][own][0]


def beside(study, sample):
    """Eigenvalues of another sample, at its own equilibrium."""
    eq = study.balance(sample, reduced=True)
    return modes_of_sample(study.models, sample, eq, by_reduction=True)["s"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("case", "kind"),
    [
        pytest.param("damped", "friction", marks=pytest.mark.slow),
        ("damped", "load"),
        ("random", "load"),
    ],
)
def test_friction_and_load_agree_with_samples_beside(studied, case, kind):
    """Central differences of whole samples: equilibrium, contact stiffness and pressures follow.

    Catches friction that acts in the modes alone, a load that leaves the contact as it is, and
    sliding damping that does not take the new pressures.
    """
    study, data = studied(case)
    sample, s = study.sample((MULTI, 0)), growing(data)
    pressure = study.scene.loads["block.top"].pressure

    def changed(x):
        if kind == "load":
            values = {**sample.values, "loads.block.top.pressure": pressure * (1 + x)}
            return replace(sample, brake=study.models.brake.at(values))
        friction = replace(sample.friction, mu=sample.friction.mu + x)
        return replace(sample, friction=friction)

    h = {"friction": 2e-4, "load": 5e-4}[kind]
    ends = [beside(study, changed(x)) for x in (h, -h)]
    ends = [e[np.abs(e[:, None] - s).argmin(axis=0)] for e in ends]
    exact = (ends[0] - ends[1]) / (2 * h)
    assert s.size
    np.testing.assert_allclose(row(data, kind), exact, rtol=1e-5)


def test_thickness_agrees_with_modes_beside(studied):
    """Central differences of the modes on the bodies alone; the damping follows them."""
    study, data = studied("damped")
    sample, s, key = study.sample((MULTI, 0)), growing(data), "parts.block.height"
    eq = study.balance(sample, reduced=True)

    def moved(x):
        own = study.models.brake.at({**sample.values, key: sample.values[key] * (1 + x)})
        return reduced_modes(study.models, replace(sample, brake=own), eq).s

    ends = [moved(x) for x in (1e-4, -1e-4)]
    ends = [e[np.abs(e[:, None] - s).argmin(axis=0)] for e in ends]
    assert s.size
    found = row(data, "length", key)
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / 2e-4, rtol=1e-3)


def total(data, kind):
    """Sum over the layers."""
    return data["driver_value"][data["driver_kind"] == kind].sum(axis=0)


def test_layers_and_contact_scale_as_a_whole(studied):
    """Undamped, lambda goes with the root of all stiffnesses over all masses.

    Catches a layer that is missing or counted twice, that has the scene's modulus in place of the
    sample's, and displacements that are not of full order.
    """
    _, data = studied("random")
    s, contact = growing(data), row(data, "contact stiffness")
    np.testing.assert_allclose(total(data, "stiffness") + contact, s / 2, rtol=1e-6)
    np.testing.assert_allclose(total(data, "mass"), -s / 2, rtol=1e-9)


def test_damping_follows_the_layers(studied):
    """All stiffnesses and masses by one factor, with the damping that they bring: no change."""
    _, data = studied("full")
    contact, mass = row(data, "contact stiffness"), total(data, "mass")
    off = total(data, "stiffness") + mass + contact
    assert np.all(np.abs(off) < 1e-6 * np.abs(mass))


def test_loss_factor_of_a_layer_acts_at_the_reference(studied):
    """d lambda / d eta from that to the stiffness, of the plate that has no loss factor itself."""
    _, data = studied("full")
    s, reference = growing(data), 2 * np.pi * 15e3
    stiffness = row(data, "stiffness", "plate.body") / (1 + s * 2e-9)
    loss = row(data, "loss factor", "plate.body")
    np.testing.assert_allclose(loss, s / reference * stiffness, rtol=1e-9)


def test_tables(studied):
    """First sample, medians by hand, maps that add up; only what the reduced model gives to all."""
    study, data = studied("random")
    study.run()
    found = StoredSamples(study.store, study.tasks)
    table = driver_table(found, 0.0).columns
    names = {*zip(table["parameter"], table["kind"], strict=True)}
    first, median = table["sample"] == "0", table["sample"] == "median"
    assert first.sum() == data["driver_value"].size == len(names) * growing(data).size
    assert {*table["kind"][median]} == {"friction", "load", "contact stiffness"}
    stored = [study.stored(task) for task in study.tasks]
    assert all(growing(d).size == 1 for d in stored) and {*table["modes"][median]} == {3}
    s = np.array([growing(d)[0] for d in stored])
    d = np.array([row(d, "friction")[0] for d in stored])
    by_hand = np.median(d.real), np.median((-2 * (s + d * 1e-6).real / (s + d * 1e-6).imag
                                            + 2 * s.real / s.imag) / 1e-6)  # fmt: skip
    i = np.flatnonzero(median & (table["kind"] == "friction"))[0]
    assert table["dalpha_dp_1_s"][i] == pytest.approx(by_hand[0], rel=1e-12)
    assert table["ddamping_dp"][i] == pytest.approx(by_hand[1], rel=1e-3)
    maps = contact_driver_table(found, 0.0).columns
    contact = first & (table["kind"] == "contact stiffness")
    np.testing.assert_allclose(
        maps["dalpha_dlnk_1_s"].sum(), table["dalpha_dp_1_s"][contact][0], rtol=1e-9
    )
    growth = 4 * np.pi * s[0].real / s[0].imag
    assert maps["friction_work"].sum() == pytest.approx(growth, rel=1e-5)


def test_a_sample_without_unstable_modes_has_no_drivers(studied):
    """Without friction nothing grows; the tables are empty."""
    study, _ = studied("random")
    sample = study.sample((MULTI, 0))
    sample = replace(sample, friction=replace(sample.friction, mu=0 * sample.friction.mu))
    eq = study.balance(sample, reduced=True)
    modes = reduced_modes(study.models, sample, eq)
    partner = np.full(len(modes), -1)
    assert driver_arrays(study.equilibria, sample, eq, True, modes, partner, True) == {}
    assert driver_table(StoredSamples(study.store, []), 0.0).columns["family"].size == 0
