"""Rules between sections of a scene: parts, what acts on their faces, and damping."""

import json
from collections.abc import Iterator

from .bodies_section import DIRECTIONS
from .keys import dotted
from .parts_section import BUILDERS, longest_length
from .scene import (
    Scene,
    depends_on_speed,
    one_friction,
    rubs,
    slides,
    turning_parts,
    used_materials,
)
from .stability_section import WHERE, Damping

# Finer sizes, which the number of cells that is looked at before meshing leaves out -> the least
# share of the part's length: ten million facets of a face; a spot or a line may be finer.
FINEST = {"face_size": 3e-4, "fine": 1e-5}


def part_mistakes(s: Scene) -> Iterator[str]:
    """Every part has cells, a possible length, and its material is there."""
    low, high = s.mesh.extent
    for name, part in s.parts.items():
        where = f"parts.{name}"
        if part.builder is None and part.matrices is None and s.mesh.file is None:
            yield f"""{where}.builder: missing; use one of {", ".join(BUILDERS)}, or name a
                mesh.file"""
        if part.parameters is not None:
            longest, length = longest_length(part.parameters)
            if not low <= length <= high:
                yield f"""{where}.{longest} = {length:.3g} m: the longest length of the part, not
                    between {low:g} m and {high:g} m; correct the unit, or widen mesh.extent"""
            for key, share in FINEST.items():
                size = getattr(part.parameters, key, None)
                if size is not None and size < share * length:
                    yield f"""{where}.{key} = {size:.3g} m: less than {share:g} of the part's
                        {longest} = {length:.3g} m, more cells than can be made; correct the unit"""
        for material in part.materials:
            if material not in s.materials:
                yield f"{where}.material = {material!r}: there is no [materials.{material}]"


def faces_by_area(s: Scene, part: str) -> dict[str, str]:
    """Faces of a part whose area or shape matters: key of the scene -> "part.face"."""
    found = {f"contact.{n}.faces": c.faces for n, c in s.contact.items()}
    found |= {f"ties.{n}.faces": tie.faces for n, tie in s.ties.items()}
    found |= {f"springs.{n}": spring.faces or (n,) for n, spring in s.springs.items()}
    found |= {dotted("loads", face): (face,) for face in s.loads}
    found |= {dotted("masses", face): (face,) for face in s.masses}
    all_faces = ((key, face) for key, faces in found.items() for face in faces)
    return {key: face for key, face in all_faces if face.partition(".")[0] == part}


def face_mistakes(s: Scene) -> Iterator[str]:
    """Ties of faces in contact, masses of turning parts, and loads that their face cannot take."""
    touching = {face: name for name, contact in s.contact.items() for face in contact.faces}
    for name, tie in s.ties.items():
        for face in tie.faces:
            if face in touching:
                yield f"""ties.{name}.faces: {face!r} is in contact.{touching[face]} as well, whose
                    faces the tie would glue; leave one out, or divide the face"""
    if s.masses and s.damping and s.damping.gyroscopic:
        yield f"""masses: {", ".join(s.masses)}: stability.damping.gyroscopic knows the density of
            the bodies alone; leave the masses or gyroscopic out"""
    for face, load in s.loads.items():
        where = f'loads."{face}"'
        if load.displacement is not None:
            yield from _displacement(s, face, load.displacement)
        part = s.parts.get(face.partition(".")[0])
        both = getattr(getattr(part, "parameters", None), "side", None) == "both"
        if both and (load.force or load.moment):
            yield f"""{where}: the face lies on both sides of the disc; write a pressure, or side =
                "top" and a second part with side = "bottom" """


def _displacement(s: Scene, face: str, moved: dict[str, float]) -> Iterator[str]:
    """Directions that the face's support holds, of a part whose stiffness is that of the scene."""
    where, held = f'loads."{face}".displacement', s.supports.get(face, ())
    for unknown in (c for c in moved if c not in DIRECTIONS):
        yield f"{where}: {unknown!r}: unknown direction; write x, y or z"
    if not moved or any(c not in held for c in moved):
        yield f"""{where} = {moved!r}: moves directions that a support holds; write
            supports."{face}" = ["x", "y", "z"], or those of them that are meant"""
    name = face.partition(".")[0]
    part = s.parts.get(name)
    if part is None or part.matrices is not None:
        yield f"{where}: moves a face of a mesh; write a force on the set of nodes"
        return
    for varied in s.varied:
        if varied.split(".")[1] in (*part.materials, name):
            yield f"""{where}: the force of the displacement would change with {varied}; leave that
                out, or write a force"""


def damping_mistakes(scene: Scene) -> Iterator[str]:
    """Terms that lack what they act on."""
    table, used = scene.damping, sorted(used_materials(scene))
    losses = {name: loss for name in used if (loss := scene.materials[name].loss)}
    acts = bool(table and table.loss) or "stability" not in scene.stages
    for name, loss in losses.items() if not acts else ():
        yield f"""{dotted("materials", name, "loss")} = {loss:g}: acts only with {WHERE}.loss =
            true; write it, with {WHERE}.omega_ref, or leave the loss factor out"""
    if table is None:
        return
    if table.loss and not losses:
        yield f"{WHERE}.loss: no material of a part has a loss factor; write materials.NAME.loss"
    yield from _friction(scene, table)
    if table.gyroscopic:
        yield from _turning(scene)
    for name in table.modal:
        if name not in scene.parts:
            yield f"{WHERE}.{dotted('modal', name)}: {_no_part(scene, name)}"
    if table.modal and "stability" in scene.stages:
        yield from _modal(scene)


def _no_part(scene: Scene, name: str) -> str:
    return f"there is no part {name!r}; there are {', '.join(scene.parts)}"


def _friction(scene: Scene, table: Damping) -> Iterator[str]:
    """Terms of friction need friction, and its slope one that depends on the speed."""
    approaches = scene.samples.approaches
    if table.sliding and not any(rubs(scene, a) for a in approaches):
        yield f"{WHERE}.sliding: there is no friction; write contact.NAME.friction"
    if not table.slope:
        return
    if not any(depends_on_speed(c.friction) for n, c in scene.contact.items() if slides(scene, n)):
        yield f"""{WHERE}.slope: no friction depends on the speed; write contact.NAME.friction = {{
            static = .., kinetic = .., decay = .. }}"""
    if all(one_friction(scene, a) for a in approaches):
        yield f"""{WHERE}.slope: samples.classical.friction is one number in the approaches
            {", ".join(approaches)}; leave it out, or name multi-scale or joint"""


def _turning(scene: Scene) -> Iterator[str]:
    """The gyroscopic term needs a rotation, and parts that turn."""
    motion, turns = scene.motion, {*turning_parts(scene)}
    if motion is None or motion.direction is not None:
        yield f'{WHERE}.gyroscopic: needs a rotation; write motion.axis = "z" and motion.speed'
    elif not motion.rate:
        yield f"motion.speed = {motion.speed!r}: {WHERE}.gyroscopic needs a rotation"
    for name in turns:
        if name not in scene.parts:
            yield f"{WHERE}.gyroscopic: {_no_part(scene, name)}"
    joints = {f"ties.{name}": tie.faces for name, tie in scene.ties.items()}
    stuck = {f"contact.{n}": c.faces for n, c in scene.contact.items() if not slides(scene, n)}
    for where, faces in (joints | stuck).items():
        parts = {face.partition(".")[0] for face in faces}
        if (rests := parts - turns) and parts & turns:
            yield f"""{where}: {", ".join(rests)} does not turn, and the part that it is joined to
                does; write {WHERE}.gyroscopic = {json.dumps(sorted(turns | parts))}"""


def _modal(scene: Scene) -> Iterator[str]:
    """Ratios of modes of the parts, in an analysis that has such modes."""
    wanted = {"method": "reduced", "verify": 0, "on_tolerance": "warn", "drivers": False}
    for name, value in wanted.items():
        if getattr(scene.stability, name) != value:
            yield f"""{WHERE}.modal: ratios belong to the modes of the parts, which only the reduced
                model has; write stability.{name} = {json.dumps(value)}, or name rayleigh or loss"""
