"""Modes of a part against tests written by pyuff from independent data.

Bar: Timoshenko's free beam in closed form (numerically solved determinant). Disc: a finer mesh of
other cells, its shapes at measured points, with noise and an arbitrary phase.
"""

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.measured.part_modes import part_modes, shapes_at
from brake_fenicsx.extras.measured.study import paired
from brake_fenicsx.extras.measured.universal import read_modes
from brake_fenicsx.mac import mac
from brake_fenicsx.scene import read_scene
from free_beam import HEIGHT, LENGTH, RHO, E, free_beam
from places import SCENES
from run_tables import read_columns
from universal_files import geometry, write_sets

pyuff = pytest.importorskip("pyuff")
BLOCK, BRAKE = SCENES / "block_on_plate.toml", SCENES / "disc_brake_demo.toml"
# The plate as a bar of iron, its top at z = 0.
BAR = [
    "parts.plate.length='200 mm'", "parts.plate.width='20 mm'", "parts.plate.height='12 mm'",
    "parts.plate.z='-12 mm'", "parts.plate.size='6 mm'", "mesh.cells=hexahedra",
]  # fmt: skip
DISC = ["parts.disc.size='20 mm'", "mesh.order=2"]


def write_test(
    path, points, shapes, frequencies, unit=1.0, damping=0.01, extra=(), old=False, system=0,
    definition=0,
):  # fmt: skip
    """A universal file as test software writes it; shapes (modes, points, 3), real or complex."""
    kind = 15 if old else 2411
    sets = [*extra, *geometry(points, unit, 101, kind, definition, system)]
    for i, (u, f) in enumerate(zip(shapes, frequencies, strict=True), start=1):
        mode = {"type": 55, "data_ch": 2, "spec_data_type": 12, "load_case": 1, "mode_n": i,
                "node_nums": 101 + np.arange(len(points)),
                "r1": u[:, 0], "r2": u[:, 1], "r3": u[:, 2]}  # fmt: skip
        omega = 2 * np.pi * f
        eig = omega * complex(-damping / np.sqrt(1 - damping**2), 1)
        kinds = {"analysis_type": 2, "freq": f, "modal_damp_vis": damping}
        if np.iscomplexobj(u):
            kinds = {"analysis_type": 3, "eig": eig}
        sets.append(mode | kinds)
    write_sets(path, sets)


def measured(shapes, rng, noise=0.01):
    """Shapes with noise in what is measured, each with a complex scale of its own."""
    size = np.abs(shapes).max(axis=(1, 2), keepdims=True)
    noisy = shapes / size + noise * rng.standard_normal(shapes.shape) * (shapes != 0)
    return noisy * (3.0 * np.exp(2j * np.pi * rng.random(len(shapes))))[:, None, None]


def correlated(scene, test, part, changes, folder):
    """The tables of a correlation."""
    words = [w for change in changes for w in ("--set", change)]
    words = ["correlate", scene, test, "--part", part, "-o", folder, *words]
    assert main([*map(str, words)]) == 0
    return read_columns(folder / "correlation.csv"), read_columns(folder / "mac.csv")


def bar_test(path, **how):
    """A test of the bar, z at its top alone, from beam theory."""
    modes = free_beam(4)
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-0.1, 0.1, 13), [-0.007, 0.0085]))
    shapes = np.zeros((4, x.size, 3))
    shapes[:, :, 2] = [w(x) for _, w in modes]
    shapes = measured(shapes, np.random.default_rng(4))
    points = np.column_stack([x, y, np.zeros(x.size)])
    write_test(path, points, shapes, [f for f, _ in modes], **how)


def test_the_beam_is_that_of_bernoulli_but_for_shear():
    slender = 4.730041**2 / (2 * np.pi * LENGTH**2) * np.sqrt(E * HEIGHT**2 / 12 / RHO)
    ratio = free_beam(1)[0][0] / slender
    assert 0.98 < ratio < 0.99


def test_bar(tmp_path, capsys):
    """Test of a free bar in mm, in one direction, against beam theory."""
    bar_test(tmp_path / "bar.unv", unit=1e3)
    found, mac = correlated(BLOCK, tmp_path / "bar.unv", "plate", BAR, tmp_path / "out")
    assert np.all(found["mac"][:4] > 0.99) and np.all(found["combined"][:3] == 1)
    # From above: the mesh is too stiff.
    assert np.all((found["difference"][:4] > 0) & (found["difference"][:4] < 0.005))
    assert found["test_damping_ratio"][:4] == pytest.approx(0.01, rel=1e-4)
    assert mac["mac"].size == 4 * mac["model_mode"].max()
    said = capsys.readouterr().out
    assert "6 rigid-body modes left out; 26 points, 26 directions, at most" in said
    assert f"open {tmp_path / 'out' / 'correlation.png'}" in said
    assert (tmp_path / "out" / "correlation.png").is_file()


def disc_points():
    """Two circles on the disc's face, one on its rim."""
    angle, place = 2 * np.pi * np.arange(24) / 24, []
    for radius, z in ((0.1, 0.01), (0.14, 0.01), (0.144, 0.002)):
        place.append(
            np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle + z])
        )
    return np.concatenate(place)


def test_disc(tmp_path):
    """Doublets of a finer mesh turned by 17 degrees, 1.3 % stiffer, noise, complex scale, no z on
    the rim and nothing else than z elsewhere."""
    scene = read_scene(BRAKE, ["parts.disc.size='14 mm'", "mesh.order=2", "mesh.cells=hexahedra"])
    points, angle = disc_points(), np.radians(17.0)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]]
    )
    modes = part_modes(scene, "disc", points, 2800.0)
    assert modes.rigid == 6
    values, distance, _ = shapes_at(modes, points @ turn)
    # 24 points of a circle meet the curved facets of second order.
    assert distance.max() < 2e-5
    shapes = np.einsum("cd,pdm->mpc", turn, values)
    rim = points[:, 2] < 0.01
    shapes[:, rim, 2], shapes[:, ~rim, :2] = 0.0, 0.0
    shapes = measured(shapes, np.random.default_rng(1))
    write_test(tmp_path / "disc.unv", points, shapes, 1.013 * modes.frequency, unit=1e3)
    found, mac = correlated(BRAKE, tmp_path / "disc.unv", "disc", DISC, tmp_path / "out")
    tests = len(modes.frequency)
    assert np.all(found["mac"][:tests] > 0.99)
    assert np.abs(found["difference"][:tests] + 1 - 1 / 1.013).max() < 0.01
    assert np.count_nonzero(found["combined"][:tests] == 2) >= 4
    square = mac["mac"].reshape(tests, -1)
    for i, j in enumerate(found["model_mode"][:tests].astype(int) - 1):
        assert np.sort(square[i])[-2] < 0.2 and square[i, j] > 0.99


def test_local_coordinate_systems(tmp_path):
    """Positions and directions in mm: Cartesian of datasets 2420 and 18, cylindrical."""
    points = np.random.default_rng(2).standard_normal((5, 3))
    motion = np.random.default_rng(3).standard_normal((1, 5, 3))
    # The first has z, x, y for its axes, the second y, z, x, the third r, theta, x about a line.
    turned = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0], [10.0, 20, 30]])
    about_x = np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0], [0, 4.0, -6.0]])
    extra = [
        {"type": 2420, "Part_UID": 1, "Part_Name": "bar", "CS_sys_labels": [1, 3],
         "CS_types": [0, 1], "CS_colors": [0, 0], "CS_names": ["a", "c"],
         "CS_matrices": [turned, about_x]},
        {"type": 18, "cs_num": [2], "ref_cs_num": [0], "ref_o": [[1.0, 1, 1]],
         "x_point": [[1.0, 3, 1]], "xz_point": [[9.0, 3, 1]]},
    ]  # fmt: skip
    y, z = (points[:, 1:] - [4e-3, -6e-3]).T
    angle, none = np.arctan2(z, y), 0 * y
    radial = np.column_stack([none, np.cos(angle), np.sin(angle)])
    around = np.column_stack([none, -np.sin(angle), np.cos(angle)])
    axes = {
        1: np.broadcast_to(turned[:3], (5, 3, 3)),
        2: np.broadcast_to(np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]]), (5, 3, 3)),
        3: np.stack([radial, around, np.broadcast_to([1.0, 0, 0], (5, 3))], axis=1),
    }
    # Dataset 15 has positions in the definition system.
    cylinder = np.column_stack([np.hypot(y, z) * 1e3, np.degrees(angle), points[:, 0] * 1e3])
    for system, rows in axes.items():
        path, given = tmp_path / f"{system}.unv", points * 1e3
        shapes = np.einsum("pac,mpc->mpa", rows, motion)
        how = {"old": True, "definition": 3} if system == 3 else {}
        given = cylinder if system == 3 else given
        write_test(path, given / 1e3, shapes, [100.0], 1e3, extra=extra, system=system, **how)
        found = read_modes(path)
        assert np.allclose(found.points, points, atol=2e-6), system
        back = np.einsum("mpa,pac->mpc", found.shapes, found.axes)
        assert np.allclose(back, motion, atol=2e-5), system
    write_test(path, points, motion, [100.0], system=1, definition=1)
    np.testing.assert_allclose(read_modes(path).shapes, motion, atol=2e-5)
    write_test(path, points, motion, [100.0], system=7)
    with pytest.raises(SceneError, match="coordinate system 7 is missing"):
        read_modes(path)


def test_damping_and_frequency_of_both_kinds_of_modes(tmp_path):
    """Complex eigenvalues and a normal mode; the damping ratio of a growing mode is negative."""
    points, shape = np.eye(3), np.eye(3)[None]
    for u, ratio in ((shape, 0.03), (1j * shape, 0.03), (1j * shape, -0.02)):
        write_test(tmp_path / "t.unv", points, u, [123.0], damping=ratio)
        found = read_modes(tmp_path / "t.unv")
        assert found.frequency[0] == pytest.approx(123.0, rel=1e-5)
        assert found.damping[0] == pytest.approx(ratio, rel=1e-4)
        assert np.array_equal(found.seen, np.eye(3, dtype=bool))


def test_a_test_that_is_of_no_use_is_refused_with_one_line(tmp_path, capsys):
    good = tmp_path / "good.unv"
    bar_test(good)
    sets = pyuff.UFF(str(good)).read_sets()

    def refused(name, words=(), change=None, where=None):
        path = tmp_path / name
        if change is not None:
            write_sets(path, change)
        out = tmp_path / "out"
        given = [w for c in BAR for w in ("--set", c)] + list(words)
        assert main(["correlate", str(BLOCK), str(path), "-o", str(out), *given]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and not out.exists()
        assert (str(path) if where is None else where) in said
        return said

    part = ("--part", "plate")
    assert "no such file" in refused("none.unv", part)
    (tmp_path / "text.unv").write_text("not a universal file\n")
    assert "no dataset at all" in refused("text.unv", part)
    assert "export the geometry" in refused(
        "no_nodes.unv", part, [s for s in sets if s["type"] != 2411]
    )
    no_modes = [s for s in sets if s["type"] != 55]
    assert "contains no modes" in refused("no_modes.unv", part, no_modes)
    (tmp_path / "responses.unv").write_text(f"{-1:6}\n{58:6}\nfrequency responses\n{-1:6}\n")
    assert "cannot be read as a universal file" in refused("responses.unv", part)
    lost = [dict(s) for s in sets]
    lost[1] = {k: v[1:] if np.ndim(v) else v for k, v in lost[1].items()}
    assert "node 101 of the modes has no position" in refused("lost.unv", part, lost)
    for length, what in ((1e3, "all nodes lie within 0.2 mm"), (1e-3, "from the surface of part")):
        wrong = [dict(s) for s in sets]
        wrong[0]["length"] = length
        said = refused("unit.unv", part, wrong)
        assert what in said and "dataset 164" in said
    assert "name one with --part" in refused("good.unv", where=str(BLOCK))
    surface = tmp_path / "surface.toml"
    surface.write_text('stages = ["surface"]\n[surface]\nstatistics = { S_q = "3 um" }\n')
    assert main(["correlate", str(surface), str(tmp_path / "good.unv")]) == 2
    assert "the scene has no part" in capsys.readouterr().err
    assert "there are block, plate" in refused("good.unv", ("--part", "disc"), where=str(BLOCK))


def test_doublet_of_which_one_mode_was_measured():
    """Turned by any angle it is found whole; what is left of the doublet is no other mode's."""
    rng = np.random.default_rng(0)
    shapes = np.linalg.qr(rng.standard_normal((30, 4)))[0].T
    angle, phase = 0.7, np.exp(2.1j)
    doublet = 5 * phase * (np.cos(angle) * shapes[1] + np.sin(angle) * shapes[2])
    stray = rng.standard_normal(30) @ (np.eye(30) - shapes.T @ shapes)
    tests = np.array([doublet, stray, -1j * shapes[3]])
    found = paired(
        tests, np.array([501.0, 600.0, 900.0]), shapes, np.array([200, 500, 500.5, 900.0])
    )
    assert list(found.mode) == [1, -1, 3] and list(found.combined) == [1, 2, 2, 1]
    assert mac(tests[:1].T, shapes.T)[0, 1] == pytest.approx(np.cos(angle) ** 2)
    assert found.mac == pytest.approx(
        np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1.0]]), abs=1e-12
    )
    # The same shape at twice the frequency and more is another mode.
    far = paired(tests, np.array([1100.0, 1200, 2000]), shapes, np.array([200, 500, 500.5, 900.0]))
    assert list(far.mode) == [-1, -1, -1]


def test_one_of_two_pads_and_its_supports():
    """A part of two bodies stands for the one that was measured; its supports hold it on demand."""
    changes = ["parts.pad.size='20 mm'", "parts.pad.plate_size='20 mm'", "mesh.quality=0.01"]
    scene = read_scene(BRAKE, changes)
    below = np.array([[0.0, 0.118, -0.018], [0.02, 0.12, -0.018]])
    free = part_modes(scene, "pad", below, 4000.0)
    assert free.rigid == 6 and free.mesh.domain.geometry.x[:, 2].max() < 0
    assert np.all(np.diff(free.frequency) > 1.0), "two pads would have each frequency twice"
    held = part_modes(scene, "pad", below, 4000.0, supported=True)
    # The ears hold x and y over their thickness: what is left is the translation along z.
    assert held.rigid == 1 and held.free.size < free.free.size
