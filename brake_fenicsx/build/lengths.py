"""Lengths of a scene that vary: thicknesses of layers, and lengths that move nodes of a mesh.

Some move contact elements along their faces: chamfer, slot, outline of a face. The facets stay the
same ones and slide over the other face, so that areas and rows follow a length with as many
derivatives as the shape functions leave: no series of matrices holds them, and they are integrated
anew for each sample. Gaps stay those of the scene.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

from mpi4py import MPI

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro import contact_elements, morphing, stretching
from brake_fenicsx.meshing.brake_mesh import Mesh
from brake_fenicsx.meshing.rawmesh import RawMesh
from brake_fenicsx.scene import Scene, parts_section
from brake_fenicsx.scene.keys import key_parts
from brake_fenicsx.scene.rules import faces_by_area
from brake_fenicsx.scene.scalars import written_value

from .brake import Brake
from .interfaces import interface_elements
from .scene_mesh import file_mesh, mesh_settings

Shape = stretching.Stretch | morphing.Moving
Shapes = dict[tuple[str, ...], Shape]
# Decimals of the lengths, relative to those of the scene, by which contact elements are told apart.
DIGITS = 12
# Centres of contact elements move at most this multiple of what nodes do.
FAST = 2.0


def lengths_in(names: tuple[str, ...], shape: Shape, values: Mapping[str, float]) -> Array:
    """Lengths of a shape by the scalars that differ from the scene [m], shape (lengths,)."""
    return np.array([values.get(n, own) for n, own in zip(names, shape.usual, strict=True)])


def shapes_of(scene: Scene, mesh: Mesh, ranges: Mapping[str, tuple[float, float]]) -> Shapes:
    """What the lengths that vary do to the layers of their parts.

    Args:
        scene: the scene.
        mesh: its mesh.
        ranges: length, by its dotted key -> lowest and highest value [m].

    Raises:
        SceneError: a layer cannot be stretched by itself, or is folded; or a face in use changes.
    """
    found: Shapes = {}
    moves = {name: movement(scene, morphing.plain(mesh), name) for name in ranges}
    for layers, names in _groups(scene, mesh, moves):
        part, key = parts_section.length_key(names[0])
        faces, usual = faces_by_area(scene, part), [written_value(scene, name) for name in names]
        if len(names) == 1 and parts_section.layers_of_thickness(scene.parts[part], key):
            for layer in layers:
                stretching.check_layer(
                    mesh, layer, usual[0] if parts_section.FILE_LAYER in names[0] else None, faces
                )
            found[names[0],] = stretching.Stretch(tuple(layers), np.array(usual))
            continue
        every = []
        for name, length in zip(names, usual, strict=True):
            if (v := moves[name]) is None:
                raise SceneError(f"""{", ".join(names)}: move the same layers, which {name} can only
                    alone: leave one as it is, or write the two as lengths of displaced meshes or of
                    a builder""")
            every.append(morphing.Move(name, length, ranges[name], v))
        found[tuple(names)] = morphing.moving(mesh, mesh_settings(scene), every, faces)
    return found


def _groups(
    scene: Scene, mesh: Mesh, moves: Mapping[str, Array | None]
) -> list[tuple[set[str], list[str]]]:
    """Layers with the lengths that change them, all lengths of a layer together."""
    groups = list[tuple[set[str], list[str]]]()
    for name, v in moves.items():
        part, key = parts_section.length_key(name)
        layers = {
            f"{part}.{layer}" for layer in parts_section.layers_of_thickness(scene.parts[part], key)
        }
        if v is not None and not layers:
            layers = {*morphing.deformed_layers(mesh, v)}
        shared = [group for group in groups if group[0] & layers]
        groups = [group for group in groups if group not in shared]
        names = [other for group in shared for other in group[1]]
        groups.append((layers.union(*(group[0] for group in shared)), [*names, name]))
    return groups


def movement(scene: Scene, raw: RawMesh, name: str) -> Array | None:
    """Movement of all nodes per length [m/m], shape (nodes, 3); None of a layer of a mesh file.

    Args:
        scene: the scene.
        raw: its plain mesh.
        name: the length, by its dotted key.
    """
    part, key = parts_section.length_key(name)
    v, planes = np.zeros_like(raw.points), parts_section.moved_planes(scene.parts[part], key)
    sideways = parts_section.moved_sideways(scene.parts[part], key)
    if planes or sideways:
        own = np.unique(raw.cells[raw.part(part)])
        if planes:
            v[own, 2] = np.interp(raw.points[own, 2], *planes)
        if sideways:
            v[own, :2] = sideways(raw.points[own])
        return v
    if parts_section.morph_of(scene.parts[part], key) is None:
        return None
    step = file_mesh(scene)[1][name.removesuffix(".value")]
    # The nodes of the file come behind those of the builders.
    v[len(v) - len(step) :] = step
    return v


class MovingContact:
    """Contact elements of a scene at other lengths.

    Attributes:
        names: the lengths that move them.
    """

    def __init__(self, scene: Scene, brake: Brake, shapes: Mapping[tuple[str, ...], object]):
        """Ask which lengths move which interfaces.

        Args:
            scene: the scene.
            brake: its operators.
            shapes: what lengths do, by their dotted keys.

        Raises:
            SceneError: an interface that may not move.
        """
        self._scene, self._brake = scene, brake
        self._interfaces: set[str] = set()
        # Length in the scene, and movement of the nodes per length.
        self._moves: dict[str, tuple[float, Array]] = {}
        for names, shape in shapes.items():
            if not isinstance(shape, morphing.Moving):
                continue
            for name, usual, v, slides in zip(
                names, shape.usual, shape.v, shape.slides, strict=True
            ):
                interfaces = {key_parts(key)[1] for key in slides}
                if interfaces:
                    self._moves[name] = float(usual), v
                self._interfaces |= interfaces
                for interface, key in product(interfaces, ("zone", "tangential_stiffness")):
                    if getattr(scene.contact[interface], key) is not None:
                        raise SceneError(f"""{name}: moves the facets of contact.{interface}, which
                            its {key} does not follow: leave that out, or run the scene once for
                            each value""")
        self.names: list[str] = list(self._moves)
        self._latest: tuple[Array, contact_elements.Contact] | None = None

    def at(self, values: Mapping[str, float]) -> contact_elements.Contact:
        """The contact elements by the scalars that differ from the scene, SI; the latest are kept.

        Raises:
            SceneError: facets come into contact, or leave it.
        """
        share = [values.get(n, own) / own - 1 for n, (own, _) in self._moves.items()]
        mark = np.round(share, DIGITS)
        if not mark.any():
            return self._brake.contact
        if self._latest is None or not np.array_equal(self._latest[0], mark):
            moves = zip(share, self._moves.values(), strict=True)
            step = sum(part * own * v for part, (own, v) in moves)
            try:
                self._latest = mark, self._integrated(np.asarray(step, float))
            except SceneError as error:
                own = ((n, values.get(n, length)) for n, (length, _) in self._moves.items())
                said = ", ".join(f"{n} = {1e3 * length:.4g} mm" for n, length in own)
                raise SceneError(f"{said}: {error}") from None
        return self._latest[1]

    def _integrated(self, step: Array) -> contact_elements.Contact:
        """The elements where the nodes of the mesh have moved, shape (nodes, 3)."""
        b, every = self._brake, list[contact_elements.Contact]()
        x, reach = b.mesh.domain.geometry.x, FAST * float(np.linalg.norm(step, axis=1).max())
        before = x.copy()
        x += step
        try:
            for i, name in enumerate(self._scene.contact):
                there = here = contact_elements.restricted(b.contact, b.contact.interface == i)
                if name in self._interfaces:
                    there = interface_elements(
                        self._scene, name, b.mesh, b.elastic.free, MPI.COMM_SELF
                    )
                if len(here.w) != len(there.w) or np.any(abs(here.points - there.points) > reach):
                    raise SceneError(f"""facets of contact.{name} come into contact or leave it:
                        narrow the range""")
                every.append(there)
        finally:
            x[:] = before
        return replace(contact_elements.join(every), g0=b.g0, uncovered=b.contact.uncovered)
