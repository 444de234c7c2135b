"""Damping ratios of the parts, against closed forms and a dense damping matrix."""

import json
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from brake_fenicsx.build.brake import assemble_brake
from brake_fenicsx.build.damping_terms import with_modal_damping
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.elasticity import layer_masses
from brake_fenicsx.pipeline import run
from brake_fenicsx.scene import read_scene
from brake_fenicsx.stability import reduce_bodies, split_substructures
from brake_fenicsx.stability.substructures import CONSTANT
from brake_fenicsx.stability.substructures.substructure import ModalRatio, mirror_image
from coarse_block import BLOCK, ROUGH
from dense_reference import Dense
from reduced_samples import BAND, HIGH, ZETA, Sample, box, substructures

SELF = MPI.COMM_SELF
FREQUENCY, RATIO = np.array([5e3, 40e3]), np.array([0.002, 0.03])
FIRST = "stability.damping.modal={ block={ ratio=0.02 } }"
BOTH = (
    "stability.damping.modal={ block={ ratio=0.02 },"
    " plate={ ratio=[0.004, 0.02], frequency=['1 kHz', '20 kHz'] } }"
)


def with_ratios(bodies):
    """A ratio that rises with the frequency for the first body, one number for the second."""
    given = [(FREQUENCY, RATIO), (np.zeros(0), np.array([0.01]))]
    return [
        replace(body, ratios=(ModalRatio(body.M, f, zeta),))
        for body, (f, zeta) in zip(bodies, given, strict=True)
    ]


def zeta_of(number, f):
    return np.interp(f, FREQUENCY, RATIO) if number == 0 else np.full(f.shape, 0.01)


def reduced(scene, changing):
    bodies = with_ratios(substructures(scene, "undamped", changing))
    parameters = box(scene, "undamped") if changing else CONSTANT
    return reduce_bodies(bodies, scene.w, BAND, parameters)


def damping(scene, bodies, kept, cutoff=None):
    """C by the ratios of the lowest modes of each body, so many are kept, and beyond a cutoff."""
    C = np.zeros(scene.K.shape)
    for i, (body, count) in enumerate(zip(bodies, kept, strict=True)):
        K, M = (A[body.dofs][:, body.dofs].toarray() for A in (scene.K, scene.M))
        kappa, W = la.eigh(K, M, subset_by_index=[0, count - 1])
        omega = np.sqrt(np.maximum(kappa, 0.0))
        own = M @ W @ np.diag(2 * zeta_of(i, omega / 2 / np.pi) * omega) @ W.T @ M
        if cutoff is not None:
            zeta = zeta_of(i, np.array([cutoff / 2 / np.pi]))[0]
            Q = np.eye(len(K)) - W @ W.T @ M
            own += Q.T @ (zeta * (2 * cutoff * M + K / (4 * cutoff))) @ Q
        C[np.ix_(body.dofs, body.dofs)] = own
    return sp.csr_matrix(C)


def test_modes_of_parts_alone_have_their_ratio(two_blocks):
    """No contact: lambda = omega (-zeta + i sqrt(1 - zeta^2)) of every mode of the bodies."""
    scene = two_blocks("coarse")
    model = reduced(scene, False)
    sample = Sample(scene, mu=0.0, k=np.zeros(scene.w.size))
    exact = []
    for i, body in enumerate(model.bodies):
        omega = np.sqrt(np.maximum(body.component.kappa, 0.0))
        zeta = zeta_of(i, omega / 2 / np.pi)
        exact.append(omega * (-zeta + 1j * np.sqrt(1 - zeta**2)))
    exact = np.concatenate(exact)
    exact = exact[(exact.imag > 1e-3 * HIGH) & (exact.imag <= HIGH)]
    found = sample.modes(model).s
    found = found[found.imag > 1e-3 * HIGH]
    assert found.size == exact.size > 5
    order = np.argsort(exact.imag)
    np.testing.assert_allclose(np.sort_complex(1j * found.conj()), 1j * exact[order].conj(), 1e-7)


@pytest.mark.parametrize("x", [(), (0.4, -0.8)], ids=["constant", "changing"])
def test_every_mode_of_bodies_with_ratios(two_blocks, x):
    """C of the kept modes and of what they leave out: none missed, errors covered, verdicts right.

    Under changing moduli C stays that of the centre of the box.
    """
    scene = two_blocks("coarse")
    model = reduced(scene, bool(x))
    sample = Sample(scene, "undamped", x, mu=0.5, seed=4)
    softening = box(scene, "undamped").softening if x else 1.0
    cutoff = model.bodies[0].component.reach * HIGH / np.sqrt(softening)
    C = damping(scene, model.bodies, [b.modes.stop - b.modes.start for b in model.bodies], cutoff)
    modes = sample.modes(model)
    dense = Dense(sample.M, C, sample.K, HIGH, ZETA)
    assert dense.agrees(modes) < 2e-6
    # The ratios matter: without them some of the modes are unstable that are not with them.
    assert np.median(-modes.s.real / np.abs(modes.s)) > 2e-3


def test_modes_beyond_the_cutoff_are_damped_too(two_blocks):
    """Full order with the ratios of all modes: alpha within 4 % for every cutoff.

    Without damping beyond the cutoff it is up to 22 % off, and different for every cutoff.
    """
    scene = two_blocks("coarse")
    bodies = with_ratios(substructures(scene, "undamped", False))
    sample = Sample(scene, "undamped", mu=0.5, seed=4)
    C = damping(scene, bodies, [b.dofs.size for b in bodies])
    dense = Dense(sample.M, C, sample.K, HIGH, ZETA)
    for cutoff in (None, 1.5 * BAND[1], 4 * BAND[1]):
        model = reduce_bodies(bodies, scene.w, BAND, cutoff=cutoff)
        s = sample.modes(model).s
        s = s[s.imag > 1e-3 * HIGH]
        alpha = np.array([dense.sharp(value) for value in s]).real
        assert s.size > 5 and np.all(np.abs(s.real - alpha) < 0.04 * np.abs(alpha))


def test_tied_parts_share_their_ratios_by_kinetic_energy():
    """One body of two glued parts: the mean of two ratios; that of both where they are equal."""
    cap = [
        'parts.cap={ builder="block", length="30 mm", width="24 mm", height="8 mm", z="20 mm",'
        ' size="9 mm", material="iron" }',
        'ties={ glue={ faces=["block.top", "cap.bottom"] } }', "loads={}",
    ]  # fmt: skip
    scene = read_scene(BLOCK, [*ROUGH, *cap, FIRST])
    brake = assemble_brake(scene, SELF)
    density = dict.fromkeys(brake.mesh.layers, 2000.0)
    masses = layer_masses(brake.mesh, brake.elastic.free, density)
    M = sum(masses.values()).tocsr()
    apart = split_substructures(brake.K, M, {"N": brake.N, "T": brake.T, "R": brake.R})
    glued, plate = sorted(with_modal_damping(scene, apart, masses), key=lambda b: -len(b.ratios))
    assert len(glued.ratios) == 2 and not plate.ratios
    kappa, W = la.eigh(glued.K.toarray(), glued.M.toarray(), subset_by_index=[0, 11])
    block = masses["block.body"][glued.dofs][:, glued.dofs]
    share = np.sum(W * (block @ W), axis=0)
    assert 0.05 < share.min() < 0.5 < share.max() < 1
    expected = 2 * 0.02 * share * np.sqrt(np.maximum(kappa, 0.0))
    np.testing.assert_allclose(glued.modal_damping(W, kappa), expected, rtol=1e-10)
    both = FIRST.replace("}", "}, cap={ ratio=0.02 }", 1)
    same = with_modal_damping(read_scene(BLOCK, [*ROUGH, *cap, both]), [glued], masses)[0]
    expected = 2 * 0.02 * np.sqrt(np.maximum(kappa, 0.0))
    np.testing.assert_allclose(same.modal_damping(W, kappa), expected, rtol=1e-10)


def test_bodies_of_other_ratios_are_no_mirror_images(two_blocks):
    """The same body twice is its own image; with another ratio it is none."""
    scene = two_blocks("coarse")
    body = with_ratios(substructures(scene, "undamped", False))[0]
    n = body.dofs.size
    places = np.column_stack([np.random.default_rng(1).random((n, 3)), np.arange(n) % 3])
    body = replace(body, points=places)
    assert mirror_image(body, body) is not None
    other = replace(body, ratios=(replace(body.ratios[0], ratio=2 * RATIO),))
    assert mirror_image(body, other) is None
    assert mirror_image(body, replace(body, ratios=())) is None


def test_a_scene_with_ratios(tmp_path):
    """Modes without flutter have a ratio between those of the parts; the summary names them."""
    told = ["samples.n=1", "stability.zeta_max=0.3"]
    told += ["parts.block.size='10 mm'", "parts.plate.size='14 mm'"]
    run(BLOCK, SELF, tmp_path / "none", [*ROUGH, *told, "stability.method=reduced"])
    run(BLOCK, SELF, tmp_path / "both", [*ROUGH, *told, BOTH])
    summary = json.loads((tmp_path / "both" / "summary.json").read_text())
    assert summary["damping"]["modal"]["block"]["ratio"] == 0.02
    s = [
        np.load(tmp_path / name / "samples" / "multi-scale-00000.npz")["s"]
        for name in ("none", "both")
    ]
    assert s[0].size == s[1].size > 15
    alone = s[0].real == 0
    zeta = -(s[1].real / np.abs(s[1]))[alone]
    assert 0.004 <= zeta.min() < zeta.max() <= 0.02


@pytest.mark.parametrize(
    "changes, text",
    [
        (["stability.damping.modal={ disc={ ratio=0.01 } }"], "there is no part 'disc'"),
        (["stability.damping.modal={ block={ ratio=1.5 } }"], "below 1"),
        (["stability.damping.modal={ block={ ratio=0 } }"], "some above 0"),
        (["stability.damping.modal={ block={ ratio=[] } }"], "some above 0"),
        (["stability.damping.modal={ block={ ratio=-0.1 } }"], "zero or more"),
        (["stability.damping.modal={ block={} }"], "ratio: missing"),
        (["stability.damping.modal={ block={ ratio=[0.1, 0.2] } }"], "0 frequencies for 2"),
        (
            ["stability.damping.modal={ block={ ratio=0.1, frequency=['1 kHz'] } }"],
            "1 frequencies for 1",
        ),
        (
            [
                "stability.damping.modal={ block={ ratio=[0.1, 0.2],"
                " frequency=['2 kHz', '1 kHz'] } }"
            ],
            "must rise",
        ),
        ([FIRST, "stability.method=full"], 'stability.method = "reduced"'),
        ([FIRST, "stability.verify=1"], "stability.verify = 0"),
        ([FIRST, "stability.on_tolerance='full order'"], "on_tolerance"),
        ([FIRST, "stability.drivers=true"], "stability.drivers = false"),
    ],
)
def test_mistakes(changes, text):
    with pytest.raises(SceneError) as error:
        read_scene(BLOCK, [*ROUGH, *changes])
    assert text in str(error.value)
