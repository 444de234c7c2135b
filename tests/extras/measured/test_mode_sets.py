"""Modes of universal files as test software writes them: every layout has the same modes."""

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.measured.posterior import read_peaks
from brake_fenicsx.extras.measured.universal import read_mode_sets, read_modes

pytest.importorskip("pyuff")
# Two complex modes of four points: zeta 1 % and 2 %, 1 and 2.5 kHz; six components.
S = np.array([1e3, 2.5e3]) * 2 * np.pi * (-np.array([0.01, 0.02]) + 1j * np.sqrt(
    1 - np.array([0.01, 0.02]) ** 2))  # fmt: skip
_RNG = np.random.default_rng(0)
U = _RNG.standard_normal((2, 4, 6)) + 1j * _RNG.standard_normal((2, 4, 6))
NODES = (3, 7, 8, 12)
MARK = "    -1"


def dataset(kind, *lines):
    return "\n".join([MARK, f"{kind:6d}", *lines, MARK, ""])


def numbers(x):
    """Six numbers of 13 columns in a line, as Fortran's 6E13.5; they may touch each other."""
    words = [f"{v:13.5e}" for v in x]
    return ["".join(words[i : i + 6]) for i in range(0, len(words), 6)]


GEOMETRY = dataset(
    2411,
    *(line for n in NODES for line in (f"{n:10d}{0:10d}{0:10d}{1:10d}",
                                       f"{0.1 * n:25.16e}{0.0:25.16e}{0.0:25.16e}")),
)  # fmt: skip


def mode(
    k, components=6, nodes=(0, 1, 2, 3), conjugate=False, title="mode", analysis=3, number=None
):
    """Dataset 55 of one mode."""
    s, u = (S[k].conj(), U[k].conj()) if conjugate else (S[k], U[k])
    lines = [title, "NONE", "NONE", "NONE", "NONE"]
    lines.append(f"{1:10d}{analysis:10d}{2 + (components > 3):10d}{8:10d}{5:10d}{components:10d}")
    lines.append(f"{2:10d}{6:10d}{1:10d}{number or k + 1:10d}")
    lines += numbers([s.real, s.imag, 1.0, 0.0, 0.0, 0.0])
    for i in nodes:
        own = u[i, :components]
        lines += [f"{NODES[i]:10d}", *numbers(np.column_stack([own.real, own.imag]).ravel())]
    return dataset(55, *lines)


LAYOUTS = {
    "six components": mode(0) + mode(1),
    "three components": mode(0, 3) + mode(1, 3),
    "second order": mode(0, analysis=7) + mode(1, analysis=7),
    "conjugate pairs": mode(0) + mode(0, conjugate=True) + mode(1, conjugate=True) + mode(1),
    "conjugates alone": mode(1, conjugate=True) + mode(0, conjugate=True),
    "a mode in two datasets": mode(0, 3, (0, 2)) + mode(1, 3) + mode(0, 3, (1, 3)),
    "a header that is not ASCII": mode(0, title="Pr\u00fcfstand \u00b5m") + mode(1, title="\u00e9"),
    "DOS ends": (mode(0) + mode(1)).replace("\n", "\r\n"),
    "D for the exponent": mode(0) + mode(1).replace("e+", "D+").replace("e-", "D-"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_has_the_same_modes(layout, tmp_path):
    """Frequencies, damping and shapes as given, to the five digits of the file; pyuff 2.5.8 fails
    at complex values of six components."""
    file = tmp_path / "test.unv"
    file.write_bytes((GEOMETRY + LAYOUTS[layout]).encode("latin1"))
    found = read_modes(file)
    np.testing.assert_allclose(found.frequency, S.imag / (2 * np.pi), rtol=2e-5)
    np.testing.assert_allclose(found.damping, [0.01, 0.02], rtol=1e-4)
    assert found.label.tolist() == list(NODES)
    np.testing.assert_allclose(found.shapes, U[:, :, :3], rtol=1e-5, atol=1e-9)
    (peaks,) = read_peaks(file)
    np.testing.assert_allclose(peaks.frequency, found.frequency, rtol=2e-4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (mode(0, 1), "1 values at a node; export displacements along three axes"),
        (mode(0, 3, (0, 1)) + mode(1, 3, (2, 3)), "no node is common"),
        (mode(0).replace(numbers([U[0, 3, 3].real])[0], ""), "dataset 55 is damaged: node 12 has"),
        (mode(0).replace("\n        12\n", "\n        xy\n"), "line 1[0-9]: dataset 55 is damaged"),
        (dataset(55, "only", "text"), "dataset 55 is damaged"),
        (mode(0, analysis=5), "contains no modes"),
    ],
)
def test_what_is_wrong_is_one_line(text, said, tmp_path):
    file = tmp_path / "test.unv"
    file.write_text(GEOMETRY + text)
    with pytest.raises(SceneError, match=said):
        read_modes(file)


def test_modes_of_pyuff_agree(tmp_path):
    """Real and complex modes of three components, written by pyuff and read by both."""
    import pyuff

    file = tmp_path / "test.unv"
    own = {"type": 55, "model_type": 1, "data_ch": 2, "spec_data_type": 8, "load_case": 1,
           "node_nums": np.array(NODES)}  # fmt: skip
    sets = [
        own | {"analysis_type": 2, "data_type": 2, "mode_n": 1, "freq": 500.0,
               "modal_damp_his": 0.03, "r1": U[0, :, 0].real, "r2": U[0, :, 1].real,
               "r3": U[0, :, 2].real},
        own | {"analysis_type": 3, "data_type": 5, "mode_n": 2, "eig": S[0], "r1": U[0, :, 0],
               "r2": U[0, :, 1], "r3": U[0, :, 2]},
    ]  # fmt: skip
    pyuff.UFF(str(file)).write_sets(sets, mode="overwrite")
    theirs, ours = pyuff.UFF(str(file)).read_sets(), read_mode_sets(file)
    assert len(ours) == 2 and ours[1].s == pytest.approx(theirs[1]["eig"])
    assert ours[0].s.imag == pytest.approx(2 * np.pi * theirs[0]["freq"])
    assert -ours[0].s.real / abs(ours[0].s) == pytest.approx(0.015, rel=1e-6)
    for mode_, theirs_ in zip(ours, theirs, strict=True):
        shape = np.array([mode_.shape[n] for n in NODES])
        np.testing.assert_allclose(shape.T, [theirs_[r] for r in ("r1", "r2", "r3")])


@pytest.mark.parametrize("delimiter", [";", "\t", ","])
def test_tables_of_peaks(delimiter, tmp_path):
    """Semicolons or tabs, and decimal commas beside them, as Excel writes in much of Europe."""
    rows = [["specimen", "frequency_khz", "q"], ["a", "1.25", "500"], ["a", "2.5", ""]]
    text = "\n".join(delimiter.join(row) for row in rows) + "\n"
    file = tmp_path / "peaks.csv"
    for own in (text, *([text.replace(".", ",")] if delimiter != "," else [])):
        file.write_text(own)
        (peaks,) = read_peaks(file)
        assert peaks.specimen == "a" and peaks.frequency.tolist() == [1250.0, 2500.0]
        assert peaks.q[0] == 500.0 and np.isnan(peaks.q[1])
    file.write_text(text.replace(";", ",").replace("\t", ",").replace("1.25", "1,25"))
    with pytest.raises(SceneError, match="decimals with a point"):
        read_peaks(file)
