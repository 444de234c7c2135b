"""Knobs of a scene: settings of the computation that a user cannot measure, and their variants.

A resolution has two refinements of one ratio, so that an order of convergence can be observed; a
choice has other readings of the same physics. A knob that a scene does not use says why.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from brake_fenicsx.checks import MIN_PIXELS
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.contact_section import MAX_PIXELS
from brake_fenicsx.scene.keys import dotted
from brake_fenicsx.scene.stability_section import NEWTON

RESOLUTION, CHOICE = "resolution", "choice"
MESH, FINER, PIXELS = 1.25, 2.0, 2.0**0.5
# Knobs whose variants draw other samples than the scene.
INDEPENDENT = ("pixels", "laws", "heights", "face-mesh")
# Knobs of the laws: what they are, and the ratio of two refinements.
LAWS = {
    "pixels": ("the resolution of the laws", PIXELS),
    "laws": ("the number of laws", FINER),
    "steps": ("the load steps of a law", FINER),
    "contact-tolerance": ("the tolerance of a contact solution", 1.0),
    "hardness": ("the hardness of the lining", 1.0),
    "boundary": ("the boundary of a patch", 1.0),
}
# Readings of the surface: name, what it is, key, values.
SURFACE = (
    ("long-waves", "the spectrum below the scan's lowest wave number", "low", ("flat", "extend")),
    ("variance", "the variance of the artificial surfaces", "S_q", ("spectrum", "scan")),
    ("heights", "the shape of the height distribution", "distribution", ("johnson", "normal")),
    ("spectrum", "the spectrum of the artificial surfaces", "spectrum", ("fit", "measured")),
    ("level", "what is subtracted from the scan", "level", ("plane", "second-order")),
)


@dataclass(frozen=True, slots=True)
class Variant:
    """The scene with one knob turned.

    Attributes:
        overrides: "key=value" replacements in the scene.
        says: what is changed, for a person.
        dofs: number of free dofs relative to the scene's, estimated.
        elements: number of contact elements, likewise.
    """

    overrides: tuple[str, ...]
    says: str
    dofs: float = 1.0
    elements: float = 1.0


@dataclass(frozen=True, slots=True)
class Knob:
    """One setting of the computation.

    Attributes:
        name: short name, as in names of folders.
        says: what it is, in plain words.
        variants: the runs; the n-th one of a resolution is ``ratio**n`` times finer.
        ratio: of two refinements [-]; 1 for a choice.
        reason: why there are no variants.
        perfect: whether it concerns the classical approach alone.
    """

    name: str
    says: str
    variants: Sequence[Variant] = ()
    ratio: float = 1.0
    reason: str = ""
    perfect: bool = False

    @property
    def kind(self) -> str:
        """RESOLUTION or CHOICE."""
        return RESOLUTION if self.ratio > 1.0 else CHOICE

    @property
    def paired(self) -> bool:
        """Whether samples are the scene's, where laws keep their number of points."""
        return self.name not in INDEPENDENT


def knobs(scene: Scene, pixels: int | None) -> list[Knob]:
    """All knobs, those that the scene does not use too.

    Args:
        scene: the scene.
        pixels: points along a side of its laws' patches; None where it has no laws.
    """
    every = _laws(scene, pixels), _surface(scene), [_gaps(scene)], _meshes(scene), _solution(scene)
    return list(chain(*every))


def _laws(scene: Scene, pixels: int | None) -> list[Knob]:
    """Resolution and physics of the pressure-gap laws."""
    micro = scene.micro if "micro" in scene.stages else None
    if micro is None or pixels is None:
        none = "the scene has no laws of a rough surface"
        return [Knob(name, says, (), ratio, none) for name, (says, ratio) in LAWS.items()]
    fine = (n for n in (round(pixels * PIXELS), 2 * pixels) if MIN_PIXELS <= n <= MAX_PIXELS)
    other = "periodic" if micro.boundary == "free" else "free"
    hard = micro.hardness or 0.0
    harder = ((2.0 * hard, "twice as hard"), (0.5 * hard, "half as hard")) if hard else ()
    variants = {
        "pixels": [_one("micro.pixels", n, f"{n} x {n} points") for n in fine],
        "laws": [_one("micro.laws", n * micro.laws, f"{n * micro.laws} laws") for n in (2, 4)],
        "steps": [_one("micro.steps", n * micro.steps, f"{n * micro.steps} steps") for n in (2, 4)],
        "contact-tolerance": [_one("micro.tolerance", micro.tolerance / 100, "a hundredth")],
        "hardness": [_one("micro.hardness", f"{x / 1e6!r} MPa", says) for x, says in harder],
        "boundary": [_one("micro.boundary", other, other)],
    }
    why = {
        "pixels": f"finer laws would have more than {MAX_PIXELS} points along a side",
        "hardness": "the scene is elastic, and no hardness can be guessed: name micro.hardness",
    }
    return [
        Knob(name, says, made, ratio, "" if made else why[name])
        for (name, (says, ratio)), made in zip(LAWS.items(), variants.values(), strict=True)
    ]


def _surface(scene: Scene) -> Iterator[Knob]:
    """Readings of the surface."""
    surface = scene.surface if "surface" in scene.stages else None
    gaps = {c.gap for c in scene.contact.values()}
    rough = surface is not None and ("micro" in scene.stages or gaps != {"none"})
    measured = surface is not None and bool(surface.scan)
    for name, says, key, values in SURFACE:
        now = getattr(surface, key, None)
        if key == "distribution" and now is None and not measured:
            now = "johnson"
        why = ""
        if not rough:
            why = "the scene has no rough surface"
        elif key in ("level", "spectrum") and not measured:
            why = "the scene has no scan"
        elif key == "S_q" and "waviness" in gaps:
            why = "critical gaps of waviness share the variance of the spectrum"
        other = next(v for v in values if v != now)
        yield Knob(name, says, () if why else [_one(f"surface.{key}", other, other)], reason=why)


def _gaps(scene: Scene) -> Knob:
    """What the critical gaps do."""
    wavy = [dotted("contact", name, "gap") for name, c in scene.contact.items() if c.gap != "none"]
    off = Variant(tuple(f'{key}="none"' for key in wavy), "none")
    why = "" if wavy else "no interface has critical gaps"
    return Knob("gap", "the critical gaps", [off] if wavy else (), reason=why)


def _meshes(scene: Scene) -> Iterator[Knob]:
    """Mesh of the contact faces and of the bodies; only what a builder makes can be refined."""
    pads = {table.faces[0].split(".")[0] for table in scene.contact.values()}
    face: dict[str, float] = {}
    body: dict[str, float] = {}
    for name, part in scene.parts.items():
        for key in ("size", "plate_size"):
            size = getattr(part.parameters, key, None)
            if size is not None:
                sizes = face if name in pads and key == "size" else body
                sizes[dotted("parts", name, key)] = size
    # Powers of the refinement that dofs and contact elements grow with.
    for name, says, sizes, dofs, elements in (
        ("face-mesh", "the mesh of the contact face and its patches", face, 0.5, 2.0),
        ("body-mesh", "the mesh of the bodies", body, 2.0, 0.0),
    ):
        finer = [
            Variant(
                tuple(f'{k}="{1e3 * size / n:.6g} mm"' for k, size in sizes.items()),
                f"cells {n:.4g} times smaller", n**dofs, n**elements,
            ) for n in (MESH, MESH**2) if sizes
        ]  # fmt: skip
        yield Knob(name, says, finer, MESH, "" if sizes else "no such mesh is made by a builder")


def _solution(scene: Scene) -> Iterator[Knob]:
    """Accuracy of equilibrium and modes, and perfect contact."""
    table, stability = scene.samples, scene.stability
    fine: list[Variant] = []
    wide: list[Variant] = []
    if stability is not None and stability.method == "reduced":
        fine = [_one("stability.tolerance", stability.tolerance / 100, "a hundredth")]
        top = 1.4 * (stability.cutoff or 1.8 * stability.band[1])
        wide = [_one("stability.cutoff", f"{top:.8g} Hz", "1.4 times as high")]
    full = "" if fine else "every sample is solved at full order"
    yield Knob("reduction", "the tolerance of the reduced model", fine, reason=full)
    yield Knob("cutoff", "the real modes kept of the bodies", wide, reason=full)
    # Two rough samples beside it, so that its modes come from the reduced model of the scene.
    rough = [name for name in ("multi-scale", "classical") if name in table.approaches]
    lean = (f"samples.approaches={json.dumps(rough)}", "samples.n=2", 'samples.design="random"')
    stiff, classical = table.classical.penalty, "classical" in table.approaches
    penalty = [
        Variant((f'samples.classical.penalty="{factor * stiff!r} Pa/m"', *lean), text)
        for factor, text in ((10.0, "ten times as stiff"), (0.1, "a tenth as stiff"))
        if classical
    ]
    why = "" if classical else "the scene has no approach 'classical'"
    yield Knob("penalty", "the penalty of perfect contact", penalty, reason=why, perfect=True)
    strict = scene.equilibrium.tolerance / 100
    newton = [_one("equilibrium.tolerance", strict, "a hundredth")] if strict >= NEWTON[0] else []
    why = "" if newton else "a hundredth is less than round-off"
    yield Knob("newton", "the tolerance of Newton's iterations", newton, reason=why)


def _one(key: str, value: float | str, says: str) -> Variant:
    return Variant((f"{key}={json.dumps(value)}",), says)
