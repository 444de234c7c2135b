"""What of a brake is refused or doubtful once it is assembled: a line each.

Bodies that move freely are refused. Faces that face nothing or lie apart, coarse meshes, large
imposed displacements, and what a mesh file states and the scene has not are allowed, and most
probably not meant.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from brake_fenicsx.errors import SceneError, lines
from brake_fenicsx.macro.contact_forces import Rotation
from brake_fenicsx.macro.faces import Face, gather_face
from brake_fenicsx.macro.free_motions import FreeMotions, free_motions
from brake_fenicsx.macro.material import Material, engineering_constants
from brake_fenicsx.meshing import brake_mesh, rawmesh
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.scene import slides
from brake_fenicsx.scene.units import quantity_text

from . import interfaces, scene_mesh
from .brake import Brake

# Sections that join or hold parts.
JOINING = ("ties", "springs", "supports")
ALONE = 0.05  # share of a first face that faces nothing, from which it is said
APART = 10e-6  # m, smallest gap before the load from which it is said
# Nodes of a wavelength below which a mesh is too coarse for it.
NODES = 6.0

# Displacement of a face over the shortest side of its part, above which it is most probably wrong.
LARGE = 0.5


@lines
def brake_doubts(scene: Scene, brake: Brake) -> Iterator[str]:
    """What is doubtful of a brake: what is not read of its meshes, cells, places, joints, loads.

    Raises:
        SceneError: a part moves freely.
    """
    yield from brake.mesh.unread.changing
    for file, stated in left_out(scene, brake.mesh.unread).items():
        yield f"""{file}: not in the scene: {", ".join(one.said for one in stated)}; write them, or
            ignore this if you left them out"""
    yield from brake.elastic.doubts
    for rule in (check_free_motions, placement_doubts, _resolution, _displacements):
        yield from rule(scene, brake)


def check_free_motions(scene: Scene, brake: Brake) -> list[str]:
    """Refuse parts that move freely.

    Args:
        scene: the scene.
        brake: its operators.

    Returns:
        Parts in several pieces with coincident nodes, and bodies that rest on contact unpressed.

    Raises:
        SceneError: the parts, the directions and the remedy.
    """
    given = [name for name, part in scene.parts.items() if part.matrices is not None]
    found = free_motions(brake, given)
    if found.motions:
        raise SceneError(f"{scene.file}: {_refusal(scene, brake, found)}")
    merge = [f"{text}; merge them in the mesh" for text in found.pieces.values()]
    return merge + found.unpressed


def _refusal(scene: Scene, brake: Brake, found: FreeMotions) -> str:
    """What moves freely, and the remedies."""
    sentences = []
    for (parts, how), count in found.motions.items():
        bodies = f"{count} pieces of part" if count > 1 else "parts" if len(parts) > 1 else "part"
        together = " together" if len(parts) > 1 else ""
        sentences.append(f"{bodies} {' and '.join(parts)}{together}: free to {how}")
    free = {name for parts, _ in found.motions for name in parts}
    sentences += [
        f"{text}: merge them in the mesh" for name, text in found.pieces.items() if name in free
    ]
    left = left_out(scene, brake.mesh.unread).values()
    lost = [one.said for stated in left for one in stated if one.section in JOINING]
    if lost and (of_file := [name for name in scene_mesh.file_parts(scene) if name in free]):
        whose = f"{scene.mesh.file}, the mesh of {' and '.join(of_file)}"
        sentences.append(f"{whose}, has {' and '.join(lost)}, which the scene has not")
    return f"""{"; ".join(sentences)}. Hold them by supports, ties or springs; contact holds along
        its normal alone"""


@lines
def placement_doubts(scene: Scene, brake: Brake) -> Iterator[str]:
    """First faces partly without an opposite face; faces that are apart or overlap before the load.

    Distances within the accuracy of plane facets of curved faces are left out.
    """
    opposite: dict[str, dict[str, float]] = {}
    for name, table in scene.contact.items():
        first, second = table.faces
        opposite.setdefault(first, {})[second] = brake.faced[name][0]
    for first, each in opposite.items():
        named = [name for name, table in scene.contact.items() if table.faces[0] == first]
        whole = brake.faced[named[0]][1]
        alone = whole - sum(each.values())
        if alone > ALONE * whole:
            yield f"""contact.{", contact.".join(named)}: {1e6 * alone:.4g} of {1e6 * whole:.4g}
                mm^2 of {first} have no opposite face; correct the place of the parts, or the
                faces"""
    yield from _axis_doubts(scene, brake)
    for i, (name, table) in enumerate(scene.contact.items()):
        g0 = brake.g0[brake.contact.interface == i]
        apart, overlap = float(g0.min()), -float(g0.max())
        if max(apart, overlap) <= APART:
            continue
        faces = (gather_face(brake.mesh, brake.elastic.free, face) for face in table.faces)
        if max(apart, overlap) > APART + sum(map(_rise, faces)):
            away = f"are {1e3 * apart:.3f} mm apart"
            place = away if apart > 0 else f"overlap by {1e3 * overlap:.3f} mm"
            yield f"""contact.{name}: the faces {place} before the load; correct the place of the
                parts"""


def _axis_doubts(scene: Scene, brake: Brake) -> Iterator[str]:
    """Interfaces that an axis of rotation passes through."""
    motion = None if scene.motion is None else interfaces.scene_motion(scene)
    if not isinstance(motion, Rotation):
        return
    for i, name in enumerate(scene.contact):
        sliding = (brake.contact.interface == i) & (brake.contact.speed > 0)
        arm = np.linalg.norm(motion.local(brake.points[sliding])[:, :2], axis=1)
        if np.any(arm**2 < brake.w[sliding]):
            yield f"""contact.{name}: the axis of the motion passes through the faces, which turn
                there on the spot; correct motion.axis or motion.point, or write
                motion.direction"""


def _rise(face: Face) -> float:
    """Rise of an arc over a plane facet, from the angles to the facets beside it: a median [m]."""
    count = min(5, len(face.centre))
    if count < 2:
        return 0.0
    away, near = cKDTree(face.centre).query(face.centre, count)
    cosine = np.einsum("ikc,ic->ik", face.normal[near[:, 1:]], face.normal)
    curvature = (np.arccos(np.clip(cosine, -1.0, 1.0)) / away[:, 1:]).max(axis=1)
    return float(np.median(curvature * face.radius**2 / 2))


def _resolution(scene: Scene, brake: Brake) -> Iterator[str]:
    """Parts whose shortest wave at the end of the band has too few nodes.

    That is the shear wave, or the bending wave of a plate of the layer's thickness where this is
    shorter. Layers of a part that are thinner than a sixth of the shear wave follow the stiffest.
    """
    raw = brake.mesh.raw
    if scene.stability is None or "stability" not in scene.stages or raw is None:
        return
    end = float(scene.stability.band[1])
    for part in raw.parts():
        own = [layer for layer in raw.layers if layer.partition(".")[0] == part]
        thick = {layer: _thickness(raw, layer) for layer in own}
        moduli = {layer: engineering_constants(brake.materials[layer].C)["E_x"] for layer in own}
        stiffest = max(own, key=lambda layer: moduli[layer] * thick[layer] ** 3)
        every = []
        for layer in own:
            shear, bending = _waves(brake.materials[layer], thick[layer], end)
            if layer == stiffest or thick[layer] >= shear / NODES:
                wave, power = min((shear, 1.0), (bending, 2.0))
                nodes = wave / _spacing(raw, layer, scene.mesh.degree)
                every.append((nodes, layer, wave, end * (nodes / NODES) ** power))
        nodes, layer, wave, reached = min(every)
        if nodes < NODES:
            cell = quantity_text(float(f"{wave / NODES * scene.mesh.degree:.2g}"), "m")
            yield f"""parts.{part}: {nodes:.2g} nodes per wavelength ({1e3 * wave:.3g} mm in
                {layer}) at the end of stability.band, {end:g} Hz, fewer than {NODES:g}: take cells
                of {cell} at most, or end the band at {float(f"{reached:.2g}"):g} Hz"""


def _displacements(scene: Scene, brake: Brake) -> Iterator[str]:
    """Imposed displacements that are not small beside the part: the analysis is linear."""
    for face, load in sorted(scene.loads.items()):
        sides = brake.mesh.extents.get(face.partition(".")[0])
        moved = max(map(abs, (load.displacement or {}).values()), default=0.0)
        if sides is not None and moved > LARGE * min(sides):
            yield f"""loads."{face}".displacement = {quantity_text(moved, "m")}: the shortest side
                of the part is {quantity_text(min(sides), "m")}, and the analysis holds for small
                displacements; correct the unit if it is wrong"""


def _waves(m: Material, thickness: float, frequency: float) -> tuple[float, float]:
    """Lengths of the shear wave and of the bending wave of a plate [m]."""
    stiffness, omega = engineering_constants(m.C), 2 * np.pi * frequency
    shear = min(stiffness[name] for name in ("G_yz", "G_xz", "G_xy"))
    plate = stiffness["E_x"] * thickness**2 / (12 * m.rho)
    wave_numbers = omega / np.sqrt(shear / m.rho), np.sqrt(omega) / plate**0.25
    return 2 * np.pi / float(wave_numbers[0]), 2 * np.pi / float(wave_numbers[1])


def _thickness(raw: rawmesh.RawMesh, layer: str) -> float:
    """Shortest side of the box around a layer, or around the largest of its bodies [m]."""
    cells = raw.cells[raw.cell_tag == raw.layers[layer]]
    nodes, own = np.unique(cells, return_inverse=True)
    own = own.reshape(cells.shape)
    pairs = np.repeat(own[:, 0], own.shape[1] - 1), own[:, 1:].ravel()
    joined = sp.coo_matrix((np.ones(pairs[0].size), pairs), (nodes.size, nodes.size))
    _, body = connected_components(joined, directed=False)
    largest = body == np.bincount(body).argmax()
    return min(brake_mesh.extent(raw.points[nodes[largest]]))


def _spacing(raw: rawmesh.RawMesh, layer: str, degree: int) -> float:
    """Distance of nodes along the longer half of the edges of cells, their median [m]."""
    x = raw.points[raw.corners[raw.cell_tag == raw.layers[layer]]]
    first, second = np.array(rawmesh.EDGES[raw.shape]).T
    edges = np.sort(np.linalg.norm(x[:, first] - x[:, second], axis=2), axis=1)
    return float(np.median(edges[:, edges.shape[1] // 2 :].mean(axis=1))) / degree


def left_out(scene: Scene, unread: rawmesh.Unread) -> dict[str, list[rawmesh.Stated]]:
    """Joints, supports and loads of mesh files that no section of the scene has, by file."""
    lost: dict[str, list[rawmesh.Stated]] = {}
    for file, stated in unread.stated:
        if not _holds(scene, stated):
            lost.setdefault(file, []).append(stated)
    return lost


def _holds(scene: Scene, stated: rawmesh.Stated) -> bool:
    """Whether the scene has a joint between the same faces, or a table of all faces."""
    if len(stated.faces) == 2:
        # Faces in contact may be glued; those that are tied may stick, but not slide.
        stuck = [table for name, table in scene.contact.items() if not slides(scene, name)]
        entries: list[Any] = [*scene.ties.values(), *stuck]
        if stated.section != "ties":
            entries = [*getattr(scene, stated.section).values(), *scene.ties.values()]
        pairs = [{*(entry.faces or ())} for entry in entries]
        first, second = stated.faces
        return any({a, b} in pairs for a in first for b in second)
    names = {*getattr(scene, stated.section)}
    if stated.section == "springs":
        names |= {face for spring in scene.springs.values() for face in spring.faces or ()}
    return bool(stated.faces[0]) and stated.faces[0] <= names
