"""What all tests share: clean-up between parallel tests, communicators, small scenes.

The scenes import DOLFINx only when a test asks for them.
"""

import gc
import logging
from copy import deepcopy
from functools import cache
from importlib import import_module

import brake_fenicsx.cli  # noqa: F401 -- before NumPy: the matrix kernels of the command

# isort: split
from mpi4py import MPI

import numpy as np
import pytest

# Groups of minutes, longest first: what begins last is short, and both workers end together.
LONG = (
    "test_displaced_meshes", "test_bodies", "test_account", "test_reduced_model", "drawn",
    "test_pipeline", "test_values", "test_sweep_of_a_scene", "test_heights_of_builders",
    "test_masked", "test_drivers", "test_budget_study", "test_thickness_hard", "test_inertia",
    "test_countermeasures", "test_lay", "test_thicknesses", "test_sweep_on_few_values",
    "test_own_classes", "test_extras", "test_registry", "test_shells", "test_friction",
    "test_line", "test_real_meshes", "test_executors", "test_extensions",
)  # fmt: skip


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Tests in tests/hard are hard; several processes run those that are marked ``together``.

    Files go whole to one worker, and so do all tests of the drawn run, whose figures take long;
    first of all plugins, since pytest-xdist reads the groups in this hook.
    """
    for item in items:
        if item.path.parent.name == "hard":
            item.add_marker("hard")
        shared = "drawn" if "drawn" in item.fixturenames else str(item.path)
        item.add_marker(pytest.mark.xdist_group(shared))
    items.sort(key=_place)
    left_out = [item for item in items if not _runs(item)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if _runs(item)]


def _place(item):
    """Place of a test's group among the long ones, or behind them."""
    name = "drawn" if "drawn" in item.fixturenames else item.path.stem
    return LONG.index(name) if name in LONG else len(LONG)


def _runs(item):
    """Whether a test says something on as many processes as there are."""
    if MPI.COMM_WORLD.size > 1:
        return bool(item.get_closest_marker("together"))
    return "processes" not in item.fixturenames


@pytest.hookimpl(trylast=True)
def pytest_runtest_logreport(report):
    """A test that fails on one of several processes ends them all: the others may wait for it."""
    if report.failed and MPI.COMM_WORLD.size > 1:
        where = f"{report.nodeid}, process {MPI.COMM_WORLD.rank}"
        print(f"\n{where}\n{report.longreprtext}", flush=True)
        MPI.COMM_WORLD.Abort(1)


@pytest.fixture(autouse=True)
def _collect_together():
    """PETSc objects are destroyed by all processes together, between tests and nowhere else."""
    yield
    if MPI.COMM_WORLD.size > 1:
        gc.collect()
        MPI.COMM_WORLD.Barrier()


@pytest.fixture(autouse=True)
def _log_of_its_own():
    """A run of the program, a shared fixture's too, takes the log over; a test finds it free."""
    log = logging.getLogger("brake_fenicsx")
    log.propagate, log.handlers[:] = True, []
    log.setLevel(logging.NOTSET)
    yield


def _once(make):
    """A function of parts and mesh settings that is called once for equal ones."""
    made = {}

    def kept(*given):
        key = repr(given)
        if key not in made:
            made[key] = make(*given)
        return deepcopy(made[key])

    return kept


@pytest.fixture(autouse=True, scope="session")
def _scenes_are_meshed_once():
    """Equal parts of scenes are built and meshed once for all tests of a process.

    Tests of builders and meshes call the functions of ``brake_fenicsx.meshing`` themselves.
    """
    scene_mesh = import_module("brake_fenicsx.build.scene_mesh")
    with pytest.MonkeyPatch.context() as monkeypatch:
        for name in ("raw_mesh", "known_names"):
            monkeypatch.setattr(scene_mesh, name, _once(getattr(scene_mesh, name)))
        yield


@pytest.fixture
def meshes():
    """Makers and writers of small meshes."""
    return import_module("small_meshes")


@pytest.fixture
def comm():
    """All processes of the test run."""
    return MPI.COMM_WORLD


def _one_pixel(monkeypatch, names):
    """Pictures of figures, meshes and modes have one pixel; a name is noted for each figure."""
    from brake_fenicsx.report import figures, render

    def pixel(path, *args, **keys):
        from PIL import Image

        Image.new("RGB", (1, 1)).save(path)
        return path

    def save(figure, directory, name):
        names.append(name)
        return [pixel(directory / f"{name}.png")]

    monkeypatch.setattr(figures, "save", save)
    monkeypatch.setattr(render, "render_mesh", pixel)
    monkeypatch.setattr(render.Shapes, "__init__", lambda *_: None)
    for name in ("still", "film"):
        monkeypatch.setattr(render.Shapes, name, staticmethod(pixel))
    return names


@pytest.fixture
def without_pixels(monkeypatch):
    """Names of the figures that are drawn; each picture of a run is stored as one pixel."""
    return _one_pixel(monkeypatch, [])


@pytest.fixture(scope="module")
def all_without_pixels():
    """The same for a whole module and its fixtures."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        yield _one_pixel(monkeypatch, [])


@pytest.fixture
def processes(tmp_path):
    """All processes and one folder for them, of a test that one process alone does not run."""
    return MPI.COMM_WORLD, MPI.COMM_WORLD.bcast(tmp_path)


class TwoBlocks:
    """A pad block on a plate, and the ways tests look at it."""

    # Stiffness of the lining, axis 3 = z [Pa].
    LINING = (5.94e9, 0.76e9, 0.98e9, 2.27e9, 1.18e9)

    def __init__(
        self,
        comm,
        pad,
        plate,
        supports,
        pressure=5e5,
        direction=(1.0, 0.3, 0.0),
        k0=1e11,
        mesh=None,
        cells="tetrahedra",
        discretisation="patch",
    ):
        from brake_fenicsx.geometry import block
        from brake_fenicsx.macro.contact_elements import contact_elements
        from brake_fenicsx.macro.contact_forces import Translation
        from brake_fenicsx.macro.elasticity import assemble_elastic, unit_loads
        from brake_fenicsx.macro.material import Material, isotropic, transversely_isotropic
        from brake_fenicsx.meshing.brake_mesh import build_mesh
        from brake_fenicsx.meshing.gmsh_mesh import MeshSettings

        self.comm = comm
        self.parts = {"pad": (block, block.Block(**pad)), "plate": (block, block.Block(**plate))}
        self.mesh = (
            build_mesh(self.parts, comm, MeshSettings(cells=cells)) if mesh is None else mesh
        )
        self.materials = {
            "pad.body": Material(transversely_isotropic(*self.LINING), 2510.0),
            "plate.body": Material(isotropic(125e9, 0.24), 7200.0),
        }
        self.elastic = assemble_elastic(self.mesh, self.materials, supports)
        self.free = self.elastic.free
        self.contact = contact_elements(
            self.mesh, self.free, ("pad.bottom", "plate.top"), Translation(direction, 2.0),
            discretisation, comm=comm,
        )  # fmt: skip
        for name in ("N", "T", "R", "w", "g0"):
            setattr(self, name, getattr(self.contact, name))
        self.f = pressure * unit_loads(self.mesh, self.free, "pad.top")
        self.K, self.M = self.elastic.K, self.elastic.M
        self.k0 = np.full(self.w.size, k0)

    def on_the_same_mesh(self, supports):
        """The scene with other supports."""
        pad, plate = ({} for _ in range(2))
        return TwoBlocks(self.comm, pad, plate, supports, mesh=self.mesh)

    @property
    def compliance(self):
        """The blocks seen from their contact elements, made once."""
        from brake_fenicsx.macro.equilibrium import compliance

        if not hasattr(self, "_compliance"):
            self._compliance = compliance(
                self.elastic.K, self.N, self.T, self.w, self.f, self.k0, self.comm
            )
        return self._compliance

    def enriched(self, law, g_cr=0.0):
        """One law on all contact elements, and their critical gaps [m]."""
        from brake_fenicsx.macro import EnrichedGap
        from brake_fenicsx.micro import OneLaw

        n = self.w.size
        return EnrichedGap(OneLaw(law), np.zeros(n, int), np.broadcast_to(g_cr, n))

    def tangent(self, k, mu):
        """K + (N + mu T)' W k N as a SciPy matrix."""
        import scipy.sparse as sp

        return (self.K + (self.N + mu * self.T).T @ sp.diags(self.w * k) @ self.N).tocsr()

    def field(self, **bodies):
        """Free vector of a displacement given per body as a function of x, shape (3, points)."""
        from dolfinx import fem

        u = fem.Function(self.free.V)
        for body, values in bodies.items():
            cells = self.mesh.cell_tags.find(self.mesh.layers[f"{body}.body"])
            u.interpolate(values, cells)
        return u.x.array[self.free.local]


def _pair(pad, plate, supports, height=6, gap=0):
    """Length, width and size of cells of pad and plate, their height and the gap between them.

    All in mm.
    """
    names = ("length", "width", "size", "height", "z")
    blocks = ((*pad, height, gap), (*plate, height, -height))
    pad, plate = ({n: 1e-3 * x for n, x in zip(names, b, strict=True)} for b in blocks)
    return {"pad": pad, "plate": plate, "supports": supports}


CLAMPED = {"plate.bottom": ["x", "y", "z"]}
GUIDED = CLAMPED | {"pad.top": ["x", "y"]}
SCENES = {
    # Lining block on a steel-like plate, clamped below; the block is guided, free along z.
    "guided": _pair((12, 8, 6), (20, 14, 14), GUIDED),
    # The same with more cells.
    "fine": _pair((12, 8, 4), (20, 14, 7), GUIDED),
    # The same with fewer cells: its dense damped spectrum takes half a second.
    "coarse": _pair((12, 8, 8), (20, 14, 20), GUIDED),
    # The first, without tilting: held all around in the plane.
    "upright": _pair((12, 8, 4), (20, 14, 7), CLAMPED | {"pad.sides": ["x", "y"]}),
    # Nothing held; the pad hangs 0.3 mm above the plate.
    "loose": _pair((12, 8, 3), (20, 14, 4.3), {}, 5, 0.3),
    # Nothing held and few cells: its dense spectrum takes a second.
    "free": _pair((12, 8, 8), (20, 14, 20), {}),
    # The pad reaches beyond the plate on all sides.
    "overhang": _pair((20, 14, 4), (12, 8, 3), {}, 5),
}


@cache
def _scene(name, alone, key):
    comm = MPI.COMM_SELF if alone else MPI.COMM_WORLD
    given = {**SCENES[name], **dict(key)}
    tables = {name: dict(given[name]) for name in ("pad", "plate", "supports")}
    return TwoBlocks(comm, **{**given, **tables})


@pytest.fixture
def two_blocks():
    """``two_blocks(name, alone=..., **changes)``: one of the scenes above, made once per run.

    ``alone``: on this process in place of all together.
    """

    def make(name, alone=False, **changes):
        alone = alone or MPI.COMM_WORLD.size == 1
        return _scene(name, alone, tuple(sorted(changes.items())))

    return make


@pytest.fixture
def dense():
    """``dense(M, C, K, high, zeta)``: see ``Dense``."""
    from dense_reference import Dense

    return Dense
