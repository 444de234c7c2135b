"""Frequency responses of a part, beside measured ones: table, FRAC and picture.

Measured ones come in a universal file, datasets 58 of function type 4 with the nodes; their
ordinate may be a displacement, velocity or acceleration over a force. A table of points asks for
responses of the model alone.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from brake_fenicsx.arguments import Array, Complex, Index
from brake_fenicsx.build.brake import Brake, layer_matrix
from brake_fenicsx.build.damping_terms import damping_terms
from brake_fenicsx.build.material_table import layer_materials
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import TextTable
from brake_fenicsx.macro.elasticity import Elastic
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.report import style
from brake_fenicsx.results.tables import Value, text_table, write_rows
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.stability.substructures.substructure import ModalRatio

from .part_modes import BEYOND, Damped, frac, part_body, real_modes, receptances, surface_rows
from .study import check_distance, correlate, part_name
from .universal import NODES, SYSTEMS, UNITS, nodes_of, read_sets

MODES, FUNCTION, RESPONSE = 55, 58, 4  # datasets; type of a function
# Specific data type of the ordinate -> times it is differentiated by time; that of a force.
ORDER, FORCE = {8: 0, 11: 1, 12: 2}, 13
QUANTITY = ("receptance [m/N]", "mobility [m/(s N)]", "accelerance [1/kg]")
GRAVITY = 9.80665  # of accelerations in g
EVENLY, MOST = 1000, 8  # frequencies of the model alone; responses of the figure
POINTS = tuple(f + w for f in ("force_", "") for w in ("x_mm", "y_mm", "z_mm", "direction"))
UNDAMPED = """
no damping, infinite peaks: write some, such as stability.damping.modal.%s.ratio = 0.01"""
COLUMNS = ("response", "frequency_hz", "re_m_N", "im_m_N", "test_re_m_N", "test_im_m_N")
ROWS = ("response", "force", "seen", "quantity", "frac", "test_over_model")


@dataclass(frozen=True, slots=True)
class Response:
    """Where a force acts and where and how its effect is seen.

    Attributes:
        names: of the place of the force and of the place seen.
        points: these [m], shape (2, 3).
        directions: unit vectors, shape (2, 3).
        order: 0 of displacements, 1 of velocities, 2 of accelerations.
        frequency: rising, above zero [Hz]; empty of the model alone.
        value: measured, m/N, m/(s N) or 1/kg, shape (frequencies,).
    """

    names: tuple[str, str]
    points: Array
    directions: Array
    order: int
    frequency: Array
    value: Complex

    def receptance(self, value: Complex) -> Complex:
        """Displacement over force [m/N] of values of its quantity."""
        return np.asarray(value / (2j * np.pi * self.frequency) ** self.order)


def studies(path: str | Path) -> list[Callable[..., str]]:
    """What a file asks for: ``correlate`` of its modes, ``respond`` of its responses, or both."""
    file = Path(path)
    kinds = {FUNCTION} if _table(file) else {d["type"] for d in read_sets(file, ())}
    asked: list[Callable[..., str]] = [respond] if FUNCTION in kinds else []
    return [correlate, *asked] if MODES in kinds or not asked else asked


def _table(file: Path) -> bool:
    return file.suffix.lower() == ".csv"


def read_responses(path: str | Path) -> list[Response]:
    """Frequency responses of a universal file, or points of a table.

    Raises:
        SceneError: the file, what it lacks, and the remedy.
    """
    file = Path(path)
    if _table(file):
        return [*_asked(file)]
    sets = read_sets(file, (*NODES, *SYSTEMS, UNITS, FUNCTION))
    place = nodes_of(file, sets)
    unit = next((s for s in sets if s["type"] == UNITS), {"length": 1.0, "force": 1.0})
    found = [
        _measured(file, s, place, unit)
        for s in sets
        if s["type"] == FUNCTION and s["func_type"] == RESPONSE
    ]
    if not found:
        raise SceneError(f"{file}: dataset 58: no frequency response (function type 4)")
    return found


def _measured(
    file: Path, s: dict[str, Any], place: dict[int, tuple[Array, Array]], unit: dict[str, Any]
) -> Response:
    ends = [(int(s[f"{end}_node"]), int(s[f"{end}_dir"])) for end in ("ref", "rsp")]
    kinds = s["ordinate_spec_data_type"], s["orddenom_spec_data_type"]
    where = f"{file}: dataset 58: response of node {ends[1][0]} to node {ends[0][0]}"
    if kinds[0] not in ORDER or kinds[1] != FORCE:
        raise SceneError(f"""{where}: specific data types {kinds[0]} over {kinds[1]}; export
            displacements (8), velocities (11) or accelerations (12) over forces (13)""")
    for node, along in ends:
        if node not in place or not 1 <= abs(along) <= 3:
            raise SceneError(f"""{where}: node {node}, direction {along}: export the nodes (dataset
                2411 or 15), and directions 1 to 3 or -1 to -3""")
    points = np.array([place[node][0] for node, _ in ends])
    directions = np.array([np.sign(d) * place[node][1][abs(d) - 1] for node, d in ends])
    names = [f"node {node} {'-' if d < 0 else ''}{'xyz'[abs(d) - 1]}" for node, d in ends]
    x, value = np.asarray(s["x"], float), np.asarray(s["data"], complex)
    kept = (x > 0) & np.isfinite(value)
    per = (
        GRAVITY if str(s.get("ordinate_axis_units_lab", "")).strip() == "g" else 1 / unit["length"]
    )
    H = value[kept] * per * unit["force"]
    return Response((names[0], names[1]), points, directions, ORDER[kinds[0]], x[kept], H)


def _asked(file: Path) -> Iterator[Response]:
    """Points and directions of a table."""
    table = TextTable.read(file)
    if tuple(table.heading) != POINTS:
        raise SceneError(f"{file}: write the heading {','.join(POINTS)}, and a line for a response")
    for line, cells in zip(table.lines, table.rows, strict=True):
        try:
            points = 1e-3 * np.array([[float(c) for c in cells[k : k + 3]] for k in (0, 4)])
            turned = [np.eye(3)["xyz".index(cells[k][-1:] or "?")] for k in (3, 7)]
            signs = [{"": 1, "+": 1, "-": -1}[cells[k][:-1]] for k in (3, 7)]
        except (ValueError, IndexError, KeyError):
            raise SceneError(f"""{file}: line {line}: {",".join(cells)}: write numbers [mm], and
                directions x, y, z, -x, -y or -z""") from None
        names = f"line {line} {cells[3]}", f"line {line} {cells[7]}"
        directions = np.array(turned) * np.array(signs)[:, None]
        yield Response(names, points, directions, 0, np.zeros(0), np.zeros(0, complex))


def respond(
    scene: str | Path,
    test: str | Path,
    part: str | None = None,
    supported: bool = False,
    directory: str | Path | None = None,
    overrides: Sequence[str] = (),
    write: bool = True,
) -> str:
    """Frequency responses of a part with the damping of the scene, beside measured ones.

    Args:
        scene: path of the scene.
        test: universal file with frequency responses (dataset 58) and nodes, or a table of points.
        part: name of the part; may be left out where the scene has one.
        supported: with the supports, springs and masses of the part's faces; free if not.
        directory: where responses.csv, frac.csv and responses.png, .svg are written;
            SCENE-correlation in the working directory if not given.
        overrides: "key=value" replacements in the scene.
        write: whether this process writes the files.

    Returns:
        The table, the error of the receptances and where the files are, for the terminal.

    Raises:
        SceneError: scene, test or part is wrong; nothing was written.
    """
    parsed = read_scene(scene, overrides)
    name, file, asked = part_name(parsed, part), Path(test), read_responses(test)
    band = _band(parsed, asked)
    mesh, elastic, alone = part_body(parsed, name, np.vstack([r.points for r in asked]), supported)
    (forces, force), (seen, see) = _ends(file, asked, mesh, elastic, name)
    asked = [_inside(file, r, band) for r in asked]
    highest = max((r.frequency[-1] for r in asked if r.frequency.size), default=band[1])
    ends = np.vstack([forces, seen]).T
    modes, omega, static = real_modes(elastic.K, elastic.M, BEYOND * highest, ends)
    if not asked[0].frequency.size:
        hertz: Array = np.asarray(omega / (2 * np.pi), float)
        asked = [_alone(r, band, hertz) for r in asked]
    f = np.unique(np.concatenate([r.frequency for r in asked]))
    body = _damped(alone, mesh, elastic, modes, omega)
    found = receptances(body, modes, static, forces.T, sp.csr_matrix(seen), f)
    places = zip(asked, see.ravel(), force.ravel(), strict=True)
    model = [found.H[np.searchsorted(f, r.frequency), i, j] for r, i, j in places]
    folder = Path(directory or Path.cwd() / f"{parsed.file.stem}-correlation")
    table = [_row(i, r, H) for i, (r, H) in enumerate(zip(asked, model, strict=True), start=1)]
    if write:
        folder.mkdir(parents=True, exist_ok=True)
        write_rows(folder / "frac.csv", ROWS, table)
        write_rows(folder / "responses.csv", COLUMNS, _cells(asked, model))
        _draw(folder, asked, model, table)
    held = "supported" if supported else "free"
    damped = body.C.nnz or body.ratio.any() or np.iscomplexobj(body.K.data)
    return (
        f"part {name}, {held}: {found.modes} modes and residual vectors; against full order at"
        f" {found.worst:.5g} Hz, where the residual is largest, {found.error:.1e} of the largest"
        f" response{'' if damped else UNDAMPED % name}\n"
        f"{text_table(ROWS, table)}\nopen {folder / 'responses.png'}"
    )


def _band(scene: Scene, asked: Sequence[Response]) -> tuple[float, ...]:
    """The band of the scene [Hz], without which measured frequencies are those computed."""
    if scene.stability is not None:
        return scene.stability.band
    if not asked[0].frequency.size:
        raise SceneError(f"""{scene.file}: stability.band: is missing; responses without a test are
            computed in the band""")
    return 0.0, np.inf


def _ends(
    file: Path, asked: Sequence[Response], mesh: Mesh, elastic: Elastic, part: str
) -> list[tuple[Array, Index]]:
    """Rows of the forces and of what is seen, each once, shape (rows, dofs); those of responses."""
    points = np.vstack([r.points for r in asked])
    rows, distance, size = surface_rows(mesh, elastic.free, points)
    check_distance(file, [n for r in asked for n in r.names], points, part, distance, size)
    along = (sp.block_diag([d[None] for r in asked for d in r.directions]) @ rows).toarray()
    return [np.unique(along[end::2], axis=0, return_inverse=True) for end in (0, 1)]


def _alone(r: Response, band: tuple[float, ...], own: Array) -> Response:
    """A response without a test: evenly in the band, and at the frequencies of the modes."""
    inside = own[(own > max(band[0], 1.0)) & (own < band[1])]
    f = np.union1d(np.linspace(band[0], band[1], EVENLY + 1)[1:], inside)
    return replace(r, frequency=f, value=np.full(f.size, np.nan + 0j))


def _inside(file: Path, r: Response, band: tuple[float, ...]) -> Response:
    """A response in the band of the scene."""
    kept = (r.frequency >= band[0]) & (r.frequency <= band[1])
    if r.frequency.size and not kept.any():
        raise SceneError(f"""{file}: dataset 58: response of {r.names[1]}: no frequency in
            stability.band, {band[0]:g} to {band[1]:g} Hz""")
    return replace(r, frequency=r.frequency[kept], value=r.value[kept])


def _damped(scene: Scene, mesh: Mesh, elastic: Elastic, modes: Array, omega: Array) -> Damped:
    """The body with the damping that the scene has of a part which is at rest.

    Loss factors are those of a complex stiffness, exact at any frequency.
    """
    stability, n = scene.stability, elastic.M.shape[0]
    ratio: Array = np.zeros(0)
    contact: Any = None
    given = stability.damping if stability else None
    if stability and given:
        own = given.modal.get(next(iter(scene.parts)))
        if own is not None:
            at = ModalRatio(elastic.M, np.array(own.frequency), np.atleast_1d(own.ratio))
            hertz: Array = np.asarray(omega / (2 * np.pi), float)
            ratio = np.asarray(2 * omega * at.at(hertz), float)
        at_rest = replace(given, gyroscopic=False, loss=False)
        scene = replace(scene, stability=replace(stability, damping=at_rest))
    layers = layer_materials(scene, mesh.layers)
    brake = Brake(mesh, elastic, contact, np.zeros(n), 0.0, np.zeros((n, 0)), materials=layers)
    C, K = damping_terms(scene, brake).bulk, elastic.K
    lossy = {n: m.loss * m.C for n, m in layers.items() if m.loss and (not given or given.loss)}
    if lossy:
        K = K + 1j * layer_matrix(scene, brake, "K", lossy)
    return Damped(K, elastic.M, sp.csr_matrix((n, n)) if C is None else C, modes[:, : ratio.size],
                  ratio)  # fmt: skip


def _row(number: int, r: Response, H: Complex) -> list[Value]:
    """Names of a response, its FRAC, and the ratio of root mean squares."""
    shown = H * (2j * np.pi * r.frequency) ** r.order
    quantity = QUANTITY[r.order].partition(" ")[0]
    if not np.isfinite(r.value).all():
        return [number, *r.names, quantity, None, None]
    ratio = np.linalg.norm(r.value) / max(float(np.linalg.norm(shown)), 1e-300)
    return [number, *r.names, quantity, frac(r.value, shown), float(ratio)]


def _cells(asked: Sequence[Response], model: Sequence[Complex]) -> Iterator[list[Value]]:
    for i, (r, H) in enumerate(zip(asked, model, strict=True), start=1):
        for f, h, t in zip(r.frequency, H, r.receptance(r.value), strict=True):
            there = np.isfinite(t)
            test: list[Value] = [float(t.real), float(t.imag)] if there else [None, None]
            yield [i, float(f), float(h.real), float(h.imag), *test]


def _draw(
    folder: Path, asked: Sequence[Response], model: Sequence[Complex], table: list[list[Value]]
) -> None:
    """Moduli over the frequency, the first responses of the file."""
    shown = [*zip(asked[:MOST], model, table, strict=False)]
    with style.house_style():
        lines = (len(shown) + 1) // 2
        figure, axes = style.new_figure(lines, min(len(shown), 2), 0.6 + 2.0 * lines)
        for axis in axes.ravel()[len(shown) :]:
            axis.remove()
        for axis, letter, (r, H, row) in zip(axes.ravel(), "abcdefgh", shown, strict=False):
            khz, there = 1e-3 * r.frequency, np.isfinite(r.value).all()
            if there:
                axis.semilogy(khz, np.abs(r.value), color=style.BLACK, linewidth=1.0, label="test")
            computed = np.abs(H * (2j * np.pi * r.frequency) ** r.order)
            axis.semilogy(khz, computed, color=style.BLUE, linewidth=1.0, label="model")
            agrees = f", FRAC {row[4]:.2f}" if there else ""
            style.panel(axis, letter, f"{r.names[1]}, force at {r.names[0]}{agrees}")
            style.finish(axis, xlabel=style.KHZ, ylabel=QUANTITY[r.order])
        axes[0, 0].legend()
        style.save(figure, folder, "responses")
