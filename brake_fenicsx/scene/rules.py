"""Rules that hold between the sections of a scene."""

from __future__ import annotations

import math
from dataclasses import fields
from itertools import combinations
from typing import TYPE_CHECKING

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene.damping import check_damping
from brake_fenicsx.scene.friction import rubs
from brake_fenicsx.scene.mesh import MeshTable
from brake_fenicsx.scene.parts import BUILDERS, part_lengths
from brake_fenicsx.scene.samples import APPROACHES, split_key
from brake_fenicsx.scene.scalars import check_scalar
from brake_fenicsx.scene.sections import LAWS
from brake_fenicsx.scene.surface import check_surface
from brake_fenicsx.scene.sweep import check_sweep
from brake_fenicsx.scene.tables import shown
from brake_fenicsx.scene.units import with_unit

if TYPE_CHECKING:
    from brake_fenicsx.scene.sections import Contact, Scene

# Stages that build on another one.
PREDECESSORS = (
    ("micro", "surface"),
    ("stability", "equilibrium"),
    ("uncertainty", "equilibrium"),
)

# Keys of [samples] that are about many of them.
MANY = ("n", "random", "design", "curves", "parametric", "joint", "limit")

# Beyond 1/sqrt(2) the squares of damped frequencies are no longer positive.
ZETA_LIMIT = 0.7

# Least and largest tolerance of Newton's iterations [-].
NEWTON = (1e-13, 1e-3)

MOST_PIXELS = 2048  # along a side of a patch


def check_consistent(s: Scene) -> None:
    """Refuse scenes whose sections contradict each other.

    Raises:
        SceneError: the key, its value and the remedy.
    """
    _check_stages(s)
    check_surface(s)
    _check_mesh(s.mesh)
    _check_parts(s)
    for name, contact in s.contact.items():
        _check_contact(s, f"contact.{name}", contact)
    _check_zones(s)
    _check_ties(s)
    _check_springs(s)
    _check_loads(s)
    _check_motion(s)
    check_damping(s)
    for name in s.samples.random:
        check_scalar(s, f'samples.random."{name}"', name)
    for name in s.sweep.parameters if s.sweep else ():
        check_scalar(s, f'sweep.parameters."{name}"', name)
    check_sweep(s)
    _check_approaches(s)


def _check_stages(s: Scene) -> None:
    """Every stage has its section and the stages it builds on."""
    sections = {"surface": "surface", "micro": "micro", "equilibrium": "contact"}
    sections["stability"] = "stability"
    for stage, section in sections.items():
        if stage in s.stages and not getattr(s, section):
            raise SceneError(f"stages: {stage!r} needs a section [{section}]")
    for stage, before in PREDECESSORS:
        if stage in s.stages and before not in s.stages:
            raise SceneError(f"stages: {stage!r} needs {before!r}")
    if s.micro and s.micro.patch == "mesh" and "equilibrium" not in s.stages:
        raise SceneError('micro.patch = "mesh": needs the stage equilibrium; write a length')
    if s.micro and s.micro.pixels != "scan" and not 2 <= s.micro.pixels <= MOST_PIXELS:
        raise SceneError(f"micro.pixels = {s.micro.pixels}: write 2 to {MOST_PIXELS}")
    if s.micro and not abs(s.micro.nu) < 1:
        raise SceneError(
            f"micro.nu = {s.micro.nu:g}: must lie between -1 and 1, E* = E / (1 - nu^2)"
        )
    if s.micro and s.micro.hardness and s.micro.max_pressure:
        highest = s.micro.max_pressure * s.micro.E / (1.0 - s.micro.nu**2)
        if highest >= s.micro.hardness:
            raise SceneError(
                f"micro.max_pressure = {s.micro.max_pressure:g} E*, {highest / 1e6:.4g} MPa: must"
                f" lie below micro.hardness = {s.micro.hardness / 1e6:.4g} MPa; leave it out"
            )
    if s.micro and s.micro.hardness and not s.micro.max_pressure:
        # The ends of a law of ``micro.law_of_surface``.
        first, last = 1e-6 * s.micro.E / (1.0 - s.micro.nu**2), 0.1 * s.micro.hardness
        if last <= first:
            raise SceneError(
                f"micro.hardness = {s.micro.hardness:g} Pa: laws end at a tenth of it,"
                f" {last:.3g} Pa, and begin at 1e-6 E*, {first:.3g} Pa; correct the unit, the"
                ' hardness of linings is "50 MPa" to "400 MPa"'
            )
    low, high = NEWTON
    if not low <= s.equilibrium.tolerance <= high:
        raise SceneError(
            f"equilibrium.tolerance = {s.equilibrium.tolerance:g}: must lie between {low:g}, where"
            f" round-off begins, and {high:g}"
        )
    if s.stability and (len(s.stability.band) != 2 or s.stability.band[0] >= s.stability.band[1]):
        raise SceneError(f"stability.band = {list(s.stability.band)!r} Hz: write [lowest, highest]")
    if s.stability and s.stability.method == "reduced":
        cutoff, top = s.stability.cutoff, s.stability.band[1]
        if cutoff is not None and cutoff <= top:
            raise SceneError(
                f"stability.cutoff = {cutoff:g} Hz: must lie above the band's {top:g} Hz; raise it,"
                " or leave it out"
            )
    if s.stability and s.stability.threshold >= 1.0:
        raise SceneError(
            f"stability.threshold = {s.stability.threshold:g}: no mode has so large a damping;"
            " write a fraction, such as 0.01"
        )
    if not s.samples.limit < 1.0:
        raise SceneError(
            f"samples.limit = {s.samples.limit:g}: a share of the samples; write a fraction below 1"
        )
    if s.stability and not s.stability.zeta_max < ZETA_LIMIT:
        raise SceneError(
            f"stability.zeta_max = {s.stability.zeta_max:g}: must lie below {ZETA_LIMIT:g}"
        )


def _check_mesh(mesh: MeshTable) -> None:
    """What is said of a mesh file needs one."""
    if mesh.degree == 1 and mesh.order == 2:
        raise SceneError("mesh.order = 2: needs mesh.degree = 2, displacements of second order")
    if mesh.degree == 2 and mesh.mass == "lumped":
        raise SceneError(
            'mesh.mass = "lumped": corners of quadratic elements would have no or negative mass;'
            " write mesh.degree = 1 as well"
        )
    for name in ("unit", "groups", "split") if mesh.file is None else ():
        if getattr(mesh, name):
            raise SceneError(f"mesh.{name}: needs mesh.file, the file that it is about")
    if len(mesh.extent) != 2 or not mesh.extent[0] < mesh.extent[1]:
        raise SceneError(f"mesh.extent = {list(mesh.extent)!r} m: write [smallest, largest]")


def _check_parts(s: Scene) -> None:
    """Every part has cells, and its material is there."""
    for name, part in s.parts.items():
        if part.matrices is not None:
            continue
        if part.builder is None and s.mesh.file is None:
            raise SceneError(
                f"parts.{name}.builder: missing; use one of {', '.join(BUILDERS)}, or name a"
                " mesh.file"
            )
        if part.parameters is not None:
            _check_extent(f"parts.{name}", part_lengths(part.parameters), s.mesh.extent)
        used = [part.material] if isinstance(part.material, str) else part.material.values()
        for material in used:
            if material not in s.materials:
                raise SceneError(
                    f"parts.{name}.material = {material!r}: there is no [materials.{material}]"
                )


def _check_extent(where: str, lengths: dict[str, float], extent: tuple[float, ...]) -> None:
    """A part is neither longer nor shorter than a mesh file may be."""
    longest = max(lengths, key=lengths.__getitem__)
    if not extent[0] <= lengths[longest] <= extent[1]:
        raise SceneError(
            f"{where}.{longest} = {lengths[longest]:.3g} m: the longest length of the part, not"
            f" between {extent[0]:g} m and {extent[1]:g} m; correct the unit, or widen mesh.extent"
        )


def _check_contact(s: Scene, where: str, contact: Contact) -> None:
    """Two faces, and a law and gaps that some stage provides."""
    if len(contact.faces) != 2:
        raise SceneError(
            f"{where}.faces = {list(contact.faces)!r}: write two faces, the pad's first"
        )
    if isinstance(contact.law, str):
        if "micro" not in s.stages and {"multi-scale", "joint"} & {*s.samples.approaches}:
            raise SceneError(f'{where}.law = "library": needs the stages surface and micro')
    elif (
        contact.law.linear is None
        and not contact.law.steps
        and (contact.law.p0 is None or contact.law.u0 is None)
    ):
        raise SceneError(f"{where}.law: write {LAWS}")
    elif contact.law.linear is not None and {contact.law.p0, contact.law.u0} != {None}:
        raise SceneError(f"{where}.law: write linear, or p0 and u0; not both")
    k_t = contact.tangential_stiffness
    if contact.slip == "stuck" and k_t is None:
        raise SceneError(
            f'{where}.slip = "stuck": needs tangential_stiffness, that of the faces along each'
            ' other, such as tangential_stiffness = "1e13 Pa/m"'
        )
    if contact.slip == "motion" and k_t is not None:
        raise SceneError(
            f"{where}.tangential_stiffness = {k_t:g} Pa/m: acts where faces stick; write"
            ' slip = "stuck" as well, or leave it out'
        )
    if contact.gap != "none" and "surface" not in s.stages:
        raise SceneError(f'{where}.gap = "{contact.gap}": needs the stage surface')
    if contact.gap == "waviness" and s.micro is None:
        raise SceneError(
            f'{where}.gap = "waviness": needs micro.patch, the length from which waves are longer'
        )


def _check_zones(s: Scene) -> None:
    """Ranges of two numbers; interfaces on the same faces divide the same contact elements."""
    for name, contact in s.contact.items():
        if contact.zone is None:
            continue
        where = f"contact.{name}.zone"
        named = {f.name: getattr(contact.zone, f.name) for f in fields(contact.zone)}
        if not any(ends is not None for ends in named.values()):
            known = ", ".join(named)
            raise SceneError(f"{where}: no range; write some of {known}, or leave it out")
        for key, ends in named.items():
            if ends is not None and not (len(ends) == 2 and ends[0] < ends[1]):
                unit, example = ("rad", "deg") if key == "angle" else ("m", "mm")
                raise SceneError(
                    f"{where}.{key} = {[*with_unit(ends, unit)]}: write [lowest, highest], such as"
                    f' ["10 {example}", "20 {example}"]'
                )
        turn = contact.zone.angle
        if turn is not None and turn[1] - turn[0] > 2 * math.pi * (1 + 1e-12):
            raise SceneError(
                f"{where}.angle = {[*with_unit(turn, 'rad')]}: more than a whole turn; leave it"
                " out for all angles"
            )
    for one, two in combinations(s.contact, 2):
        first, second = s.contact[one], s.contact[two]
        if {*first.faces} != {*second.faces}:
            continue
        for key in ("faces", "discretisation"):
            values = getattr(first, key), getattr(second, key)
            if values[0] != values[1]:
                raise SceneError(
                    f"contact.{two}.{key} = {shown(values[1])}: contact.{one} is on the same faces"
                    f" with {shown(values[0])}; write the same, for the two divide its elements"
                )


def _check_approaches(s: Scene) -> None:
    """Approaches that live from random inputs have some; no material is named in two ways."""
    if not s.samples.approaches:
        raise SceneError(f"samples.approaches = []: name some of {', '.join(APPROACHES)}")
    for name in ("parametric", "joint"):
        if name in s.samples.approaches and not s.samples.random:
            raise SceneError(
                f"samples.approaches: {name!r} needs random inputs; write them in [samples.random]"
            )
        if name in s.samples.approaches and "uncertainty" not in s.stages:
            raise SceneError(f"samples.approaches: {name!r} needs the stage uncertainty")
    for name in MANY if "equilibrium" in s.stages and "uncertainty" not in s.stages else ():
        if s.table.get("samples", {}).get(name, 1) not in (1, {}):
            raise SceneError(
                f"samples.{name}: without the stage uncertainty there is one sample; add it to"
                f" stages, or leave samples.{name} out"
            )
    ways: dict[str, set[bool]] = {}
    for section, table, last in map(split_key, s.varied):
        if section == "materials" and last != "loss":
            ways.setdefault(table, set()).add(last[0] == "C")
    for table, found in ways.items():
        if len(found) > 1:
            raise SceneError(
                f"samples.random, sweep.parameters: materials.{table} by stiffnesses and by"
                " engineering constants; use one kind"
            )


def _check_ties(s: Scene) -> None:
    """Two faces, and none that is in contact as well."""
    touching = {face: name for name, contact in s.contact.items() for face in contact.faces}
    for name, tie in s.ties.items():
        if len({*tie.faces}) != 2 or len(tie.faces) != 2:
            raise SceneError(f"ties.{name}.faces = {list(tie.faces)!r}: write two faces")
        for face in tie.faces:
            if face in touching:
                raise SceneError(
                    f"ties.{name}.faces: {face!r} is in contact.{touching[face]} as well, whose"
                    " faces the tie would glue; leave one out, or divide the face"
                )


def _check_springs(s: Scene) -> None:
    """Three values of each kind; and no mass that the gyroscopic term would leave out."""
    for name, spring in s.springs.items():
        where = f'springs."{name}"'
        kinds = {
            "stiffness": ("N/m", "20 kN/mm"),
            "stiffness_per_area": ("Pa/m", "1e9 Pa/m"),
            "damping": ("N s/m", "50 N s/m"),
        }
        given = {kind: v for kind in kinds if (v := getattr(spring, kind)) is not None}
        for kind, values in given.items():
            if len(values) != 3 or not any(values):
                unit, example = kinds[kind]
                raise SceneError(
                    f"{where}.{kind} = {list(values)} {unit}: write three, along the part's axes 1"
                    f' and 2 and along z, such as [0, 0, "{example}"]'
                )
        if not given:
            raise SceneError(f"{where}: neither stiffness nor damping; write {', '.join(kinds)}")
        if spring.faces is None:
            continue
        if len({*spring.faces}) != 2 or len(spring.faces) != 2:
            raise SceneError(f"{where}.faces = {list(spring.faces)!r}: write two faces")
        if spring.stiffness_per_area is not None:
            raise SceneError(
                f"{where}.stiffness_per_area: is for a face and the ground; write the total of the"
                " two faces as stiffness, or a tie with its stiffness"
            )
    for face, added in s.masses.items():
        if added.inertia is not None and (len(added.inertia) != 3 or not any(added.inertia)):
            raise SceneError(
                f'masses."{face}".inertia = {list(added.inertia)} kg m^2: write three, about the'
                ' part\'s axes 1 and 2 and about z, such as ["2 kg mm^2", "2 kg mm^2", 0]'
            )
    damping = s.stability.damping if s.stability else None
    if s.masses and damping and damping.gyroscopic:
        raise SceneError(
            f"masses: {', '.join(s.masses)}: stability.damping.gyroscopic knows the density of the"
            " bodies alone; leave the masses or gyroscopic out"
        )


def _check_loads(s: Scene) -> None:
    """A pressure, a force and a moment of three values each, or a displacement of a support."""
    for face, load in s.loads.items():
        where = f'loads."{face}"'
        three = {"force": load.force, "moment": load.moment}
        given = {name: values for name, values in three.items() if values is not None}
        if (load.pressure is not None) + bool(given) + (load.displacement is not None) != 1:
            raise SceneError(
                f"{where}: write a pressure, or a force and a moment, or a displacement"
            )
        if load.displacement is not None:
            _check_displacement(s, face, load.displacement)
        for name, values in given.items():
            if len(values) != 3 or not any(values):
                raise SceneError(
                    f"{where}.{name} = {list(values)}: write three, along the part's axes 1 and 2"
                    ' and along z, such as [0, 0, "-5 kN"]'
                )
        part = s.parts.get(face.partition(".")[0])
        if given and getattr(getattr(part, "parameters", None), "side", None) == "both":
            raise SceneError(
                f"{where}: the face lies on both sides of the disc; write a pressure, or side ="
                ' "top" and a second part with side = "bottom"'
            )


def _check_displacement(s: Scene, face: str, moved: dict[str, float]) -> None:
    """Directions that the face's support holds, of a part whose stiffness is that of the scene."""
    where, held = f'loads."{face}".displacement', s.supports.get(face, ())
    free = [c for c in moved if c not in held]
    if unknown := [c for c in moved if c not in ("x", "y", "z")]:
        raise SceneError(f"{where}: {unknown[0]!r}: unknown direction; write x, y or z")
    if not moved or free:
        raise SceneError(
            f"{where} = {moved!r}: moves directions that a support holds; write"
            f' supports."{face}" = ["x", "y", "z"], or those of them that are meant'
        )
    part = s.parts.get(face.partition(".")[0])
    if part is None or part.matrices is not None:
        raise SceneError(f"{where}: moves a face of a mesh; write a force on the set of nodes")
    used = [part.material] if isinstance(part.material, str) else [*part.material.values()]
    changed = [name for name in s.varied if name.split(".")[:2][-1] in used]
    if changed:
        raise SceneError(
            f"{where}: the force of the displacement would change with {changed[0]}; leave that"
            " out, or write a force"
        )


def _check_motion(s: Scene) -> None:
    """Friction has a direction, and the speed the right unit."""
    sliding = any(rubs(s, approach) for approach in s.samples.approaches)
    if "equilibrium" in s.stages and sliding and s.motion is None:
        raise SceneError("motion: friction needs a section [motion]")
    if s.motion:
        for name in ("axis", "point"):
            value = getattr(s.motion, name)
            if value is not None and s.motion.direction is not None:
                raise SceneError(
                    f"motion.{name} = {shown(value)}: a disc turns about an axis or slides along a"
                    f" direction; leave motion.{name} or motion.direction out"
                )
        for name in ("axis", "direction", "point"):
            value = getattr(s.motion, name)
            zero = isinstance(value, tuple) and not any(value) and name != "point"
            if isinstance(value, tuple) and (len(value) != 3 or zero):
                more = "" if name == "point" else ", not all zero"
                raise SceneError(f"motion.{name} = {list(value)!r}: write three numbers{more}")
        try:
            _ = s.motion.rate
        except ValueError as error:
            raise SceneError(f"motion.speed = {s.motion.speed!r}: {error}") from None
