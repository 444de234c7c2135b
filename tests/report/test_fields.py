"""What ParaView gets: every dof, both parts of a mode, its period; pictures of modes and meshes."""

import h5py
import numpy as np
import pytest

MPI = pytest.importorskip("mpi4py.MPI")
pytest.importorskip("dolfinx")
pyvista = pytest.importorskip("pyvista")

from dolfinx import fem, mesh  # noqa: E402

from brake_fenicsx.report.fields import (  # noqa: E402
    facet_means,
    write_facets,
    write_fields,
    write_phases,
    write_points,
)
from brake_fenicsx.report.render import Shapes, render_mesh, render_mode  # noqa: E402


def vector_space(comm, n=3, cell=None):
    return vector_space_on(mesh.create_unit_cube(comm, n, n, n, cell or mesh.CellType.tetrahedron))


def vector_space_on(domain):
    if hasattr(fem, "functionspace"):
        return fem.functionspace(domain, ("Lagrange", 2, (3,)))
    return fem.VectorFunctionSpace(domain, ("Lagrange", 2))


def field(x):
    """Quadratic, complex: its vertex values are not those of a coarser fit."""
    re = np.array([x[0] ** 2, x[1] * x[2], 1 + x[2]])
    return re + 1j * np.array([x[1], -x[0], x[0] * x[2]])


# Largest amplitude of the field, at the corner (1, 1, 1): modes are written over it.
LARGEST = float(np.linalg.norm(field(np.ones(3))))


def values_on(V):
    return field(V.tabulate_dof_coordinates().T).T.ravel()


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    """A ninth of the pixels: none of what is looked at depends on their number."""
    monkeypatch.setattr("brake_fenicsx.report.render.DPI", 67)


@pytest.fixture(scope="module")
def space():
    return vector_space(MPI.COMM_SELF)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_every_dof_is_read_back(tmp_path, cell, degree):
    """By VTK, an independent reader: values, positions, and cells that fill the cube once.

    VTK 9.2.6 and 9.3.1 read no cell where offsets and points of cells are other integers.
    """
    from brake_fenicsx.compat import vector_space as space_of_degree

    V = space_of_degree(vector_space(MPI.COMM_SELF, cell=getattr(mesh.CellType, cell)).mesh, degree)
    values = values_on(V)
    path = write_fields(tmp_path / "m.vtkhdf", V, {"mode": values, "static": values.real.copy()})
    with h5py.File(path) as file:
        assert all(file["VTKHDF"][name].dtype == "i8" for name in ("Connectivity", "Offsets"))
    grid = pyvista.read(path)
    assert grid.n_points == (3 * degree + 1) ** 3
    exact = field(grid.points.T.astype(float)).T
    assert sorted(grid.point_data.keys()) == ["mode_im", "mode_re", "static"]
    assert np.allclose(grid.point_data["mode_re"], exact.real / LARGEST, atol=1e-12)
    assert np.allclose(grid.point_data["mode_im"], exact.imag / LARGEST, atol=1e-12)
    assert np.allclose(grid.point_data["static"], exact.real, atol=1e-12)
    assert grid.compute_cell_sizes().cell_data["Volume"].sum() == pytest.approx(1.0)
    # Between the points the field is that of the cells: quadratic where they are.
    x = np.array([[0.43, 0.21, 0.77], [0.13, 0.9, 0.5]])
    probed = pyvista.PolyData(x).sample(grid).point_data["static"]
    assert np.allclose(probed, field(x.T).real.T, atol=1e-9 if degree == 2 else 0.05)


def test_a_curved_mesh_keeps_its_middle_nodes(tmp_path):
    gmsh = pytest.importorskip("gmsh")
    from brake_fenicsx.compat import mesh_from_gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("cylinder")
    gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 0.5, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [1], 1)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    V = vector_space_on(mesh_from_gmsh(gmsh.model)[0])
    gmsh.finalize()
    grid = pyvista.read(write_fields(tmp_path / "m.vtkhdf", V, {"u": values_on(V).real.copy()}))
    assert grid.n_points > 3 * V.mesh.topology.index_map(0).size_local
    assert np.allclose(grid.point_data["u"], field(grid.points.T).real.T, atol=1e-9)
    # Straight cells of this size would miss the radius by a tenth.
    assert np.hypot(*grid.points.T[:2]).max() == pytest.approx(1.0, abs=1e-6)


def test_a_phase_turns_the_mode_once(tmp_path, space):
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOHDF import vtkHDFReader

    path = write_phases(tmp_path / "p.vtkhdf", space, values_on(space), frames=8)
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert np.allclose(times, 2 * np.pi * np.arange(8) / 8)
    for k in (0, 3, 7):
        reader.UpdateTimeStep(times[k])
        grid = pyvista.wrap(reader.GetOutput())
        turned = field(grid.points.T.astype(float)).T * np.exp(1j * times[k])
        assert np.allclose(grid.point_data["displacement"], turned.real / LARGEST, atol=1e-12)
    assert grid.n_points == 7**3


def test_contact_points_keep_every_digit(tmp_path):
    rng = np.random.default_rng(3)
    points, p = rng.normal(size=(5, 3)), rng.random(5)
    path = write_points(tmp_path / "contact.vtkhdf", points, {"p": p, "slip": points[:, ::-1]})
    cloud = pyvista.read(path)
    assert np.array_equal(cloud.point_data["p"], p)
    assert np.array_equal(cloud.point_data["slip"], points[:, ::-1])
    assert np.allclose(cloud.points, points, rtol=1e-7)


def test_facets_carry_the_mean_of_their_elements(tmp_path):
    """Two triangles, two elements on the first of unequal area, none on a third."""
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    facet, w = np.array([0, 0, 1, -1]), np.array([1.0, 3.0, 2.0, 5.0])
    means = facet_means(facet, w, np.array([4.0, 8.0, 1.0, 100.0]), 3)
    assert np.allclose(means, [7.0, 1.0, np.nan], equal_nan=True)
    path = write_facets(tmp_path / "p.vtkhdf", corners, {"p": means[:2]})
    grid = pyvista.read(path)
    assert (grid.n_cells, grid.n_points) == (2, 6)
    assert np.array_equal(grid.cell_data["p"], [7.0, 1.0])
    assert np.allclose(grid.compute_cell_sizes().cell_data["Area"], 0.5)


def test_a_field_of_another_length_is_refused(tmp_path, space):
    with pytest.raises(ValueError, match="field u: shape"):
        write_fields(tmp_path / "m.vtkhdf", space, {"u": np.zeros(7)})
    assert not (tmp_path / "m.vtkhdf").exists()


def test_mode_picture_shows_both_views_in_colour(tmp_path, space):
    from matplotlib.image import imread

    path = render_mode(tmp_path / "mode.png", space, values_on(space), title="1.23 kHz")
    image = imread(path)[:, :, :3]
    drawn = (image.max(axis=2) - image.min(axis=2)) > 0.2
    rows = np.flatnonzero(drawn.any(axis=1))
    upper = rows[rows < 0.4 * len(drawn)].size, rows[rows > 0.4 * len(drawn)].size
    left, right = (half.mean() for half in np.array_split(drawn, 2, axis=1))
    assert min(upper) > 20
    assert left > 0.05
    assert right > 0.05


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_the_surface_of_a_cube_has_its_area_and_its_edges(cell):
    """With middles of edges; a point on an edge stands on each of its faces."""
    V = vector_space(MPI.COMM_SELF, 2, getattr(mesh.CellType, cell))
    shapes = Shapes(V)
    points, n = shapes.rest, shapes.faces.shape[1]
    assert np.array_equal(points, V.tabulate_dof_coordinates()[shapes.node])
    corners = [points[shapes.faces[:, j]] for j in (0, 1, n - 2, n - 1)]
    area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[3] - corners[0]), axis=1)
    assert area.sum() * (0.5 if n == 3 else 1.0) == pytest.approx(6.0)
    assert len(points) == 6 * 5**2
    lines = points[shapes.ends].reshape(-1, 2, 3)
    assert np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum() == pytest.approx(12.0)


def test_a_ball_has_no_sharp_edge(tmp_path):
    """A cube that is blown up: faces alone are drawn."""
    from matplotlib.image import imread

    domain = mesh.create_unit_cube(MPI.COMM_SELF, 6, 6, 6, mesh.CellType.hexahedron)
    x = 2 * domain.geometry.x - 1
    length = np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
    domain.geometry.x[:] = x * np.abs(x).max(axis=1, keepdims=True) / length
    space = vector_space_on(domain)
    shapes = Shapes(space)
    assert shapes.ends.size == 0
    image = imread(shapes.still(tmp_path / "ball.png", values_on(space)))
    assert image.min() < 0.5


def test_bodies_in_a_row_hide_nothing():
    """Three boxes on each other: side by side, lowest first, in both views."""
    from brake_fenicsx.report.render import in_a_row, levels, view_of

    heights = [0.0, 0.9, 1.0, 1.9, 2.0, 2.9]
    points = np.array([[x, y, z] for z in heights for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    body = (points[:, 2] // 1).astype(int)
    level = levels(points[:, 2], 2 - body)
    assert np.array_equal(level, body)
    for side in (1.0, -1.0):
        view = view_of(points, side)
        row = in_a_row(points, level, view, side)
        right = np.cross([0.0, 0.0, side], view)
        reach = [(row[level == j] @ right / np.linalg.norm(right)) for j in range(3)]
        assert reach[0].max() < reach[1].min()
        assert reach[1].max() < reach[2].min()


def test_the_picture_does_not_depend_on_the_phase_or_the_size_of_the_mode(tmp_path, space):
    from matplotlib.image import imread

    values = values_on(space)
    turned = 1e-7 * np.exp(0.7j) * values
    first = imread(render_mode(tmp_path / "a.png", space, values))
    second = imread(render_mode(tmp_path / "b.png", space, turned))
    assert np.mean(np.abs(first - second)) < 1e-3


def test_animated_mode_is_one_period_from_the_largest_motion(tmp_path, space):
    """A standing wave: at rest after a quarter of the period, mirrored after half of it."""
    from PIL import Image

    values = np.real(values_on(space)) * np.exp(0.4j)
    shapes = Shapes(space)
    path = shapes.film(tmp_path / "mode.webp", values, frames=8, width=200)
    with Image.open(path) as film:
        assert (film.n_frames, film.width) == (8, 200)
        frames = []
        for j in range(8):
            film.seek(j)
            frames.append(np.asarray(film.convert("RGB"), float))
    away = [np.abs(frame - frames[2]).mean() for frame in frames]
    # Lossy compression keeps what hardly differs from the frame before.
    assert away[6] < 0.5 * min(away[0], away[4])
    assert np.abs(frames[1] - frames[7]).mean() < 0.5 * away[0]
    assert np.abs(frames[0] - frames[4]).mean() > away[0]
    assert shapes.film(tmp_path / "b.webp", values, 8, 200).read_bytes() == path.read_bytes()


def test_mesh_picture_has_one_colour_per_part(tmp_path, space):
    from matplotlib.image import imread

    n = space.mesh.topology.index_map(3).size_local
    one = imread(render_mesh(tmp_path / "one.png", space))[:, :, :3]
    parts = (np.arange(n) >= n // 2).astype(int)
    two = imread(render_mesh(tmp_path / "two.png", space, parts, {0: "disc", 1: "pad"}))[:, :, :3]

    def orange(image):
        return np.mean((image[:, :, 0] - image[:, :, 2]) > 0.3)

    assert orange(one) == 0
    assert orange(two) > 0.01
