"""Mode shapes of a run as a universal file, read back by pyuff."""

import sys

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.compat import vector_space
from brake_fenicsx.report.fields import write_fields
from brake_fenicsx.results.tables import MODES, SAMPLES, write_rows

# Frequency [Hz], alpha [1/s]; the second decays.
GROWING, DECAYING = (8331.4142, 217.5), (1500.25, -40.0)


def finished_run(folder, cell="tetrahedron", with_shapes=True):
    """A results folder with one squeal mode and, as a study stores it, its shape."""
    from dolfinx import mesh

    rows = []
    for number, (f, alpha) in enumerate((DECAYING, GROWING)):
        verdict = "unstable" if alpha > 0 else "stable"
        damping = -2 * alpha / (2 * np.pi * f)
        rows.append(["joint", 3, number, f, alpha, damping, 1e-12, 1e-6, 2.0, verdict, number])
    write_rows(folder / "modes.csv", MODES, rows)
    write_rows(folder / "samples.csv", SAMPLES, [["joint", 3, "ok", 1]])
    if with_shapes:
        (folder / "fields").mkdir()
        kind = getattr(mesh.CellType, cell)
        V = vector_space(mesh.create_unit_cube(MPI.COMM_SELF, 2, 1, 2, kind), 2)
        x = V.tabulate_dof_coordinates()
        shape = np.exp(1j * x[:, [0]]) * np.column_stack([x[:, 1], 1 + x[:, 2], x[:, 0] * x[:, 1]])
        write_fields(folder / "fields" / "modes_joint.vtkhdf", V, {"mode_08331Hz": shape.ravel()})


@pytest.mark.parametrize(
    ("cell", "corners", "per_box"), [("tetrahedron", 4, 6), ("hexahedron", 8, 1)]
)
def test_modes_read_back(cell, corners, per_box, tmp_path, capsys):
    """Frequency, sign of the damping, cells, and shapes to the six digits of the format."""
    pyuff = pytest.importorskip("pyuff")
    finished_run(tmp_path, cell)
    assert main(["export", str(tmp_path)]) == 0
    path = tmp_path / "modes.unv"
    assert capsys.readouterr().out == f"wrote {path}\n"
    sets = {s["type"]: s for s in pyuff.UFF(str(path)).read_sets()}
    assert list(sets) == [151, 164, 2411, 2412, 55] and sets[164]["length"] == 1.0
    mode, nodes = sets[55], sets[2411]
    assert mode["eig"].imag / 2 / np.pi == pytest.approx(GROWING[0], rel=1e-5)
    assert mode["eig"].real == pytest.approx(GROWING[1], rel=1e-5)
    assert "damping -2 alpha/|omega| = -0.0083" in mode["id2"]
    x, y, z = (nodes[c] for c in "xyz")
    assert np.array_equal(mode["node_nums"], nodes["node_nums"])
    # The largest displacement is 1: where y = z = x = 1.
    wanted = np.exp(1j * x) * np.array([y, 1 + z, x * y]) / np.sqrt(6.0)
    found = np.array([mode[r] for r in ("r1", "r2", "r3")])
    assert np.abs(found - wanted).max() < 1e-6
    (elements,) = (v for k, v in sets[2412].items() if isinstance(k, int))
    cells = np.array([e["nodes_nums"] for e in elements]) - 1
    assert cells.shape == (per_box * 4, corners)
    edges = np.column_stack([x, y, z])[cells[:, [1, 3, 4] if corners == 8 else [1, 2, 3]]]
    edges -= np.column_stack([x, y, z])[cells[:, :1]]
    assert np.abs(np.linalg.det(edges)) == pytest.approx(0.25)


def test_a_folder_without_shapes_is_refused(tmp_path, capsys):
    finished_run(tmp_path, with_shapes=False)
    assert main(["export", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and f"{tmp_path}/fields: contains no mode shapes" in said
    assert "stages" in said and "stability.threshold" in said
    assert not (tmp_path / "modes.unv").exists()


def test_pyuff_is_asked_for_by_name(tmp_path, capsys, monkeypatch):
    finished_run(tmp_path)
    monkeypatch.setitem(sys.modules, "pyuff", None)
    assert main(["export", str(tmp_path)]) == 2
    assert "pip install pyuff" in capsys.readouterr().err
