"""Mode shapes of a run as a universal file, read back by pyuff and SDynPy (extra ``[peers]``)."""

import sys

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.compat import vector_space
from brake_fenicsx.errors import SceneError
from brake_fenicsx.extras.measured.universal import export_modes
from brake_fenicsx.report.fields import write_fields
from brake_fenicsx.results.tables import MODES, SAMPLES, write_rows
from run_tables import read_run

# Frequency [Hz], alpha [1/s]; the second decays.
GROWING, DECAYING, SLOW = (8331.4142, 217.5), (1500.25, -40.0), (2750.5, 12.25)
UNIT_CUBE = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def finished_run(folder, cell="tetrahedron", with_shapes=True, growing=(GROWING,), box=UNIT_CUBE):
    """A results folder with squeal modes and, as a study stores them, their shapes.

    The shape of mode n is that of the first one with n x in place of x.
    """
    from dolfinx import mesh

    rows = []
    for number, (f, alpha) in enumerate((DECAYING, *growing)):
        verdict = "unstable" if alpha > 0 else "stable"
        damping = -2 * alpha / (2 * np.pi * f)
        rows.append(["joint", 3, number, f, alpha, damping, 1e-12, 1e-6, 2.0, verdict, number])
    write_rows(folder / "modes.csv", MODES, rows)
    write_rows(folder / "samples.csv", SAMPLES, [["joint", 3, "ok", 1]])
    if with_shapes:
        (folder / "fields").mkdir()
        kind = getattr(mesh.CellType, cell)
        V = vector_space(mesh.create_box(MPI.COMM_SELF, np.array(box), [2, 1, 2], kind), 2)
        shapes = {
            f"mode_{f:05.0f}Hz": shape_at(V.tabulate_dof_coordinates(), n).ravel()
            for n, (f, _) in enumerate(growing, 1)
        }
        write_fields(folder / "fields" / "modes_joint.vtkhdf", V, shapes)


def shape_at(x, n):
    """Complex displacements of mode n at some points."""
    return np.exp(1j * n * x[:, [0]]) * np.column_stack([x[:, 1], 1 + x[:, 2], x[:, 0] * x[:, 1]])


@pytest.mark.parametrize(
    ("cell", "corners", "per_box"), [("tetrahedron", 4, 6), ("hexahedron", 8, 1)]
)
def test_modes_read_back(cell, corners, per_box, tmp_path):
    """Frequency, sign of the damping, cells, and shapes to the six digits of the format."""
    pyuff = pytest.importorskip("pyuff")
    finished_run(tmp_path, cell)
    path = tmp_path / "modes.unv"
    assert export_modes(read_run(tmp_path)) == path
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


def by_pyuff(path):
    """Numbers and positions of the nodes, eigenvalues, and shapes at the nodes."""
    import pyuff

    sets = pyuff.UFF(str(path)).read_sets()
    (nodes,) = (s for s in sets if s["type"] == 2411)
    modes = [s for s in sets if s["type"] == 55]
    shapes = [np.column_stack([s["r1"], s["r2"], s["r3"]]) for s in modes]
    positions = np.column_stack([nodes[c] for c in "xyz"])
    return nodes["node_nums"], positions, [s["eig"] for s in modes], shapes


def by_sdynpy(path):
    """The same by SDynPy, which reads by columns and knows frequencies and damping ratios."""
    sdynpy = pytest.importorskip("sdynpy")
    read = sdynpy.uff.readuff(str(path))
    nodes = sdynpy.geometry.Geometry.from_unv(read).node
    modes = sdynpy.shape.ShapeArray.from_unv(read)
    omega, zeta = 2 * np.pi * modes.frequency, modes.damping
    s = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    shapes = [
        mode[sdynpy.coordinate_array(nodes.id[:, np.newaxis], ["X+", "Y+", "Z+"])] for mode in modes
    ]
    return nodes.id, nodes.coordinate, s, shapes


@pytest.mark.parametrize("reader", [by_pyuff, by_sdynpy])
def test_independent_readers_agree(reader, tmp_path):
    """Two complex modes on nodes with negative coordinates, to the digits of the format."""
    pytest.importorskip("pyuff")
    box, growing = ((-0.151, -0.12, -0.0123), (0.05, 0.0, -0.001)), (GROWING, SLOW)
    finished_run(tmp_path, "hexahedron", growing=growing, box=box)
    export_modes(read_run(tmp_path))
    numbers, x, s, shapes = reader(tmp_path / "modes.unv")
    assert np.array_equal(numbers, np.arange(1, 19))
    assert x.min(axis=0) == pytest.approx(box[0], rel=1e-14)
    assert x.max(axis=0) == pytest.approx(box[1], abs=1e-16)
    assert len(s) == len(shapes) == 2
    for n, (f, alpha) in enumerate(growing, 1):
        k = np.argmin(np.abs(np.imag(s) - 2 * np.pi * f))
        assert s[k] == pytest.approx(alpha + 2j * np.pi * f, rel=1e-5)
        assert np.real(s[k]) == pytest.approx(alpha, rel=1e-4)
        wanted = shape_at(x, n)
        wanted /= np.linalg.norm(wanted, axis=1).max()
        assert np.abs(shapes[k] - wanted).max() < 2e-6


def test_a_folder_without_shapes_is_refused(tmp_path):
    finished_run(tmp_path, with_shapes=False)
    with pytest.raises(SceneError) as raised:
        export_modes(read_run(tmp_path))
    said = str(raised.value)
    assert f"{tmp_path}/fields: contains no mode shapes" in said
    assert "stages" in said and "stability.threshold" in said
    assert not (tmp_path / "modes.unv").exists()


def test_pyuff_is_asked_for_by_name(tmp_path, capsys, monkeypatch):
    finished_run(tmp_path)
    monkeypatch.setitem(sys.modules, "pyuff", None)
    assert main(["export", str(tmp_path)]) == 2
    assert "pip install pyuff" in capsys.readouterr().err
