"""Rules between sections of a scene: names, stages, approaches, parts, faces and what varies."""

import json
import os
from collections.abc import Iterator
from itertools import combinations

from brake_fenicsx.errors import SceneError

from .keys import dotted, shown
from .parts_section import BUILDERS, DIRECTIONS, longest_length
from .samples_section import APPROACHES, NO_ROUGH_SAMPLES, below_least, is_constant, split_key
from .scalars import check_scalar
from .scene import (
    STAGES,
    Scene,
    depends_on_speed,
    one_friction,
    own_surface,
    rubs,
    slides,
    turning_parts,
    used_materials,
)
from .stability_section import WHERE, Damping

# Sections without which a stage has nothing to do, and stages that build on another one.
SECTIONS = dict(surface="surface", micro="micro", equilibrium="contact", stability="stability")
PREDECESSORS = {"micro": "surface", "stability": "equilibrium", "uncertainty": "equilibrium"}
LONGEST_NAME = 100
# Keys of [samples] that are about many of them.
MANY = ("n", "random", "design", "curves", "parametric", "joint", "limit")

# Finer sizes, which the number of cells that is looked at before meshing leaves out -> the least
# share of the part's length: ten million facets of a face; a spot or a line may be finer.
FINEST = {"face_size": 3e-4, "fine": 1e-5}


def check_consistent(s: Scene) -> None:
    """Refuse scenes whose sections contradict each other.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    bodies = _names, _stages, _surface, part_mistakes, _contact, face_mistakes, _motion
    for rule in (*bodies, damping_mistakes, _varied, _sweep, _approaches):
        for text in rule(s):
            raise SceneError(text)


def _names(s: Scene) -> Iterator[str]:
    """Names of tables are words that a person, a file name and a dotted key can hold."""
    for section in ("parts", "materials", "contact", "ties"):
        for name in getattr(s, section):
            hidden = not name.replace(" ", "_").isprintable()
            if hidden or "." in name or not 0 < len(name.strip()) <= LONGEST_NAME:
                yield f"""{dotted(section, name[:LONGEST_NAME])}: write a name of 1 to
                    {LONGEST_NAME} visible characters without dots"""


def _stages(s: Scene) -> Iterator[str]:
    """Some are named; every one has its section and the stages it builds on."""
    if "stages" not in s.table:
        yield f"""stages: missing; name some of {", ".join(STAGES)}, or write stages = [] in a scene
            of parts alone, for correlate and identify"""
    for stage, section in SECTIONS.items():
        if stage in s.stages and not getattr(s, section):
            yield f"stages: {stage!r} needs a section [{section}]"
    for stage, before in PREDECESSORS.items():
        if stage in s.stages and before not in s.stages:
            yield f"stages: {stage!r} needs {before!r}"
    if s.micro and s.micro.patch == "mesh" and "equilibrium" not in s.stages:
        yield 'micro.patch = "mesh": needs the stage equilibrium; write a length'


def _surface(s: Scene) -> Iterator[str]:
    """Files that are not there or count twice, and what gaps ask of the surface."""
    own = {own_surface(n): c.surface for n, c in s.contact.items()}
    for where, surface in {"surface": s.surface, **own}.items():
        if surface is None or "surface" not in s.stages:
            continue
        scan, files = surface.scan, surface.scans
        if scan == ():
            yield f"{where}.scan = []: an empty list; name the file of a scan, or several"
        if not scan and not surface.statistics:
            yield f"{where}: name a scan or statistics"
        if scan and surface.statistics:
            yield f"{where}.scan = {shown(scan)}: give either {where}.scan or {where}.statistics"
        for name, file in [*(("scan", f) for f in files), ("form", surface.form)]:
            if file and not os.path.isfile(s.path(file)):
                yield f"{where}.{name} = {file!r}: no such file; paths start at the scene's folder"
        for one, other in combinations(files, 2):
            if os.path.samefile(s.path(one), s.path(other)):
                yield f"""{where}.scan: {other!r} is the same file as {one!r} and would count twice;
                    leave it out"""


def _contact(s: Scene) -> Iterator[str]:
    """Laws and gaps that no stage provides; interfaces that divide the same faces differently."""
    for name, contact in s.contact.items():
        where = f"contact.{name}"
        if contact.law == "library" and "micro" not in s.stages and s.samples.rough:
            yield f'{where}.law = "library": needs the stages surface and micro'
        if contact.gap != "none" and "surface" not in s.stages:
            yield f'{where}.gap = "{contact.gap}": needs the stage surface'
        if contact.gap == "waviness" and s.surface and s.surface.S_q == "scan":
            yield """surface.S_q = "scan": gap = "waviness" shares the variance of the spectrum;
                write surface.S_q = "spectrum", or gap = "hdf" """
        if contact.gap == "waviness" and s.micro is None:
            yield f"""{where}.gap = "waviness": needs micro.patch, the length from which waves are
                longer"""
    for (one, first), (two, second) in combinations(s.contact.items(), 2):
        for name in ("faces", "discretisation") if {*first.faces} == {*second.faces} else ():
            values = getattr(first, name), getattr(second, name)
            if values[0] != values[1]:
                yield f"""contact.{two}.{name} = {shown(values[1])}: contact.{one} is on the same
                    faces with {shown(values[0])}; write the same, for the two divide its
                    elements"""


def _sweep(s: Scene) -> Iterator[str]:
    """A sweep that has no values, nothing to follow, or samples it cannot follow."""
    sweep = s.sweep
    if sweep is None:
        return
    if "stability" not in s.stages:
        yield "sweep: follows complex modes; add the stage stability to stages"
    if not 1 <= len(sweep.parameters) <= 2:
        yield f"""sweep.parameters: {len(sweep.parameters)} keys; name one or two, such as
            "contact.NAME.friction" = {{ start = 0.0, stop = 0.8, steps = 41 }}"""
    for name, values in sweep.parameters.items():
        if wanted := below_least(name, min(values.points)):
            yield f"{dotted('sweep', 'parameters', name)}: {min(values.points):g}: {wanted}"
    written = f"sweep.samples = {sweep.samples}"
    if sweep.samples and sweep.second:
        yield f"""{written}: samples are followed over one parameter; leave
            {dotted("sweep", "parameters", sweep.second)} or sweep.samples out"""
    if sweep.samples and not s.samples.rough:
        yield f"{written}: {NO_ROUGH_SAMPLES}"
    if sweep.samples and "uncertainty" not in s.stages:
        yield f"{written}: needs the stage uncertainty; add it to stages"


def _motion(s: Scene) -> Iterator[str]:
    """Friction has a direction."""
    sliding = any(rubs(s, approach) for approach in s.samples.approaches)
    if "equilibrium" in s.stages and sliding and s.motion is None:
        yield "motion: friction needs a section [motion]"


def _varied(s: Scene) -> Iterator[str]:
    """Scalars that may vary; no material is named in two ways."""
    for name in s.samples.random:
        check_scalar(s, f'samples.random."{name}"', name)
    for name in s.sweep.parameters if s.sweep else ():
        check_scalar(s, f'sweep.parameters."{name}"', name)
    constants = [split_key(name) for name in s.varied if is_constant(name)]
    by_stiffness = {table for _, table, last in constants if last[0] == "C"}
    for table in by_stiffness & {table for _, table, last in constants if last[0] != "C"}:
        yield f"""samples.random, sweep.parameters: materials.{table} by stiffnesses and by
            engineering constants; use one kind"""


def _approaches(s: Scene) -> Iterator[str]:
    """Approaches that live from random inputs have some, and many samples their stage."""
    if not s.samples.approaches:
        yield f"samples.approaches = []: name some of {', '.join(APPROACHES)}"
    many = "uncertainty" in s.stages
    for name in (a for a in ("parametric", "joint") if a in s.samples.approaches):
        if not s.samples.random:
            yield f"samples.approaches: {name!r} needs random inputs; write [samples.random]"
        if not many:
            yield f"samples.approaches: {name!r} needs the stage uncertainty"
    for name in MANY if "equilibrium" in s.stages and not many else ():
        if s.table.get("samples", {}).get(name, 1) not in (1, {}):
            yield f"""samples.{name}: without the stage uncertainty there is one sample; add it to
                stages, or leave samples.{name} out"""


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
