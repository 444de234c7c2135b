"""Frequency responses: closed forms of two masses and of a beam, and the full system solved."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from brake_fenicsx.cli import main
from brake_fenicsx.extras.measured.part_modes import (
    Damped,
    frac,
    part_body,
    real_modes,
    receptances,
    surface_rows,
)
from brake_fenicsx.extras.measured.response_study import POINTS, _damped
from brake_fenicsx.scene import read_scene
from free_beam import HEIGHT, LENGTH, NU, RHO, WIDTH, E, beam
from places import SCENES
from run_tables import read_columns
from universal_files import function, geometry, write_sets

pytest.importorskip("pyuff")
PAD = SCENES / "lining_pad.toml"
BETA = 3e-6
BAR = f"""\
stages = []
[mesh]
cells = "hexahedra"
[parts.bar]
builder = "block"
length = "200 mm"
width = "20 mm"
height = "12 mm"
z = "-12 mm"
size = "6 mm"
material = "iron"
[materials.iron]
model = "isotropic"
E = "{E} Pa"
nu = {NU}
rho = "{RHO} kg/m^3"
[stability]
band = ["200 Hz", "9 kHz"]
[stability.damping]
rayleigh = [0, "{BETA} s"]
"""
LOSSY = BAR.partition("[stability.damping]")[0].replace("[stability]", "loss = {loss}\n[stability]")


def test_the_closed_form_of_the_beam_at_rest_is_a_rigid_body():
    mass, f = RHO * LENGTH * WIDTH * HEIGHT, 2.0
    rigid = -(np.array([4.0, 1.0, -2.0])) / (mass * (2 * np.pi * f) ** 2)
    found = beam(f, np.array([-0.5, 0.0, 0.5]) * LENGTH, BETA)
    turning = 1 + HEIGHT**2 / LENGTH**2  # inertia of rotation
    np.testing.assert_allclose(found, rigid, rtol=2 * (turning - 1))


def write_responses(path, points, responses, **labels):
    """A universal file of accelerances, nodes 1, 2, ... in mm; responses (frequency, values)."""
    own = [function(*pair, node, **labels) for node, pair in enumerate(responses, start=2)]
    write_sets(path, [*geometry(points, 1e3), *own])


@pytest.mark.long
@pytest.mark.parametrize("loss", [None, 0.05])
def test_a_bar_beside_its_closed_form(loss, tmp_path, capsys):
    """Accelerances of a free beam, in mm/s^2 over N: beta K, or E (1 + i eta) at any omega_ref."""
    scene, test, out = tmp_path / "bar.toml", tmp_path / "bar.unv", tmp_path / "out"
    scene.write_text(BAR if loss is None else LOSSY.format(loss=loss))
    x, f = np.array([0.0, 0.05, 0.1]), np.linspace(0, 6000, 601)
    beta = np.full(600, BETA) if loss is None else loss / (2 * np.pi * f[1:])
    H = np.array([np.zeros(3), *(beam(one, x, b) for one, b in zip(f[1:], beta, strict=True))]).T
    points = [(-LENGTH / 2, 0, 0), *((one, 0.0, 0.0) for one in x)]
    accelerance = -1e3 * (2 * np.pi * f) ** 2 * H
    write_responses(test, points, [(f, a) for a in accelerance])
    assert main(["correlate", str(scene), str(test), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "modes and residual vectors" in said and "no damping" not in said
    rows = read_columns(out / "frac.csv")
    assert np.all(rows["frac"] > 0.99)
    np.testing.assert_allclose(rows["test_over_model"], 1, rtol=0.05)
    cells = read_columns(out / "responses.csv")
    test, model = (cells[f"{a}re_m_N"] + 1j * cells[f"{a}im_m_N"] for a in ("test_", ""))
    np.testing.assert_allclose(test, np.concatenate([h[f >= 200] for h in H]), rtol=1e-4)
    low = cells["frequency_hz"] < 1000  # at a zero of the response a ratio tells nothing
    for number in (1, 2, 3):
        own = low & (cells["response"] == number)
        assert np.abs(model - test)[own].max() < 2e-3 * np.abs(test[own]).max()
    assert (out / "responses.png").is_file() and (out / "responses.svg").is_file()


def test_two_masses():
    """k - m - k - m: H = adj(D) / det(D); a dashpot, k (1 + i eta), and a ratio of a mode."""
    k, m, c = 3e6, 0.5, 40.0
    K, M = k * np.array([[2.0, -1], [-1, 1]]), m * np.eye(2)
    C = c * np.array([[1.0, 0], [0, 0]])
    f = np.linspace(1.0, 900.0, 400)
    Phi, omega, static = real_modes(sp.csr_matrix(K), sp.csr_matrix(M), 900.0, np.eye(2))
    golden = (np.sqrt(5) - 1) / 2  # omega = sqrt(k / m) times it, and its inverse
    np.testing.assert_allclose(omega, np.sqrt(k / m) * np.array([golden, 1 / golden]), rtol=1e-10)
    ratio = np.array([2 * 0.01 * omega[0]])
    K = K + 0.05j * k * np.array([[1.0, -1], [-1, 1]])
    body = Damped(*map(sp.csr_matrix, (K, M, C)), Phi[:, :1], ratio)
    found = receptances(body, Phi, static, np.eye(2), sp.eye(2).tocsr(), f)
    w = (M @ Phi[:, 0])[:, None]
    whole = C + ratio[0] * w @ w.T
    for one, H in zip(2 * np.pi * f, found.H, strict=True):
        (a, b), (d, e) = K - one**2 * M + 1j * one * whole
        np.testing.assert_allclose(H, np.array([[e, -b], [-d, a]]) / (a * e - b * d), rtol=1e-8)
    assert found.error < 1e-9


@pytest.mark.parametrize("ratio", [0.0, 0.02])
def test_the_stated_error_is_that_of_the_whole_system(ratio):
    """A pad whose lining is lossy and whose plate is not, in springs; solved by SuperLU."""
    scene = read_scene(PAD, [
        "parts.pad.size='25 mm'", "parts.pad.plate_size='25 mm'", "materials.lining.loss=0.2",
        "stability={ band=['0 Hz', '6 kHz'], damping={ loss=true, omega_ref='2 kHz' } }",
        *([f"stability.damping.modal.pad.ratio={ratio}"] if ratio else []),
    ])  # fmt: skip
    mesh, elastic, alone = part_body(scene, "pad", np.zeros((1, 3)))
    x = mesh.domain.geometry.x
    points = x[[np.argmin(x @ n) for n in ((1, 1, 0.3), (-1, 1, 0.3), (0, -1, 0.5))]]
    rows = surface_rows(mesh, elastic.free, points)[0]
    forces, seen, f = rows[[0, 5]].toarray().T, rows[[2, 4, 8]], np.linspace(300, 6000, 60)
    ends = np.hstack([forces, seen.toarray().T])
    modes, omega, static = real_modes(elastic.K, elastic.M, 9000.0, ends)
    body = _damped(alone, mesh, elastic, modes, omega)
    found = receptances(body, modes, static, forces, seen, f)
    assert found.error < 1e-3 and body.C.nnz == 0
    low = elastic.M @ body.W
    exact = []
    for one in 2 * np.pi * f:
        D = (body.K - one**2 * elastic.M + 1j * one * body.C).tocsc()
        if ratio:  # the modal damping as further unknowns
            d = sp.diags(1 / (1j * one * body.ratio + 1e-30))
            D = sp.bmat([[D, low], [low.T, -d]]).tocsc()
        right = np.vstack([forces, np.zeros((D.shape[0] - len(forces), 2))])
        exact.append(seen @ spsolve(D, right)[: len(forces)])
    largest = np.abs(exact).max(axis=0)
    assert np.abs((found.H - exact) / largest).max() < 3 * max(found.error, 1e-6)


def test_frac_is_one_whatever_the_scale_and_zero_of_orthogonal_responses():
    h = np.exp(1j * np.arange(8.0))
    assert frac(h, (2 - 3j) * h) == pytest.approx(1)
    assert frac(np.exp(2j * np.pi * np.arange(8) / 8), np.ones(8)) == pytest.approx(0, abs=1e-12)


@pytest.mark.long
def test_responses_of_the_model_alone(tmp_path, capsys):
    """At points of a table: reciprocal, with the peaks of the real modes among the frequencies."""
    scene, table, out = tmp_path / "bar.toml", tmp_path / "points.csv", tmp_path / "out"
    scene.write_text(BAR)
    heading = "force_x_mm,force_y_mm,force_z_mm,force_direction,x_mm,y_mm,z_mm,direction\n"
    table.write_text(heading + "-100,0,0,z,30,5,-12,-z\n30,5,-12,z,-100,0,0,-z\n")
    assert main(["correlate", str(scene), str(table), "-o", str(out)]) == 0
    cells = read_columns(out / "responses.csv")
    both = (cells["re_m_N"] + 1j * cells["im_m_N"]).reshape(2, -1)
    np.testing.assert_allclose(both[0], both[1], rtol=1e-9)
    assert np.isnan(cells["test_re_m_N"]).all() and both.shape[1] > 1000


@pytest.mark.long
def test_without_damping_what_the_terminal_says_to_write_is_enough(tmp_path, capsys):
    scene, table = tmp_path / "bar.toml", tmp_path / "points.csv"
    scene.write_text(BAR.partition("[stability.damping]")[0])
    table.write_text(",".join(POINTS) + "\n-100,0,0,z,30,5,-12,-z\n")
    call = ["correlate", str(scene), str(table), "-o", str(tmp_path / "out")]
    assert main(call) == 0
    _, found, key = capsys.readouterr().out.partition("such as ")
    assert found and main([*call, "--set", key.splitlines()[0].replace(" ", "")]) == 0
    assert "no damping" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("labels", "said"),
    [
        ({"rsp_dir": 4}, "direction 4: export the nodes"),
        ({"rsp_node": 77}, "node 77, direction 3: export the nodes"),
        ({"ordinate_spec_data_type": 15}, "specific data types 15 over 13"),
        ({"func_type": 1}, "no frequency response"),
    ],
)
def test_functions_that_cannot_be_compared_are_one_line(labels, said, tmp_path, capsys):
    scene, test, out = tmp_path / "bar.toml", tmp_path / "bar.unv", tmp_path / "out"
    scene.write_text(BAR)
    write_responses(test, [(-0.1, 0, 0), (0.1, 0, 0)], [(np.arange(1e3), np.ones(1000))], **labels)
    assert main(["correlate", str(scene), str(test), "-o", str(out)]) == 2
    assert said in capsys.readouterr().err and not out.exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x,y\n1,2\n", "write the heading force_x_mm"),
        ("HEADING\n-100,0,0,q,30,5,-12,z\n", "line 2: -100,0,0,q"),
        ("HEADING\n-100,0,50,z,30,5,-12,z\n", "from the surface of part 'bar'"),
    ],
)
def test_points_that_are_not_there_are_one_line(text, said, tmp_path, capsys):
    scene, table = tmp_path / "bar.toml", tmp_path / "points.csv"
    scene.write_text(BAR)
    heading = "force_x_mm,force_y_mm,force_z_mm,force_direction,x_mm,y_mm,z_mm,direction"
    table.write_text(text.replace("HEADING", heading))
    assert main(["correlate", str(scene), str(table), "-o", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
