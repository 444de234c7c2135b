"""What is seen of a study: fields for ParaView, pictures of squeal modes, the contact faces.

The nodal diameters of a rotor are the strongest harmonic of its motion at the rim.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.spatial import KDTree

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.build.brake import Brake
from brake_fenicsx.folder.log import spared
from brake_fenicsx.folder.processes import meanwhile, on_first
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store
from brake_fenicsx.macro.faces import body_of_nodes, gather_face
from brake_fenicsx.meshing.rawmesh import body_of_points
from brake_fenicsx.results import squeal, tables
from brake_fenicsx.results.run import RunData, read_run, save_tables
from brake_fenicsx.samples.forces import contact_of
from brake_fenicsx.samples.sampling import SampleInput
from brake_fenicsx.samples.solve import by_bodies, displacements
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.digest import in_effect
from brake_fenicsx.scene.scene import slides

from . import mode_cards, render
from .fields import facet_means, write_facets, write_fields, write_phases, write_points
from .style import label

RIM = 0.9  # nodes beyond this share of the largest radius make the rim
WIDEST = np.pi / 6  # gap between neighbouring angles [rad] beyond which there is no ring
DIRECTIONS = ("out of plane", "in plane, radial", "in plane, tangential")
EXACT = 1e-3  # relative error of displacements that no picture shows
MOST = 4  # modes drawn for each approach, of the most severe families


@dataclass(frozen=True, slots=True)
class NodalPattern:
    """The strongest harmonic of a rotor's motion.

    Attributes:
        diameters: its order: the number of nodal diameters.
        direction: "out of plane", "in plane, radial" or "in plane, tangential".
        share: share of the harmonic in the squared displacements of the rim [-].
    """

    diameters: int
    direction: str
    share: float


def nodal_pattern(points: AnyArray, u: AnyArray, most: int = 12) -> NodalPattern | None:
    """Strongest harmonic of the motion of a rotor's rim, by least squares over its nodes.

    Args:
        points: nodes of the rotor [m], shape (n, 3); its axis is z.
        u: displacements of these nodes, real or complex, shape (n, 3).
        most: highest order.

    Returns:
        The harmonic; None where the nodes form no closed ring or none of them moves.
    """
    radius = np.hypot(points[:, 0], points[:, 1])
    rim = radius >= RIM * radius.max(initial=0.0)
    angle = np.arctan2(points[rim, 1], points[rim, 0])
    around = np.unique(angle.round(6))
    if around.size < 8 or np.diff(around, append=around[0] + 2 * np.pi).max() > WIDEST:
        return None
    orders = np.arange(min(most, around.size // 4) + 1)
    phase = np.outer(angle, orders)
    basis = np.hstack([np.cos(phase), np.sin(phase[:, 1:])])
    across = np.cos(angle), np.sin(angle)
    x, y, z = u[rim].T
    motion = np.column_stack([z, across[0] * x + across[1] * y, across[0] * y - across[1] * x])
    whole = float(np.sum(np.abs(motion) ** 2))
    if whole == 0.0:
        return None
    found = np.linalg.lstsq(basis, motion, rcond=None)[0]
    cosines, sines = found[: orders.size], found[orders.size :]
    pieces = np.empty((orders.size, 3))
    for n in orders:
        own = np.outer(basis[:, n], cosines[n])
        if n:
            own = own + np.outer(basis[:, orders.size + n - 1], sines[n - 1])
        pieces[n] = np.sum(np.abs(own) ** 2, axis=0)
    n, j = np.unravel_index(int(pieces.argmax()), pieces.shape)
    return NodalPattern(int(n), DIRECTIONS[j], min(float(pieces[n, j]) / whole, 1.0))


@dataclass(frozen=True, slots=True)
class ShapeWorks:
    """What is to be written and drawn of modes, by any processes in any order.

    Attributes:
        works: each gives the table's row of a mode, or None, and what failed, a line each.
        lost: what failed before, or is less exact than a picture asks, a line each.
    """

    works: list[Callable[[], tuple[mode_cards.ModeShape | None, list[str]]]]
    lost: list[str]


def prepare_shapes(
    study: Study, first: Mapping[Task, Mapping[str, Any]], faces: dict[str, AnyArray],
    pictures: bool, comm: MPI.Comm,
) -> ShapeWorks:  # fmt: skip
    """Write the fields of the equilibria, and find shapes; collective.

    Equilibrium and contact are those of the first sample of each approach; modes are of its most
    severe families, of each the squeal mode of median damping.

    Args:
        study: the study.
        first: what was stored of the first good sample of each approach.
        faces: see ``contact_faces``.
        pictures: False leaves the fields and the nodal diameters alone to the works.
        comm: processes that share the work, the first of the study among them.

    Returns:
        The works that write fields/modes_*, fields/phase_* and figures/mode_*.
    """
    on_first(partial(_clear, study.store), comm)
    run, drawn = _severe(study, comm)
    rest, known = _resting(study, first), dict[Task, Array]()

    fields = partial(_write_equilibria, study, first, faces, known)
    write = partial(spared, "fields of the equilibria", fields)
    # On one process: the factor of all bodies is large. The others take those of single bodies.
    written = None if rest else meanwhile(write, comm)
    modes = []
    for mode in (mode for chosen in drawn for mode in chosen):
        task = mode.approach, mode.sample
        stored = study.stored(task)
        modes.append((study.sample(task), stored, np.array([mode.mode])))
    given = study.models, modes, comm, int(not rest), rest
    found, missing = spared("shapes of modes", lambda: displacements(*given))
    every = found or []
    known |= zip(first, [u[:, 0].real for u, _ in every[len(modes) :]], strict=False)
    lost, shapes, works = (written or meanwhile(write, comm))()[1], iter(every), []
    seen = cache(partial(_seen, study, pictures))  # by a process that draws
    for chosen in drawn if found is not None else ():
        own = [next(shapes) for _ in chosen]
        works += _shape_works(study, run, chosen, [u[:, 0] for u, _ in own], seen)
        missing += [
            f"shape of the mode at {mode.frequency:.0f} Hz of {mode.approach} {mode.sample}: its"
            f" displacements have an estimated relative error of {error[0]:.0e}"
            for mode, (_, error) in zip(chosen, own, strict=True)
            if not error[0] <= EXACT
        ]
    return ShapeWorks(works, lost + missing)


def _clear(store: Store) -> None:
    """Folders of the fields and figures, without those of an earlier run."""
    shutil.rmtree(store.path("fields"), ignore_errors=True)
    for name in ("fields", "figures"):
        store.path(name).mkdir(exist_ok=True)
    for old in (*store.path("figures").glob("mode_*.*"), store.path("figures", "mesh.png")):
        old.unlink(missing_ok=True)


def write_shapes(study: Study, rows: Sequence[mode_cards.ModeShape]) -> None:
    """Write figures/mode_shapes.csv, and its columns for the page, on one process."""
    table = tables.RowTable.of(mode_cards.ModeShape, rows)
    table.write(study.store.path("figures", "mode_shapes.csv"))
    save_tables(study.store, mode_cards.SHAPES, {"shapes": table.columns})


def contact_faces(study: Study) -> dict[str, AnyArray]:
    """Facets of the interfaces' first faces, and the facet of every contact element; collective.

    An element of "patch" or "quadrature" belongs to the facet whose centre is nearest; one of
    "node" to none.

    Args:
        study: the study; process 0 writes its contact_faces.npz.

    Returns:
        ``corners`` in cyclic order [m], shape (facets, 3 or 4, 3), ``facet``, -1: none, and
        ``slides``, whether an element's faces slide.
    """
    b = study.brake
    facet, corners, count = np.full(len(b.w), -1), [], 0
    for i, table in enumerate(study.scene.contact.values()):
        face = gather_face(b.mesh, b.elastic.free, table.faces[0])
        if table.discretisation != "node":
            own = b.contact.interface == i
            facet[own] = count + KDTree(face.centre).query(b.points[own])[1]
        corners.append(face.corners)
        count += len(face.corners)
    found = {"corners": np.concatenate(corners), "facet": facet, "slides": b.contact.speed > 0}
    if study.comm.rank == 0:
        study.store.save("contact_faces.npz", **found)
    return found


def _resting(
    study: Study, first: Mapping[Task, Mapping[str, Any]]
) -> list[tuple[SampleInput, Mapping[str, Any]]]:
    """Samples and what was stored of them; none where a displacement takes the whole stiffness."""
    given = [(study.sample(task), data) for task, data in first.items()]
    return given if all(by_bodies(study.models, sample) for sample, _ in given) else []


def _write_equilibria(
    study: Study, first: Mapping[Task, Mapping[str, Any]], faces: dict[str, AnyArray],
    known: Mapping[Task, Array],
) -> None:  # fmt: skip
    """Displacements; pressure, gap, stiffness and state of every contact element."""
    folder, free = study.store.path("fields"), study.brake.elastic.free
    for task, u in (known or study.displacements(first)).items():
        name, data, whole = task[0], first[task], free.expand(u)
        if study.brake.lift is not None:
            whole = whole + study.brake.lift
        write_fields(folder / f"equilibrium_{name}.vtkhdf", free.V, {"u_e": whole})
        values = {key: data[key] for key in ("g", "g_cr", "p", "k", "k_vibration")}
        contact = contact_of(study.brake.contact, data)
        values["active"] = (data["p"] > 0).astype(float)
        write_points(folder / f"contact_{name}.vtkhdf", contact.points, values)
        facet, corners = faces["facet"], faces["corners"]
        if np.any(facet >= 0):
            n = len(corners)
            means = {key: facet_means(facet, contact.w, v, n) for key, v in values.items()}
            held = np.isfinite(means["p"])
            means = {key: v[held] for key, v in means.items()}
            write_facets(folder / f"pressure_{name}.vtkhdf", corners[held], means)


def _severe(study: Study, comm: MPI.Comm) -> tuple[RunData, list[list[squeal.ModeKey]]]:
    """What is known of the study, and the modes drawn of each approach that squeals; collective."""
    folder, settings = study.store.directory, {"in_effect": in_effect(study.scene)}

    def severe() -> list[list[squeal.ModeKey]]:
        run = read_run(folder, settings)
        keys = (run.squeal.representatives(name, MOST) for name in run.approaches)
        return [chosen for chosen in keys if chosen]

    return RunData(folder, summary=settings), on_first(severe, comm)


def _seen(study: Study, pictures: bool) -> render.Shapes | None:
    """What draws the mode shapes of a study; None without pictures."""
    if not pictures:
        return None
    return render.Shapes(study.brake.elastic.free.V, tied_bodies(study.scene, study.brake))


def _shape_works(
    study: Study,
    run: RunData,
    chosen: list[squeal.ModeKey],
    shapes: list[Complex],
    seen: Callable[[], render.Shapes | None],
) -> list[Callable[[], tuple[mode_cards.ModeShape | None, list[str]]]]:
    """Works for some modes of an approach: their fields, and for each a period and its pictures.

    Args:
        study: the study.
        run: its tables.
        chosen: the modes.
        shapes: displacement of each, shape (dofs,).
        seen: gives what draws them; None: they are not drawn.
    """
    store, name, free = study.store, chosen[0].approach, study.brake.elastic.free
    V, rotors = free.V, _rotors(study)

    def write() -> None:
        pairs = zip(chosen, shapes, strict=True)
        fields = {f"mode_{mode.name}": free.expand(shape) for mode, shape in pairs}
        write_fields(store.path("fields", f"modes_{name}.vtkhdf"), V, fields)

    def draw(mode: squeal.ModeKey, of_free: Complex) -> mode_cards.ModeShape:
        hertz, share, shape = mode.name, mode.family.share, free.expand(of_free)
        write_phases(store.path("fields", f"phase_{name}_{hertz}.vtkhdf"), V, shape)
        often = f"; family squeals in {share.hits} of {share.n} samples" if share.n > 1 else ""
        title = (
            f"{label(run, name)}, sample {mode.sample}: {mode.frequency:.0f} Hz,"
            f" damping {mode.damping:.2e}{often}"
        )
        picture = f"mode_{name}_{hertz}"
        if (look := seen()) is not None:
            look.still(store.path("figures", f"{picture}.png"), shape, title)
            look.film(store.path("figures", f"{picture}.webp"), shape)
        numbers = mode.family.number, mode.sample, mode.mode, mode.frequency, mode.damping
        return mode_cards.ModeShape.of(name, *numbers, picture, *_nodal_cells(rotors, V, shape))

    works: list[Callable[[], tuple[mode_cards.ModeShape | None, list[str]]]] = []
    works.append(partial(spared, f"fields of the modes of {name}", write))
    for mode, shape in zip(chosen, shapes, strict=True):
        what = f"picture of the mode at {mode.frequency:.0f} Hz"
        works.append(partial(spared, what, partial(draw, mode, shape)))
    return works


def tied_bodies(scene: Scene, brake: Brake) -> Index:
    """Number of the body of each node, as pictures place them: ties join bodies to one.

    A face may lie on several copies of a part; each copy is glued to what is nearest. A body by
    matrices has no mesh, and is not drawn.
    """
    free = brake.elastic.free
    body = body_of_nodes(free.V)
    found = [np.column_stack([body, body])]
    for tie in (t for t in scene.ties.values() if {*t.faces} <= {*brake.mesh.faces}):
        first, second = (gather_face(brake.mesh, free, face) for face in tie.faces)
        nearest = KDTree(second.centre).query(first.centre)[1]
        ends = first.number[:, 0], second.number[nearest, 0]
        found.append(np.column_stack([body[end] for end in ends]))
    return body_of_points(np.concatenate(found), int(body.max(initial=-1)) + 1)[body]


def _rotors(study: Study) -> dict[str, Index]:
    """Nodes of each part that turns about z, by its name."""
    scene, mesh, V = study.scene, study.brake.mesh, study.brake.elastic.free.V
    if scene.motion is None or scene.motion.axis != "z" or scene.motion.point:
        return {}
    found = {}
    for name, table in scene.contact.items():
        part = table.faces[1].partition(".")[0]
        if slides(scene, name) and part not in found:
            found[part] = np.unique([V.dofmap.cell_dofs(int(c)) for c in mesh.cells_of(part)])
    return found


def _nodal_cells(
    rotors: Mapping[str, AnyArray], V: Any, shape: AnyArray
) -> tuple[str | None, int | None, str | None, float | None]:
    """The rotor that is a closed ring, and the strongest harmonic of its rim."""
    points, u = V.tabulate_dof_coordinates(), shape.reshape(-1, V.dofmap.index_map_bs)
    for name, nodes in rotors.items():
        pattern = nodal_pattern(points[nodes], u[nodes])
        if pattern is not None:
            return name, pattern.diameters, pattern.direction, pattern.share
    return None, None, None, None
