"""The coupling of the kept modes by responses between the factors, against factors and dense K."""

import numpy as np
import pytest

from brake_fenicsx.stability import Parameters, ReducedModel, reduce_bodies
from reduced_samples import BAND, K0, Sample, box, coefficients, scattered, substructures

# Of the stiffness of perfect contact.
SOFT = 0.1


def made(scene, contact, parameters=None, case="undamped", tolerance=1e-5):
    """Arrays of a reduced model, and its factors."""
    done, arrays = [], {}
    model = reduce_bodies(
        substructures(scene, case, True), scene.w, BAND, parameters or box(scene, case),
        contact=contact, comm=scene.comm, tolerance=tolerance,
        progress=lambda total: done.append, keep=lambda own: arrays.update(own) or own,
    )  # fmt: skip
    return model, arrays, sum(done)


def rough(scene, x=(), mu=0.5, seed=3):
    """A sample in rough contact."""
    return Sample(scene, x=x, mu=mu, k=SOFT * scattered(scene, seed))


def pad(arrays):
    """Number of the body whose materials change."""
    return next(name.split(".")[0] for name in arrays if ".change" in name)


def test_responses_give_the_coupling_where_there_is_no_factor(two_blocks):
    """As factors at all anchors do, to a third of what the interpolation between these lacks."""
    scene = two_blocks("coarse")
    (_, found, few), (_, exact, many) = (made(scene, c) for c in (rough(scene).contact, None))
    assert few < 0.7 * many
    i, modes = pad(found), found[f"{pad(found)}.W"].shape[1]
    rows = found[f"{i}.elements"].size
    places = (..., slice(rows, rows + modes), slice(2 * rows, 2 * rows + modes))
    for n in range(len(found[f"{i}.degrees"])):
        anchors = len(found[f"{i}.coupling.D{n}"])
        assert anchors > len(found[f"{i}.D{n}"])
        known = exact[f"{i}.D{n}"][:anchors][places]
        off = np.linalg.norm(found[f"{i}.coupling.D{n}"] - known)
        lacking = np.linalg.norm(exact[f"{i}.checks"][:, n][places])
        assert off < 0.3 * lacking + 1e-6 * np.linalg.norm(known)


def test_round_off_of_responses_acts_by_its_square(two_blocks):
    """At small errors the points that are checked see the same ones as with all factors."""
    scene = two_blocks("coarse")
    narrow = box(scene, "undamped", 0.1)
    (_, found, _), (_, exact, _) = (
        made(scene, c, narrow, tolerance=3e-7) for c in (rough(scene).contact, None)
    )
    i, modes = pad(found), found[f"{pad(found)}.W"].shape[1]
    np.testing.assert_array_equal(found["orders"], exact["orders"])
    rows = found[f"{i}.elements"].size
    places = (..., slice(rows, rows + modes), slice(2 * rows, 2 * rows + modes))
    own, known = (
        np.sqrt(np.sum(np.square(A, dtype=float), axis=(0, 2, 3)))
        for A in (found[f"{i}.coupling.checks"], exact[f"{i}.checks"][places])
    )
    assert np.all(own < 3 * known)


@pytest.mark.parametrize("x", [(0.0, 0.0), (0.45, -0.8), (-1.0, 1.0), (1.0, 1.0)])
def test_every_mode_in_rough_contact(two_blocks, x):
    """Within the tolerance at dense full order, errors covered; as with factors at all anchors."""
    scene = two_blocks("coarse")
    sample = rough(scene, x, seed=5)
    off = [
        sample.agrees(sample.modes(made(scene, contact)[0]))
        for contact in (rough(scene).contact, None)
    ]
    assert off[0] < 1e-5 and off[0] < 3 * off[1] + 1e-6


def test_contact_that_is_too_stiff_takes_more_levels(two_blocks):
    """In perfect contact what is left out counts: estimates say so, and the model is made again."""
    scene = two_blocks("coarse")
    sample = Sample(scene, x=(0.45, -0.8), k=np.full(scene.w.size, K0))
    model, arrays, _ = made(scene, sample.contact, tolerance=1e-6)
    assert sample.agrees(sample.modes(model)) < 1e-5
    assert f"{pad(arrays)}.coupling.D" in arrays


def test_one_parameter_and_what_is_damped_or_of_another_shape(two_blocks):
    """One parameter is interpolated so too; what is damped, shaped or coarse has all factors."""
    scene = two_blocks("coarse")
    one = Parameters(
        1, lambda x: np.array([c := coefficients()([x[0], 0.0]), 0 * c, 0 * c]), 1 / 1.2
    )
    model, arrays, few = made(scene, rough(scene).contact, one)
    assert f"{pad(arrays)}.coupling.D" in arrays and few < made(scene, None, one)[2]
    x = np.array([0.7])
    sample = rough(scene, (0.7, 0.0))
    assert sample.agrees(model.modes(x, sample.contact)) < 1e-5
    shaped = Parameters(2, box(scene, "undamped").coefficients, 1 / 1.2, shapes=(0,))
    for given in ({"parameters": shaped}, {"case": "loss"}, {"tolerance": 1e-3}):
        arrays = made(scene, rough(scene).contact, **given)[1]
        assert not any("coupling.D" in name for name in arrays)


def test_what_was_made_earlier_gives_the_same_bytes(two_blocks):
    """The arrays alone make the model again."""
    scene = two_blocks("coarse")
    model, arrays, _ = made(scene, rough(scene).contact)
    again = ReducedModel(arrays, scene.w, BAND, box(scene, "undamped"))
    sample = rough(scene, (0.3, -0.5))
    a, b = sample.modes(model), sample.modes(again)
    np.testing.assert_array_equal(a.s, b.s)
    np.testing.assert_array_equal(a.error, b.error)


@pytest.mark.together
def test_processes_share_the_responses(two_blocks):
    """Modes to round-off of single precision, however many processes hold them."""
    found = []
    for alone in (True, False):
        scene, whole = (two_blocks("coarse", alone=own) for own in (alone, True))
        model = reduce_bodies(
            substructures(scene, "undamped", True), scene.w, BAND, box(scene, "undamped"),
            contact=rough(whole).contact, comm=scene.comm,
        )  # fmt: skip
        found.append(rough(whole, (0.2, 0.1)).modes(model))
    a, b = found
    assert len(a) == len(b)
    assert np.all(np.abs(a.s - b.s) <= 1e-8 * np.abs(a.s))
