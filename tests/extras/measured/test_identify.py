"""Constants from resonances: known truths, the posterior by quadrature, mistakes."""

import re
import tomllib

import numpy as np
import pytest

from brake_fenicsx.build.material_table import constants
from brake_fenicsx.cli import main
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.extras.measured.identify import with_constants
from brake_fenicsx.extras.measured.part_modes import part_modes
from brake_fenicsx.extras.measured.posterior import (
    NARROW,
    UNHEARD,
    VariedBody,
    assigned,
    fill_basis,
    identified,
    misfit,
    read_peaks,
)
from brake_fenicsx.scene import read_scene
from places import SCENES
from run_tables import read_rows
from universal_files import function, write_sets

PAD, BOX = SCENES / "lining_pad.toml", SCENES / "measured" / "aluminium_box.toml"
COARSE_PAD = ["parts.pad.size='25 mm'", "parts.pad.plate_size='25 mm'"]
COARSE = ["parts.box.size='4 mm'"]


def pad_truth(theta, names):
    """The pad's frequencies at full order, by another path than the basis."""
    values = zip(names, np.exp(theta), strict=True)
    scene = read_scene(
        PAD, [*COARSE_PAD, *(f"materials.lining.{n}='{float(v)} Pa'" for n, v in values)]
    )
    return part_modes(scene, "pad", np.zeros((1, 3)), 14e3).frequency


def covered(truths, prior=0.2, error=3e-3):
    """Share of constants within their 95 % intervals, all peaks assigned to their own modes."""
    body = VariedBody(read_scene(PAD, COARSE_PAD), "pad", "lining", 1.2 * 14e3, False)
    fill_basis(body, prior)
    rng, away = np.random.default_rng(1), []
    for _ in range(truths):
        theta = body.nominal + prior * rng.standard_normal(body.nominal.size)
        exact = pad_truth(theta, body.names)
        peaks = np.sort(exact * np.exp(error * rng.standard_normal(exact.size)))
        end = identified(body, peaks, prior, error)
        assert end.basis_error < 0.05 * error
        away.append((end.theta - theta) / np.sqrt(np.diag(end.covariance)))
    return np.mean(np.abs(away) < 1.96)


def test_truths_of_a_pad_lie_in_their_intervals():
    assert covered(3) >= 12 / 15


@pytest.mark.slow
def test_twenty_truths_of_a_pad_lie_in_their_intervals():
    """95 of 100 expected; 88 is three standard deviations of the binomial below."""
    assert covered(20) >= 0.88


def test_derivatives_are_those_of_differences():
    body = VariedBody(read_scene(PAD, COARSE_PAD), "pad", "lining", 15e3, False)
    fill_basis(body, 0.2)
    theta = body.nominal + 0.1
    slope, step = body.modes(theta).slope[:8], 1e-5
    for j, axis in enumerate(np.eye(theta.size)):
        ends = [np.log(body.modes(theta + s * step * axis).frequency[:8]) for s in (1, -1)]
        assert np.abs(slope[:, j] - (ends[0] - ends[1]) / (2 * step)).max() < 1e-6


def test_laplace_is_what_quadrature_finds():
    """Mean and covariance of the posterior of two constants of a box with ten peaks.

    By the trapezoidal rule, which converges exponentially for a bell.
    """
    prior, error = 0.3, 3e-3
    body = VariedBody(read_scene(BOX, COARSE), "box", "aluminium", 225e3, False)
    fill_basis(body, prior)
    rng = np.random.default_rng(5)
    peaks = body.modes(body.nominal + np.array([0.1, -0.05])).frequency[:10]
    peaks = np.sort(peaks * np.exp(error * rng.standard_normal(10)))
    end = identified(body, peaks, prior, error)

    def cost(theta):
        """Twice the negative logarithm of the posterior, but for a constant."""
        p, f = np.log(peaks), np.log(body.modes(theta).frequency)
        away = np.sum(((theta - body.nominal) / prior) ** 2)
        return away + misfit(p, f, assigned(p, f, NARROW * error), error, NARROW * error)

    # In standard deviations along the axes of the covariance, beyond all weight.
    line = np.linspace(-6, 6, 21)
    root = np.linalg.cholesky(end.covariance)
    away = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2) @ root.T
    costs = np.array([cost(end.theta + x) for x in away])
    weight = np.exp(-0.5 * (costs - costs.min()))
    weight /= weight.sum()
    mean, sd = weight @ away, np.sqrt(np.diag(end.covariance))
    spread = np.sqrt(weight @ (away - mean) ** 2)
    assert np.abs(mean / sd).max() < 0.1
    assert np.abs(spread / sd - 1).max() < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    ("box", "material", "start", "error", "known", "least"),
    [  # C11, C12, C44 [GPa] with two of their standard deviations
        ("aluminium_box", "aluminium", {"C11": 130, "C12": 70}, 2.5e-3,
         {"C11": (109.2, 1.6), "C12": (55.9, 1.8)}, 40),
        ("srtio3_box", "srtio3", {"C11": 280, "C12": 120, "C44": 140}, 4e-3,
         {"C11": (324.9, 4.8), "C12": (107.4, 6.0), "C44": (124.48, 0.9)}, 45),
    ],
)  # fmt: skip
def test_constants_of_the_measured_boxes(box, material, start, error, known, least):
    """As Rayleigh-Ritz finds from the same peaks, of an isotropic and of a cubic crystal.

    Three of the peaks of strontium titanate are no modes of the box. The mesh of the aluminium box
    is 0.1 % too stiff at the highest modes; of its constants C44 = (C11 - C12) / 2 is known best.
    """
    changes = [f"materials.{material}.{name}='{value} GPa'" for name, value in start.items()]
    changes += ["parts.box.size='1.5 mm'"] * (box == "aluminium_box")
    scene = BOX.with_name(f"{box}.toml")
    (peaks,) = read_peaks(scene.with_suffix(".csv"))
    highest = 1.2 * peaks.frequency[-1]
    body = VariedBody(read_scene(scene, changes), "box", material, highest, False)
    fill_basis(body, 0.3)
    end = identified(body, peaks.frequency, 0.3, error)
    found = dict(zip(body.names, np.exp(end.theta) / 1e9, strict=True))
    assert all(abs(found[name] - value) < off for name, (value, off) in known.items())
    if box == "aluminium_box":
        assert abs(0.5 * (found["C11"] - found["C12"]) - 26.65) < 0.09
        assert np.all(end.mode[:30] == np.arange(30)) and np.all(end.mode[30:] >= 32)
    assert np.sum(end.mode >= 0) >= least


def test_a_constant_of_zero_stays(caplog):
    """An isotropic box with nu = 0: E alone is found."""
    scene = read_scene(BOX, [*COARSE, "materials.aluminium={ model='isotropic', E='70 GPa', nu=0,"
                             " rho='2788 kg/m^3' }"])  # fmt: skip
    body = VariedBody(scene, "box", "aluminium", 250e3, False)
    assert body.names == ["E"] and "nu stay as they are" in caplog.text
    fill_basis(body, 0.3)
    peaks = body.modes(body.nominal + 0.1).frequency[:8]
    end = identified(body, peaks, 0.3, 3e-3)
    assert end.theta[0] == pytest.approx(body.nominal[0] + 0.1, abs=1e-3)


def test_a_material_of_no_layer_of_the_mesh_is_refused():
    scene = read_scene(PAD, [
        "parts.pad.material={ lining='lining', plate='steel', shim='rubber' }",
        "materials.rubber={ model='isotropic', E='10 MPa', nu=0.4, rho='1200 kg/m^3' }",
    ])  # fmt: skip
    with pytest.raises(
        SceneError, match=r"materials.rubber: of no layer of parts.pad; .* --material"
    ):
        VariedBody(scene, "pad", "rubber", 10e3, False)


def test_resonances_of_frequency_responses(tmp_path):
    """Eight accelerances (dataset 58) with 0.1 % noise: five modes, two of them 2 % apart."""
    pytest.importorskip("sdypy.EMA")
    rng = np.random.default_rng(0)
    f0 = np.array([1210.0, 1955.0, 1995.0, 3101.0, 4407.0])
    zeta = np.array([2e-3, 1e-3, 8e-4, 1e-3, 5e-3])
    f = np.arange(0, 5200.0)
    omega, own = 2 * np.pi * f, 2 * np.pi * f0[:, None]
    modes = -(omega**2) / (own**2 - omega**2 + 2j * zeta[:, None] * own * omega)
    sets = []
    for node in range(1, 9):
        H = rng.normal(size=5) @ modes
        noise = rng.normal(size=(2, f.size)) * 1e-3 * np.abs(H).max()
        sets.append(function(f, H + noise[0] + 1j * noise[1], node))
    (peaks,) = read_peaks(write_sets(tmp_path / "test.uff", sets))
    np.testing.assert_allclose(peaks.frequency, f0, rtol=5e-4)
    np.testing.assert_allclose(peaks.q, 0.5 / zeta, rtol=0.1)


@pytest.mark.parametrize(
    ("kind", "counts", "said"),
    [
        (1, (64, 64), "0 frequency responses"),
        (4, (64, 32), "not all at the same frequencies"),
    ],
)
def test_functions_that_are_no_responses_are_one_line(kind, counts, said, tmp_path, monkeypatch):
    """Histories of time, and responses of two frequency axes; refused before the library reads."""
    monkeypatch.setattr("brake_fenicsx.extras.measured.posterior.import_module", lambda name: None)
    sets = [
        function(np.arange(float(n)), np.ones(n), node, func_type=kind)
        for node, n in enumerate(counts, 1)
    ]
    with pytest.raises(SceneError, match=said):
        read_peaks(write_sets(tmp_path / "test.uff", sets))


def test_peaks_are_assigned_over_gaps_and_strangers():
    modes = np.log([100.0, 102, 130, 150, 151, 180])
    peaks = np.log([100.4, 131, 140, 150.9, 150.2])
    assert assigned(peaks, modes, 0.02).tolist() == [0, 2, -1, 4, 3]


def test_a_mode_without_a_peak_is_paid_for():
    """Also where the mode of the highest peak lies just above it."""
    modes, peaks = np.log([100.0, 120, 140, 160]), np.log([100.0, 140, 159.9])
    mode = assigned(peaks, modes, 0.02)
    assert mode.tolist() == [0, 2, 3]
    rest = (np.log(159.9 / 160) / 0.005) ** 2
    assert misfit(peaks, modes, mode, 0.005, 0.02) == pytest.approx(UNHEARD + rest)


def run(folder, text, capsys, *words):
    folder.mkdir(exist_ok=True)
    (folder / "peaks.csv").write_text(text)
    status = main(["identify", str(BOX), "--peaks", str(folder / "peaks.csv"), "-o",
                   str(folder / "out"), "--set", COARSE[0], *words])  # fmt: skip
    return status, capsys.readouterr()


def box_peaks(scale=1.0):
    scene = read_scene(BOX, COARSE)
    return scale * part_modes(scene, "box", np.zeros((1, 3)), 190e3).frequency[:8]


def test_command_with_two_specimens_and_q(tmp_path, capsys):
    """Scatter of two boxes, a loss factor, a peak that is no mode, one that nobody heard."""
    lines = ["specimen,frequency_hz,q"]
    for name, scale in (("a", 0.98), ("b", 1.02)):
        f = box_peaks(scale)
        lines += [f"{name},{x},200" for x in np.delete(f, 3)] + [f"{name},{1.04 * f[0]},"]
    status, out = run(tmp_path, "\n".join(lines), capsys)
    assert status == 0
    said = "1 peaks fit no mode and are left out; 1 modes below the highest peak have no peak"
    assert (out.out + out.err).count(said) == 2
    rows = read_rows(tmp_path / "out" / "constants.csv")
    assert [row["constant"] for row in rows] == [
        "materials.aluminium.C11",
        "materials.aluminium.C12",
    ]
    assert rows[0]["identified"] == pytest.approx(rows[0]["scene"], rel=0.01)
    table = read_rows(tmp_path / "out" / "peaks.csv")
    assert sum(row["mode"] is None for row in table) == 2
    assert sum(row["peak_hz"] is None and row["mode"] == 4 for row in table) == 2
    block = tomllib.loads((tmp_path / "out" / "random.toml").read_text())["samples"]["random"]
    assert block["materials.aluminium.loss"]["mean"] == pytest.approx(1 / 200, rel=1e-3)
    # Frequencies 4 % apart are stiffnesses 8 % apart, as the standard deviation of two 5.7 %.
    scatter = block["materials.aluminium.C11"]
    assert float(scatter["sd"].split()[0]) / float(scatter["mean"].split()[0]) > 0.055
    assert scatter["mean"].endswith(" GPa") and re.search(r"\.C11 +GPa +109\.3 ", out.out)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frequency_hz\n116.7\n143.8\n158\n", "name the column frequency_khz if it is in kHz"),
        (
            "specimen,frequency_hz\na,116700\na,143800\nb,900\n",
            "specimen b: all peaks lie below",
        ),
        ("frequency_khz\n116700\n143800\n", "name the column frequency_hz if it is in Hz"),
        ("frequency_khz,frequency_hz\n116,116000\n", "write one of frequency_hz, frequency_khz"),
        ("frequency\n116.7\n", "the heading is frequency; write one of frequency_hz"),
        ("frequency_hz\n1e5\n-3\n", "line 3: frequency_hz = '-3': write a positive number"),
        ("frequency_hz\n", "contains no line of values"),
        ("frequency_khz\n116,7\n143,8\n", "line 2: more cells than the heading has"),
        ("specimen,frequency_hz\na,40\nb,116665\n", "specimen a: all peaks lie below"),
    ],
)
def test_mistakes_are_one_line(text, said, tmp_path, capsys):
    status, out = run(tmp_path, text, capsys)
    assert status == 2 and said in out.err and out.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_doubtful_peaks_are_warned_of(tmp_path, capsys):
    """One peak for two constants, one of the thread; one twice."""
    f = box_peaks()
    status, out = run(tmp_path, f"frequency_hz\n40\n{f[0]}\n", capsys)
    said = out.out + out.err
    assert status == 0
    assert "1 peaks below" in said and "no more than 1 combinations" in said
    assert "not determined by these peaks (as the prior): materials.aluminium.C12" in said
    status, out = run(tmp_path, f"frequency_hz\n{f[0]}\n{f[0] * 1.00001}\n{f[1]}\n", capsys)
    assert status == 0 and "are taken as two modes" in out.err + out.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--material", "gold"], "has the materials aluminium; --material gold: not of the part"),
        (["--error", "0"], "must be positive"),
        (["--part", "disc"], "no such part"),
        (
            [
                "--set",
                "materials.aluminium.C12='-10 GPa'",
                "--set",
                "materials.aluminium.C11='0 GPa'",
            ],
            "C11",
        ),
    ],
)
def test_words_that_are_wrong(words, said, tmp_path, capsys):
    status, out = run(tmp_path, "frequency_hz\n116700\n143800\n", capsys, *words)
    assert status == 2 and said in out.err


ISOTROPIC = "materials.aluminium={ model='isotropic', E='70 GPa', nu=0.33, rho='2700 kg/m^3' }"


def test_a_start_that_leaves_every_material_is_one_that_does_not_settle():
    """nu beyond 0.5 ends a start and not the command: the ten first peaks give E and nu back.

    Exact peaks at nominal constants; a prior of 30 % has starts beyond ln(0.5 / 0.33) = 0.42.
    """
    body = VariedBody(read_scene(BOX, [*COARSE, ISOTROPIC]), "box", "aluminium", 3e5, False)
    with pytest.raises(InaccurateResult, match=r"nu = 0\.5"):
        body.modes(body.nominal + np.array([0.0, 0.42]))
    fill_basis(body, 0.3)
    peaks = body.modes(body.nominal).frequency[:10]
    end = identified(body, peaks, 0.3, 2.5e-3)
    E, nu = np.exp(end.theta)
    assert pytest.approx(70e9, rel=2e-3) == E and nu == pytest.approx(0.33, rel=2e-2)
    assert np.exp(end.theta + 3 * np.sqrt(np.diag(end.covariance)))[1] < 0.5


WRITTEN = {
    "stiffnesses": ("""\
[materials.steel]
model = "isotropic"
rho = "7850 kg/m^3"
C11 = "300 GPa"
C12 = "100 GPa"
[materials.other]  # C11 = "109.26 GPa"
model = "isotropic"
rho = "2788 kg/m^3"   # weighed
C11 = "109.26 GPa"    # as on paper
C12="55.82 GPa"
""", {"C11": 1.2345678e11, "C12": 4e10}),
    "inline": ("""\
materials = { other = { model = "isotropic", rho = "1 kg/m^3", nu = 0.3, 'E' = '70000 MPa' } }
""", {"E": 6.9e10, "nu": 0.33}),
    "dotted": ("""\
materials.other.E = "7e10 Pa"
materials.other.nu = 0.3
materials.other.rho = "1 kg/m^3"
materials.other.model = "isotropic"
""", {"E": 6.9e10, "nu": 0.33}),
    "five": ("""\
[materials.other]
model = "transversely-isotropic"   # about z
rho = "2 kg/m^3"
E = ["10 GPa", "2 GPa"]
nu = [0.1, 0.4]
G = "1 GPa"                        # of G_13
""", {"E_1": 9e9, "E_2": 8e9, "E_3": 3e9, "nu_12": 0.12, "nu_31": 0.1, "nu_32": 0.09,
      "G_12": 4e9, "G_13": 1.1e9, "G_23": 1.2e9}),
}  # fmt: skip


def material(path, text):
    """A scene of a material, its file with a byte order mark and line ends of Windows."""
    path.write_bytes(("\ufeff# a note\r\nstages = []\r\n" + text.replace("\n", "\r\n")).encode())
    return read_scene(path)


@pytest.mark.parametrize("form", WRITTEN)
def test_constants_go_back_to_their_places(form, tmp_path):
    """Read again they are those identified; other lines, and the rest of these, stay."""
    text, values = WRITTEN[form]
    scene = material(tmp_path / "scene.toml", text)
    new = with_constants(scene, "other", values)
    old = scene.file.read_bytes().decode()
    assert new.startswith("\ufeff# a note\r\n") and new.count("\r\n") == old.count("\r\n")
    for before, after in zip(old.splitlines(), new.splitlines(), strict=True):
        changed = [n for n in values if re.match(rf"\W*(materials.other.)?{n[0]}", before)]
        assert before == after or changed or form == "inline" or "model" in before
        assert before.partition("#")[2] == after.partition("#")[2]
    scene.file.write_bytes(new.encode())
    found = constants(read_scene(scene.file).materials["other"])
    assert {n: found[n] for n in values} == pytest.approx(values, rel=1e-5)
    steel = tomllib.loads(new[1:])["materials"].get("steel")
    assert steel == tomllib.loads(old[1:])["materials"].get("steel")


def test_a_constant_that_the_file_does_not_write_is_refused(tmp_path):
    """As one of --set; the file stays as it is."""
    scene = material(tmp_path / "scene.toml", WRITTEN["dotted"][0])
    with pytest.raises(SceneError, match=r"materials.other.loss: the file does not write it"):
        with_constants(scene, "other", {"E": 7e10, "loss": 0.1})


@pytest.mark.long
def test_identify_writes_the_scene(tmp_path, capsys):
    """A copy beside the scene fits the peaks; another folder and another file are refused."""
    scene, peaks = tmp_path / "box.toml", tmp_path / "peaks.csv"
    scene.write_text(BOX.read_text().replace("0.68 mm", "4 mm"))
    stiff = ["materials.aluminium.C11='120 GPa'", "materials.aluminium.C12='60 GPa'"]
    truth = part_modes(read_scene(scene, stiff), "box", np.zeros((1, 3)), 230e3).frequency[:10]
    peaks.write_text("frequency_hz,q\n" + "".join(f"{hertz},400\n" for hertz in truth))
    call = ["identify", str(scene), "--peaks", str(peaks), "--error", "0.02", "-o"]
    call += [str(tmp_path / "out"), "--write"]
    (tmp_path / "other.toml").touch()
    for file, said in (("other.toml", "is there already"), ("no/box.toml", "name a file in")):
        assert main([*call, str(tmp_path / file)]) == 2
        assert said in capsys.readouterr().err and not (tmp_path / "out").exists()
    assert main([*call, str(tmp_path / "new.toml")]) == 0
    said = capsys.readouterr().out
    assert "wrote C11, C12 into" in said and "aluminium.loss = 0.0025 is not written" in said
    assert "0.68" not in scene.read_text() and "109.26 GPa" in scene.read_text()
    found = read_scene(tmp_path / "new.toml").materials["aluminium"]
    np.testing.assert_allclose([found.C11, found.C12], [120e9, 60e9], rtol=2e-3)
    before, after = (f.read_text().splitlines() for f in (scene, tmp_path / "new.toml"))
    changed = [a for a, b in zip(before, after, strict=True) if a != b]
    assert [line[:3] for line in changed] == ["C11", "C12"]
    assert main([*call, str(scene)]) == 0
    assert scene.read_text() == (tmp_path / "new.toml").read_text()
